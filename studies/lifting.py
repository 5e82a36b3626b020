"""Cables laid on a table and lifted again by both ends: when they leave it, and whether plans from there on hold.

    .venv/bin/python studies/lifting.py [PRESET ...] [--draws 10] [--out runs/lifting]

Plans in space are for a cable in the air: one that lies on the table in part is no shape of its rod. In the plant in
MuJoCo, a cable hangs between grippers in line with it up to 45 degrees, 50 to 90% of its length apart; both ends are
lowered straight onto the table, where friction holds it, wait until it rests, and are lifted straight up to where they
began. A lift *carries* where the cable then lies within 10 mm of the shape that the rod has there, with which a plan
would begin. "Off the table" is the height of the ends from which on nothing touches it. Results are kept in the folder,
so that an interrupted study goes on. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from cableway.benchmark.tables import Table
from cableway.core.errors import CablewayError
from cableway.core.files import write_json
from cableway.geometry import rotations
from cableway.rod.inverse import equilibria_at
from cableway.scene.files.presets import preset_names
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.spatial_plant import SpatialPlant

SIZE = 1.0
"""Edge of the workspace [m]."""

YAW = np.radians(45.0)
"""Largest turn of a gripper from the line between them [rad]."""

SPANS = (0.5, 0.9)
"""Least and greatest distance of the grippers, in lengths of the cable."""

STEP = 0.005
"""Way of the ends in a control step [m]."""

RESTING = 30
"""Control steps that the grippers stand still, below and above."""

TOUCHING = 0.0005
"""Clearance [m] up to which the cable touches the table."""

CARRIED = 0.01
"""Largest distance of a keypoint from the rod's shape [m]."""


def task_of(cable: SpatialCable, seed: int) -> SpatialTask:
    """A cable that hangs in the air, at rest.

    Raises:
        CablewayError: It has no stable shape between these grippers.
    """
    rng = np.random.default_rng([26, seed])
    span, yaws = cable.length * rng.uniform(*SPANS), rng.uniform(-YAW, YAW, 2)
    poses = np.zeros((2, 7))
    poses[:, :3] = [[(SIZE + side * span) / 2, SIZE / 2, cable.length + 0.05] for side in (-1, 1)]
    poses[:, 3:] = rotations.from_vector(np.outer(yaws, [0.0, 0.0, 1.0]))
    found = equilibria_at(cable.rod, poses)
    if not len(found):
        raise CablewayError("no stable shape")
    return SpatialTask(
        name=f"lift-{seed}", scene=SpatialScene((SIZE, SIZE, SIZE), ()), cable=cable, start=found[0], goal=found[0]
    )


def lifted(cable: SpatialCable, seed: int) -> dict[str, Any]:
    """What became of a cable that was laid down and lifted."""
    try:
        plant = SpatialPlant(task := task_of(cable, seed), seed=seed)
    except CablewayError as error:
        return {"start": str(error)}
    steps = round((float(task.gripper_poses("start")[0, 2]) - cable.radius) / STEP)
    up = np.zeros((2, 6))
    up[:, 2] = STEP
    try:
        for action in [-up] * steps + [0 * up] * RESTING:
            plant.step(action)
        laid = plant.measure()
        off: float | None = None
        for _ in range(steps):
            plant.step(up)
            touches = plant.measure().clearance < TOUCHING
            off = None if touches else off if off is not None else float(plant.measure().poses[:, 2].min())
        for _ in range(RESTING):
            plant.step(0 * up)
    except CablewayError as error:
        return {"failed": str(error)}
    away = np.linalg.norm(plant.measure().keypoints - task.keypoints("start"), axis=1)
    on_table = laid.centreline[:, 2] < cable.radius + 0.002
    return {"off_table": off, "deviation": float(away.max()), "on_table": float(on_table.mean())}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("presets", nargs="*", default=preset_names())
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path("runs/lifting"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    lines = [("cable", "weight", "lifts", "carried", "deviation [mm]", "on the table [%]", "off the table [L]")]
    for name in given.presets:
        cable, rows = SpatialCable.of_preset(name), []
        for seed in range(given.draws):
            file = given.out / f"{name}-{seed}.json"
            if not file.exists():
                write_json(file, lifted(cable, seed))
            rows.append(json.loads(file.read_text()))
            print(name, seed, rows[-1], flush=True)
        lines.append(line(name, cable, rows))
    print("\n" + Table("", tuple(lines)).markdown())


def line(name: str, cable: SpatialCable, rows: list[dict[str, Any]]) -> tuple[str, ...]:
    """A row of the table; a lift that failed counts as one that did not carry."""
    tried = [row for row in rows if "start" not in row]
    done = [row for row in tried if "failed" not in row]
    away, lying = (np.array([row[what] for row in done]) for what in ("deviation", "on_table"))
    off = np.array([row["off_table"] for row in done if row["off_table"] is not None]) / cable.length
    carried = int(np.sum(away < CARRIED))

    def spread(values: np.ndarray, digits: int) -> str:
        return f"{np.median(values):.{digits}f} / {values.max():.{digits}f}" if len(values) else "-"

    return (
        name, f"{cable.weight:.1f}", str(len(tried)), str(carried), spread(1000 * away, 1), spread(100 * lying, 0),
        spread(off, 2),
    )  # fmt: skip


if __name__ == "__main__":
    main()
