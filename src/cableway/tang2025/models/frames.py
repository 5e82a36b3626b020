"""In which frame, and as a correction of what, a learned model predicts.

A learned network sees the cable in its own frame: origin midway between the grippers, first axis along the cable,
unit of length the cable's own length. A planar elastic cable without friction behaves the same under rigid motion
and, since its shape does not depend on its stiffness, at every size; in this frame both hold exactly. The network
then corrects the *end-motion blend*, the interpolation of the rigid motions of the two ends, with a window that
leaves the ends with their grippers. `Framing` switches each of the three on or off.

The first axis is the direction of sum_i (s_i - 1/2) p_i, which is the mean tangent with the most weight in the
middle. Unlike the line between the grippers it stays defined where the grippers meet, and unlike the mean of the two
gripper angles it does not jump where they differ by pi.

Note:
    None of it is in the paper (Tang et al.), whose models see and predict world coordinates; `Framing.plain()` does
    so. Angles enter as cosine and sine, so they have no jumps in either.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from cableway.core.checks import Checked, Choice

FrameName = Literal["cable", "world"]

TINY = 1e-12
"""Squared length [m^2] added under roots, so that a gradient stays finite where keypoints coincide."""


@dataclass(frozen=True, kw_only=True)
class Framing(Checked):
    """What surrounds the network of a learned model.

    Attributes:
        frame: "cable" for the cable's own frame and unit of length, "world" for metres in the world frame.
        blend: Predict the difference from the end-motion blend instead of the displacement itself.
        hard_ends: The first and last keypoint move exactly with their grippers.
        rod: Predict the difference from the step of a visco-elastic rod, whose parameters are learned too; takes
            the place of the blend.
        angles: Give the network the angles of the grippers and how they turn; the paper's ablation leaves them out.
    """

    frame: Annotated[FrameName, Choice("frame")] = "cable"
    blend: bool = True
    hard_ends: bool = True
    rod: bool = False
    angles: bool = True

    @classmethod
    def plain(cls) -> Framing:
        """World coordinates and nothing else, as in the paper."""
        return cls(frame="world", blend=False, hard_ends=False)


class Frame(NamedTuple):
    """A frame and a unit of length.

    Attributes:
        origin: (2,) [m].
        axes: (2, 2), the unit vectors of the frame in its columns.
        unit: Length of one unit [m].
    """

    origin: Float[Array, "2"]
    axes: Float[Array, "2 2"]
    unit: Float[Array, ""]


class Inputs(NamedTuple):
    """What a network sees, in the units of a frame.

    Attributes:
        keypoints: (n, 2) positions.
        poses: (2, 4) grippers' positions and the cosine and sine of their angles.
        motions: (2, 3) grippers' motions (dx, dy, dtheta).
    """

    keypoints: Float[Array, "n 2"]
    poses: Float[Array, "2 4"]
    motions: Float[Array, "2 3"]


def arc_fractions(count: int) -> Float[np.ndarray, "n"]:
    """Arc length of each keypoint over the cable's length, from 0 to 1."""
    return np.linspace(0.0, 1.0, count, dtype=np.float32)


def resampled(rows: Float[Array, "n k"], count: int) -> Float[Array, "m k"]:
    """The rows at another number of places at equal arc length, by cubic splines; the first and last stay."""
    return rows if len(rows) == count else jnp.asarray(_splines(len(rows), count)) @ rows


@lru_cache
def _splines(given: int, wanted: int) -> Float[np.ndarray, "m n"]:
    """Weight of each given row in each wanted one."""
    return CubicSpline(arc_fractions(given), np.eye(given))(arc_fractions(wanted)).astype(np.float32)


