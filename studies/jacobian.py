"""Settings of Jacobian feedback compared, on tasks and plants that nothing else is measured on.

    .venv/bin/python studies/jacobian.py [--cases N] [--settings N]

Random tasks of the kinds clutter (ten plants in turn), open-near and open-far (four cables of the laboratory), plans
without rehearsal. Each line is one setting on all of them: successes (below 3 cm, nothing touched), those below 1 cm,
contacts, and the stacked final error [mm], median / mean. The options leave out all but the first ones.
"""

from __future__ import annotations

import argparse

import numpy as np

from cableway.benchmark.suites import make_task
from cableway.control.jacobian import JacobianConfig, JacobianFeedback
from cableway.core.errors import CablewayError
from cableway.outcome import Outcome
from cableway.planning.planner import plan
from cableway.records import Plan
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

PLANTS = ("nominal", "hard", "graded", "long-1", "tau-1.5", "grasp", "very-hard", "stiff-middle", "start-off",
          "half-curved")  # fmt: skip
CABLES = ("paracord-0.34", "rubber-0.34", "ethernet-0.34", "usb-0.34")
CASES = [(f"clutter-{84000 + i}", PLANTS[i % len(PLANTS)]) for i in range(30)]
CASES += [(f"open-near-{84100 + i}~{CABLES[i % len(CABLES)]}", "laid") for i in range(8)]
CASES += [(f"open-far-{84200 + i}~{CABLES[i % len(CABLES)]}", "laid") for i in range(8)]

SETTINGS = [
    JacobianConfig(source="broyden", gain=gain, learning_rate=rate, least_motion=motion, damping=damping)
    for gain, rate, motion, damping in [
        (0.3, 0.3, 0.001, 0.3), (0.1, 0.1, 0.005, 1.0), (0.05, 0.1, 0.005, 1.0), (0.15, 0.1, 0.005, 1.0),
        (0.1, 0.3, 0.005, 1.0), (0.1, 0.1, 0.002, 1.0), (0.1, 0.1, 0.01, 1.0), (0.1, 0.03, 0.005, 1.0),
        (0.1, 0.1, 0.005, 3.0), (0.2, 0.1, 0.005, 3.0), (0.1, 0.3, 0.01, 1.0),
    ]
] + [
    JacobianConfig(gain=gain, damping=damping)
    for gain, damping in [
        (0.3, 0.3), (0.1, 0.3), (0.2, 0.3), (0.5, 0.3), (0.3, 1.0), (0.3, 0.1), (0.1, 1.0), (0.2, 0.1),
    ]
]  # fmt: skip


def planned(most: int) -> list[tuple[Task, Plan, Perturbation, int]]:
    """The cases that can be begun: task, plan, plant and seed."""
    found = []
    for seed, (name, plant) in enumerate(CASES[:most]):
        try:
            task = make_task(name)
            perturbation = named_perturbation(plant, task, seed)
            perturbation.build(task, seed)
            found.append((task, plan(task), perturbation, seed))
        except CablewayError as error:
            print(f"left out: {name} on {plant}, {error}")
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--cases", type=int, default=len(CASES))
    parser.add_argument("--settings", type=int, default=len(SETTINGS))
    given = parser.parse_args()
    cases = planned(given.cases)
    for config in SETTINGS[: given.settings]:
        controller = JacobianFeedback(config)
        reports = [
            solve(task, SolveOptions(plan=found, controller=controller, perturbation=perturbation, seed=seed,
                                     recover=False)).report
            for task, found, perturbation, seed in cases
        ]  # fmt: skip
        error = np.array([np.inf if report.shape_error is None else report.shape_error for report in reports])
        good = np.array([report.success for report in reports])
        touched = sum(report.outcome is Outcome.CONTACT for report in reports)
        print(
            f"{config.source}, gain {config.gain}, damping {config.damping}, rate {config.learning_rate}, least motion "
            f"{config.least_motion}: {good.sum()} and {sum(good & (error < 0.01))} of "
            f"{len(cases)}, {touched} contacts, {1000 * np.median(error):.1f} / {1000 * error.mean():.1f} mm",
            flush=True,
        )


if __name__ == "__main__":
    main()
