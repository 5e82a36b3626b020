"""Compiling the kernels of a run before they are needed, with progress, on two processors where there are two.

Numba compiles one kernel at a time in a process. So a second process compiles those of tracking, and of the
verification that planning ends with, while this one compiles those of planning; they meet in the cache folder.
"""

from __future__ import annotations

import importlib
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from typing import Any

from cableway.control.rod_mpc import RodMPC
from cableway.core.compiled import compiled_among, is_compiled, kernels_below, mark_compiled, watched
from cableway.core.executors import cores
from cableway.core.kernel_cache import trusted_folder
from cableway.core.logs import log_file, log_to
from cableway.planning.planner import plan as find_plan
from cableway.records import Plan
from cableway.scene.files.loading import load_planar_task
from cableway.scene.task import Task
from cableway.verification import verify_plan
from cableway.workflow.events import Event, Listener, Note, Progress

EXAMPLE = "single-obstacle-2"
"""The task of the catalogue by which kernels are compiled."""

PLANNING, TRACKING = "planning", "tracking"

KERNELS = {
    PLANNING: (
        "geometry.convex._point_distances",
        "geometry.convex._polyline_distances",
        "motion.kernels.self_distance",
        "motion.kernels.sharpest_turn",
        "planning.routes.band.relax",
        "planning.routes.band.shortcut",
        "planning.routes.pivot_grid._search",
        "planning.rrt_connect_kernels.connect",
        "planning.rrt_connect_kernels.features",
        "planning.rrt_connect_kernels.shortcut",
        "motion.banded_least_squares._fill_bands",
        "rod.fitting.fit_shape",
        "rod.kernels.batch_shapes",
        "rod.kernels.batch_stability",
        "rod.kernels.uniform",
        "rod.least_squares.fresh_state",
        "rod.least_squares.judge",
        "verification.follower._least_eigenvalue",
        "verification.follower._settle",
    ),
    TRACKING: (
        "control.rod_kernels.optimize",
        "estimation.rod_kernels.predict",
        "rod.fitting.fit_along",
        "rod.fitting.meet_ends",
    ),
}
"""The kernels that Python calls in every run; others, as for alternatives or a cable of another material, are compiled
when they are needed."""

CELL = "robot.free_arms.arms_room"
"""The kernel that the search calls in a cell alone; it and those that only it calls are compiled when needed."""

COMPILING = "Compiling kernels; this happens once, the next run finds them in your cache folder."

AHEAD = "import sys; from cableway.workflow.compilation import compile_ahead; compile_ahead(*sys.argv[1:])"


@cache
def compile_planning() -> None:
    """Have every kernel of the default planner compiled and kept, by planning a task of the catalogue."""
    find_plan(load_planar_task(EXAMPLE))
    mark_compiled(PLANNING)


@cache
def compile_tracking() -> None:
    """The same for the controllers on the rod, by a plan that stands still."""
    RodMPC().init(*_standing())
    mark_compiled(TRACKING)


def compile_ahead(log: str | None = None) -> None:
    """What a second process compiles, with the file that it logs to."""
    log_to(log)
    task, plan = _standing()
    verify_plan(plan, task)
    compile_tracking()


def _standing() -> tuple[Task, Plan]:
    """The example, and a plan that stays at its start."""
    task = load_planar_task(EXAMPLE)
    return task, Plan.of(task.cable.rod, task.start_equilibrium[None].repeat(4, 0))


class Compilation:
    """Compiles what a run needs, each stage when it comes, and says how far it is; to be used in a `with` statement.

    Args:
        listener: Is told.
        tracking: Whether the plan will be followed by a controller that needs kernels.
        checking: Whether stages that are said to be compiled are gone through all the same.
    """

    def __init__(self, listener: Listener, *, tracking: bool, checking: bool = False) -> None:
        self._listener = listener
        stages = (PLANNING, TRACKING) if tracking else (PLANNING,)
        self._stages = tuple(stage for stage in stages if checking or not is_compiled(stage))
        self._kernels = kernels_of(*self._stages)
        self._second: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Compilation:
        return self

    def __exit__(self, *_: object) -> None:
        if self._second is not None:
            self._second.kill()
            self._second.wait()

    def for_planning(self) -> tuple[str, ...]:
        """Compile what planning needs; what the report is to say about it."""
        begun = time.monotonic()
        if self._stages:
            self._listener.emit(Note(COMPILING))
            self._tell()
        if TRACKING in self._stages and self._is_missing(TRACKING) and _can_share():
            nowhere, log = subprocess.DEVNULL, log_file()
            command = [sys.executable, "-c", AHEAD, *([log] if log else [])]
            self._second = subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=nowhere)
        if PLANNING not in self._stages:
            return ()
        with watched(self._tell):
            compile_planning()
        self._tell()
        return (f"Kernels were compiled for {time.monotonic() - begun:.0f} s before planning; this happens once.",)

    def for_tracking(self) -> None:
        """Compile what tracking needs, or wait for it."""
        if TRACKING not in self._stages:
            return
        while self._second is not None and self._second.poll() is None and not self._listener.cancelled:
            self._tell()
            time.sleep(0.2)
        with watched(self._tell):
            compile_tracking()
        self._tell()

    def _is_missing(self, stage: str) -> bool:
        kernels = kernels_of(stage)
        return compiled_among(kernels) < len(kernels)

    def _tell(self) -> None:
        done, total = compiled_among(self._kernels), len(self._kernels)
        self._listener.emit(Progress(f"compilation: {done} of {total}", done / max(total, 1)))


def compile_all(progress: Callable[[str, float], Any], *, checking: bool = False) -> None:
    """Compile everything that a default run needs.

    Args:
        progress: Called with "compilation: 37 of 55" and the share that is done.
        checking: Whether what is said to be compiled is gone through all the same, since files may be missing.
    """

    def tell(event: Event) -> None:
        if isinstance(event, Progress):
            progress(event.stage, event.share)

    with Compilation(Listener(tell), tracking=True, checking=checking) as compilation:
        compilation.for_planning()
        compilation.for_tracking()


def kernels_of(*stages: str) -> tuple[Any, ...]:
    """The kernels of stages, with those that they call outside a cell."""
    return kernels_below(*(_kernel(name) for stage in stages for name in KERNELS[stage]), without=_kernel(CELL))


def _kernel(name: str) -> Any:
    module, _, function = name.rpartition(".")
    return getattr(importlib.import_module(f"cableway.{module}"), function)


def _can_share() -> bool:
    """Whether a second process has a processor, and a folder to leave its kernels in."""
    return cores() > 1 and trusted_folder() is not None
