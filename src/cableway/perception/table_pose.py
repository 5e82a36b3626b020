"""Where a camera is over a table, by pictures of a board in hand and lying there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from cableway.core.errors import InputError
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.charuco import (
    LEAST_CORNERS,
    LEAST_PICTURES,
    MARKER_PIXELS,
    Board,
    corners_of,
    fitted_lens,
)
from cableway.perception.lying import first_of_plane


@dataclass(frozen=True, eq=False)
class Calibration:
    """What pictures of a board say.

    Attributes:
        camera: The camera, in the frame of the table.
        lens_residual: Root mean square distance [pixels] of corners from where the lens would show them, all pictures.
        table_residual: The same of the pictures with the board on the table, were it flat there.
        pictures: Pictures that counted.
        corners: Corners in all of them.
    """

    camera: CalibratedCamera
    lens_residual: float
    table_residual: float
    pictures: int
    corners: int


def calibrate(
    images: Sequence[UInt8[np.ndarray, "h w 3"]],
    on_table: Sequence[UInt8[np.ndarray, "h w 3"]],
    board: Board,
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Calibration:
    """The camera that took pictures of a board.

    Args:
        images: Of the board in various poses, near and slanted; (red, green, blue).
        on_table: Of the board flat on the table, its face up: one of it at a place that is known, and others of it
            anywhere on the table, all over it, by which it is known better how the table is tilted.
        board: What it is.
        place: Where its first corner is in the first of them, and along which angle its first row goes (x, y, theta)
            [m, m, rad]: the corner of the printed board that is the upper left one of its drawing.

    Raises:
        InputError: The pictures differ in size, show too few corners, or too few of them show enough.
        MissingExtraError: OpenCV is not installed.
    """
    every, size = corners_of(board, (*on_table, *images))
    lying, found = every[: len(on_table)], [corners for corners in every if corners is not None]
    if len(found) < LEAST_PICTURES:
        raise InputError(
            f"{len(found)} of {len(every)} pictures show {LEAST_CORNERS} corners of the board or more; "
            f"{LEAST_PICTURES} must"
        )
    if not lying or lying[0] is None:
        raise InputError(
            f"the picture of the board on the table shows fewer than {LEAST_CORNERS} of its corners: all of it must be "
            f"in the picture, and its markers {MARKER_PIXELS} pixels wide or wider there"
        )
    lens = fitted_lens(found, size)
    flat = [corners for corners in lying if corners is not None]
    seen, residual = first_of_plane(lens, flat, lens.boards[: len(flat)])
    camera = lens.camera(size, *_of_table(seen[:3, :3], seen[:3, 3], place))
    return Calibration(camera, lens.residual, residual, len(found), sum(len(points) for points, _ in found))


def _of_table(
    rotation: Float[np.ndarray, "3 3"], translation: Float[np.ndarray, "3"], place: tuple[float, float, float]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Of the table into the camera's frame, from the same of the board, whose z axis points into the table."""
    x, y, angle = place
    c, s = math.cos(angle), math.sin(angle)
    lies = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])  # the board's axes, as columns, on the table
    turned = rotation @ lies.T
    return turned, translation - turned @ np.array([x, y, 0.0])
