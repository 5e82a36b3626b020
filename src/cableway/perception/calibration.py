"""Calibrated cameras: a pinhole camera with a lens that distorts, as OpenCV describes both.

A point whose ray is (x, y, 1) in the camera's frame is seen at focal * (x', y') + center, with r^2 = x^2 + y^2 and

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2),
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

(Brown 1966, "Decentering distortion of lenses").
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.core.checks import shown
from cableway.core.errors import InputError
from cableway.rendering.camera import Camera

NONE = (0.0, 0.0, 0.0, 0.0, 0.0)
"""Coefficients of a lens that does not distort."""

STEPS = 20
"""Of Newton's method at most; five are enough within the picture of a common lens."""

MET = 1e-10
"""Distance between where a ray is seen and where it should be, in focal lengths, up to which they are one."""

GRAZING = 0.05
"""Slope of a ray towards a plane, for each metre along it, from which on it meets that."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedCamera:
    """A camera with the distortion of its lens.

    Attributes:
        pinhole: The camera without it.
        distortion: k1, k2, p1, p2, k3, in OpenCV's order.

    Raises:
        InputError: The coefficients are not five finite numbers.
    """

    pinhole: Camera
    distortion: tuple[float, float, float, float, float] = NONE

    def __post_init__(self) -> None:
        if len(self.distortion) != 5 or not all(map(math.isfinite, self.distortion)):
            raise InputError(
                f"distortion of a camera must be five finite numbers (k1, k2, p1, p2, k3), got {shown(self.distortion)}"
            )

    @classmethod
    def from_opencv(
        cls,
        *,
        size: tuple[int, int],
        matrix: Float[np.ndarray, "3 3"],
        distortion: Float[np.ndarray, "5"],
        rotation: Float[np.ndarray, "3 3"],
        translation: Float[np.ndarray, "3"],
    ) -> CalibratedCamera:
        """What OpenCV's calibration found.

        Args:
            size: Width and height of its picture [pixels].
            matrix: `cameraMatrix`; without skew.
            distortion: k1, k2, p1, p2, k3: `distCoeffs` of the usual length.
            rotation: Of the world into the camera's frame: `cv2.Rodrigues(rvec)[0]`.
            translation: The world's origin in the camera's frame [m]: `tvec`.

        Raises:
            InputError: The matrix is not one of a camera without skew, or the rotation not rigid.
        """
        matrix, turn = np.asarray(matrix, float), np.asarray(rotation, float)
        focal, center = (float(matrix[0, 0]), float(matrix[1, 1])), (float(matrix[0, 2]), float(matrix[1, 2]))
        plain = np.array([[focal[0], 0.0, center[0]], [0.0, focal[1], center[1]], [0.0, 0.0, 1.0]])
        if not np.array_equal(matrix, plain):
            raise InputError(f"matrix of a camera must be focal lengths and a center, got {shown(matrix.tolist())}")
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn.T, -turn.T @ np.asarray(translation, float)
        k1, k2, p1, p2, k3 = map(float, distortion)
        return cls(pinhole=Camera(size=size, focal=focal, center=center, pose=pose), distortion=(k1, k2, p1, p2, k3))

    def project(
        self, points: Float[np.ndarray, "... 3"]
    ) -> tuple[Float[np.ndarray, "... 2"], Float[np.ndarray, "..."]]:
        """Where points [m] of the world are in the picture (u, v) [pixels], NaN behind the camera; and their depth [m].

        Far outside the picture the equations may fold back into it.
        """
        at = self.pinhole.seen(np.asarray(points, float))
        depth = at[..., 2]
        rays = at[..., :2] / np.where(depth > 0, depth, np.nan)[..., None]
        return self._distorted(rays)[0] * self.pinhole.focal + self.pinhole.center, depth

    def rays(self, pixels: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 2"]:
        """(x, y) of the rays (x, y, 1) in the camera's frame that are seen at pixels (u, v); NaN where no ray is.

        Newton's method from the ray of the camera without distortion.
        """
        wanted = (np.asarray(pixels, float) - self.pinhole.center) / self.pinhole.focal
        if self.distortion == NONE:
            return wanted
        found = wanted.copy()
        with np.errstate(all="ignore"):  # rays beyond the lens run away, and come out as NaN
            for _ in range(STEPS):
                seen, (xx, xy, yx, yy) = self._distorted(found)
                dx, dy = np.moveaxis(wanted - seen, -1, 0)
                if np.abs(wanted - seen).max(initial=0.0) <= MET:
                    break
                area = xx * yy - xy * yx
                found = found + np.stack([(yy * dx - xy * dy) / area, (xx * dy - yx * dx) / area], axis=-1)
            seen, (xx, xy, yx, yy) = self._distorted(found)
            met = (np.abs(wanted - seen).max(axis=-1) <= MET) & (xx * yy > xy * yx)
        return np.where(met[..., None], found, np.nan)

    def on_plane(
        self, pixels: Float[np.ndarray, "... 2"], height: float | Float[np.ndarray, "..."]
    ) -> Float[np.ndarray, "... 2"]:
        """(x, y) [m] of what is seen at pixels (u, v) if it lies at a height above the table [m], or each at its own.

        NaN where the ray does not come down, or rise, to that height, or nearly runs along the table.

        >>> above = np.diag([1.0, -1.0, -1.0, 1.0])
        >>> above[2, 3] = 2.0
        >>> pinhole = Camera(size=(640, 480), focal=(500.0, 500.0), center=(319.5, 239.5), pose=above)
        >>> CalibratedCamera(pinhole=pinhole).on_plane(np.array([344.5, 239.5]), 0.0).round(6).tolist()
        [0.1, 0.0]
        """
        rays = self.rays(pixels)
        pose = self.pinhole.pose
        directions = rays @ pose[:3, :2].T + pose[:3, 2]
        down, away = directions[..., 2], height - pose[2, 3]
        grazing = np.abs(down) < GRAZING * np.linalg.norm(directions, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            far = np.where(grazing, np.nan, away / down)
        far = np.where(far > 0, far, np.nan)
        return pose[:2, 3] + far[..., None] * directions[..., :2]

    def _distorted(
        self, rays: Float[np.ndarray, "... 2"]
    ) -> tuple[Float[np.ndarray, "... 2"], tuple[Float[np.ndarray, "..."], ...]]:
        """Rays as the lens bends them, and their derivative: x' by x and y, y' by x and y."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = rays[..., 0], rays[..., 1]
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        slope = 2 * (k1 + square * (2 * k2 + square * 3 * k3))  # of `radial`, by x over x
        seen = np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )
        across = x * y * slope + 2 * p1 * x + 2 * p2 * y
        return seen, (
            radial + x * x * slope + 2 * p1 * y + 6 * p2 * x,
            across,
            across,
            radial + y * y * slope + 6 * p1 * y + 2 * p2 * x,
        )
