"""Controllers tuned with one budget each: the shipped settings and drawn ones, all on the same episodes.

    .venv/bin/python studies/tuning.py tune [--controllers A,B] [--settings N] [--cases N] [--out runs/tuning]
    .venv/bin/python studies/tuning.py validate [--controllers A,B] [--cases N] [--out runs/tuning]
    .venv/bin/python studies/tuning.py samples [--cases N]

`tune` runs the settings on random tasks of the kinds clutter and dense with perturbed cables and friction, in the
planar simulator. The best has the most successes (below 3 cm, nothing touched), then the most errors below 1 cm, then
the least median error. `validate` runs it beside the shipped settings where neither was chosen: on the table plant, on
other tasks. Both go on after an interrupt. `samples` plans mazes by RRT-Connect alone, with more and more samples.

Each setting is a method of the benchmark, `studies/tuning.py:rod_mpc_3`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cableway.benchmark.episode import STRICT_ERROR, Result, jobs_of
from cableway.benchmark.methods import Method
from cableway.benchmark.runner import read_result, run_jobs
from cableway.benchmark.suites import Episode, make_task, task_digest
from cableway.control.base import Controller
from cableway.control.jacobian import JacobianConfig, JacobianFeedback
from cableway.control.rod_mpc import RodMPC, RodMPCConfig
from cableway.core.errors import PlanningError
from cableway.planning.config import PlannerConfig
from cableway.planning.planner import plan
from cableway.tang2025.control.mpc_config import MPCConfig
from cableway.tang2025.control.neural_mpc import NeuralMPC
from cableway.tang2025.models.checkpoint import load_model

SETTINGS = 12
"""Settings of each controller that are tried, of which the first one is the shipped one."""

TUNED_ON = [
    (f"{'clutter' if i % 2 else 'dense'}-{84300 + i}", plant)
    for i, plant in enumerate((
        "rough-hard", "rough-graded", "rough-long-3", "rough-grasp", "rough-very-hard", "rough-half-curved",
        "rough-short-3", "rough-obstacles-moved", "rough-stiff-middle", "rough-tau-1.5", "rough-slip",
        "rough-start-off",
        "rough-hard", "rough-long-1", "rough-very-hard", "rough-graded",
    ))
]  # fmt: skip
"""Tasks and plants on which settings are chosen."""

JUDGED_ON = [
    (f"{('clutter', 'dense', 'maze')[i % 3]}-{84400 + i}" + ("@0.085" if i % 3 == 2 else ""), plant)
    for i, plant in enumerate(6 * ("table-coiled", "table-rough", "table-stiff-third", "table-all"))
]
"""Those on which the chosen ones are judged."""

MORE_SAMPLES = (6_000, 24_000, 96_000, 384_000)
"""Samples of RRT-Connect, of which the first is the shipped number."""


@dataclass(frozen=True)
class Tunable:
    """A controller whose settings are drawn.

    Attributes:
        shipped: The settings that it comes with.
        ranges: Least and largest value of each setting that is drawn, uniformly in its logarithm; integers where both
            are.
        make: The controller of some settings.
        others: Settings that are tried before those that are drawn.
    """

    shipped: Any
    ranges: dict[str, tuple[float, float]]
    make: Callable[[Any], Controller[Any]]
    others: tuple[Any, ...] = ()

    def setting(self, number: int) -> Any:
        """The shipped settings for 0, then the others, then drawn ones."""
        if number <= len(self.others):
            return (self.shipped, *self.others)[number]
        rng = np.random.default_rng([2025, number])
        drawn = {name: float(np.exp(rng.uniform(*np.log(ends)))) for name, ends in self.ranges.items()}
        whole = {name: round(drawn[name]) for name, ends in self.ranges.items() if isinstance(ends[0], int)}
        return replace(self.shipped, **drawn | whole)


FEEDBACK = {"gain": (0.05, 0.6), "damping": (0.05, 2.0), "turn_lever": (0.02, 0.15)}

CONTROLLERS = {
    "rod_mpc": Tunable(
        RodMPCConfig(),
        {"horizon": (2, 6), "tracking_weight": (0.2, 5.0), "turn_lever": (0.02, 0.15), "clearance_weight": (5.0, 200.0),
         "threshold": (0.003, 0.01)},
        RodMPC,
    ),
    "neural_mpc": Tunable(
        MPCConfig(),
        {"horizon": (2, 8), "iterations": (1, 3), "tracking_weight": (30.0, 1000.0), "control_weight": (1e3, 1e5),
         "pose_weight": (30.0, 3000.0), "offset_gain": (0.05, 0.6), "threshold": (0.003, 0.01)},
        lambda config: NeuralMPC(load_model("conv"), config),
    ),
    "rod_jacobian": Tunable(JacobianConfig(), FEEDBACK, JacobianFeedback),
    "broyden": Tunable(
        JacobianConfig.broyden(), FEEDBACK | {"learning_rate": (0.03, 0.5), "least_motion": (0.0005, 0.02)},
        JacobianFeedback, (JacobianConfig(source="broyden"),),
    ),
}  # fmt: skip


def __getattr__(name: str) -> Method:
    """The method of a controller and the number of its settings."""
    controller, _, number = name.rpartition("_")
    if controller not in CONTROLLERS or not number.isdecimal():
        raise AttributeError(f"no method {name}")
    tunable = CONTROLLERS[controller]
    make = partial(tunable.make, tunable.setting(int(number)))
    return Method(name=name.replace("_", "-"), description=f"{controller}, settings {number}", controller=make)


def episodes(cases: list[tuple[str, str]]) -> list[Episode]:
    """Of tasks and plants."""
    return [
        Episode("tuning", f"{name.replace('@', '-')}-{plant}", name, plant, seed, task_digest(name, make_task(name)))
        for seed, (name, plant) in enumerate(cases)
    ]


def results(controller: str, number: int, cases: list[Episode], out: Path, workers: int) -> list[Result]:
    """Of one setting, those that are missing run first."""
    jobs = jobs_of(f"studies/tuning.py:{controller}_{number}", cases)
    run_jobs([job for job in jobs if read_result(job, out) is None], out, workers=workers)
    return [result for job in jobs if (result := read_result(job, out))]


def score(found: list[Result]) -> tuple[int, int, float]:
    """Successes, those below 1 cm, and the negative median of the final errors [m]; larger is better."""
    errors = [np.inf if result.shape_error is None else result.shape_error for result in found]
    strict = sum(result.success and error < STRICT_ERROR for result, error in zip(found, errors, strict=True))
    return sum(result.success for result in found), strict, -float(np.median(errors))


def line(name: str, found: list[Result]) -> str:
    """What is printed of a setting."""
    good, strict, error = score(found)
    touched = sum(result.contact for result in found)
    shares = f"{good:3d} and {strict:3d} below 1 cm of {len(found)}, {touched} contacts"
    return f"{name:15s} {shares}, median {-1000 * error:.1f} mm"


def tuned(controller: str, given: argparse.Namespace) -> int:
    """Number of the best settings, all of them printed."""
    cases = episodes(TUNED_ON[: given.cases])
    scores = []
    for number in range(given.settings):
        found = results(controller, number, cases, given.out, given.workers)
        scores.append(score(found))
        print(
            line(f"{controller}_{number}", found), CONTROLLERS[controller].setting(number) if number else "", flush=True
        )
    return max(range(given.settings), key=lambda number: scores[number])


def by_samples(count: int) -> None:
    """Mazes planned by RRT-Connect alone: how many, and in what processor time."""
    shipped = PlannerConfig.named("rrt-connect")
    for samples in MORE_SAMPLES:
        config = replace(shipped, rrt_connect=replace(shipped.rrt_connect, samples=samples))
        solved, took = 0, []
        for seed in range(84500, 84500 + count):
            start = time.process_time()
            try:
                plan(make_task(f"maze-{seed}@0.085"), config=config)
                solved += 1
            except PlanningError:
                pass
            took.append(time.process_time() - start)
        print(f"{samples:7,d} samples: {solved} of {count}, {np.median(took):.2f} s, worst {max(took):.2f}", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("tune", "validate", "samples"))
    parser.add_argument("--controllers", default=",".join(CONTROLLERS))
    parser.add_argument("--settings", type=int, default=SETTINGS)
    parser.add_argument("--cases", type=int, default=len(JUDGED_ON))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/tuning"))
    given = parser.parse_args()
    if given.what == "samples":
        return by_samples(given.cases)
    for controller in given.controllers.split(","):
        best = tuned(controller, given)
        print(f"best of {controller}: {best}")
        if given.what == "validate":
            for number in sorted({0, best}):
                found = results(controller, number, episodes(JUDGED_ON[: given.cases]), given.out, given.workers)
                print(f"judged: {line(f'{controller}_{number}', found)}", flush=True)


if __name__ == "__main__":
    main()
