"""The way that the grippers came, on which they may go back."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.estimation.gating import connected, poses_usable
from cableway.geometry.groups import SE2
from cableway.records import Observation
from cableway.scene.clearance import clearances
from cableway.scene.task import Task
from cableway.tracking.observed import at_rest

BESIDE = 0.015
"""Mean distance [m] of the keypoints from where they were seen on the way there, less what the grippers moved since, up
to which the cable goes back as it came: what a contact or friction does. One that snapped is farther off."""

FRAMES = 5
"""Frames in a row that say where the cable was, in whose later half each keypoint was most likely seen."""

ROOM_BACK = 0.001
"""Clearance [m] down to which the grippers go back the way they came, on which nothing was in theirs."""


class Motion(NamedTuple):
    """What was sent while a plan was followed, and what was seen before it: keypoints [m] and gripper poses."""

    action: Float[np.ndarray, "2 3"]
    keypoints: Float[np.ndarray, "n 2"]
    poses: Float[np.ndarray, "2 3"]


def had_room(way: list[Motion], observation: Observation, task: Task) -> bool:
    """Whether the cable lies near where it was seen on the way there, where it had room.

    Grippers that go back then lead it there again.

    Args:
        way: The motions so far, the last one of which would be taken back.
        observation: The newest one.
        task: With the scene as it is known.
    """
    now = connected(observation.keypoints, task.cable)
    if not (np.isfinite(now).all() and poses_usable(observation)):
        return False
    recent = way[-FRAMES:]
    lay, since = at_rest([motion.keypoints for motion in recent], way[-1].poses), recent[len(recent) // 2].poses
    led = np.linalg.norm(SE2.position(observation.poses) - SE2.position(since), axis=1).max()
    if np.linalg.norm(now - lay, axis=1).mean() > led + BESIDE:
        return False
    here, there = clearances(np.stack([now, lay]), np.stack([observation.poses, way[-1].poses]), task)
    return bool((there >= np.minimum(ROOM_BACK, here)).all())
