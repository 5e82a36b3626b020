"""What plans promise beyond existing: the pivot path, other homotopy classes, and how the plant follows.

    PYTHONPATH=tests .venv/bin/python studies/plan_quality.py pivot [--kinds clutter dense] [--seeds 0:20]
    .venv/bin/python studies/plan_quality.py alternatives [--kinds clutter dense] [--seeds 0:20]
    .venv/bin/python studies/plan_quality.py open-loop    [--kinds clutter ...]   [--seeds 0:20]

pivot: time of the pivot path, and its cost over that of fast marching on a grid of 1 mm. alternatives: how many of
three plans that go round the obstacles in different ways are found, where three pivot paths wide enough for the cable
do so. open-loop: the gripper steps of a plan sent to the MuJoCo plant, which nobody corrects: the largest deviation of
a keypoint and the least clearance, swept. Each task prints a line, each question a table in Markdown.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from cableway.benchmark.tables import Table
from cableway.control.open_loop import OpenLoop, OpenLoopConfig
from cableway.planning.config import PivotConfig, PlannerConfig
from cableway.planning.planner import plan
from cableway.planning.routes.homotopy import different_routes, motion_class
from cableway.planning.routes.pivot import pivot_cost, pivot_keypoint, plan_pivot_path
from cableway.scene.task import Task
from cableway.simulation.plant import CableSimulator
from cableway.tasks.generation import KINDS, random_task
from cableway.tracking import track

GRID = 0.001
"""Spacing of the fast marching grid [m]; its error falls in proportion, so twice that gives an extrapolation."""

REPEATS = 5
"""Times that a pivot path is planned; the median counts."""

WANTED = 3
"""Plans of different classes."""

DAMPING_TIMES = (0.1, 0.2)
"""Of the plants [s]."""

Row = dict[str, float]


def pivot(task: Task) -> Row:
    """Planning time [ms], and cost over that of fast marching, as it is and extrapolated to no spacing."""
    from fast_marching import least_cost  # the tests' oracle, in tests/

    config, middle = PivotConfig(), pivot_keypoint(task.cable.keypoints)
    arguments = task.scene, task.start[middle], task.goal[middle], task.cable.radius, config
    path, seconds = plan_pivot_path(*arguments), []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        plan_pivot_path(*arguments)
        seconds.append(time.perf_counter() - begin)
    cost, fine, coarse = pivot_cost(task.scene, path, config), *(least_cost(*arguments, k * GRID) for k in (1, 2))
    ratios = {"cost ratio": cost / fine, "to the extrapolation": cost / (2 * fine - coarse)}
    return {"ms": 1000 * float(np.median(seconds)), **ratios}


def alternatives(task: Task) -> Row | None:
    """Different plans found and seconds; None where pivot paths with room for the cable are of fewer classes."""
    config = PlannerConfig()
    room = task.cable.radius + config.limits.clearance
    routes = different_routes(task, config.pivot, 0, 6 * WANTED)
    wide = [route for route in routes if task.scene.clearance(route[None], room)[0] >= 0]
    if len(wide) < WANTED:
        return None
    begin = time.perf_counter()
    plans = plan(task, alternatives=WANTED)
    seconds = time.perf_counter() - begin
    return {"different": len({motion_class(task, found.shapes) for found in plans}), "s": seconds}


def open_loop(task: Task) -> Row:
    """Largest deviation [mm] and least clearances [mm] of cable and grippers on each plant."""
    found, row = plan(task), {}
    for tau in DAMPING_TIMES:
        plant = CableSimulator(task, cable=replace(task.cable, damping_time=tau))
        rollout = track(plant, OpenLoop(OpenLoopConfig(hold=0.0)), found)
        off = rollout.deviations_from_reference.max()
        row |= {
            f"deviation [mm], tau {tau} s": 1000 * float(off),
            f"clearance [mm], tau {tau} s": 1000 * float(rollout.clearance.min()),
            f"gripper clearance [mm], tau {tau} s": 1000 * float(rollout.gripper_clearance.min()),
        }
    return row


QUESTIONS: dict[str, Callable[[Task], Row | None]] = {
    "pivot": pivot,
    "alternatives": alternatives,
    "open-loop": open_loop,
}


def rows(question: Callable[[Task], Row | None], kinds: list[str], seeds: range) -> Iterator[Row]:
    """The answers for all tasks that the question can be asked of."""
    for kind in kinds:
        for seed in seeds:
            task = random_task(seed, kind)
            row = question(task)
            if row is not None:
                print(task.name, ", ".join(f"{name} {value:.3f}" for name, value in row.items()), flush=True)
                yield row


def main() -> None:
    """Ask, and print the distribution of each figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("question", choices=QUESTIONS)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=["clutter", "dense"])
    parser.add_argument("--seeds", default="0:20")
    options = parser.parse_args()
    question, seeds = QUESTIONS[options.question], range(*map(int, options.seeds.split(":")))
    question(random_task(0, "clutter"))  # so that no task pays for loading kernels
    answers = list(rows(question, options.kinds, seeds))
    lines = [("question", "tasks", "least", "p5", "median", "p95", "most")]
    for name in answers[0]:
        values = np.array([row[name] for row in answers])
        spread = (f"{value:.3f}" for value in np.quantile(values, [0, 0.05, 0.5, 0.95, 1]))
        lines.append((name, f"{len(answers)}", *spread))
    print("\n" + Table("", tuple(lines)).markdown())


if __name__ == "__main__":
    main()
