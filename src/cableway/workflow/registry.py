"""The controllers by name, and what makes planners and controllers of their names.

An entry names its function as "module:function", which is imported when it is first asked for, so that a planner or a
controller may need packages that are not installed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from cableway.core.deprecation import renamed_value
from cableway.core.errors import InputError, UnknownNameError, raised, said
from cableway.core.extras import require
from cableway.core.plugins import is_plugin, load_plugin, require_name
from cableway.core.provenance import describe
from cableway.planning.named import PLANNERS

if TYPE_CHECKING:
    from cableway.control.base import Controller


@dataclass(frozen=True)
class Planner:
    """A planner with its settings.

    Attributes:
        config: Frozen record of the settings, for reports; `config.limits` is what a plan must keep.
        find: `find(task, config=config, seed=..., progress=..., expired=..., previous=...)` returns a `Plan` or raises
            `PlanningError`; as `cableway.planning.planner.plan`.
    """

    config: Any
    find: Callable[..., Any]

    @property
    def limits(self) -> Any:
        """What a plan must keep; None for the defaults."""
        return None if self.config is None else self.config.limits


@dataclass(frozen=True)
class ControllerEntry:
    """A controller's line in the registry.

    Attributes:
        description: What it does, in a few words.
        load: "module:function"; the function returns a `Controller`. It takes nothing; where there is a `model`, that
            model's name or file and whether the model is adapted while it runs.
        model: Name of the deformation model unless another is given; None for a controller without one.
        kernels: Whether it needs the kernels of tracking.
        compiled: "module:function" that says whether its other compiled code is in the user's cache; "" where it has
            none.
        follows_blindly: Whether it ignores the observations, so that a recovery would not help.
        cable: "module:function" that returns the cable that a model, by name or file, was trained on; "" where there is
            no model.
        extra: Of cableway that it needs, see `cableway.core.extras`; "" for none.
    """

    description: str
    load: str
    model: str | None = None
    kernels: bool = False
    compiled: str = ""
    follows_blindly: bool = False
    cable: str = ""
    extra: str = ""


_JAX = "cableway.tang2025.models.compilation:enable_compilation_cache"
_CABLE = "cableway.tang2025.models.checkpoint:cable_of"

CONTROLLERS = {
    "rod-mpc": ControllerEntry("adaptive MPC on the rod; ours", "cableway.control.rod_mpc:RodMPC", kernels=True),
    "neural-mpc": ControllerEntry(
        "our MPC on a learned model",
        "cableway.tang2025.control.named:neural_mpc",
        "conv",
        compiled=_JAX,
        cable=_CABLE,
        extra="tang2025",
    ),
    "tang2025": ControllerEntry(
        "the paper's MPC on the paper's network",
        "cableway.tang2025.control.named:tang2025",
        "tang2025-tdm",
        compiled=_JAX,
        cable=_CABLE,
        extra="tang2025",
    ),
    "rod-jacobian": ControllerEntry(
        "feedback by the rod's derivative", "cableway.control.jacobian:JacobianFeedback", kernels=True
    ),
    "broyden": ControllerEntry(
        "feedback by a learned derivative (the paper's Jacob-IK)", "cableway.control.jacobian:broyden", kernels=True
    ),
    "open-loop": ControllerEntry(
        "the plan's gripper motion, without feedback", "cableway.control.open_loop:OpenLoop", follows_blindly=True
    ),
}
"""Controllers by name; the first is the default."""

RENAMED = {"neural-mpc-paper": "tang2025"}
"""New name of each old one."""

DEFAULT_PLANNER, DEFAULT_CONTROLLER = next(iter(PLANNERS)), next(iter(CONTROLLERS))


def make_planner(name: str) -> Planner:
    """The planner of a name.

    Raises:
        UnknownNameError: There is none; the message lists them.
        MissingExtraError: It needs an extra that is not installed.
    """
    from cableway.planning.config import PlannerConfig
    from cableway.planning.planner import plan

    return Planner(PlannerConfig.named(name), plan)


def make_controller(name: str, model: str | None = None, adapt: bool = False) -> Controller[Any]:
    """The controller of a name.

    Args:
        name: One of `CONTROLLERS`, or the "package.module:NAME" of a class or a function that makes one of nothing.
        model: Name or file of the deformation model, in place of the controller's own.
        adapt: Whether the model is adapted to the cable while it runs.

    Raises:
        UnknownNameError: There is no such controller or model; the message lists them.
        InputError: A model is given for, or to be adapted by, a controller that has none, or what is named cannot be
            loaded or is no controller.
    """
    entry = controller_entry(name)
    if entry.model is not None:
        return resolve_name(entry.load)(model or entry.model, adapt)
    having = " and ".join(known for known, each in CONTROLLERS.items() if each.model is not None)
    if model is not None:
        raise InputError(f"--model applies to {having} only; {name} has no deformation model")
    if adapt:
        raise InputError(f"--adapt applies to {having} only; {name} has no learned model")
    return _own_controller(name) if is_plugin(name) else resolve_name(entry.load)()


def _own_controller(source: str) -> Controller[Any]:
    """A controller of a user's own."""
    from cableway.control.base import Controller
    from cableway.scene.task import CONTROL_STEP

    make, _ = load_plugin(source)
    try:
        made = make()
        configuration = describe(made.config) if isinstance(made, Controller) else None
    except raised() as error:
        raise InputError(f"{source}: no controller can be made: {said(error)}") from None
    if configuration is None or not isinstance(made, Controller):
        raise InputError(
            f"{source}: must make a cableway.control.base.Controller with a config, got {type(made).__name__}"
        )
    if made.control_step != CONTROL_STEP:
        raise InputError(f"{source}: its control_step must be {CONTROL_STEP} s, got {made.control_step!r}")
    return made


def require_extras(*names: str) -> None:
    """Make sure, without loading them, that planners and controllers have the packages they need.

    Raises:
        MissingExtraError: An extra that one of them needs is not installed.
    """
    for name in names:
        entry = PLANNERS.get(name) or CONTROLLERS.get(name)
        if entry is not None and entry.extra:
            require(entry.extra, name)


def controller_is_compiled(name: str) -> bool:
    """Whether the compiled code of a controller, but for kernels, is in the user's cache, or it has none.

    Raises:
        UnknownNameError: There is no such controller; the message lists them.
    """
    compiled = controller_entry(name).compiled
    return not compiled or resolve_name(compiled)()


def controller_entry(name: str) -> ControllerEntry:
    """The line of a controller; of one of a user's own, one without a model.

    Raises:
        UnknownNameError: There is none of that name; the message lists them.
    """
    require_name(name)
    if is_plugin(name):
        return ControllerEntry("a user's own", name)
    name = renamed_value("controller", name, RENAMED)
    if name not in CONTROLLERS:
        raise UnknownNameError("controller", name, CONTROLLERS)
    return CONTROLLERS[name]
