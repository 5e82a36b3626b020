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

from cableway.perception.charuco import Corners, Lens, pose_of

STRAY = 0.2
"""Distance [pixels] of a corner from where it should be seen from which on it counts less."""


def first_of_plane(
    lens: Lens, lying: Sequence[Corners], boards: Float[np.ndarray, "k 4 4"]
) -> tuple[Float[np.ndarray, "4 4"], float]:
    """The pose of the first of several boards that lie in one plane, in the frame of the camera.

    Args:
        lens: Of the camera.
        lying: Corners of a board in each picture.
        boards: Where each is by its own picture, the same.

    Returns:
        The pose, and the root mean square distance [pixels] of all corners from where they should be seen.
    """
    first, within = boards[0], np.linalg.inv(boards[0]) @ boards[1:]
    places = np.column_stack([within[:, :2, 3], np.arctan2(within[:, 1, 0], within[:, 0, 0])])
    begun = np.concatenate([Rotation.from_matrix(first[:3, :3]).as_rotvec(), first[:3, 3], places.ravel()])

    def off(guess: Float[np.ndarray, "m"]) -> Float[np.ndarray, "k"]:
        pose, slid = pose_of(guess[:3], guess[3:6]), guess[6:].reshape(-1, 3)
        there = [pose @ pose_of(np.array([0.0, 0.0, angle]), np.array([x, y, 0.0])) for x, y, angle in slid]
        return lens.off(lying, [pose, *there]).ravel()

    found = least_squares(off, begun, loss="soft_l1", f_scale=STRAY, x_scale="jac").x
    return pose_of(found[:3], found[3:6]), math.sqrt(2 * float(np.mean(off(found) ** 2)))
