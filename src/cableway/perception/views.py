"""Views: what one camera shows of the cable at one time, and the points of its axis that follow from that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from cableway.core.errors import InputError
from cableway.perception import kernels
from cableway.perception.calibration import CalibratedCamera

WIDTH_SHARE, WIDTH_PIXELS = 0.35, 1.0
"""By how much the width of a band may differ from that of the cable: a share of it, and pixels."""

SMALL = 0.75
"""In widths of the cable, how far from its axis a pixel of it may be and still be that place of it."""

ROOM = 4
"""Room for middles of runs, in pixels around the picture."""


@dataclass(frozen=True, eq=False)
class View:
    """What a camera shows.

    Attributes:
        camera: The camera.
        mask: Which pixels are the cable's, see `segmentation.cable_mask`; a mask of your own does as well. Those that
            show something that hides the cable do not count: hands and arms may be of its colour.
        hiding: Which pixels show something that may hide the cable: hands, arms, posts. None where that is not known: a
            place where the cable should be seen and is not is then taken to be hidden.
        marks: Which pixels are markers on the cable, and so the cable's, too; None where they are not told apart from
            it, or it has none.

    Raises:
        InputError: A mask is not as large as the camera's picture.
    """

    camera: CalibratedCamera
    mask: Bool[np.ndarray, "h w"]
    hiding: Bool[np.ndarray, "h w"] | None = None
    marks: Bool[np.ndarray, "h w"] | None = None

    def __post_init__(self) -> None:
        width, height = self.camera.pinhole.size
        for name, mask in (("mask", self.mask), ("hiding", self.hiding), ("marks", self.marks)):
            if mask is not None and (mask.shape != (height, width) or mask.dtype != bool):
                raise InputError(
                    f"{name} of a view must be {height} x {width} truth values, as the camera's picture, got "
                    f"{' x '.join(map(str, mask.shape))} of {mask.dtype}"
                )

    @property
    def cable(self) -> Bool[np.ndarray, "h w"]:
        """Which pixels are the cable's and nothing else's."""
        return self._shown(self.mask if self.marks is None else self.mask | self.marks)

    @property
    def markers(self) -> Bool[np.ndarray, "h w"]:
        """Which pixels are markers and nothing else; all of the mask where they are not told apart from the cable."""
        return self._shown(self.mask if self.marks is None else self.marks)

    def _shown(self, mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
        return np.ascontiguousarray(mask if self.hiding is None else mask & ~self.hiding)


def centreline(view: View) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k"]]:
    """Points (u, v) on the centre line of the mask, to a part of a pixel and in no order, and its width there [pixels].

    They are the middles of runs of pixels across the band, see `kernels.middles`: there is no kernel of an even size to
    shift them. Runs beside what hides the cable are left out.
    """
    out, cable = np.empty((ROOM * sum(view.mask.shape), 3)), view.cable
    hiding = np.zeros((0, 0), bool) if view.hiding is None else np.ascontiguousarray(view.hiding)
    found = out[: kernels.middles(cable, hiding, out)]
    return found[:, :2].copy(), found[:, 2].copy()


def axis_points(view: View, radius: float) -> Float[np.ndarray, "k 2"]:
    """Points [m] of the axis of a cable that lies on the table, in no order.

    Bands that are wider or narrower than the cable would be are left out.

    Args:
        view: What is seen.
        radius: Of the cable [m], and so the height of its axis.
    """
    pixels, width = centreline(view)
    points = view.camera.on_plane(pixels, radius)
    expected = widths(view, lying(points, radius), radius)
    fits = np.abs(width - expected) <= WIDTH_SHARE * expected + WIDTH_PIXELS
    return points[fits]


def seen_of(view: View, points: Float[np.ndarray, "m 2"], radius: float) -> Int[np.ndarray, "m"]:
    """Of each point [m] of the axis whether it is `kernels.HIDDEN`, `SEEN` or `MISSING`.

    Args:
        view: What is seen.
        points: Where the axis should be.
        radius: Of the cable [m].
    """
    axis = lying(points, radius)
    pixels, _ = view.camera.project(axis)
    reach = SMALL * widths(view, axis, radius) + 1.0
    hiding = np.ones(view.mask.shape, bool) if view.hiding is None else np.ascontiguousarray(view.hiding)
    out = np.empty(len(points), np.int64)
    kernels.claims(pixels, reach, view.cable, hiding, out)
    return out


def widths(view: View, points: Float[np.ndarray, "k 3"], radius: float) -> Float[np.ndarray, "k"]:
    """Width of the cable in the picture [pixels] at points [m] of its axis; 0 where they are behind the camera."""
    pinhole = view.camera.pinhole
    ahead = pinhole.seen(points)[:, 2]
    return 2 * radius * float(np.mean(pinhole.focal)) / np.where(ahead <= 0, np.inf, ahead)


def lying(points: Float[np.ndarray, "k 2"], radius: float) -> Float[np.ndarray, "k 3"]:
    """Points [m] of the axis of a cable that lies on the table."""
    return np.column_stack([points, np.full(len(points), radius)])
