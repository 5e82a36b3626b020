"""Neural MPC with each shipped model: how far from the goal it ends, and how long its steps take.

    taskset -c 0 .venv/bin/python studies/neural.py [--models A,B] [--iterations 1,2] [--tasks N] [--first SEED]

Random tasks of the kind clutter, on the plants "nominal" and "hard" of the benchmark. Steps are timed by
the clock on the wall, as in every run. Plans are kept in runs/neural.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cableway.control.base import Controller
from cableway.control.rod_mpc import RodMPC
from cableway.core.errors import CablewayError
from cableway.planning.planner import plan
from cableway.records import Plan, Rollout
from cableway.scene.task import Task
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tang2025.control.mpc_config import MPCConfig
from cableway.tang2025.control.neural_mpc import NeuralMPC
from cableway.tang2025.models.checkpoint import load_model
from cableway.tang2025.models.compilation import enable_compilation_cache
from cableway.tasks.generation import random_task
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

PLANTS = ("nominal", "hard")


def planned(first: int, count: int, folder: Path = Path("runs/neural")) -> Iterator[tuple[Task, Plan]]:
    """Tasks that have a plan, with it."""
    for seed in range(first, first + count):
        task = random_task(seed, "clutter")
        path = folder / f"{task.name}.npz"
        try:
            if not path.exists():
                plan(task).save(path)
            yield task, Plan.load(path)
        except CablewayError as error:
            print(f"{task.name} is left out: {error}")


def controllers(models: list[str], iterations: list[int]) -> Iterator[tuple[str, Controller[Any]]]:
    """By name; "rod-mpc" among the models is the adaptive rod MPC, to compare with."""
    for name in models:
        if name == "rod-mpc":
            yield name, RodMPC()
            continue
        for most in iterations:
            yield f"{name}, {most} iterations", NeuralMPC(load_model(name), MPCConfig(iterations=most))


def line(task_goals: list[np.ndarray], rollouts: list[Rollout]) -> str:
    """One line of the table."""
    pairs = list(zip(task_goals, rollouts, strict=True))
    error = 1000 * np.array([run.shape_error(goal) for goal, run in pairs])
    deviation = 1000 * np.array([run.deviations_from_reference.max() for run in rollouts])
    clear = np.array([run.least_clearance > 0 for run in rollouts])
    seconds = 1000 * np.concatenate([run.solve_time for run in rollouts])
    cells = [
        f"{np.sum((error < 30) & clear)} of {len(rollouts)}",
        f"{np.sum((error < 10) & clear)}",
        f"{np.sum(~clear)}",
        "{:.2f} / {:.1f} / {:.1f}".format(*np.quantile(error, [0.5, 0.95, 1.0])),
        "{:.1f} / {:.0f}".format(*np.quantile(deviation, [0.5, 1.0])),
        "{:.1f} / {:.1f} / {:.1f}".format(*np.quantile(seconds, [0.5, 0.99, 1.0])),
    ]
    return " | ".join(cells)


def main() -> None:
    """Print the table, a line as soon as it is there."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--models", default="rod-mpc,transformer,conv,bilstm,mlp,linear,rod,hybrid")
    parser.add_argument("--iterations", default="15")
    parser.add_argument("--tasks", type=int, default=20)
    parser.add_argument("--first", type=int, default=8200)
    given = parser.parse_args()
    enable_compilation_cache()
    tasks = list(planned(given.first, given.tasks))
    print("| model | plant | < 3 cm | < 1 cm | contacts | error [mm], median / p95 / worst "
          "| deviation [mm], median / worst | step [ms], median / p99 / worst |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for name, controller in controllers(given.models.split(","), [int(n) for n in given.iterations.split(",")]):
        runs: dict[str, list[tuple[np.ndarray, Rollout]]] = {}
        for task, found in tasks:
            for plant in PLANTS:
                options = SolveOptions(
                    plan=found, controller=controller, perturbation=named_perturbation(plant, task), recover=False
                )
                run = solve(task, options)
                if run.rollout is None:
                    print(f"{task.name}, {plant}: {run.report.failure}")
                else:
                    runs.setdefault(plant, []).append((task.goal, run.rollout))
        for plant_name, pairs in runs.items():
            print(f"| {name} | {plant_name} | {line(*map(list, zip(*pairs, strict=True)))} |", flush=True)  # pyright: ignore[reportArgumentType]


if __name__ == "__main__":
    main()
