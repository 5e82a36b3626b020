"""Perturbed plants: how fast they step, and how the shipped controller tracks one plan on them.

    .venv/bin/python studies/plants.py [--task NAME] [--runs 7]

Each line of the second table is as many runs, with seeds from 0 on, which draw noise and what is lost; each line of the
third is one run on a cable drawn from the ranges of a preset, and one on the same cable without friction. All runs
follow the plan of seed 0.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from cableway.outcome import Outcome
from cableway.planning.planner import plan as find_plan
from cableway.records import Plan
from cableway.scene.cable import Cable
from cableway.scene.files.loading import cable_from_preset, load_task
from cableway.scene.files.presets import preset_names
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.sensing import SensingConfig
from cableway.simulation.perturbations.variant import LAB
from cableway.simulation.plant import CableSimulator
from cableway.simulation.table import GRAVITY
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

GRADED = {"stiffness_profile": (0.5, 2.0), "rest_curvature": (0.0, 0.0, 5.0)}
CABLES: dict[str, dict] = {
    "nominal": {},
    "graded stiffness and rest curvature": GRADED,
    "yield curvature 10 1/m": {"yield_curvature": 10.0},
    "drag 1 N s/m^2": {"drag": 1.0},
    "friction 0.4": {"friction": 0.4},
    "friction 0.4, a tenth of the stiffness": {"friction": 0.4, "bending_stiffness": 1e-4},
}
SENSING = {
    "ideal": SensingConfig(),
    "noise 2 mm": SensingConfig(keypoint_noise=0.002),
    "one frame in five lost": SensingConfig(drop_rate=0.2),
    "occlusion in every second frame": SensingConfig(occlusion_rate=0.5),
    "measurement latency 0.1 s": SensingConfig(measurement_delay=0.1),
    "actuation latency 0.1 s": SensingConfig(action_delay=0.1),
    "noise 2 mm, one frame in ten lost, measurement latency 0.1 s": LAB,
    "all of these, one frame in five lost": replace(LAB, drop_rate=0.2, occlusion_rate=0.5, action_delay=0.1),
}
STEPS, ROUNDS = 32, 20


def rate(task: Task, cable: Cable) -> float:
    """Control steps of the plant alone in a second of one core's time: the best of some rounds, led to and fro."""
    plant, best = CableSimulator(task, cable=cable), 0.0
    there = np.random.default_rng(0).normal(0, [0.002, 0.002, 0.02], (STEPS // 8, 1, 1, 2, 3))
    actions = np.tile(np.concatenate([there, -there], axis=1), (1, 1, 4, 1, 1)).reshape(-1, 2, 3)
    for _ in range(ROUNDS):
        plant.reset()
        before = time.process_time()
        for action in actions:
            plant.step(action)
        best = max(best, len(actions) / (time.process_time() - before))
    return best


def followed(task: Task, plan: Plan, cable: Cable, sensing: SensingConfig, seed: int) -> tuple[float, float, bool]:
    """Final stacked error, largest deviation [mm], whether it succeeded; infinite where the plant gave up."""
    perturbation = Perturbation(cable=cable, sensing=sensing)
    report = solve(task, SolveOptions(plan=plan, perturbation=perturbation, seed=seed, recover=False)).report
    if report.outcome is Outcome.PLANT_FAILED or report.shape_error is None or report.largest_deviation is None:
        return np.inf, np.inf, False
    return 1000 * report.shape_error, 1000 * report.largest_deviation, report.success


def print_rates(task: Task) -> None:
    """How fast each cable steps."""
    print("| cable | control steps in a second of one core |\n|---|---|")
    for name, changes in CABLES.items():
        print(f"| {name} | {rate(task, replace(task.cable, **changes)):.0f} |", flush=True)


def print_sensing(task: Task, plan: Plan, runs: int) -> None:
    """The task's cable, sensed in each way."""
    print("\n| sensing | success | error, stacked: median / p95 / worst [mm] | deviation from the plan [mm] |")
    print("|---|---|---|---|")
    for name, sensing in SENSING.items():
        rows = np.array([followed(task, plan, task.cable, sensing, seed) for seed in range(runs)])
        errors, deviations = np.percentile(rows[:, :2], [50, 95, 100], axis=0, method="inverted_cdf").T
        spread = " | ".join(" / ".join(f"{value:.1f}" for value in row) for row in (errors, deviations))
        print(f"| {name} | {int(rows[:, 2].sum())}/{runs} | {spread} |", flush=True)


def print_cables(task: Task, plan: Plan, runs: int) -> None:
    """Cables as long as the task's, one preset after the other, from its ranges."""
    print("\n| cable drawn | mu g rho L^3/EI | success | error [mm] | deviation [mm] | error without friction [mm] |")
    print("|---|---|---|---|---|---|")
    names = preset_names()
    for seed in range(runs):
        cable = cable_from_preset(names[seed % len(names)], length=task.cable.length).sample(seed)
        number = cable.friction * GRAVITY * cable.linear_density * cable.length**3 / cable.bending_stiffness
        error, deviation, success = followed(task, plan, cable, LAB, seed)
        without = followed(task, plan, replace(cable, friction=0.0), LAB, seed)[0]
        figures = f"{'yes' if success else 'no'} | {error:.1f} | {deviation:.1f} | {without:.1f}"
        print(f"| {cable.preset}, seed {seed} | {number:.0f} | {figures} |", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description="How fast perturbed plants step, and how they are tracked.")
    parser.add_argument("--task", default="single-obstacle-2")
    parser.add_argument("--runs", type=int, default=7)
    options = parser.parse_args()
    task = load_task(options.task)
    print_rates(task)
    plan = find_plan(task, seed=0)
    print_sensing(task, plan, options.runs)
    print_cables(task, plan, options.runs)


if __name__ == "__main__":
    main()
