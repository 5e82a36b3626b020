"""Rigid bodies that move with a gripper: convex outlines on its frame, between two heights.

A body's outline is a convex polygon with its vertices counter-clockwise, grown by a rounding radius; a disc is one
vertex with a rounding. The gripper's disc and the plug are bodies. Search, optimisation, controllers, watchdog and
simulator read them from `Task.bodies`, so that a new shape is one more body.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cableway.core.compiled import inlined
from cableway.geometry import se2
from cableway.geometry.convex import distance_at, segment_clearance

LEFT, RIGHT = 0, 1
"""The gripper that a body moves with."""


@dataclass(frozen=True)
class Body:
    """A rigid convex body on the frame of a gripper.

    Attributes:
        name: For messages, such as "left gripper".
        side: `LEFT` or `RIGHT`.
        outline: (k, 2) vertices [m] in the gripper's frame, counter-clockwise; x points along the cable's tangent.
        rounding: By which the outline is grown [m].
        heights: Lowest and highest point above the table [m].
    """

    name: str
    side: int
    outline: Float[np.ndarray, "k 2"]
    rounding: float = 0.0
    heights: tuple[float, float] = (-math.inf, math.inf)

    @classmethod
    def disc(cls, name: str, side: int, radius: float) -> Body:
        """A disc of a radius [m] about the origin of the frame."""
        return cls(name, side, np.zeros((1, 2)), radius)

    @classmethod
    def box(cls, name: str, side: int, length: float, width: float) -> Body:
        """A rectangle `length` [m] ahead of the origin of the frame, `width` [m] across."""
        half = width / 2
        return cls(name, side, np.array([[0.0, -half], [length, -half], [length, half], [0.0, half]]))

    def boundary(self, spacing: float) -> Float[np.ndarray, "m 2"]:
        """Points [m] at most `spacing` apart round the outline, the last one the first again, in the frame.

        >>> Body.box("plug", RIGHT, 0.04, 0.01).boundary(0.04).tolist()
        [[0.0, -0.005], [0.04, -0.005], [0.04, 0.005], [0.0, 0.005], [0.0, -0.005]]
        """
        corners = np.vstack([self.outline, self.outline[:1]])
        sides = []
        for a, b in pairwise(corners):
            count = int(np.ceil(np.linalg.norm(b - a) / spacing - 1e-9))
            sides.append(a + np.arange(count)[:, None] / count * (b - a))
        return np.vstack([*sides, corners[:1]])

    def placed(self, poses: Float[np.ndarray, "... 3"], spacing: float = math.inf) -> Float[np.ndarray, "... m 2"]:
        """`boundary` [m] with the frame at `poses` [m, m, rad]; the one vertex of a disc where it is a disc."""
        poses = np.asarray(poses, float)[..., None, :]
        points = self.outline if len(self.outline) == 1 else self.boundary(spacing)
        x, y = points.T[..., None]
        return poses[..., :2] + x * se2.direction(poses[..., 2]) + y * se2.direction(poses[..., 2] + np.pi / 2)


class PackedBodies(NamedTuple):
    """Bodies for the compiled kernels, each with the distance that its outline keeps.

    Attributes:
        side: (b,) gripper that each moves with.
        outline: (b, v, 2) [m] in its frame, rows past `counts` unused.
        counts: (b,) vertices of each.
        distance: (b,) [m] that its outline keeps from obstacles and walls, the rounding included.
    """

    side: Int[np.ndarray, "b"]
    outline: Float[np.ndarray, "b v 2"]
    counts: Int[np.ndarray, "b"]
    distance: Float[np.ndarray, "b"]


def pack(bodies: Sequence[Body], distance: Sequence[float]) -> PackedBodies:
    """Pack bodies with the distance [m] that each outline keeps."""
    outline = np.zeros((len(bodies), max((len(body.outline) for body in bodies), default=1), 2))
    for row, body in zip(outline, bodies, strict=True):
        row[: len(body.outline)] = body.outline
    counts = np.array([len(body.outline) for body in bodies], dtype=np.int64)
    sides = np.array([body.side for body in bodies], dtype=np.int64)
    return PackedBodies(sides, outline, counts, np.array(distance, dtype=float))


@inlined
def bodies_keep_distance(poses, bodies, world):
    """Whether all bodies keep their distance from obstacles and walls with the grippers at `poses` (2, 3)."""
    for b in range(len(bodies.side)):
        pose, count, wanted = poses[bodies.side[b]], bodies.counts[b], bodies.distance[b]
        c, s = math.cos(pose[2]), math.sin(pose[2])
        outline = bodies.outline[b]
        ax = pose[0] + c * outline[count - 1, 0] - s * outline[count - 1, 1]
        ay = pose[1] + s * outline[count - 1, 0] + c * outline[count - 1, 1]
        if count == 1:
            if distance_at(ax, ay, world) < wanted:
                return False
            continue
        for i in range(count):
            bx = pose[0] + c * outline[i, 0] - s * outline[i, 1]
            by = pose[1] + s * outline[i, 0] + c * outline[i, 1]
            if segment_clearance(ax, ay, bx, by, world, wanted)[0] < wanted:
                return False
            ax, ay = bx, by
    return True
