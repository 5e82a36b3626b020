"""Where the links of an arm of Universal Robots are, and which joint angles bring its flange somewhere.

Frames and signs are those of the maker's Denavit-Hartenberg parameters: link i turns about the z axis of frame i - 1.
The inverse is in closed form: two choices each of shoulder, wrist and elbow, 8 *branches*. A motion stays in its branch
unless it passes through a singularity, where two branches meet.

Poses in space are (3, 4) or (4, 4) matrices, the kernels take an arm as (6,) lengths d1, a2, a3, d4, d5, d6 [m].
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from cableway.core.compiled import inlined, kernel

BRANCHES = 8


@inlined
def _advance(frame, angle, d, a, sine, cosine, out):
    """The frame after a joint: turned by its angle, d along and a across, twisted by this sine and cosine."""
    c, s = math.cos(angle), math.sin(angle)
    for i in range(3):
        x, y, z = frame[i, 0], frame[i, 1], frame[i, 2]
        turned = c * y - s * x
        out[i, 0] = c * x + s * y
        out[i, 1] = cosine * turned + sine * z
        out[i, 2] = cosine * z - sine * turned
        out[i, 3] = frame[i, 3] + d * z + a * out[i, 0]


@kernel
def link_frames(lengths, base, joints, out):
    """Write the frames (7, 3, 4) of the base and of all links into `out`; `base` is (3, 4) or (4, 4)."""
    d1, a2, a3, d4, d5, d6 = lengths
    for i in range(3):
        for j in range(4):
            out[0, i, j] = base[i, j]
    _advance(out[0], joints[0], d1, 0.0, 1.0, 0.0, out[1])
    _advance(out[1], joints[1], 0.0, a2, 0.0, 1.0, out[2])
    _advance(out[2], joints[2], 0.0, a3, 0.0, 1.0, out[3])
    _advance(out[3], joints[3], d4, 0.0, 1.0, 0.0, out[4])
    _advance(out[4], joints[4], d5, 0.0, -1.0, 0.0, out[5])
    _advance(out[5], joints[5], d6, 0.0, 0.0, 1.0, out[6])


@kernel
def branch_joints(lengths, flange, branch, out):
    """Write the joints (6,) in [-pi, pi) that bring the flange to a pose (3, 4) in the frame of the base, in a branch.

    Returns the distance from the nearest singularity: the least of the sines of elbow and wrist, and of the shoulder's
    angle, as far as they are defined; negative where the branch does not reach the pose.

    Note:
        With z the axis of joints 2 to 4, (sin q1, -cos q1, 0): the wrist centre is d4 along z from the base's axis, the
        flange d4 + d6 cos q5. The three joints between are a planar arm.
    """
    d1, a2, a3, d4, d5, d6 = lengths
    wx, wy = flange[0, 3] - d6 * flange[0, 2], flange[1, 3] - d6 * flange[1, 2]
    radius = math.hypot(wx, wy)
    if radius <= abs(d4):
        return -1.0
    swing = math.acos(d4 / radius)
    q1 = math.atan2(wy, wx) + math.pi / 2 + (swing if branch < 4 else -swing)
    s1, c1 = math.sin(q1), math.cos(q1)
    c5 = (s1 * flange[0, 3] - c1 * flange[1, 3] - d4) / d6
    if abs(c5) > 1.0:
        return -1.0
    q5 = math.acos(c5) if branch % 4 < 2 else -math.acos(c5)
    s5 = math.sin(q5)
    if abs(s5) < 1e-9:
        return 0.0
    q6 = math.atan2(-(s1 * flange[0, 1] - c1 * flange[1, 1]) / s5, (s1 * flange[0, 0] - c1 * flange[1, 0]) / s5)
    # in the plane of the middle joints, along (cos q1, sin q1, 0) and up: the x axis of frame 4, and its origin
    s6, c6 = math.sin(q6), math.cos(q6)
    ahead = c1 * (c6 * flange[0, 0] - s6 * flange[0, 1]) + s1 * (c6 * flange[1, 0] - s6 * flange[1, 1])
    up = c6 * flange[2, 0] - s6 * flange[2, 1]
    total = math.atan2(c5 * up - s5 * flange[2, 2], c5 * ahead - s5 * (c1 * flange[0, 2] + s1 * flange[1, 2]))
    aside = c1 * (s6 * flange[0, 0] + c6 * flange[0, 1]) + s1 * (s6 * flange[1, 0] + c6 * flange[1, 1])
    x = c1 * wx + s1 * wy + d5 * aside
    y = flange[2, 3] - d6 * flange[2, 2] + d5 * (s6 * flange[2, 0] + c6 * flange[2, 1]) - d1
    c3 = (x * x + y * y - a2 * a2 - a3 * a3) / (2 * a2 * a3)
    if abs(c3) > 1.0:
        return -1.0
    q3 = math.acos(c3) if branch % 2 == 0 else -math.acos(c3)
    s3 = math.sin(q3)
    q2 = math.atan2(y, x) - math.atan2(a3 * s3, a2 + a3 * c3)
    out[0], out[1], out[2], out[3], out[4], out[5] = q1, q2, q3, total - q2 - q3, q5, q6
    for i in range(6):
        out[i] -= 2 * math.pi * math.floor((out[i] + math.pi) / (2 * math.pi))
    return min(abs(s3), abs(s5), math.sin(swing))


@kernel
def branch_motion(lengths, flanges, branch, least, out):
    """Write the joints (t, 6) [-pi, pi) along a motion (t, 3, 4) of the flange, in the frame of the base, in a branch.

    Returns how many poses are reached, one after the other, no nearer to a singularity than `least`.
    """
    for t in range(len(flanges)):
        if branch_joints(lengths, flanges[t], branch, out[t]) < least:
            return t
    return len(flanges)


def flange_poses(
    poses: Float[np.ndarray, "t 3"], reach: float, height: Float[np.ndarray, "t"] | float, turn: int, lean: float = 0.0
) -> Float[np.ndarray, "t 4 4"]:
    """Poses of a flange whose tool points down and holds the cable at gripper poses [m, m, rad].

    Args:
        poses: Of the gripper.
        reach: From the flange to the cable [m].
        height: Of the cable's axis above the table [m].
        turn: 0 or 1: the flange's y axis, along which the fingers move, is to the left of the cable or to its right.
        lean: Turn about the gripper's y axis from straight down, see `outward` [rad].
    """
    sign, upright, aside = 1.0 - 2.0 * turn, math.cos(lean), math.sin(lean)
    along = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    flanges = np.zeros((len(poses), 4, 4))
    flanges[:, :2, 0], flanges[:, 2, 0] = -sign * upright * along, sign * aside
    flanges[:, 0, 1], flanges[:, 1, 1] = -sign * along[:, 1], sign * along[:, 0]
    flanges[:, :2, 2], flanges[:, 2, 2], flanges[:, 3, 3] = -aside * along, -upright, 1.0
    flanges[:, :2, 3], flanges[:, 2, 3] = poses[:, :2] + reach * aside * along, height + reach * upright
    return flanges


def gripper_poses(flanges: Float[np.ndarray, "t 3 4"], reach: float, turn: int) -> Float[np.ndarray, "t 3"]:
    """Gripper poses [m, m, rad] of flanges, the inverse of `flange_poses`: those of the tip, seen from above."""
    sign = 1.0 - 2.0 * turn
    angle = np.arctan2(-sign * flanges[:, 1, 0], -sign * flanges[:, 0, 0])
    return np.column_stack([flanges[:, :2, 3] + reach * flanges[:, :2, 2], angle])
