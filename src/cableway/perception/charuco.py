"""Pictures of a ChArUco board: its corners, and the lens that shows them.

OpenCV finds the corners and fits the lens (Zhang 2000, "A flexible new technique for camera calibration").
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from cableway.core.checks import Bounds, Checked, Positive
from cableway.core.errors import InputError, UnknownNameError
from cableway.core.extras import require
from cableway.perception.calibration import CalibratedCamera

LEAST_CORNERS = 8
"""Of the board in a picture, for the picture to count."""

LEAST_PICTURES = 4
"""With that many corners, for a lens."""

FINER = 2
"""Times that pictures are enlarged before corners are looked for: on the table OpenCV is then off by 0.12 pixels in
place of 0.16, and finds more of them."""

SQUARE_PIXELS = 120
"""Width of a square of a drawn board: markers of most sizes have cells of whole pixels, or nearly."""

MARKER_PIXELS = 16
"""Width of a marker that is found for certain, with six cells each way."""


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

    def drawing(self) -> UInt8[np.ndarray, "h w"]:
        """The squares from above, 120 pixels wide each, without paper about them; raises as `in_opencv`."""
        size = (SQUARE_PIXELS * self.across, SQUARE_PIXELS * self.down)
        return self.in_opencv().generateImage(size, marginSize=0, borderBits=1)


class Corners(NamedTuple):
    """Corners of a board in a picture: on the board [m] and in the picture (u, v) [pixels]."""

    points: Float[np.ndarray, "m 3"]
    pixels: Float[np.ndarray, "m 2"]


class Lens(NamedTuple):
    """A lens as OpenCV describes it, and where the boards were from which it is known.

    Attributes:
        matrix: (3, 3) focal lengths and center [pixels].
        distortion: k1, k2, p1, p2, k3.
        residual: Root mean square distance [pixels] of corners from where it would show them.
        boards: (k, 4, 4) poses of the board in the frame of the camera, one for each picture.
    """

    matrix: Float[np.ndarray, "3 3"]
    distortion: Float[np.ndarray, "5"]
    residual: float
    boards: Float[np.ndarray, "k 4 4"]

    def shown(self, points: Float[np.ndarray, "m 3"], pose: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "m 2"]:
        """Where points [m] of a board are in a picture [pixels], the board at a pose in the frame of the camera."""
        import cv2

        turn = cv2.Rodrigues(pose[:3, :3])[0]
        return cv2.projectPoints(points, turn, pose[:3, 3], self.matrix, self.distortion)[0].reshape(-1, 2)

    def off(self, found: Sequence[Corners], poses: Iterable[Float[np.ndarray, "4 4"]]) -> Float[np.ndarray, "m 2"]:
        """How far corners are seen from where boards at poses in the frame of the camera have them [pixels]."""
        seen = zip(found, poses, strict=True)
        return np.concatenate([self.shown(corners.points, pose) - corners.pixels for corners, pose in seen])

    def camera(
        self, size: tuple[int, int], rotation: Float[np.ndarray, "3 3"], translation: Float[np.ndarray, "3"]
    ) -> CalibratedCamera:
        """The camera with this lens; arguments as of `CalibratedCamera.from_opencv`."""
        return CalibratedCamera.from_opencv(
            size=size, matrix=self.matrix, distortion=self.distortion, rotation=rotation, translation=translation
        )


def corners_of(
    board: Board, images: Sequence[UInt8[np.ndarray, "h w 3"]]
) -> tuple[list[Corners | None], tuple[int, int]]:
    """Corners of a board in each picture, None where they are fewer than `LEAST_CORNERS`; and the pictures' size.

    Raises:
        InputError: The pictures differ in size, or there are none.
        MissingExtraError: OpenCV is not installed.
    """
    drawn, sizes = board.in_opencv(), {image.shape for image in images}
    if len(sizes) != 1:
        raise InputError(f"pictures of one camera must be of one size, got {sorted(shape[:2] for shape in sizes)}")
    height, width, _ = sizes.pop()
    return [_corners(drawn, image) for image in images], (width, height)


def fitted_lens(found: Sequence[Corners], size: tuple[int, int]) -> Lens:
    """The lens of a camera that shows corners of a board in several poses."""
    import cv2

    fit: Any = cv2.calibrateCamera  # its types want arrays for what is to be found
    seen: Any = ([points for points, _ in found], [pixels for _, pixels in found])
    fixed = cv2.CALIB_FIX_K3  # boards in hand do not reach where k3 tells
    residual, matrix, distortion, turns, places = fit(*seen, size, None, None, flags=fixed)
    boards = np.array([pose_of(np.ravel(turn), np.ravel(at)) for turn, at in zip(turns, places, strict=True)])
    return Lens(matrix, np.ravel(distortion)[:5], float(residual), boards)


def pose_of(turn: Float[np.ndarray, "3"], at: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """The pose of a rotation vector [rad] and a place [m]."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), at
    return pose


def _corners(drawn: Any, image: UInt8[np.ndarray, "h w 3"]) -> Corners | None:
    """Of one picture; None where they are too few."""
    import cv2

    gray = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    fine = cv2.resize(gray, None, fx=FINER, fy=FINER, interpolation=cv2.INTER_CUBIC)
    corners, names, _, _ = cv2.aruco.CharucoDetector(drawn).detectBoard(fine)
    if names is None or len(names) < LEAST_CORNERS:
        return None
    points, pixels = drawn.matchImagePoints(corners, names)
    pixels = (np.asarray(pixels, np.float32).reshape(-1, 2) + 0.5) / FINER - 0.5  # of middles of pixels
    return Corners(np.asarray(points, np.float32).reshape(-1, 3), pixels)
