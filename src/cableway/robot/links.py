"""Distances of the links of arms, as capsules, from each other, the table and what stands on it; compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cableway.core.compiled import inlined, kernel
from cableway.geometry.convex import segment_clearance
from cableway.robot.kinematics import link_frames
from cableway.scene.arm_models import ArmModel
from cableway.scene.cell import Tool
from cableway.scene.scene import Scene

APART = 3
"""Joints between two links of an arm that can touch each other; nearer ones are kept apart by limits of position."""


class Capsules(NamedTuple):
    """The links of an arm and its tool: segments with a radius.

    Attributes:
        frame: (k,) frame that each moves with, 0 the base to 6 the flange.
        ends: (k, 2, 3) of its segment in that frame [m].
        radius: (k,) [m].
        hand: Which is the tool's first; the links' come before it.
    """

    frame: Int[np.ndarray, "k"]
    ends: Float[np.ndarray, "k 2 3"]
    radius: Float[np.ndarray, "k"]
    hand: int

    @classmethod
    def of(cls, model: ArmModel, tool: Tool) -> Capsules:
        """Those of an arm with a tool."""
        every = (*model.capsules, *tool.capsules)
        return cls(
            np.array([each.frame for each in every]),
            np.array([[each.start, each.end] for each in every], float),
            np.array([each.radius for each in every]),
            len(model.capsules),
        )


def world_of_arms(scene: Scene) -> tuple[np.ndarray, ...]:
    """What links may touch, for `arm_clearances`: obstacles, but not the walls, which arms come over."""
    *world, heights = scene.world.arrays
    return (*world, np.append(heights[:-1], -np.inf))


@inlined
def segment_gap(p, q, r, s):
    """Distance of the segments p-q and r-s in space (Ericson 2005, Real-Time Collision Detection, 5.1.9)."""
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = s[0] - r[0], s[1] - r[1], s[2] - r[2]
    wx, wy, wz = p[0] - r[0], p[1] - r[1], p[2] - r[2]
    a, e, f = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, vx * wx + vy * wy + vz * wz
    b, c = ux * vx + uy * vy + uz * vz, ux * wx + uy * wy + uz * wz
    across = a * e - b * b
    along = min(max((b * f - c * e) / across, 0.0), 1.0) if across > 1e-15 else 0.0
    other = (b * along + f) / e if e > 1e-15 else 0.0
    if other < 0.0 or other > 1.0 or e <= 1e-15:
        other = min(max(other, 0.0), 1.0)
        along = min(max((b * other - c) / a, 0.0), 1.0) if a > 1e-15 else 0.0
    x, y, z = wx + along * ux - other * vx, wy + along * uy - other * vy, wz + along * uz - other * vz
    return math.sqrt(x * x + y * y + z * z)


@inlined
def _own_clearance(ends, capsules, world):
    """Least clearance in one row, see `arm_clearances`."""
    frame, _, radius, hand = capsules
    least = np.inf
    for k in range(len(frame)):
        if frame[k] >= 2 and k < hand:
            a, b = ends[k, 0], ends[k, 1]
            lowest = min(a[2], b[2]) - radius[k]
            gap = segment_clearance(a[0], a[1], b[0], b[1], world, least + radius[k], lowest)[0] - radius[k]
            least = min(least, lowest, gap)
        for j in range(k):
            if frame[j] <= frame[k] - APART:
                gap = segment_gap(ends[k, 0], ends[k, 1], ends[j, 0], ends[j, 1])
                least = min(least, gap - radius[k] - radius[j])
    return least


@kernel
def arm_clearances(lengths, base, joints, capsules, world, placed):
    """Least clearance (t,) of an arm's links from the table, obstacles and links `APART` joints away.

    Its tool meets links only, since the bodies of grippers measure the rest. An obstacle that is higher than a link's
    lowest point is met where their outlines seen from above meet: too little room may be found, never too much.
    Writes the ends of the capsules in the world into `placed` (t, k, 2, 3); `joints` is (t, 6).
    """
    out, frames = np.empty(len(joints)), np.empty((7, 3, 4))
    for t in range(len(joints)):
        link_frames(lengths, base, joints[t], frames)
        for k in range(len(capsules.frame)):
            frame = frames[capsules.frame[k]]
            for end in range(2):
                at = capsules.ends[k, end]
                for i in range(3):
                    placed[t, k, end, i] = frame[i, 3] + frame[i, 0] * at[0] + frame[i, 1] * at[1] + frame[i, 2] * at[2]
        out[t] = _own_clearance(placed[t], capsules, world)
    return out


@kernel
def _balls(ends, capsules, out):
    """Write centres and radii (k, 4) of balls about capsules with ends (k, 2, 3) into `out`."""
    for k in range(len(ends)):
        squared = 0.0
        for i in range(3):
            out[k, i] = 0.5 * (ends[k, 0, i] + ends[k, 1, i])
            squared += (ends[k, 1, i] - ends[k, 0, i]) ** 2
        out[k, 3] = 0.5 * math.sqrt(squared) + capsules.radius[k]


@kernel
def arms_gaps(left, left_capsules, right, right_capsules):
    """Distance (t,) of two arms from the ends of their capsules (t, k, 2, 3); not that of one tool from the other."""
    out = np.empty(len(left))
    balls, others = np.empty((left.shape[1], 4)), np.empty((right.shape[1], 4))
    for t in range(len(left)):
        least = np.inf
        _balls(left[t], left_capsules, balls)
        _balls(right[t], right_capsules, others)
        for i in range(len(left_capsules.frame)):
            for j in range(len(right_capsules.frame)):
                if i < left_capsules.hand or j < right_capsules.hand:
                    near = least + balls[i, 3] + others[j, 3]
                    squared = 0.0
                    for k in range(3):
                        squared += (balls[i, k] - others[j, k]) ** 2
                    if near > 0.0 and squared >= near * near:
                        continue
                    gap = segment_gap(left[t, i, 0], left[t, i, 1], right[t, j, 0], right[t, j, 1])
                    least = min(least, gap - left_capsules.radius[i] - right_capsules.radius[j])
        out[t] = least
    return out
