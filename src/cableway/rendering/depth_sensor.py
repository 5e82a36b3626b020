"""What a depth camera makes of true depths: active stereo, by default about an Intel RealSense D415.

Two infrared cameras `baseline` apart see a point at depth z with a disparity of focal * baseline / z pixels. Errors of
the matching are errors of that disparity, so those of depth grow with its square:

    error of depth = z^2 * subpixel / (focal * baseline)

(A. Grunnet-Jepsen, J. Sweetser, J. Woodfill, "Tuning depth cameras for best performance", Intel 2018). At a focal
length of 1005 pixels, that of the D415 at 1280 x 720, it is 2.3 mm at 1.25 m and 4.2 mm at 1.7 m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter, map_coordinates

from cableway.core.checks import Bounds, Checked, NotNegative, Positive

MILLIMETRE = 0.001
"""Depths are whole numbers of it [m], as in files of 16 bits."""


OFFSET = 0.6
"""[pixels] 1.5% of the depth at 1.25 m, and 1.9% at 1.7 m: the data sheet says at most 2%."""


@dataclass(frozen=True, kw_only=True)
class DepthSensor(Checked):
    """A stereo camera.

    Attributes:
        baseline: Between its two cameras [m]; 0.055 is the D415's (Intel's data sheet of the D400 family).
        subpixel: Standard deviation of disparities [pixels]: 0.08 as the maker advises (librealsense, issue 3904).
        window: Standard deviation of the Gaussian by which errors of neighbours are alike [pixels]: matching compares
            patches of some seven pixels. Our assumption.
        jitter: Standard deviation of the place in the picture that a pixel's depth is of [pixels], whence ragged edges
            and depths between those of two surfaces: 0.5 (J. Barron and J. Malik, "Intrinsic scene properties from a
            single RGB-D image", 2013; A. Handa et al., "A benchmark for RGB-D visual odometry, 3D reconstruction and
            SLAM", 2014).
        step: Of disparities [pixels]: 1/32 (Intel, "Subpixel linearity improvement", 2019).
        offset: Error that all disparities have in common [pixels], see `drawn`.

    Raises:
        InputError: A value is out of range.
    """

    baseline: Positive[float] = 0.055
    subpixel: NotNegative[float] = 0.08
    window: NotNegative[float] = 1.5
    jitter: NotNegative[float] = 0.5
    step: Annotated[float, Bounds(1e-6, 1)] = 1 / 32
    offset: float = 0.0

    def drawn(self, rng: np.random.Generator) -> DepthSensor:
        """One such camera, with its own `offset` of at most `OFFSET`."""
        return replace(self, offset=float(rng.uniform(-OFFSET, OFFSET)))


def measured(
    depth: Float[np.ndarray, "h w"], focal: float, sensor: DepthSensor, rng: np.random.Generator
) -> Float[np.ndarray, "h w"]:
    """What the sensor says of true depths [m], to a millimetre; 0 where it knows nothing.

    It knows nothing where there is nothing, and where only the left one of its cameras sees.

    Args:
        depth: Of the middle of each pixel; infinite where nothing is.
        focal: Focal length [pixels].
        sensor: The sensor.
        rng: Of its errors.
    """
    shape = depth.shape
    inverse = 1.0 / depth
    if sensor.jitter:
        places = np.indices(shape) + sensor.jitter * rng.standard_normal((2, *shape))
        inverse = map_coordinates(inverse, places, order=1, mode="nearest")
    disparity = focal * sensor.baseline * inverse
    hidden = _seen_by_one(disparity)
    errors = gaussian_filter(rng.standard_normal(shape), sensor.window)
    disparity += sensor.subpixel / errors.std() * errors + sensor.offset
    disparity = np.round(disparity / sensor.step) * sensor.step
    known = (inverse > 0) & (disparity > 0) & ~hidden
    found = focal * sensor.baseline / np.where(known, disparity, 1.0)
    return np.where(known, np.round(found / MILLIMETRE) * MILLIMETRE, 0.0)


def _seen_by_one(disparity: Float[np.ndarray, "h w"]) -> np.ndarray:
    """Which pixels (h, w) the camera at the right does not see: something to their right is before them there."""
    at = np.arange(disparity.shape[1]) - disparity
    nearest = np.minimum.accumulate(at[:, ::-1], axis=1)[:, ::-1]
    return nearest < at - 0.5
