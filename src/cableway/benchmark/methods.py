"""Methods: a planner, a controller and its model. Ours, the paper's, its baselines; others come as plug-ins."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from typing import Any

from cableway.control.base import Controller
from cableway.core.checks import require_call
from cableway.core.deprecation import renamed_value
from cableway.core.errors import InputError, UnknownNameError
from cableway.core.plugins import is_plugin, load_plugin, require_name
from cableway.core.provenance import PACKAGE, versions
from cableway.perception.markers import Tracker
from cableway.planning.named import PLANNERS
from cableway.records import Plan
from cableway.scene.task import Task
from cableway.workflow.registry import DEFAULT_CONTROLLER, DEFAULT_PLANNER, make_controller
from cableway.workflow.run import SolveOptions

GROUP = "cableway.methods"
"""Group of the entry points with which a package offers methods: each names a `Method`."""

RENAMED = {
    "paper": "tang2025",
    "paper-tracking": "tang2025-tracking",
    "paper-plan": "tang2025-plan",
    "paper-refined-plan": "tang2025-refined-plan",
}
"""New name of each old one."""

DEFAULT = "cableway"
"""The method that is run unless others are asked for."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """A method.

    Attributes:
        name: In tables and files.
        description: One sentence.
        controller: A name of `registry.CONTROLLERS`, or a function that makes a controller; called once in every
            process.
        planner: A name of `planning.named.PLANNERS`, or a `function(task, seed)` that returns a plan or raises
            `PlanningError`.
        model: Name or file of the deformation model, for a controller named that has one.
        rehearses: Whether plans are rehearsed where the cable asks for it; those of a function never are.
        recovers: Whether a cable that left its plan is stopped and replanned for.
        follows_unverified: Whether the closest attempt is followed where no plan verifies.
        tracker: What finds the cable in pictures, in suites with cameras; None where true keypoints are given instead.
    """

    name: str
    description: str
    controller: str | Callable[[], Controller[Any]] = DEFAULT_CONTROLLER
    planner: str | Callable[[Task, int], Plan] = DEFAULT_PLANNER
    model: str | None = None
    rehearses: bool = True
    recovers: bool = True
    follows_unverified: bool = False
    tracker: Tracker | None = "rod"

    def __post_init__(self) -> None:
        if not self.name or not all(letter.isalnum() or letter in "-_." for letter in self.name):
            raise InputError(f"a method's name may contain only letters, digits, '-', '_' and '.', got {self.name!r}")

        if not isinstance(self.controller, str):
            require_call(self.controller, f"the controller of the method {self.name!r}", 0)
        if not isinstance(self.planner, str):
            require_call(self.planner, f"the planner of the method {self.name!r}", 2)

    def make_controller(self) -> Controller[Any]:
        """The controller.

        Raises:
            UnknownNameError: There is none of that name, or no such model; the message lists them.
        """
        return make_controller(self.controller, self.model) if isinstance(self.controller, str) else self.controller()

    def options(self, **options: Any) -> SolveOptions:
        """Options with which `solve` runs the method, and those given."""
        return SolveOptions(
            planner=self.planner,
            rehearse=self.rehearses and isinstance(self.planner, str),
            recover=self.recovers,
            follow_unverified=self.follows_unverified,
            **options,
        )


def load_method(source: str) -> Method:
    """The method of a name, of an installed plug-in, or of a file.

    Args:
        source: One of `method_names()`, or FILE.py:NAME or package.module:NAME, see `core.plugins.load_plugin`.

    Raises:
        UnknownNameError: No such method; the message lists them.
        InputError: The file or the plug-in cannot be loaded, has no such name, or what it names is no method.
    """
    require_name(source)
    if is_plugin(source):
        return _require_method(load_plugin(source, Method)[0], source)
    if (name := renamed_value("method", source, RENAMED)) in BUILT_IN:
        return BUILT_IN[name]
    for point in metadata.entry_points(group=GROUP):
        if point.name == source:
            try:
                return _require_method(point.load(), source)
            except Exception as error:
                raise InputError(f"the method {source!r} of {point.value} cannot be loaded: {error}") from None
    raise UnknownNameError("method", source, method_names())


def made_by(source: str) -> str:
    """What a result of a method depends on beside its episode: versions, and for a file a digest of what stands in it.

    Args:
        source: The method, as for `load_method`.
    """
    makers = [f"{PACKAGE} {versions()[PACKAGE]}"]
    if is_plugin(source):
        file = load_plugin(source)[1]
        makers.append(f"{file.name} {hashlib.sha256(file.read_bytes()).hexdigest()[:16]}")
    elif RENAMED.get(source, source) not in BUILT_IN:
        points = metadata.entry_points(group=GROUP, name=source)
        makers += [f"{point.dist.name} {point.dist.version}" for point in points if point.dist is not None]
    return ", ".join(makers)


def method_names() -> tuple[str, ...]:
    """Names of the methods that come with cableway and of those that are installed."""
    others = (point.name for point in metadata.entry_points(group=GROUP))
    return tuple(dict.fromkeys([*BUILT_IN, *others]))


def _require_method(value: Any, source: str) -> Method:
    if not isinstance(value, Method):
        raise InputError(f"{source}: must be a cableway.benchmark.methods.Method, got {type(value).__name__}")
    return value


# ------------------------------------------------------------------------------------------------ ours
def _all() -> tuple[Method, ...]:
    ours, paper = "our plan", "the paper's plan, tracked although it does not verify"
    neural = {"tdm-mpc": ("the Transformer", "transformer"), "cdm-mpc": ("the convolutional model", "conv"),
              "bdm-mpc": ("the bidirectional LSTM", "bilstm")}  # fmt: skip
    return (
        Method(name=DEFAULT, description=f"{ours}, adaptive rod MPC"),
        Method(name="true-keypoints", description=f"{ours}, adaptive rod MPC; where there are cameras, true keypoints, "
               "without noise or latency", tracker=None),
        Method(name="markers", description=f"{ours}, adaptive rod MPC; where there are cameras, by markers",
               tracker="markers"),
        Method(name="unrehearsed", description=f"{ours}, not rehearsed; adaptive rod MPC", rehearses=False),
        Method(name="rod-jacobian", description=f"{ours}, feedback by the rod's derivative", controller="rod-jacobian"),
        Method(name="broyden", description=f"{ours}, feedback by a learned derivative (the paper's Jacob-IK)",
               controller="broyden"),
        Method(name="open-loop", description=f"{ours}, in open loop", controller="open-loop", recovers=False),
        *(Method(name=name, description=f"{ours}, our neural MPC with {what}", controller="neural-mpc", model=model)
          for name, (what, model) in neural.items()),
        Method(name="tang2025-tracking", description=f"{ours}; the paper's MPC and network", controller="tang2025"),
        Method(name="tang2025", description=f"{paper}; its MPC and network", controller="tang2025",
               planner="tang2025", rehearses=False, recovers=False, follows_unverified=True),
        *(Method(name=f"{name}-plan", description=f"{PLANNERS[name].description}; adaptive rod MPC", planner=name,
                 rehearses=False) for name in ("straight", "slide", "rrt-connect", "tang2025-refined")),
        Method(name="tang2025-plan", description=f"{paper}; adaptive rod MPC", planner="tang2025", rehearses=False,
               follows_unverified=True),
    )  # fmt: skip


BUILT_IN = {method.name: method for method in _all()}
"""The methods that come with cableway."""
