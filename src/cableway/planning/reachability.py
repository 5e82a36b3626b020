"""Why there is no plan: a gap that the grippers or the cable would have to pass, and that is too narrow.

A gripper's disc must go from its place at the start to its place at the goal, and so must a disc as thick as the
cable about the cable's middle. On a grid, connectivity of the places where the signed distance is at least r - h/sqrt 2
(h the grid's spacing) is necessary for that, because the distance changes no faster than the place. So what is
reported is certain; narrower misses than h sqrt 2 are not seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from cableway.planning.pivot import pivot_keypoint
from cableway.scene.task import Task

SPACING = 0.0025
"""Of the grid [m]."""


@dataclass(frozen=True)
class Blockage:
    """A way that is too narrow.

    Attributes:
        who: What would have to pass.
        needed: Width [m] that it needs.
        widest: Width [m] of the narrowest place on the widest way there is, to the grid's precision; 0 for none.
        place: (2,) [m] where that is.
    """

    who: str
    needed: float
    widest: float
    place: Float[np.ndarray, "2"]

    def __str__(self) -> str:
        x, y = self.place
        wide = f"about {1000 * self.widest:.0f} mm wide" if self.widest > 0 else "closed"
        return (
            f"{self.who} needs a way {1000 * self.needed:.0f} mm wide from start to goal, and the widest one is {wide} "
            f"at ({x:.3f}, {y:.3f})"
        )


def find_blockage(task: Task) -> Blockage | None:
    """The first of left gripper, right gripper and cable that certainly cannot pass; None where all may."""
    counts = np.maximum(2, np.ceil(np.array(task.scene.size) / SPACING).astype(int) + 1)
    axes = [np.linspace(0, size, count) for size, count in zip(task.scene.size, counts, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = task.scene.signed_distance(nodes)
    middle = pivot_keypoint(task.cable.keypoints)
    for who, keypoint, radius in (
        ("the left gripper", 0, task.grippers.radius),
        ("the right gripper", -1, task.grippers.radius),
        ("the cable", middle, task.cable.radius),
    ):
        ends = [_node(point, axes) for point in (task.start[keypoint], task.goal[keypoint])]
        blocked = _narrowest(distance, ends, radius - SPACING / np.sqrt(2))
        if blocked is not None:
            half_width, at = blocked
            place = nodes[at]
            return Blockage(who, 2 * radius, 2 * max(0.0, half_width), place)
    return None


def _node(point: np.ndarray, axes: list[np.ndarray]) -> tuple[int, int]:
    i, j = (int(np.argmin(np.abs(axis - x))) for axis, x in zip(axes, point, strict=True))
    return i, j


def _connected(distance: np.ndarray, ends: list[tuple[int, int]], least: float) -> bool:
    free = distance >= least
    for end in ends:
        free[end] = True
    labels, _ = ndimage.label(free, structure=np.ones((3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
    return bool(labels[ends[0]] == labels[ends[1]])


def _narrowest(distance: np.ndarray, ends: list[tuple[int, int]], least: float) -> tuple[float, tuple[int, int]] | None:
    """Where no way keeps `least`: the distance that the widest way keeps, and the node where it keeps no more."""
    if _connected(distance, ends, least):
        return None
    low, high = float(distance.min()), least
    while high - low > 1e-4:
        level = 0.5 * (low + high)
        low, high = (level, high) if _connected(distance, ends, level) else (low, level)
    labels, _ = ndimage.label(distance >= high, structure=np.ones((3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
    band = (distance >= low) & (distance < high)
    around = np.asarray(ndimage.binary_dilation(labels == labels[ends[0]], iterations=2), dtype=bool)
    near = np.logical_and(around, band)
    rows = np.argwhere(near if near.any() else band)
    i, j = rows[len(rows) // 2]
    return low, (int(i), int(j))