def cable_frame(keypoints: Float[Array, "n 2"], poses: Float[Array, "2 3"]) -> Frame:
    """The cable's own frame; it moves and grows with the cable."""
    offsets = jnp.asarray(arc_fractions(len(keypoints)) - 0.5)
    axis = offsets @ keypoints
    axis = axis / jnp.sqrt(jnp.sum(axis**2) + TINY)
    steps = keypoints[1:] - keypoints[:-1]
    unit = jnp.sum(jnp.sqrt(jnp.sum(steps**2, axis=-1) + TINY))
    axes = jnp.stack([axis, jnp.stack([-axis[1], axis[0]])], axis=1)
    return Frame(0.5 * (poses[0, :2] + poses[1, :2]), axes, unit)


def frame_of(framing: Framing, keypoints: Float[Array, "n 2"], poses: Float[Array, "2 3"]) -> Frame:
    """The frame that a framing asks for; that of the world is in metres."""
    if framing.frame == "cable":
        return cable_frame(keypoints, poses)
    return Frame(jnp.zeros(2), jnp.eye(2), jnp.ones(()))


def express(
    framing: Framing,
    frame: Frame,
    keypoints: Float[Array, "n 2"],
    poses: Float[Array, "2 3"],
    action: Float[Array, "2 3"],
) -> Inputs:
    """What the network sees of a sample, in the units of a frame; without `angles` these are 0."""
    inverse, shown = frame.axes / frame.unit, float(framing.angles)
    headings = shown * jnp.stack([jnp.cos(poses[:, 2]), jnp.sin(poses[:, 2])], axis=1) @ frame.axes
    return Inputs(
        keypoints=(keypoints - frame.origin[None]) @ inverse,
        poses=jnp.concatenate([(poses[:, :2] - frame.origin[None]) @ inverse, headings], axis=1),
        motions=jnp.concatenate([action[:, :2] @ inverse, shown * action[:, 2:]], axis=1),
    )


def rigid_motion(
    points: Float[Array, "k 2"], pose: Float[Array, "3"], motion: Float[Array, "3"]
) -> Float[Array, "k 2"]:
    """Displacement [m] of points fixed to a gripper at `pose` that moves by `motion`."""
    arms = points - pose[None, :2]
    c, s = jnp.cos(motion[2]) - 1.0, jnp.sin(motion[2])
    return motion[None, :2] + arms @ jnp.array([[c, s], [-s, c]])


def end_motion_blend(
    keypoints: Float[Array, "n 2"], poses: Float[Array, "2 3"], action: Float[Array, "2 3"]
) -> Float[Array, "n 2"]:
    """Displacement [m] by the two ends' rigid motions, the right one weighted 3 s^2 - 2 s^3 at arc fraction s.

    The weight is level at both ends, so the cable keeps the grippers' directions.
    """
    s = arc_fractions(len(keypoints))
    right = jnp.asarray(s * s * (3.0 - 2.0 * s))[:, None]
    left_motion = rigid_motion(keypoints, poses[0], action[0])
    right_motion = rigid_motion(keypoints, poses[1], action[1])
    return left_motion + right * (right_motion - left_motion)


def base_displacement(
    framing: Framing, keypoints: Float[Array, "n 2"], poses: Float[Array, "2 3"], action: Float[Array, "2 3"]
) -> Float[Array, "n 2"]:
    """What the network's output is added to [m]."""
    if framing.blend:
        return end_motion_blend(keypoints, poses, action)
    base = jnp.zeros_like(keypoints)
    if framing.hard_ends:
        ends = [
            rigid_motion(keypoints[i : i + 1], poses[j], action[j])[0] for i, j in ((0, 0), (len(keypoints) - 1, 1))
        ]
        base = base.at[0].set(ends[0]).at[-1].set(ends[1])
    return base


def correction_window(framing: Framing, count: int) -> Float[np.ndarray, "n"]:
    """Weight of the network's output at each keypoint.

    Beside the end-motion blend it is 16 s^2 (1 - s)^2 at arc fraction s: level zeros at both ends, 1 in the middle.
    """
    if framing.blend and framing.hard_ends:
        s = arc_fractions(count)
        return 16.0 * (s * (1.0 - s)) ** 2
    window = np.ones(count, dtype=np.float32)
    if framing.hard_ends:
        window[[0, -1]] = 0.0
    return window
