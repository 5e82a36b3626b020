"""Plan and control a cable held by two grippers among obstacles.

Names are imported when they are first used, so that importing the package costs nothing.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from cableway.core.deprecation import MODULES, keep_moved_modules, renamed

if TYPE_CHECKING:
    __version__: str
    from cableway.control.insertion import InsertionConfig, InsertionController
    from cableway.control.jacobian import JacobianConfig, JacobianFeedback
    from cableway.control.open_loop import OpenLoop
    from cableway.control.rod_mpc import RodMPC, RodMPCConfig
    from cableway.core.errors import (
        CablewayError,
        Cancelled,
        ControlError,
        FileFormatError,
        GraspError,
        InputError,
        MissingExtraError,
        PlanningError,
        PlanningInterrupted,
        PressedError,
        SimulationError,
        StorageError,
        TaskError,
        TrackingInterrupted,
        UnknownNameError,
    )
    from cableway.datasets.reading import load_transitions, shuffled_batches
    from cableway.datasets.transitions import Transitions
    from cableway.figures.draw import draw
    from cableway.outcome import Outcome
    from cableway.planning.config import PlannerConfig
    from cableway.planning.insertion import plan_insertion
    from cableway.planning.planner import plan
    from cableway.planning.routes.passages import find_passages
    from cableway.records import Plan, Rollout
    from cableway.report import Report, summarize
    from cableway.scene.cable import Cable
    from cableway.scene.files.loading import load_task, task_names
    from cableway.scene.files.saving import save_task
    from cableway.scene.obstacles import Box, Disc, Polygon
    from cableway.scene.scene import Scene
    from cableway.scene.task import Grippers, Task
    from cableway.simulation.perturbations.grasp import GraspConfig, GraspedCable
    from cableway.simulation.perturbations.perturbation import Perturbation
    from cableway.simulation.perturbations.sensing import SensedPlant, SensingConfig
    from cableway.simulation.plant import CableSimulator
    from cableway.tang2025.control.mpc_config import MPCConfig
    from cableway.tang2025.control.neural_mpc import NeuralMPC
    from cableway.tang2025.models.checkpoint import load_model
    from cableway.tasks.generation import random_task, random_task_with_witness
    from cableway.tracking import RealTimePlant, Recovery, Watchdog, insert_plug, track, track_in_real_time
    from cableway.verdict import Verdict
    from cableway.verification import verify_insertion, verify_insertion_plan, verify_plan, verify_rollout
    from cableway.workflow.rehearsal import RehearsalConfig, rehearsed_plan
    from cableway.workflow.run import Run, SolveOptions
    from cableway.workflow.solve import solve
    from cableway.workflow.trajectory import Trajectory

_HOME = {
    name: module
    for module, names in {
        "control.insertion": ("InsertionConfig", "InsertionController"),
        "control.jacobian": ("JacobianConfig", "JacobianFeedback"),
        "control.open_loop": ("OpenLoop",),
        "control.rod_mpc": ("RodMPC", "RodMPCConfig"),
        "core.errors": (
            "CablewayError",
            "Cancelled",
            "ControlError",
            "FileFormatError",
            "GraspError",
            "InputError",
            "MissingExtraError",
            "PlanningError",
            "PlanningInterrupted",
            "PressedError",
            "SimulationError",
            "StorageError",
            "TaskError",
            "TrackingInterrupted",
            "UnknownNameError",
        ),
        "datasets.reading": ("load_transitions", "shuffled_batches"),
        "datasets.transitions": ("Transitions",),
        "figures.draw": ("draw",),
        "outcome": ("Outcome",),
        "planning.config": ("PlannerConfig",),
        "planning.insertion": ("plan_insertion",),
        "planning.planner": ("plan",),
        "planning.routes.passages": ("find_passages",),
        "records": ("Plan", "Rollout"),
        "report": ("Report", "summarize"),
        "scene.cable": ("Cable",),
        "scene.files.loading": ("load_task", "task_names"),
        "scene.files.saving": ("save_task",),
        "scene.obstacles": ("Box", "Disc", "Polygon"),
        "scene.scene": ("Scene",),
        "scene.task": ("Grippers", "Task"),
        "simulation.perturbations.grasp": ("GraspConfig", "GraspedCable"),
        "simulation.perturbations.perturbation": ("Perturbation",),
        "simulation.perturbations.sensing": ("SensedPlant", "SensingConfig"),
        "simulation.plant": ("CableSimulator",),
        "tang2025.control.mpc_config": ("MPCConfig",),
        "tang2025.control.neural_mpc": ("NeuralMPC",),
        "tang2025.models.checkpoint": ("load_model",),
        "tasks.generation": ("random_task", "random_task_with_witness"),
        "tracking": ("RealTimePlant", "Recovery", "Watchdog", "insert_plug", "track", "track_in_real_time"),
        "verdict": ("Verdict",),
        "verification": ("verify_insertion", "verify_insertion_plan", "verify_plan", "verify_rollout"),
        "workflow.rehearsal": ("RehearsalConfig", "rehearsed_plan"),
        "workflow.run": ("Run", "SolveOptions"),
        "workflow.solve": ("solve",),
        "workflow.trajectory": ("Trajectory",),
    }.items()
    for name in names
}

__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


keep_moved_modules()


def _attribute(name: str) -> Any:
    if name == "__version__":
        return import_module("cableway.core.provenance").versions()["cableway"]
    if name in MODULES:
        return sys.modules[f"cableway.{name}"]
    if name not in _HOME:
        raise AttributeError(f"module 'cableway' has no attribute {name!r}")
    return getattr(import_module(f"cableway.{_HOME[name]}"), name)


__getattr__ = renamed(
    __name__,
    {
        "PlugPush": "InsertionController",
        "PlugPushConfig": "InsertionConfig",
        "plan_push": "plan_insertion",
        "push_in": "insert_plug",
        "verify_push": "verify_insertion_plan",
    },
    _attribute,
)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME, "__version__"})
