"""Calibration by pictures of a ChArUco board: the lens, and where the camera is over the table.

The board is shown to the camera in several poses; in one picture it lies on the table at a place that is known. OpenCV
finds its corners and fits the lens (Zhang 2000, "A flexible new technique for camera calibration").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float, UInt8

from cableway.core.checks import Bounds, Checked, Positive
from cableway.core.errors import InputError, UnknownNameError
from cableway.core.extras import require
from cableway.perception.calibration import CalibratedCamera

LEAST_CORNERS = 8
"""Of the board in a picture, for the picture to count."""

LEAST_PICTURES = 4
"""With that many corners, for a lens."""


@dataclass(frozen=True, kw_only=True)
class Board(Checked):
    """A ChArUco board.

    Attributes:
        across: Squares in a row.
        down: Rows of squares.
        square: Side of a square [m].
        marker: Side of a marker [m].
        dictionary: OpenCV's name of the markers.

    Raises:
        InputError: A number is out of range, or a marker is not smaller than a square.
    """

    across: Annotated[int, Bounds(3, 40)] = 7
    down: Annotated[int, Bounds(3, 40)] = 5
    square: Positive[float] = 0.03
    marker: Positive[float] = 0.022
    dictionary: str = "DICT_4X4_50"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.marker < self.square:
            raise InputError(f"marker must be smaller than a square of {self.square!r} m, got {self.marker!r}")

    def in_opencv(self) -> Any:
        """The `cv2.aruco.CharucoBoard`.

        Raises:
            MissingExtraError: OpenCV is not installed.
            UnknownNameError: There is no such dictionary; the message lists them.
        """
        require("vision", "a ChArUco board")
        import cv2

        names = sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))
        if self.dictionary not in names:
            raise UnknownNameError("dictionary", self.dictionary, names)
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        return cv2.aruco.CharucoBoard((self.across, self.down), self.square, self.marker, markers)


@dataclass(frozen=True, eq=False)
class Calibration:
    """What pictures of a board say.

    Attributes:
        camera: The camera, in the frame of the table.
        lens_residual: Root mean square distance [pixels] of corners from where the lens would show them, all pictures.
        table_residual: The same of the picture with the board on the table.
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
    on_table: UInt8[np.ndarray, "h w 3"],
    board: Board,
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Calibration:
    """The camera that took pictures of a board.

    Args:
        images: Of the board in various poses, near and slanted; (red, green, blue).
        on_table: Of the board flat on the table, its face up.
        board: What it is.
        place: Where its first corner is then, and along which angle its first row goes (x, y, theta) [m, m, rad]: the
            corner of the printed board that is the upper left one of its drawing.

    Raises:
        InputError: The pictures differ in size, show too few corners, or too few of them show enough.
        MissingExtraError: OpenCV is not installed.
    """
    drawn = board.in_opencv()
    import cv2

    sizes = {image.shape for image in (*images, on_table)}
    if len(sizes) != 1:
        raise InputError(f"pictures of one camera must be of one size, got {sorted(shape[:2] for shape in sizes)}")
    height, width, _ = on_table.shape
    found = [each for image in (*images, on_table) if (each := _corners(drawn, image)) is not None]
    if len(found) < LEAST_PICTURES:
        raise InputError(
            f"{len(found)} of {len(images) + 1} pictures show {LEAST_CORNERS} corners of the board or more; "
            f"{LEAST_PICTURES} must"
        )
    lying = _corners(drawn, on_table)
    if lying is None:
        raise InputError(f"the picture of the board on the table shows fewer than {LEAST_CORNERS} of its corners")
    seen: Any = ([points for points, _ in found], [pixels for _, pixels in found])
    fit: Any = cv2.calibrateCamera  # its types want arrays for what is to be found
    fixed = cv2.CALIB_FIX_K3  # boards in hand do not reach where k3 tells
    residual, matrix, distortion, _, _ = fit(*seen, (width, height), None, None, flags=fixed)
    points, pixels = lying
    _, turn, at = cv2.solvePnP(points, pixels, matrix, distortion)
    turn, at = cv2.solvePnPRefineLM(points, pixels, matrix, distortion, turn, at)
    expected, _ = cv2.projectPoints(points, turn, at, matrix, distortion)
    off = np.sum((expected.reshape(-1, 2) - pixels.reshape(-1, 2)) ** 2, axis=1)
    rotation, translation = _of_table(cv2.Rodrigues(turn)[0], np.asarray(at).ravel(), place)
    camera = CalibratedCamera.from_opencv(
        size=(width, height), matrix=matrix, distortion=np.ravel(distortion)[:5], rotation=rotation,
        translation=translation,
    )  # fmt: skip
    corners = sum(len(points) for points, _ in found)
    return Calibration(camera, float(residual), math.sqrt(float(off.mean())), len(found), corners)


def _corners(drawn: Any, image: UInt8[np.ndarray, "h w 3"]) -> tuple[np.ndarray, np.ndarray] | None:
    """Corners on the board [m] and in a picture [pixels]; None where they are too few."""
    import cv2

    gray = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    corners, names, _, _ = cv2.aruco.CharucoDetector(drawn).detectBoard(gray)
    if names is None or len(names) < LEAST_CORNERS:
        return None
    points, pixels = drawn.matchImagePoints(corners, names)
    return np.asarray(points, np.float32), np.asarray(pixels, np.float32)


def _of_table(
    rotation: Float[np.ndarray, "3 3"], translation: Float[np.ndarray, "3"], place: tuple[float, float, float]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Of the table into the camera's frame, from the same of the board, whose z axis points into the table."""
    x, y, angle = place
    c, s = math.cos(angle), math.sin(angle)
    lies = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])  # the board's axes, as columns, on the table
    turned = rotation @ lies.T
    return turned, translation - turned @ np.array([x, y, 0.0])
