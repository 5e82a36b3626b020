"""Segmentation: which pixels of a picture belong to the cable and to its markers, by colour, and what has changed since
a picture without them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float, UInt8

from cableway.core.checks import Bounds, Checked, Positive, shown
from cableway.core.errors import InputError
from cableway.perception import kernels
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.views import View

CHANGED = 30.0
"""Distance between colours, each part from 0 to 255, from which on a pixel has changed: six times the noise of a dim
picture."""

SPARSE = 8
"""Of how many pixels each way one is asked for the background."""


@dataclass(frozen=True, kw_only=True)
class CableColor(Checked):
    """How pixels of the cable look.

    A pixel is one of the cable if its colour, as a vector, is near that of the cable in direction, which stays the same
    in the shade, and not too far from it in length. A black cable on a light table differs in length alone.

    Near is what may be a mixture of cable and background, the median of the picture, with more of the cable; and what
    is within `angle` in any case. Where a lens blurs, a cable is as wide as a sharp one then, or narrower in dim light.

    Attributes:
        color: Red, green and blue, from 0 to 255, as they are in a picture.
        angle: Angle between the two vectors [rad] within which a pixel is near, whatever the background.
        darkest: Least length, in those of `color`.
        brightest: Largest length, the same.

    Raises:
        InputError: A value is out of range, or the colour is black without any.
    """

    color: tuple[float, float, float]
    angle: Annotated[float, Bounds(0, math.pi / 2, open=True)] = 0.25
    darkest: Positive[float] = 0.35
    brightest: Positive[float] = 1.5

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.color) != 3 or not all(0 <= part <= 255 for part in self.color) or not any(self.color):
            raise InputError(
                f"cable_color.color must be three numbers from 0 to 255, not all 0, got {shown(self.color)}"
            )


def angle_between(one: Float[np.ndarray, "3"], other: Float[np.ndarray, "3"]) -> float:
    """The angle between two vectors [rad]."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def cable_mask(image: UInt8[np.ndarray, "h w 3"], color: CableColor) -> Bool[np.ndarray, "h w"]:
    """The pixels of a picture (red, green, blue) that have the colour of the cable.

    >>> image = np.array([[[200, 60, 10], [110, 30, 5], [128, 128, 128]]], np.uint8)
    >>> cable_mask(image, CableColor(color=(220, 70, 10))).tolist()
    [[True, True, False]]
    """
    reference = np.array(color.color, float)
    length = float(np.linalg.norm(reference))
    background = np.median(image[::SPARSE, ::SPARSE].reshape(-1, 3), axis=0)
    mask = np.empty(image.shape[:2], bool)
    kernels.of_color(
        np.ascontiguousarray(image),
        reference / length,
        math.cos(max(color.angle, angle_between(reference, reference + background))),
        color.darkest * length,
        color.brightest * length,
        mask,
    )
    return mask


def changed(
    image: UInt8[np.ndarray, "h w 3"], background: UInt8[np.ndarray, "h w 3"], least: float = CHANGED
) -> Bool[np.ndarray, "h w"]:
    """The pixels of a picture (red, green, blue) that differ from one of the same place without the cable.

    Where all of the picture is brighter or darker, as by exposure, that is taken out. A shadow is a change.

    >>> empty = np.full((8, 8, 3), 200, np.uint8)
    >>> image = empty // 2
    >>> image[2, 3] = (110, 30, 5)
    >>> np.argwhere(changed(image, empty)).tolist()
    [[2, 3]]

    Raises:
        InputError: The pictures differ in size.
    """
    if image.shape != background.shape:
        got = " and ".join(" x ".join(map(str, each.shape[1::-1])) for each in (image, background))
        raise InputError(f"a picture and its background must be of one size, got {got} pixels")
    before = background.astype(np.float32)
    sparse = (slice(None, None, SPARSE), slice(None, None, SPARSE))
    gain = np.median(image[sparse] / np.maximum(before[sparse], 1.0), axis=(0, 1))
    away = image - np.minimum(gain.astype(np.float32) * before, 255.0)
    return np.sum(away * away, axis=2) > least**2


def view_of(
    camera: CalibratedCamera,
    image: UInt8[np.ndarray, "h w 3"],
    hiding: Bool[np.ndarray, "h w"] | None,
    color: CableColor,
    marker: CableColor | None = None,
    background: UInt8[np.ndarray, "h w 3"] | None = None,
) -> View:
    """What a picture (red, green, blue) shows of a cable.

    Args:
        camera: That took it.
        image: The picture.
        hiding: Which pixels may show something that hides the cable; None where that is not known.
        color: Of the cable.
        marker: Of the markers on it, where they are told apart from it.
        background: A picture without the cable: what was there before is not the cable, whatever its colour.

    Raises:
        InputError: A mask is not as large as the camera's picture.
    """
    mask, marks = cable_mask(image, color), None if marker is None else cable_mask(image, marker)
    if background is not None:
        new = changed(image, background)
        mask, marks = mask & new, None if marks is None else marks & new
    return View(camera, mask, hiding, marks)
