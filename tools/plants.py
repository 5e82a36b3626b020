"""Plants that differ: how fast they step, and how the shipped controller tracks one plan on them.

    .venv/bin/python tools/plants.py [--task NAME] [--runs N]

Each line of the second table is N runs with seeds 0 to N - 1, noise and lost frames drawn anew; where the cable is
drawn from the ranges of presets, it is another one in each run. All runs follow the plan of seed 0.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cableway.control.neural_mpc import NeuralMPC
from cableway.errors import SimulationError
from cableway.models.checkpoint import load_model
from cableway.planning.planner import plan
from cableway.records import SUCCESS_ERROR
from cableway.scene.cable import Cable
from cableway.scene.loading import load_task
from cableway.scene.presets import preset_names, preset_values
from cableway.scene.task import Task
from cableway.simulation.plant import CableSimulator
from cableway.simulation.sensing import SensedPlant, SensingConfig
from cableway.tracking import track

CABLES: dict[str, dict] = {
    "nominal": {},
    "stiffness_profile [0.5, 2], rest_curvature [0, 0, 5]": {
        "stiffness_profile": (0.5, 2.0),
        "rest_curvature": (0.0, 0.0, 5.0),
    },
    "yield_curvature 10": {"yield_curvature": 10.0},
    "drag 1": {"drag": 1.0},
    "friction 0.4": {"friction": 0.4},
    "friction 0.4, bending_stiffness 1e-4": {"friction": 0.4, "bending_stiffness": 1e-4},
}
LAB = SensingConfig(keypoint_noise=0.002, drop_rate=0.1, measurement_delay=0.1)
SENSING = {
    "as it is": SensingConfig(),
    "noise 2 mm": SensingConfig(keypoint_noise=0.002),
    "a frame in five lost": SensingConfig(drop_rate=0.2),
    "a stretch hidden in every second frame": SensingConfig(occlusion_rate=0.5),
    "seen 0.1 s late": SensingConfig(measurement_delay=0.1),
    "moved 0.1 s late": SensingConfig(action_delay=0.1),
    "noise 2 mm, a frame in ten lost, seen 0.1 s late": LAB,
    "all of these": replace(LAB, drop_rate=0.2, occlusion_rate=0.5, action_delay=0.1),
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


def drawn(task: Task, seed: int) -> Cable:
    """A cable as long as the task's, of a preset and from its ranges."""
    name = preset_names()[seed % len(preset_names())]
    return Cable(**{**preset_values(name), "length": task.cable.length, "preset": name}).sample(seed)


def runs(task: Task, make: Callable[[int], SensedPlant], count: int, controller: NeuralMPC, planned) -> str:
    """One line: how the runs of one kind of plant ended."""
    errors, deviations, succeeded = [], [], 0
    for seed in range(count):
        try:
            rollout = track(make(seed), controller, planned, seed=seed)
        except SimulationError as error:
            print(f"  seed {seed}: {error}")
            continue
        errors.append(1000 * float(np.linalg.norm(rollout.keypoints[-1] - task.goal)))
        deviations.append(1000 * float(np.linalg.norm(rollout.keypoints - rollout.reference, axis=2).max()))
        succeeded += errors[-1] < 1000 * SUCCESS_ERROR and rollout.clearance.min() > 0
    spread = [" / ".join(f"{q:.1f}" for q in np.percentile(v, [50, 95, 100])) for v in (errors, deviations)]
    return f"{succeeded}/{count} | {spread[0]} | {spread[1]}"


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description="How fast plants that differ step, and how they are tracked.")
    parser.add_argument("--task", default="single-obstacle-2")
    parser.add_argument("--runs", type=int, default=10)
    options = parser.parse_args()
    task = load_task(options.task)
    print("| cable | control steps (0.1 s) in a second of one core |\n|---|---|")
    for name, changes in CABLES.items():
        print(f"| {name} | {rate(task, replace(task.cable, **changes)):.0f} |", flush=True)
    planned, controller = plan(task, seed=0), NeuralMPC(load_model("transformer"))
    print("\n| plant | success | error, stacked: median / p95 / worst [mm] | deviation [mm] |\n|---|---|---|---|")
    for name, sensing in SENSING.items():
        line = runs(task, lambda seed, s=sensing: SensedPlant(CableSimulator(task), s, seed), options.runs,
                    controller, planned)  # fmt: skip
        print(f"| {name} | {line} |", flush=True)
    line = runs(task, lambda seed: SensedPlant(CableSimulator(task, cable=drawn(task, seed)), LAB, seed),
                options.runs, controller, planned)  # fmt: skip
    print(f"| cables drawn from the presets' ranges, sensed so | {line} |", flush=True)


if __name__ == "__main__":
    main()
