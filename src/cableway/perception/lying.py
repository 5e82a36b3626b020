"""The plane of a table by pictures of a board that lies on it: at a place that is known, and slid about on it.

The board of one picture says little of how a plane is tilted: corners are off by a tenth of a pixel, and a board is
small. Boards all over the table, in one plane wherever they lie, say it several times better. Where each lies is found
with the plane, by least squares over the pixels of all corners.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cableway.perception.charuco import Corners, Lens, seen_board

STRAY = 0.2
"""Distance [pixels] of a corner from where it should be seen from which on it counts less."""


def first_of_plane(lens: Lens, lying: Sequence[Corners]) -> tuple[Float[np.ndarray, "4 4"], float]:
    """The pose of the first of several boards that lie in one plane, in the frame of the camera.

    Args:
        lens: Of the camera.
        lying: Corners of a board in each picture.

    Returns:
        The pose, and the root mean square distance [pixels] of all corners from where they should be seen.
    """
    first, *others = (seen_board(lens, corners) for corners in lying)
    within = [np.linalg.inv(first) @ other for other in others]
    places = [(at[0, 3], at[1, 3], math.atan2(at[1, 0], at[0, 0])) for at in within]
    begun = [*Rotation.from_matrix(first[:3, :3]).as_rotvec(), *first[:3, 3], *np.ravel(places)]

    def off(guess: Float[np.ndarray, "m"]) -> Float[np.ndarray, "k"]:
        poses = [_lies(0.0, 0.0, 0.0), *(_lies(*place) for place in guess[6:].reshape(-1, 3))]
        shown = [
            lens.shown(corners.points, _plane(guess) @ pose) - corners.pixels
            for corners, pose in zip(lying, poses, strict=True)
        ]
        return np.concatenate(shown).ravel()

    found = least_squares(off, begun, loss="soft_l1", f_scale=STRAY, x_scale="jac").x
    return _plane(found), math.sqrt(2 * float(np.mean(off(found) ** 2)))


def _plane(guess: Float[np.ndarray, "m"]) -> Float[np.ndarray, "4 4"]:
    """The pose of the first board by the first six numbers."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(guess[:3]).as_matrix(), guess[3:6]
    return pose


def _lies(x: float, y: float, angle: float) -> Float[np.ndarray, "4 4"]:
    """A board's pose in the plane of the first one, in the frame of that."""
    pose, (c, s) = np.eye(4), (math.cos(angle), math.sin(angle))
    pose[:2, :2], pose[:2, 3] = [[c, -s], [s, c]], [x, y]
    return pose
