"""How near to its limits a true rollout comes: the margins that `verification/recording.py` leaves.

    .venv/bin/python studies/true_rollouts.py [--suites plants,sensing,...]
        [--episodes 48] [--snaps 40]

Runs the first episodes of each suite, judges their rollouts as the run does and as `cableway check` does, lists those
of successful runs that are refused, and prints of each check the largest value over its limit. Then the same for cables
whose grippers turn by half a turn each, either way, so that most of them snap; no plan does that.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np

from cableway.benchmark.suites import get_suite
from cableway.core.errors import CablewayError, SimulationError
from cableway.records import Measurement, Rollout, Verdict
from cableway.scene.files.loading import load_task
from cableway.scene.task import CONTROL_STEP
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.simulation.plant import CableSimulator
from cableway.verification import plant_length, verify_insertion, verify_rollout
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

SUITES = "plants,sensing,table,faults,dense,mazes,corridors,lab-drawn,lab-constrained,lab-unconstrained"
RECORD = (
    "cable step beyond the grippers'",
    "row off the way between its neighbours",
    "bending",
    "kink",
    "distance from the rod",
)
"""Checks that a snap may come near to."""


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suites", default=SUITES)
    parser.add_argument("--episodes", type=int, default=48)
    parser.add_argument("--snaps", type=int, default=40)
    given = parser.parse_args()
    plants: Counter[str] = Counter()
    verdicts = []
    for suite in given.suites.split(","):
        for name, plant, verdict in judged(suite, given.episodes):
            plants[plant] += 1
            verdicts.append(verdict)
            if not verdict.passed:
                print(f"refused: {name}: {verdict}", flush=True)
    print(f"{len(verdicts)} verdicts on successful runs of {len(plants)} plants")
    print_margins(verdicts)
    for damping in (0.02, 0.1):
        print(f"\nsnaps, damping time {damping:g} s")
        print_margins([snapped(seed, damping) for seed in range(given.snaps)], RECORD)


def judged(suite: str, count: int) -> Iterator[tuple[str, str, Verdict]]:
    """Name, plant and verdict of what successful runs recorded."""
    for episode in get_suite(suite).episodes("full")[:count]:
        try:
            task = episode.load_planar()
            perturbation = named_perturbation(episode.plant, task, episode.seed)
            run = solve(task, SolveOptions(perturbation=perturbation, seed=episode.seed))
        except CablewayError as error:
            print(f"{episode.name}: {error}", flush=True)
            continue
        report = run.report
        if not report.success or run.rollout is None or report.rollout_verdict is None:
            continue
        length = plant_length(run.rollout, task)
        yield episode.name, episode.plant, report.rollout_verdict
        yield f"{episode.name} (file)", episode.plant, verify_rollout(run.rollout, task, length=length)
        if run.insertion is not None:
            yield f"{episode.name} (insertion)", episode.plant, verify_insertion(run.insertion, task, length=length)


def snapped(seed: int, damping: float) -> Verdict:
    """A cable in open space between grippers that turn as fast as they may, and go together or apart."""
    rng = np.random.default_rng(seed)
    task = load_task("single-obstacle-2")
    task = replace(task, scene=replace(task.scene, obstacles=()))
    plant = CableSimulator(task, cable=replace(task.cable, damping_time=damping))
    turns, pull = task.grippers.max_turn * rng.uniform(0.3, 1.0) * rng.choice([-1, 1], 2), rng.uniform(-0.002, 0.002)
    rows, actions = [plant.measure()], []
    while np.abs(rows[-1].poses[:, 2] - rows[0].poses[:, 2]).max() < np.pi:
        way = rows[-1].poses[1, :2] - rows[-1].poses[0, :2]
        along = pull * way / np.linalg.norm(way)
        action = np.column_stack([[along, -along], turns])
        try:
            plant.step(action)
        except SimulationError:
            break
        rows.append(plant.measure())
        actions.append(action)
    truth: dict[str, Any] = {
        field.name: np.array([getattr(row, field.name) for row in rows]) for field in fields(Measurement)
    }
    keypoints, steps = truth["keypoints"], len(actions)
    rollout = Rollout(
        times=CONTROL_STEP * np.arange(steps + 1),
        observed=keypoints,
        actions=np.array(actions).reshape(steps, 2, 3),
        reference=keypoints,
        solve_time=np.zeros(steps),
        status=np.full(steps, "turning"),
        **truth,
    )
    return verify_rollout(rollout, task)


def print_margins(verdicts: list[Verdict], names: tuple[str, ...] = ()) -> None:
    """Of each check with a limit that must not be exceeded, the largest value over that."""
    largest: dict[str, float] = {}
    for check in (check for verdict in verdicts for check in verdict.checks):
        if check.limit > 0 and (not names or check.name in names):
            largest[check.name] = max(largest.get(check.name, -np.inf), check.value / check.limit)
    for name, share in largest.items():
        print(f"{name:45} {share:6.3f} of its limit")


if __name__ == "__main__":
    main()
