"""Settings of Jacobian feedback compared, on tasks and plants that nothing else is measured on.

    .venv/bin/python studies/jacobian.py

Random tasks of the kinds clutter (ten plants in turn), open-near and open-far (four cables of the laboratory), plans
without rehearsal. Each line is one setting on all of them: successes (below 3 cm, nothing touched), those below 1 cm,
contacts, and the stacked final error [mm], median / mean.
"""

from __future__ import annotations

import numpy as np

from cableway.benchmark.suites import make_task
from cableway.control.jacobian import JacobianConfig, JacobianFeedback
from cableway.core.errors import CablewayError
from cableway.outcome import SUCCESS_ERROR
from cableway.planning.planner import plan
from cableway.records import Plan
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tracking import track

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


def planned() -> list[tuple[Task, Plan, Perturbation, int]]:
    """The cases that can be begun: task, plan, plant and seed."""
    found = []
    for seed, (name, plant) in enumerate(CASES):
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
    cases = planned()
    for config in SETTINGS:
        controller, errors, touched = JacobianFeedback(config), [], []
        for task, found, perturbation, seed in cases:
            rollout = track(perturbation.build(task, seed), controller, found, seed=seed)
            errors.append(rollout.shape_error(task.goal))
            touched.append(not rollout.least_clearance > 0)
        error, good = np.array(errors), ~np.array(touched)
        print(
            f"{config.source}, gain {config.gain}, damping {config.damping}, rate {config.learning_rate}, least motion "
            f"{config.least_motion}: {sum(good & (error < SUCCESS_ERROR))} and {sum(good & (error < 0.01))} of "
            f"{len(cases)}, {sum(touched)} contacts, {1000 * np.median(error):.1f} / {1000 * error.mean():.1f} mm",
            flush=True,
        )


if __name__ == "__main__":
    main()
