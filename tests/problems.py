"""Named problems with known properties, made in code and none of them in the catalogue."""

from __future__ import annotations

import numpy as np

from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Box, Disc, Obstacle
from cableway.scene.scene import Scene
from cableway.scene.task import Task

LOW_ARC = np.array([0.35, 0.14, 0.0, -14.0, 0.5, -2.4])
HIGH_ARC = np.array([0.33, 0.58, 0.2, -10.0, -0.5, 2.2])
MOVED_ARC = np.array([0.33, 0.55, 0.3, -10.0, -0.5, -1.8])


def task_between(
    start: np.ndarray, goal: np.ndarray, obstacles: tuple[Obstacle, ...] = (), *, name: str = "between", **cable: float
) -> Task:
    """A task whose ends are the equilibria `start` and `goal` (rod coordinates)."""
    made = Cable(**cable)  # pyright: ignore[reportArgumentType]
    shapes = made.rod.at_keypoints(made.rod.shapes(np.array([start, goal]))[0])
    return Task(name=name, scene=Scene(obstacles=obstacles), cable=made, start=shapes[0], goal=shapes[1])


def free() -> Task:
    """Nothing in the way: an arc is moved and bent the other way."""
    return task_between(LOW_ARC, HIGH_ARC, name="free")


def moved() -> Task:
    """Nothing in the way, and the straight line in q from start to goal is a true plan."""
    return task_between(LOW_ARC, MOVED_ARC, name="moved")


def beside_disc() -> Task:
    """A disc in the middle of the straight way."""
    return task_between(LOW_ARC, HIGH_ARC, (Disc(center=(0.34, 0.36), radius=0.07),), name="beside-disc")


def doorway() -> Task:
    """A wall with a 9 cm door at its right end."""
    return task_between(LOW_ARC, HIGH_ARC, (Box(center=(0.305, 0.36), size=(0.61, 0.03)),), name="doorway")


def sealed() -> Task:
    """A wall without a door: there is no plan."""
    return task_between(LOW_ARC, HIGH_ARC, (Box(center=(0.35, 0.36), size=(0.7, 0.03)),), name="sealed")


def slit(gap: float) -> Task:
    """A wall across the table with one gap [m], left of its middle."""
    left, right = 0.3 - gap / 2, 0.3 + gap / 2
    walls = (
        Box(center=(left / 2, 0.36), size=(left, 0.03)),
        Box(center=((right + 0.7) / 2, 0.36), size=(0.7 - right, 0.03)),
    )
    return task_between(LOW_ARC, HIGH_ARC, walls, name="slit")


SOLVABLE = {"free": free, "beside-disc": beside_disc, "doorway": doorway}


def line_in_q(rod: PlanarRod, start: np.ndarray, goal: np.ndarray, rows: int) -> np.ndarray:
    """Rod coordinates on the straight line from start to goal, (rows, 6)."""
    return start + np.linspace(0.0, 1.0, rows)[:, None] * (goal - start)
