"""Runs in a cell whose arms are simulated: success, grasps, contact, error, how far joints are behind, times.

    .venv/bin/python studies/arm_servos.py 5000 5020 --out runs/arm-servos     # seeds 5000 to 5019
    .venv/bin/python studies/arm_servos.py 5000 5020 --arms exact              # the same with arms that follow exactly

Random tasks `cell` on perturbations of the suite `cell`. A joint is behind by its commanded position less the measured
one at the end of a control step. A tip is off by its distance from where it was asked to be a servo's `LAG` before, and
by that from where ideal servos would have it, whose joints turn in proportion to what is missing to commands that go
evenly from step to step. Times are the plant's processor time for a step. Results are appended to
`ARMS.jsonl` in the folder as they come, and runs that are there are not done again.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import cableway as cw
from cableway.core.provenance import versions
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.cell import Way
from cableway.scene.task import CONTROL_STEP
from cableway.simulation.arms import LAG
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.simulation.table_plant import TablePlant

STEPS: list[float] = []
"""Processor time [s] of the control steps of the run under way."""


def timed(step: Callable[..., Any]) -> Callable[..., Any]:
    """A plant's step that notes how long it takes."""

    def measured(*given: Any) -> Any:
        before = time.process_time()
        observation = step(*given)
        STEPS.append(time.process_time() - before)
        return observation

    return measured


def behind(task: cw.Task, rollout: cw.Rollout) -> dict[str, list[float]]:
    """How far after each step the worst joint of a rollout is behind its command [rad], and the worst tip is off what
    was asked `LAG` before [m], and off what ideal servos would do."""
    way = Way.of_record(rollout.metadata)
    if rollout.joints is None or way is None:
        return {}
    arms, joints = CellKinematics(task, way), rollout.joints
    target, rows = arms.poses(joints[0]), [joints[0]]
    for action in rollout.actions:
        target = target + action
        rows.append(arms.joints(target, rows[-1]))
    commanded = np.array(rows)
    shift = LAG / CONTROL_STEP
    at = np.maximum(np.arange(len(rows)) - shift, 0.0)
    low, share = np.floor(at).astype(int), (at % 1.0)[:, None, None]
    asked = commanded[low] + share * (commanded[np.minimum(low + 1, len(rows) - 1)] - commanded[low])
    alone, fading = [commanded[0]], np.exp(-CONTROL_STEP / LAG)
    for before, after in pairwise(commanded):  # x' = (c - x) / LAG, c going evenly from one command to the next
        trailing = shift * (after - before)
        alone.append(after - trailing + (alone[-1] - before + trailing) * fading)

    def off(wanted: np.ndarray | list[np.ndarray]) -> list[float]:
        places = (np.array([arms.poses(row)[:, :2] for row in each]) for each in (wanted, joints))
        return np.linalg.norm(np.subtract(*places), axis=2).max(axis=1)[1:].tolist()

    late = np.abs(commanded - joints).max(axis=(1, 2))[1:].tolist()
    return {"behind": late, "off": off(asked), "off_servo": off(alone)}


def judged(task: cw.Task, perturbation: Perturbation, seed: int) -> dict[str, Any]:
    """What became of a run."""
    STEPS.clear()
    options = cw.SolveOptions(perturbation=perturbation, seed=seed, time_limit=60.0, clock=time.process_time)
    run = cw.solve(task, options)
    report, found = run.report, {"steps": list(STEPS)}
    if run.rollout is not None:
        found |= behind(task, run.rollout)
        found["clearance"] = run.rollout.least_clearance
        found["recovered"] = len(run.rollout.metadata["recovered"])
        found["hands"] = run.rollout.metadata.get("hands", {})
    if run.plan is not None:
        found["unreached"] = [
            why for name in ("approach", "retreat") if (why := run.plan.metadata["arms"].get(f"no_{name}"))
        ]
    return {"outcome": str(report.outcome), "why": report.failure, "shape_error": report.shape_error, **found}


def spread(values: list[float], scale: float) -> str:
    """Median, 95th percentile and greatest of some values."""
    if not len(values):
        return "none"
    return " / ".join(f"{scale * value:.3g}" for value in (np.median(values), np.quantile(values, 0.95), max(values)))


def summary(results: list[dict[str, Any]]) -> str:
    """The figures of some runs."""
    led = [each for each in results if each["shape_error"] is not None]
    joints, steps, off, alone = (
        [value for each in led for value in each.get(name, [])] for name in ("behind", "steps", "off", "off_servo")
    )
    succeeded = sum(each["outcome"] == "success" for each in results)
    hands = [each.get("hands", {}) for each in results]
    grasped, let_go = (sum(each.get(name, False) for each in hands) for name in ("grasped", "let_go"))
    touched = sum(not each["clearance"] > 0 for each in led)
    return (
        f"{len(results)} runs, {succeeded} succeeded, {grasped} grasped, {let_go} let go, "
        f"{touched} of {len(led)} with contact, "
        f"{sum(each['recovered'] > 0 for each in led)} with a recovery; median / 95% / worst: error [mm] "
        f"{spread([each['shape_error'] for each in led], 1e3)}, joint behind by [mrad] {spread(joints, 1e3)}, "
        f"tip off what was asked {1e3 * LAG:g} ms before [mm] {spread(off, 1e3)}, off ideal servos [mm] "
        f"{spread(alone, 1e3)}, control step of the plant [ms] {spread(steps, 1e3)}"
    )


def main() -> None:
    """Go through the tasks and sum up."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("seeds", type=int, nargs=2)
    parser.add_argument("--plants", nargs="+", default=("table-uniform", "table-coiled"))
    parser.add_argument("--arms", default="simulated")
    parser.add_argument("--out", type=Path, default=Path("runs/arm-servos"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / f"{given.arms}.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    done = {(result["task"], result["plant"]): result for result in map(json.loads, lines)}
    TablePlant.step = timed(TablePlant.step)
    wanted = [(seed, plant) for seed in range(*given.seeds) for plant in given.plants]
    for seed, plant in wanted:
        key = (f"cell-{seed}", plant)
        if key not in done:
            task = cw.random_task(seed, "cell")
            result = judged(task, replace(named_perturbation(plant, task, seed), arms=given.arms), seed)
            done[key] = {"task": key[0], "plant": plant, **result, "versions": versions()}
            with path.open("a") as file:
                file.write(json.dumps(done[key]) + "\n")
        shown = {
            name: value
            for name, value in done[key].items()
            if name not in ("versions", "behind", "steps", "off", "off_servo")
        }
        print(json.dumps(shown), flush=True)
    for plant in given.plants:
        print(f"{plant}: {summary([done[f'cell-{seed}', plant] for seed in range(*given.seeds)])}")


if __name__ == "__main__":
    main()
