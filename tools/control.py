"""Controllers on plants they don't know: random tasks x plants x controllers, one table.

    .venv/bin/python tools/control.py [--controllers A,B] [--plants A,B] [--tasks N] [--first SEED] [--out FOLDER]

Tasks are those of `cableway tasks --random` of the kinds clutter and dense in turn, from seed FIRST on. Plans are kept
in FOLDER/plans (runs/control unless given), each run is a line in FOLDER/CONTROLLER.jsonl; what stands there is not
done again. Success is the strict final stacked error below the bound and no contact; the floor is the least error that
any gripper poses reach on that cable. Intervals are those of 2,000 resamplings of the tasks.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cableway.cli.controllers import CONTROLLERS, make_controller
from cableway.cli.options import Options
from cableway.cli.terminal import Terminal
from cableway.errors import CablewayError, PlanningError, SimulationError
from cableway.planning.planner import plan
from cableway.records import Plan, Rollout
from cableway.report import summarize
from cableway.rod.inverse import equilibria_at
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Obstacle, Polygon
from cableway.scene.random.tasks import random_task
from cableway.scene.task import Task
from cableway.simulation.grasp import GraspConfig, GraspedCable
from cableway.simulation.plant import CableSimulator
from cableway.simulation.sensing import SensedPlant, SensingConfig
from cableway.tracking import track

KINDS = ("clutter", "dense")
MOVED = 0.010
"""Distance [m] by which obstacles are moved after planning, and the start is off."""


@dataclass(frozen=True)
class Variant:
    """A plant: how the cable, its grasp, its sensing and the start differ from what is believed."""

    cable: Cable
    grasp: GraspConfig = field(default_factory=GraspConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    start: Task | None = None
    scene: Task | None = None


def askew(rng: np.random.Generator, shift: float, turn: float) -> tuple[tuple[float, float, float], ...]:
    """Grasps of both ends that are off by `shift` [m] in any direction and `turn` [degrees] either way."""
    angles, signs = rng.uniform(0, 2 * math.pi, 2), rng.choice([-1, 1], 2)
    return tuple(
        (shift * math.cos(a), shift * math.sin(a), float(s * math.radians(turn)))
        for a, s in zip(angles, signs, strict=True)
    )


def graded(rng: np.random.Generator) -> tuple[float, float]:
    """Stiffness from half to twice along the length, or the other way round."""
    return (0.5, 2.0) if rng.random() < 0.5 else (2.0, 0.5)


def half_curved(rng: np.random.Generator, length: float) -> tuple[float, ...]:
    """One half at rest an arc of one radian."""
    curvature = float(rng.choice([-1, 1])) * 2.0 / length
    values = (0.0, 0.0, 0.0, curvature, curvature)
    return values if rng.random() < 0.5 else values[::-1]


def hard(task: Task, rng: np.random.Generator) -> Variant:
    """1% short, grasped 2 mm and 2 degrees askew, graded, tau 0.5 s, 1 mm of noise, seen 0.1 s late."""
    cable = replace(task.cable, length=0.99 * task.cable.length, stiffness_profile=graded(rng), damping_time=0.5)
    left, right = askew(rng, 0.002, 2.0)
    return Variant(
        cable, GraspConfig(left=left, right=right), SensingConfig(keypoint_noise=0.001, measurement_delay=0.1)
    )


def very_hard(task: Task, rng: np.random.Generator) -> Variant:
    """3% short, grasped 4 mm and 4 degrees askew, graded, tau 1.5 s, 2 mm of noise, seen 0.2 s late."""
    cable = replace(task.cable, length=0.97 * task.cable.length, stiffness_profile=graded(rng), damping_time=1.5)
    left, right = askew(rng, 0.004, 4.0)
    return Variant(
        cable, GraspConfig(left=left, right=right), SensingConfig(keypoint_noise=0.002, measurement_delay=0.2)
    )


def stiff_middle(task: Task, rng: np.random.Generator) -> Variant:
    """1% long, three times as stiff in the middle, half curved, 1 mm of noise, seen 0.1 s late."""
    cable = replace(
        task.cable,
        length=1.01 * task.cable.length,
        stiffness_profile=(1.0, 1.0, 3.0, 1.0, 1.0),
        rest_curvature=half_curved(rng, task.cable.length),
    )
    return Variant(cable, sensing=SensingConfig(keypoint_noise=0.001, measurement_delay=0.1))


def grasped(task: Task, rng: np.random.Generator) -> Variant:
    """Grasped 2 mm and 2 degrees askew."""
    left, right = askew(rng, 0.002, 2.0)
    return Variant(task.cable, GraspConfig(left=left, right=right))


def slipping(task: Task, rng: np.random.Generator) -> Variant:
    """One end slips by 5 mm and 3 degrees, 4 s after the start."""
    left, right = askew(rng, 0.005, 3.0)
    end = {"left_after": left} if rng.random() < 0.5 else {"right_after": right}
    return Variant(task.cable, GraspConfig(slip_time=4.0, **end))


def start_off(task: Task, rng: np.random.Generator) -> Variant:
    """The grippers stand 10 mm and 5 degrees beside the planned start."""
    poses = task.cable.rod.shapes(task.start_fit[0][None])[1][0]
    angles, signs = rng.uniform(0, 2 * math.pi, 2), rng.choice([-1, 1], 2)
    poses = poses + np.column_stack([MOVED * np.cos(angles), MOVED * np.sin(angles), math.radians(5.0) * signs])
    found = equilibria_at(task.cable.rod, poses)
    if not len(found):
        raise SimulationError("no stable shape between the moved grippers")
    shapes = task.cable.rod.at_keypoints(task.cable.rod.shapes(found)[0])
    nearest = int(np.argmin(np.linalg.norm(shapes - task.start, axis=(1, 2))))
    return Variant(task.cable, start=replace(task, start=shapes[nearest], start_poses=None))


def obstacles_moved(task: Task, rng: np.random.Generator) -> Variant:
    """Every obstacle moved by 10 mm in a direction of its own; the controller knows, the plan does not."""

    def moved(obstacle: Obstacle) -> Obstacle:
        angle = rng.uniform(0, 2 * math.pi)
        step = MOVED * np.array([math.cos(angle), math.sin(angle)])
        if isinstance(obstacle, Polygon):
            return replace(obstacle, vertices=np.add(obstacle.vertices, step))
        return replace(obstacle, center=tuple(np.add(obstacle.center, step).tolist()))

    obstacles = tuple(moved(obstacle) for obstacle in task.scene.obstacles)
    return Variant(task.cable, scene=replace(task, scene=replace(task.scene, obstacles=obstacles)))


def changed(**values: Any) -> Callable[[Task, np.random.Generator], Variant]:
    """A cable with other values; a `scale` multiplies the length."""
    scale = values.pop("scale", 1.0)
    return lambda task, _: Variant(replace(task.cable, length=scale * task.cable.length, **values))


PLANTS: dict[str, Callable[[Task, np.random.Generator], Variant]] = {
    "nominal, tau 0.05 s": changed(damping_time=0.05),
    "nominal, tau 0.2 s": changed(damping_time=0.2),
    "nominal, tau 1.5 s": changed(damping_time=1.5),
    "friction 0.3": changed(friction=0.3),
    "start off 10 mm, 5 deg": start_off,
    "length -1%": changed(scale=0.99),
    "length +1%": changed(scale=1.01),
    "length -3%": changed(scale=0.97),
    "length +3%": changed(scale=1.03),
    "grasp 2 mm, 2 deg": grasped,
    "graded 0.5-2": lambda task, rng: Variant(replace(task.cable, stiffness_profile=graded(rng))),
    "half curved": lambda task, rng: Variant(replace(task.cable, rest_curvature=half_curved(rng, task.cable.length))),
    "hard": hard,
    "very hard": very_hard,
    "stiff middle, half curved": stiff_middle,
    "slip 5 mm, 3 deg": slipping,
    "obstacles moved 10 mm": obstacles_moved,
}

NOISY = ("hard", "very hard", "stiff middle, half curved")
"""Plants that are seen with noise; the others are the same with every seed."""


def run(task: Task, found: Plan, variant: Variant, controller: Any, seed: int) -> dict[str, Any]:
    """One row; without figures where the plant cannot take its start."""
    try:
        simulated = CableSimulator(variant.start or variant.scene or task, cable=variant.cable)
        plant = SensedPlant(GraspedCable(simulated, variant.grasp, variant.scene or task), variant.sensing, seed)
    except CablewayError as error:
        return {"no start": str(error)}
    rollout: Rollout = track(plant, controller, found, seed=seed)
    report = summarize(task, None, rollout, cable=variant.cable)
    return {
        "error": report.shape_error,
        "floor": report.shape_error_floor,
        "clearance": min(report.min_clearance or 0.0, report.gripper_clearance or 0.0),
        "deviation": report.largest_deviation,
        "steps": report.steps,
        "failed": "failed" in rollout.metadata["outcome"],
        "times": [round(1000 * t, 3) for t in np.quantile(rollout.solve_time, [0.5, 0.99, 1.0])],
    }


def plans(folder: Path, first: int, count: int) -> Iterator[tuple[int, Task, Plan]]:
    """Tasks with their plans; a task that has none is left out and said so."""
    (folder / "plans").mkdir(parents=True, exist_ok=True)
    for number in range(count):
        seed = first + number // len(KINDS)
        task = random_task(seed, KINDS[number % len(KINDS)])
        path = folder / "plans" / f"{task.name}.npz"
        try:
            if not path.exists():
                plan(task).save(path)
            yield number, task, Plan.load(path)
        except PlanningError as error:
            print(f"{task.name}: no plan, {error}")


def complete(name: str, folder: Path, wanted: list[str], first: int, count: int, noises: int) -> list[dict[str, Any]]:
    """All rows of a controller, those that are missing made now."""
    path = folder / f"{name}.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {(row["task"], row["plant"], row["seed"]) for row in rows}
    controller = make_controller(name, None, Terminal(Options(quiet=True)))
    with path.open("a") as file:
        for number, task, found in plans(folder, first, count):
            for plant in wanted:
                variant = None
                for seed in range(noises if number % 3 == 0 and plant in NOISY else 1):
                    if (task.name, plant, seed) in done:
                        continue
                    key = {"task": task.name, "plant": plant, "seed": seed}
                    try:
                        variant = variant or PLANTS[plant](task, np.random.default_rng([number + first, 7]))
                        row = key | run(task, found, variant, controller, seed)
                    except CablewayError as error:
                        row = key | {"no start": str(error)}
                    rows.append(row)
                    file.write(json.dumps(row) + "\n")
                    file.flush()
    return [row for row in rows if row["plant"] in wanted]


def interval(rows: list[dict[str, Any]], good: Callable[[dict[str, Any]], bool]) -> str:
    """Share of rows in percent with its 95% interval, from resampled tasks."""
    tasks = sorted({row["task"] for row in rows})
    if not tasks:
        return "-"
    sums = np.array([[sum(good(row) for row in rows if row["task"] == task),
                      sum(row["task"] == task for row in rows)] for task in tasks])  # fmt: skip
    picks = np.random.default_rng(0).integers(len(tasks), size=(2000, len(tasks)))
    drawn = sums[picks].sum(axis=1)
    low, high = np.quantile(drawn[:, 0] / drawn[:, 1], [0.025, 0.975])
    share = sums[:, 0].sum() / sums[:, 1].sum()
    return f"{100 * share:.1f} ({100 * low:.0f}-{100 * high:.0f})"


def line(plant: str, rows: list[dict[str, Any]]) -> str:
    """One line of the table."""
    started = [row for row in rows if "no start" not in row]
    if not started:
        return f"| {plant} | 0 of {len(rows)} | | | | | | |"

    def clean(row: dict[str, Any], below: float) -> bool:
        return not row["failed"] and row["clearance"] > 0 and row["error"] < below

    near = [row for row in started if (row["floor"] or 0.0) < 0.008]
    over = 1000 * np.array([row["error"] - (row["floor"] or 0.0) for row in started])
    deviation = 1000 * np.array([row["deviation"] for row in started])
    cells = [
        plant,
        f"{len(started)} of {len(rows)}",
        interval(started, lambda row: clean(row, 0.03)),
        f"{interval(near, lambda row: clean(row, 0.01))} of {len(near)}",
        f"{100 * np.mean([row['clearance'] <= 0 for row in started]):.1f}",
        f"{np.median(over):.2f} / {np.quantile(over, 0.95):.1f} / {over.max():.1f}",
        f"{np.median(deviation):.1f} / {deviation.max():.0f}",
        f"{np.median([row['times'][0] for row in started]):.1f} / {np.max([row['times'][1] for row in started]):.1f}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Run what is missing and print a table for each controller."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--controllers", default=CONTROLLERS[0])
    parser.add_argument("--plants", default=",".join(PLANTS).replace(", ", "; "))
    parser.add_argument("--tasks", type=int, default=100)
    parser.add_argument("--first", type=int, default=7000)
    parser.add_argument("--noises", type=int, default=3, help="seeds of the noise, on every third task")
    parser.add_argument("--out", type=Path, default=Path("runs/control"))
    given = parser.parse_args()
    wanted = [name.replace("; ", ", ") for name in given.plants.split(",")]
    for name in given.controllers.split(","):
        rows = complete(name, given.out, wanted, given.first, given.tasks, given.noises)
        print(f"\n{name}\n")
        print("| plant | runs | < 3 cm [%] | < 1 cm, floor < 8 mm [%] | contact [%] | over the floor [mm] "
              "| deviation [mm] | step [ms] |")  # fmt: skip
        print("|---|---|---|---|---|---|---|---|")
        for plant in wanted:
            print(line(plant, [row for row in rows if row["plant"] == plant]), flush=True)


if __name__ == "__main__":
    main()
