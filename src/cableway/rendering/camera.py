"""Pinhole cameras.

Frames are OpenCV's. In the camera's frame x points to the right in the picture, y down and z forward. Pixel (u, v) is
column u of row v, the first being 0; whole numbers are the middles of pixels, so that a picture reaches from -0.5 to
its width or height less 0.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.core.checks import shown
from cableway.core.errors import InputError

RIGID = 1e-6
"""Error by which the axes of a pose may fail to be orthonormal."""

STEEP = 1 - 1e-9
"""Cosine of the angle to the vertical beyond which a direction is straight down or up."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A pinhole camera without distortion.

    Attributes:
        size: Width and height of its picture [pixels].
        focal: Focal lengths along x and y [pixels].
        center: Principal point (u, v) [pixels].
        pose: (4, 4) of its frame in the world: the columns are its x, y and z axes and where it is [m].

    Raises:
        InputError: The size is not two positive whole numbers, a focal length is not positive, a number is not finite,
            or the pose is not rigid.
    """

    size: tuple[int, int]
    focal: tuple[float, float]
    center: tuple[float, float]
    pose: Float[np.ndarray, "4 4"]

    def __post_init__(self) -> None:
        if len(self.size) != 2 or not all(isinstance(each, int) and each > 0 for each in self.size):
            raise InputError(f"size of a camera must be two positive whole numbers, got {shown(self.size)}")
        if len(self.focal) != 2 or not all(0 < each < math.inf for each in self.focal):
            raise InputError(f"focal of a camera must be two positive numbers, got {shown(self.focal)}")
        if len(self.center) != 2 or not all(map(math.isfinite, self.center)):
            raise InputError(f"center of a camera must be two finite numbers, got {shown(self.center)}")
        pose = np.array(self.pose, dtype=float)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise InputError(f"pose of a camera must be 4 x 4 finite numbers, got {shown(self.pose)}")
        axes = pose[:3, :3]
        rigid = np.abs(axes.T @ axes - np.eye(3)).max() <= RIGID and np.linalg.det(axes) > 0
        if not rigid or np.abs(pose[3] - (0.0, 0.0, 0.0, 1.0)).max() > RIGID:
            raise InputError(f"pose of a camera must be a rotation and a translation, got {shown(self.pose)}")
        object.__setattr__(self, "pose", pose)

    @classmethod
    def looking(
        cls, place: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"], *, size: tuple[int, int], view: float
    ) -> Camera:
        """A camera that looks in a direction, its principal point in the middle of the picture.

        Args:
            place: Where it is [m].
            direction: In which it looks. The world's z axis is upwards in the picture, y where it looks straight down.
            size: Width and height [pixels].
            view: Angle of view across the width [rad].

        Raises:
            InputError: The direction has no length, or the angle of view leaves no picture.
        """
        if not 0 < view < math.pi:
            raise InputError(f"view of a camera must be between 0 and pi rad, got {view!r}")
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = _looking(np.asarray(direction, float)), place
        focal, (width, height) = size[0] / 2 / math.tan(view / 2), size
        return cls(size=size, focal=(focal, focal), center=((width - 1) / 2, (height - 1) / 2), pose=pose)

    @classmethod
    def framing(
        cls,
        points: Float[np.ndarray, "k 3"],
        direction: Float[np.ndarray, "3"],
        *,
        size: tuple[int, int],
        view: float,
        margin: float = 0.03,
    ) -> Camera:
        """The nearest camera that looks in a direction and has all points in its picture.

        Args:
            points: [m].
            direction: See `looking`.
            size: Width and height [pixels].
            view: Angle of view across the width [rad].
            margin: Share of width and height that stays free at each edge.

        Raises:
            InputError: The direction has no length, or the angle of view or the margin leaves no picture.
        """
        if not 0 <= margin < 0.5:
            raise InputError(f"margin must be from 0 to less than 0.5, got {margin!r}")
        aim = cls.looking(np.zeros(3), direction, size=size, view=view)
        slopes = np.array(size) * (0.5 - margin) / aim.focal  # of the frustum's sides, within the margin
        at = aim.seen(points)
        across, ahead = at[:, :2], at[:, 2:]
        right, left = (across - slopes * ahead).max(axis=0), (-across - slopes * ahead).max(axis=0)
        place = np.append((right - left) / 2, (-(right + left) / (2 * slopes)).min())
        return cls.looking(aim.pose[:3, :3] @ place, direction, size=size, view=view)

    def finer(self, times: int) -> Camera:
        """The same with so many times as many pixels each way, in the same places."""
        focal = (times * self.focal[0], times * self.focal[1])
        center = (times * (self.center[0] + 0.5) - 0.5, times * (self.center[1] + 0.5) - 0.5)
        return Camera(size=(times * self.size[0], times * self.size[1]), focal=focal, center=center, pose=self.pose)

    def seen(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """Points [m] of the world in the camera's frame."""
        return (points - self.pose[:3, 3]) @ self.pose[:3, :3]

    def project(
        self, points: Float[np.ndarray, "... 3"]
    ) -> tuple[Float[np.ndarray, "... 2"], Float[np.ndarray, "..."]]:
        """Where points [m] of the world are in the picture (u, v) [pixels], NaN behind the camera; and their depth [m].

        >>> front = Camera(size=(640, 480), focal=(500.0, 500.0), center=(319.5, 239.5), pose=np.eye(4))
        >>> pixel, depth = front.project(np.array([0.1, 0.0, 2.0]))
        >>> pixel.tolist(), depth.tolist()
        ([344.5, 239.5], 2.0)
        """
        at = self.seen(np.asarray(points, float))
        depth = at[..., 2]
        ahead = np.where(depth > 0, depth, np.nan)[..., None]
        return at[..., :2] / ahead * self.focal + self.center, depth


def _looking(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Axes x, y, z as columns, with z along a direction and y as far down as that leaves."""
    length = float(np.linalg.norm(direction))
    if not 0 < length < math.inf:
        raise InputError(f"direction of a camera must be finite and not zero, got {shown(direction.tolist())}")
    forward = direction / length
    right = np.cross(forward, (0.0, 0.0, 1.0) if abs(forward[2]) < STEEP else (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(forward, right), forward])
