"""Controllers over many steps: memory, and what they do with observations that make no sense.

    .venv/bin/python studies/endurance.py [--controllers A,B] [--steps N]

Twice N steps each, without a plant: along a plan and back, with noise; then with hostile observations, of which a
fifth each is none or not finite or empty, frozen, swapped end for end, jumped or far away, and seconds late. Printed
are the resident memory after a tenth, half and all of the steps, the processor time of a step (median / 99th percentile
/ worst), how often each status came, and how many actions were beyond the limits and steps raised.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cableway.control.limits import exceeds_limits
from cableway.planning.planner import plan
from cableway.records import Observation, Plan
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from cableway.workflow.registry import DEFAULT_CONTROLLER, make_controller

NOISE = 0.001
"""Standard deviation [m] of the keypoints along the plan."""

Seen = Callable[[int], Observation | None]


def along(found: Plan, rng: np.random.Generator) -> Seen:
    """Observations there and back along a plan."""

    def seen(step: int) -> Observation:
        row = found.steps - abs(found.steps - step % (2 * found.steps))
        return Observation(
            0.1 * step, found.shapes[row] + rng.normal(0, NOISE, found.shapes[row].shape), found.poses[row]
        )

    return seen


def hostile(found: Plan, rng: np.random.Generator) -> Seen:
    """What no plant should show."""
    good, n = along(found, rng), found.shapes.shape[1]
    nothing = [
        None,
        Observation(0.0, np.full((n, 2), np.nan), np.full((2, 3), np.nan)),
        Observation(np.nan, np.full((n, 2), np.inf), np.full((2, 3), -np.inf)),
        Observation(0.0, np.empty((0, 2)), np.empty((0, 3))),
    ]

    def seen(step: int) -> Observation | None:
        kind, now = rng.integers(5), good(step)
        if kind == 0:
            return nothing[rng.integers(len(nothing))]
        if kind == 1:
            return good(0)
        if kind == 2:
            return Observation(now.time, now.keypoints[::-1], now.poses[::-1])
        if kind == 3:
            jump = rng.normal(size=2) * 10.0 ** rng.integers(-3, 300)
            return Observation(now.time, now.keypoints + jump, now.poses + [*jump, 10 * rng.normal()])
        return good(max(0, step - rng.integers(50)))

    return seen


def resident() -> float:
    """Memory [MiB] of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20


def endure(controller: Any, task: Task, found: Plan, seen: Seen, steps: int) -> str:
    """Text on a run of so many steps."""
    state, memory, seconds, statuses = controller.init(task, found), [], [], Counter[str]()
    for step in range(steps):
        observation, before = seen(step), time.process_time()
        try:
            action, state = controller.step(state, observation)
        except Exception as error:
            statuses[f"RAISED {type(error).__name__}: {error}"] += 1
            continue
        seconds.append(time.process_time() - before)
        bad = not np.isfinite(action).all() or exceeds_limits(action, task.grippers)
        statuses["BEYOND THE LIMITS" if bad else str(state.status)] += 1
        if step + 1 in (steps // 10, steps // 2, steps):
            memory.append(f"{resident():.1f}")
    times = "{:.2f} / {:.2f} / {:.2f} ms".format(*1000 * np.quantile(seconds, [0.5, 0.99, 1.0]))
    return f"{' / '.join(memory)} MiB, step {times}, {dict(statuses)}"


def main() -> None:
    """Print two lines for each controller."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--controllers", default=DEFAULT_CONTROLLER)
    parser.add_argument("--steps", type=int, default=10_000)
    given = parser.parse_args()
    task = load_task("single-obstacle-2")
    found = plan(task)
    for name in given.controllers.split(","):
        controller = make_controller(name)
        for kind in (along, hostile):
            seen = kind(found, np.random.default_rng(0))
            print(f"{name}, {kind.__name__}: {endure(controller, task, found, seen, given.steps)}", flush=True)


if __name__ == "__main__":
    main()
