"""Markers: bands of one colour about the inner keypoints of a cable, found and named anew in every picture.

The paper follows 13 markers. Here nothing is followed from picture to picture: each mark gets the name of the marker
that the rod expects there (`estimation.naming`), and one that is hidden, in part or whole, is left out: its keypoint is
the rod's. The keypoints at the ends have no markers: hands hide them, and say where they are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import label
from scipy.spatial.distance import cdist

from cableway.estimation.curve_filter import CurveFit
from cableway.estimation.rod_filter import RodEstimate
from cableway.perception.rod_tracker import Evidence, RodTracker
from cableway.perception.sighting import Track
from cableway.perception.views import View, lying, widths
from cableway.records import RodParameters
from cableway.rod.material import ROD

SMALLEST, LARGEST = 0.3, 1.8
"""Pixels of a mark over those of a square as wide as the cable is there: a band is as long as it is wide, looks shorter
along the view of a low camera, and longer where it is blurred."""

BESIDE = 2
"""Pixels around a mark among which one of what hides the cable, or the edge of the picture, tells that it was cut."""


VISIBLE = math.pi / 4
"""Distance of the middle of the visible half of a band from the cable's axis, in radii: the mean of the cosine of the
angle from its middle, by which its parts are seen foreshortened."""


class Marks(NamedTuple):
    """What may be markers in a picture, those left out that are cut by what hides the cable.

    Attributes:
        pixels: (b, 2) their middles (u, v).
        areas: (b,) of each [pixels].
    """

    pixels: Float[np.ndarray, "b 2"]
    areas: Float[np.ndarray, "b"]

    def of_size(self, widths: Float[np.ndarray, "b"]) -> Bool[np.ndarray, "b"]:
        """Which are as large as a marker, where the cable is so wide [pixels]."""
        return (self.areas >= SMALLEST * widths**2) & (self.areas <= LARGEST * widths**2)


def marks_in(view: View) -> Marks:
    """What may be markers in a view, in no order."""
    mask = view.markers
    rows, columns = np.nonzero(mask)
    numbers = np.empty(mask.shape, np.int32)
    label(mask, output=numbers)
    names = numbers[rows, columns] - 1
    areas = np.bincount(names)
    whole = np.bincount(names, _cut(view, rows, columns), len(areas)) == 0
    pixels = np.column_stack([np.bincount(names, columns), np.bincount(names, rows)]) / areas[:, None]
    return Marks(pixels[whole], areas[whole].astype(float))


def marks_of(view: View, radius: float, line: Float[np.ndarray, "m 2"] | None = None) -> Float[np.ndarray, "b 2"]:
    """Where the marks of a view are [m], on the axis of a cable that lies on the table, in no order.

    Marks that are cut by what hides the cable are left out, and those of another size than a marker has there.

    Args:
        view: What is seen.
        radius: Of the cable [m].
        line: Where the cable about is [m]; None where that is not known. By its direction the middle of what is seen of
            a band is brought to the axis: of one that runs towards a low camera it is nearly a radius above that.
    """
    found = marks_in(view)
    points = view.camera.on_plane(found.pixels, radius)
    fits = found.of_size(widths(view, lying(points, radius), radius))
    return points[fits] if line is None else _to_axis(view, found.pixels[fits], points[fits], radius, line)


def _to_axis(
    view: View,
    pixels: Float[np.ndarray, "b 2"],
    points: Float[np.ndarray, "b 2"],
    radius: float,
    line: Float[np.ndarray, "m 2"],
) -> Float[np.ndarray, "b 2"]:
    """Points of the axis [m] of bands that are seen at pixels, about at `points`, along a line."""
    along = np.gradient(line, axis=0)[cdist(points, line).argmin(axis=1)] if len(points) else np.empty((0, 2))
    along = np.column_stack([along / np.linalg.norm(along, axis=1, keepdims=True), np.zeros(len(along))])
    lift = visible_side(view, lying(points, radius), along, radius)
    return view.camera.on_plane(pixels, radius + lift[:, 2]) - lift[:, :2]


def visible_side(
    view: View, points: Float[np.ndarray, "b 3"], along: Float[np.ndarray, "b 3"], radius: float
) -> Float[np.ndarray, "b 3"]:
    """From points [m] of a cable's axis, whose directions are `along`, to the middles of what is seen of bands."""
    facing = view.camera.pinhole.pose[:3, 3] - points
    facing -= np.sum(facing * along, axis=1, keepdims=True) * along
    return VISIBLE * radius * facing / np.linalg.norm(facing, axis=1, keepdims=True)


def _cut(view: View, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Whether something that hides the cable, or the edge of the picture, is beside pixels."""
    height, width = view.mask.shape
    cut = np.zeros(len(rows), bool)
    for down, right in ((-BESIDE, 0), (BESIDE, 0), (0, -BESIDE), (0, BESIDE)):
        row, column = rows + down, columns + right
        outside = (row < 0) | (row >= height) | (column < 0) | (column >= width)
        cut |= outside
        if view.hiding is not None:
            cut |= view.hiding[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    return cut


class MarkerTracker(RodTracker):
    """Follows a cable by its markers, and by its own pixels where its views have both (`View.marks`).

    As `RodTracker`, but keypoints whose markers are seen are where these are. Where views have one mask, that is of the
    markers. Controllers estimate the rod from the keypoints themselves.
    """

    def _seen_in(self, views: Sequence[View], track: Track | None = None) -> Evidence:
        line = None if track is None else self._line(track)
        marks = [marks_of(view, self._cable.radius, line) for view in views]
        return super()._seen_in([view for view in views if view.marks is not None])._replace(blobs=marks)

    def _line(self, track: Track) -> Float[np.ndarray, "m 2"]:
        """The rod as it was last known [m]."""
        length, *modes = track.estimate.theta[ROD].tolist()
        rod = replace(self._cable.rod, length=length, modes=tuple(modes))
        return rod.shapes(track.estimate.q[None])[0][0]

    def _shared(self, estimate: RodEstimate) -> RodParameters | None:
        return None

    def _looked_for(self, views: Sequence[View]) -> Float[np.ndarray, "m"]:
        return super()._looked_for(views) if any(view.marks is not None for view in views) else self._keypoints[1:-1]

    def _observed(
        self, keypoints: Float[np.ndarray, "n 2"], variance: Float[np.ndarray, "n"], fit: CurveFit
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
        seen = np.isfinite(fit.marks[:, 0])
        return np.where(seen[:, None], fit.marks, keypoints), np.where(seen, self._estimator.curve.mark**2, variance)


Tracker = Literal["rod", "markers"]
"""What finds a cable in pictures: the rod by its own pixels, or by them and by markers on it."""

TRACKERS: dict[str, type[RodTracker]] = {"rod": RodTracker, "markers": MarkerTracker}
"""By name."""
