"""Before the first motion: does what is observed fit the start of the plan, and if not, which mistake explains it?"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.core.quantities import quantity
from cableway.geometry.groups import SE2
from cableway.geometry.se2 import wrap_angle
from cableway.records import Observation, Plan
from cableway.scene.task import Task

OFF = 0.03
"""Mean distance [m] of keypoints or grippers from the start of the plan beyond which an explanation is looked for."""

TURNED = 0.3
"""The same for the angle of a gripper [rad]."""

BENT = 0.6
"""Angle [rad] between the cable's tangent at a gripper, by its keypoints, and the gripper, beyond which one is wrong.

Grasps askew by 10 degrees, rest curvature, and noise of 2 mm leave less than a third of it as a rule, and strongly bent
ends more than all of it: so much counts only where the keypoints are mirrored, see `ends_off`."""

TELLING = (7, 13)
"""Keypoints from which on the tangents at the ends are known from them, and as many as noise leaves useful."""

SIDES = ("left", "right")

FITS = 0.25
"""Share of the difference that may be left where a mistake explains it."""


def setup_mistake(observation: Observation, plan: Plan, task: Task) -> str:
    """A sentence on a mistake in the set-up of a robot or a camera that explains the first observation; "" for none.

    A cable that merely lies elsewhere is no such mistake.

    Args:
        observation: The first one.
        plan: What is about to be followed.
        task: With the size of the workspace.
    """
    mistake = _explained(observation.keypoints, plan.shapes[0], task, "the camera's keypoints")
    return mistake or _explained_poses(observation.poses, plan.poses[0], task)


def _explained(points: Float[np.ndarray, "k 2"], wanted: Float[np.ndarray, "k 2"], task: Task, what: str) -> str:
    """Which mistake brings points to where they should be."""
    size = np.array(task.scene.size)
    mistakes = {
        "look like millimetres, not metres": points / 1000,
        "look like centimetres, not metres": points / 100,
        "come in the opposite order; the first must be at the left gripper": points[::-1],
        "look as if y pointed downwards": points * [1.0, -1.0] + [0.0, size[1]],
        "look as if x pointed to the left": points * [-1.0, 1.0] + [size[0], 0.0],
        "look as if x and y were exchanged": points[:, ::-1],
    }
    off = _mean_distance(points, wanted)
    if not OFF < off < np.inf:
        return ""
    name = min(mistakes, key=lambda name: _mean_distance(mistakes[name], wanted))
    if _mean_distance(mistakes[name], wanted) > FITS * off:
        return ""
    return f"{what} {name}: they are {quantity(off)} off the start of the plan"


def _explained_poses(poses: Float[np.ndarray, "2 3"], wanted: Float[np.ndarray, "2 3"], task: Task) -> str:
    if not np.isfinite(poses).all():
        return ""
    mistake = _explained(SE2.position(poses), SE2.position(wanted), task, "the robot's gripper positions")
    turned = SE2.distance(poses, wanted)[1].max()
    in_degrees = np.column_stack([SE2.position(poses), np.radians(poses[:, SE2.space :])])
    if not mistake and turned > TURNED and SE2.distance(in_degrees, wanted)[1].max() <= FITS * turned:
        degrees = " and ".join(f"{angle:.4g}" for angle in poses[:, SE2.space])
        return f"the robot's gripper angles, {degrees}, look like degrees, not radians"
    return mistake


def _mean_distance(points: Float[np.ndarray, "k 2"], wanted: Float[np.ndarray, "k 2"]) -> float:
    """Of those that are there; infinite where none is."""
    distance = np.linalg.norm(points - wanted, axis=1)
    there = distance[np.isfinite(distance)]
    return float(there.mean()) if len(there) else np.inf


def disagreement(
    keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"], reference: Float[np.ndarray, "n 2"]
) -> str:
    """A sentence where the ends of a cable are not in its grippers, or its keypoints are mirrored; "" for neither.

    Args:
        keypoints: (n, 2) as observed [m], NaN where hidden.
        poses: (2, 3) grippers [m, m, rad].
        reference: (n, 2) where the keypoints should be [m].
    """
    return off_grippers(*ends_off(keypoints, poses[None], reference))


def ends_off(
    keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "k 2 3"], reference: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Least distance [m] and turn [rad] of each end of the cable from poses of its gripper, the newest last.

    A turn counts only where the keypoints are mirrored: mirrored about the line of the grippers, they would be nearer
    to where they should be, and turned less than half as far. Strongly bent ends are turned as far.
    """
    apart, turned = (off.min(axis=0) for off in SE2.distance(poses, cable_ends(keypoints)))
    left, right = SE2.position(poses[-1])
    along = (right - left) / max(np.linalg.norm(right - left), 1e-9)
    from_left = keypoints - left
    image = left + 2 * (from_left @ along)[:, None] * along - from_left
    left_over = SE2.distance(poses, cable_ends(image))[1].min(axis=0)
    is_mirrored = _mean_distance(image, reference) < _mean_distance(keypoints, reference)
    return apart, np.where(is_mirrored & (left_over < turned / 2), turned, 0.0)


def off_grippers(apart: Float[np.ndarray, "2"], turned: Float[np.ndarray, "2"]) -> str:
    """The sentence of `disagreement` on what `ends_off` returned; NaN where an end is hidden."""
    side = int(np.argmax(np.nan_to_num(np.fmax(apart / OFF, turned / BENT))))
    gripper = f"from where the {SIDES[side]} gripper is reported"
    if apart[side] > OFF:
        return f"the camera's cable ends {quantity(apart[side])} {gripper}"
    return (
        f"the camera's cable points {quantity(turned[side], 'rad')} away {gripper} to point"
        if turned[side] > BENT
        else ""
    )


def cable_ends(keypoints: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2 3"]:
    """Poses [m, m, rad] of a cable's ends; NaN where keypoints are hidden, angles where they are too few to tell."""
    if len(keypoints) < TELLING[0]:
        return np.column_stack([keypoints[[0, -1]], np.full(2, np.nan)])
    stride = max(1, (len(keypoints) - 1) // (TELLING[1] - 1))
    # of the two chords at each end, from the end inwards
    chords = np.diff(np.stack([keypoints[: 2 * stride + 1 : stride], keypoints[: -2 * stride - 2 : -stride]]), axis=1)
    angles = np.arctan2(chords[..., 1], chords[..., 0])
    bend = wrap_angle(angles[:, 1] - angles[:, 0])
    return np.column_stack([keypoints[[0, -1]], angles[:, 0] - bend / 2 + [0.0, np.pi]])
