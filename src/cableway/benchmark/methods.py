"""Methods: what plans and what controls. Ours, the paper's, its baselines; others come as plug-ins."""

from __future__ import annotations

import hashlib
import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol

from cableway.control.base import Controller
from cableway.core.errors import InputError, PlanningError, UnknownNameError
from cableway.core.provenance import PACKAGE, versions
from cableway.records import Plan
from cableway.scene.task import Task
from cableway.workflow.registry import make_controller, make_planner

GROUP = "cableway.methods"
"""Group of the entry points with which a package offers methods: each names a `Method`."""

DEFAULT = "cableway"
"""The method that is run unless others are asked for."""

TIME_LIMIT = 30.0
"""Time [s] that our planners search."""


class Planner(Protocol):
    """What finds a plan."""

    def __call__(self, task: Task, seed: int) -> Plan:
        """The plan.

        Raises:
            PlanningError: There is none.
        """
        ...


def default_planner(task: Task, seed: int) -> Plan:
    """Our planner, its plan rehearsed where the cable asks for it."""
    from cableway.workflow.rehearsal import rehearsed_plan

    find = planner_of("default")
    return rehearsed_plan(task, lambda seed: find(task, seed), seed=seed)


@dataclass(frozen=True, kw_only=True)
class Method:
    """A method.

    Attributes:
        name: In tables and files.
        description: One sentence.
        controller: Makes what leads the grippers; called once in every process.
        planner: Makes the plan.
        recovers: Whether a cable that left its plan is stopped and led on by a new one.
    """

    name: str
    description: str
    controller: Callable[[], Controller[Any]]
    planner: Planner = default_planner
    recovers: bool = True

    def __post_init__(self) -> None:
        if not self.name or not all(letter.isalnum() or letter in "-_." for letter in self.name):
            raise InputError(f"a method's name must be of letters, digits, '-', '_' and '.', got {self.name!r}")


def load_method(source: str) -> Method:
    """The method of a name, of an installed plug-in, or of a file.

    Args:
        source: One of `method_names()`, or FILE.py:NAME, which runs the file and takes what it calls NAME.

    Raises:
        UnknownNameError: No such method; the message lists them.
        InputError: The file or the plug-in cannot be loaded, or what it names is no method.
    """
    file, _, name = source.rpartition(":")
    if file:
        return _require_method(_from_file(Path(file), name), source)
    if source in BUILT_IN:
        return BUILT_IN[source]
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
    file = source.rpartition(":")[0]
    makers = [f"{PACKAGE} {versions()[PACKAGE]}"]
    if file:
        makers.append(f"{Path(file).name} {hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16]}")
    elif source not in BUILT_IN:
        points = metadata.entry_points(group=GROUP, name=source)
        makers += [f"{point.dist.name} {point.dist.version}" for point in points if point.dist is not None]
    return ", ".join(makers)


def method_names() -> tuple[str, ...]:
    """Names of the methods that come with cableway and of those that are installed."""
    others = (point.name for point in metadata.entry_points(group=GROUP))
    return tuple(dict.fromkeys([*BUILT_IN, *others]))


def _from_file(file: Path, name: str) -> Any:
    if not file.is_file():
        raise InputError(f"{file}: no such file")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise InputError(f"{file}: a method's file must end in .py")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"{file}: cannot be run: {type(error).__name__}: {error}") from None
    if not hasattr(module, name):
        raise InputError(f"{file}: has no {name!r}")
    return getattr(module, name)


def _require_method(value: Any, source: str) -> Method:
    if not isinstance(value, Method):
        raise InputError(f"{source}: must be a cableway.benchmark.methods.Method, got {type(value).__name__}")
    return value


# ------------------------------------------------------------------------------------------------ ours
def planner_of(name: str, unverified: bool = False) -> Planner:
    """A planner of the registry; with `unverified`, its closest attempt where there is no verified plan.

    Its time limit does not count the compilation of the kernels.
    """

    def find(task: Task, seed: int) -> Plan:
        from cableway.planning.compilation import compile_kernels

        compile_kernels()
        deadline, planner = time.monotonic() + TIME_LIMIT, make_planner(name)
        try:
            return planner.find(task, seed=seed, config=planner.config, expired=lambda: time.monotonic() > deadline)
        except PlanningError as error:
            if unverified and error.attempt is not None and error.attempt.poses is not None:
                return _as_plan(error.attempt)
            raise

    return find


def _as_plan(attempt: Any) -> Plan:
    return Plan(attempt.shapes, attempt.poses, stages=attempt.stages, metadata={"unverified": attempt.reason})


def controller_of(name: str, model: str | None = None) -> Callable[[], Controller[Any]]:
    """Makes a controller of the registry, with a deformation model in place of its own where one is given."""
    return lambda: make_controller(name, model)


def _all() -> tuple[Method, ...]:
    ours, paper = "our plan", "the paper's plan, followed though it does not verify"
    simpler = {
        "straight": "each keypoint straight to its goal",
        "slide": "the cable slid along one curve",
        "rrt-connect": "RRT-Connect among equilibria, not refined",
        "paper-refined": "the paper's chain with our realisation",
    }
    rod_mpc = controller_of("rod-mpc")
    return (
        Method(name=DEFAULT, description=f"{ours}, adaptive rod MPC", controller=rod_mpc),
        Method(name="unrehearsed", description=f"{ours}, not rehearsed; adaptive rod MPC", controller=rod_mpc,
               planner=planner_of("default")),
        Method(name="rod-jacobian", description=f"{ours}, feedback by the rod's derivative",
               controller=controller_of("rod-jacobian")),
        Method(name="broyden", description=f"{ours}, feedback by a learned derivative (the paper's Jacob-IK)",
               controller=controller_of("broyden")),
        Method(name="open-loop", description=f"{ours}, followed blindly", controller=controller_of("open-loop"),
               recovers=False),
        Method(name="tdm-mpc", description=f"{ours}, our neural MPC with the Transformer",
               controller=controller_of("neural-mpc", "transformer")),
        Method(name="cdm-mpc", description=f"{ours}, our neural MPC with the convolutional model",
               controller=controller_of("neural-mpc", "conv")),
        Method(name="bdm-mpc", description=f"{ours}, our neural MPC with the bidirectional LSTM",
               controller=controller_of("neural-mpc", "bilstm")),
        Method(name="paper-tracking", description=f"{ours}, neural MPC as in the paper",
               controller=controller_of("neural-mpc-paper", "transformer")),
        Method(name="paper", description=f"{paper}; neural MPC as in the paper",
               controller=controller_of("neural-mpc-paper", "transformer"),
               planner=planner_of("paper", unverified=True), recovers=False),
        *(Method(name=f"{name}-plan", description=f"{text}; adaptive rod MPC", controller=rod_mpc,
                 planner=planner_of(name)) for name, text in simpler.items()),
        Method(name="paper-plan", description=f"{paper}; adaptive rod MPC", controller=rod_mpc,
               planner=planner_of("paper", unverified=True)),
    )  # fmt: skip


BUILT_IN = {method.name: method for method in _all()}
"""The methods that come with cableway."""
