"""Depth images: heights above the table of what is seen at each pixel.

A depth camera's error is one of disparity, and so of inverse depth. What of it all of a picture has in common, and what
a calibration is off, is found at the table, whose inverse depth is linear in a pixel's ray (x, y, 1):

    1 / depth = 1 / measured - (a + b x + c y),

with a, b and c such that the table is at height 0, by least squares over what is near to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import maximum_filter, median_filter, minimum_filter

from cableway.core.errors import InputError
from cableway.perception.calibration import CalibratedCamera

WINDOW = 5
"""Pixels across the window of whose depths the median is taken."""

EDGE = 0.006
"""Difference of depth [m] both from the nearest and from the farthest neighbour from which on a pixel may be a mixture
of two surfaces. On a table, seen at 40 degrees from 1.25 m, it is 2 mm."""

BANDS = (0.015, 0.012, 0.01, 0.008, 0.008)
"""Heights [m] over or under the table, as it is found so far, up to which pixels count as its in each step."""

BIN, PEAK = 0.004, 0.25
"""Width [m] of the bins of heights, and the share of the fullest one from which on a bin holds a level surface. The
table is the lowest."""

LEAST_TABLE = 2000
"""Pixels of the table at least."""

OFF = 0.025
"""Share of the depth by which depths and calibration may disagree about the table: data sheets have 2%."""


@dataclass(frozen=True, eq=False)
class DepthView:
    """What a depth camera shows.

    Attributes:
        camera: The camera.
        depth: Of each pixel along the camera's z axis [m], in the pixels of its colours; 0 where it is not known.
        cable: Which pixels show the cable, see `segmentation.cable_mask`, and a few around.
        ignored: Which pixels show what is known: grippers, arms. They are neither table nor obstacle.

    Raises:
        InputError: An array is not as large as the camera's picture, or a depth is no number.
    """

    camera: CalibratedCamera
    depth: Float[np.ndarray, "h w"]
    cable: Bool[np.ndarray, "h w"]
    ignored: Bool[np.ndarray, "h w"]

    def __post_init__(self) -> None:
        width, height = self.camera.pinhole.size
        for name, array in (("depth", self.depth), ("cable", self.cable), ("ignored", self.ignored)):
            if array.shape != (height, width):
                got = " x ".join(map(str, array.shape))
                raise InputError(f"{name} of a view must be {height} x {width}, as the camera's picture, got {got}")
        if not (np.isfinite(self.depth) & (self.depth >= 0)).all():
            raise InputError("depth of a view must be numbers from 0 on, 0 where it is not known")

    @cached_property
    def rays(self) -> Float[np.ndarray, "h w 2"]:
        """(x, y) of the rays (x, y, 1) in the camera's frame; NaN where no ray is."""
        height, width = self.depth.shape
        return self.camera.rays(np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1))

    @cached_property
    def of_table(self) -> Float[np.ndarray, "h w"]:
        """Inverse depth of the table [1/m]; 0 or less where a ray does not come down to it."""
        down, high = self.camera.pinhole.pose[2, :3], self.camera.pinhole.pose[2, 3]
        return (self.rays @ down[:2] + down[2]) / -high

    def at(self, inverse: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w 3"]:
        """Points [m] of the world at inverse depths [1/m]."""
        pose = self.camera.pinhole.pose
        with np.errstate(divide="ignore", invalid="ignore"):
            scaled = np.concatenate([self.rays, np.ones((*self.depth.shape, 1))], axis=-1) / inverse[..., None]
        return scaled @ pose[:3, :3].T + pose[:3, 3]


@dataclass(frozen=True, eq=False)
class Relief:
    """Heights above the table.

    Attributes:
        points: Of each pixel [m] in the world, its height third; NaN where it is not known, where two surfaces may mix
            at an edge, and where the view ignores it.
        noise: Standard deviation of the heights of the table [m].
        off: How high the table was by depth and calibration alone, in the mean [m].
    """

    points: Float[np.ndarray, "h w 3"]
    noise: float
    off: float


def relief(view: DepthView, workspace: tuple[float, float]) -> Relief:
    """Heights above the table of what a depth camera shows.

    Depths are medians over `WINDOW` pixels each way.

    Args:
        view: What it shows.
        workspace: Width and height of what of the table counts [m].

    Raises:
        InputError: Too little is seen of the table, or depths and calibration disagree about it.
    """
    known = (view.depth > 0) & (view.of_table > 0) & np.isfinite(view.rays).all(axis=-1)
    filled = np.where(known, 1.0 / np.where(known, view.depth, 1.0), view.of_table)  # the table is behind most gaps
    inverse = median_filter(filled, WINDOW)
    within = known & ~view.ignored & _inside(view.at(np.where(known, view.of_table, 1.0)), workspace)
    flat, noise, off = _table(view, inverse, within)
    inverse = inverse - flat[0] - view.rays @ flat[1:]
    points = view.at(np.where(known, inverse, 1.0))
    points[~known | view.ignored | _mixed(inverse)] = np.nan
    return Relief(points, noise, off)


def _table(
    view: DepthView, inverse: Float[np.ndarray, "h w"], within: Bool[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "3"], float, float]:
    """What inverse depths are off where the table is (a, b, c), the noise of its heights, and how high it was [m]."""
    rays = np.concatenate([view.rays[within], np.ones((int(within.sum()), 1))], axis=1)[:, [2, 0, 1]]
    off, high = inverse[within] - view.of_table[within], view.camera.pinhole.pose[2, 3]
    slope = high / view.of_table[within]  # height over inverse depth, near to the table
    most = OFF * float((1 / view.of_table[within]).mean()) if within.any() else OFF
    flat, near = np.zeros(3), np.zeros(len(rays), bool)
    for step, band in enumerate(BANDS):
        heights = slope * (off - rays @ flat)
        near = np.abs(heights - (_lowest(heights, 2 * most) if step == 0 else 0.0)) <= band
        if near.sum() < LEAST_TABLE:
            break
        flat = np.linalg.lstsq(rays[near], off[near], rcond=None)[0]
    if near.sum() < LEAST_TABLE:
        raise InputError(
            f"depth: of the table {int(near.sum())} pixels are seen, and {LEAST_TABLE} are needed: either it is "
            "covered, or depths and calibration do not belong together"
        )
    moved = float((slope * (rays @ flat))[near].mean())
    if abs(moved) > most:
        raise InputError(
            f"depth: the table is {1000 * moved:.0f} mm above where the calibration has it, and at most "
            f"{1000 * most:.0f} mm can be put down to the camera: depths and calibration do not belong together"
        )
    heights = slope * (off - rays @ flat)
    return flat, float(1.4826 * np.median(np.abs(heights[near]))), moved


def _lowest(heights: Float[np.ndarray, "k"], most: float) -> float:
    """Height [m] of the lowest level surface, at most so far from the table as calibrated [m]."""
    counts, edges = np.histogram(heights, np.arange(-most, most + BIN, BIN))
    return float(edges[np.flatnonzero(counts >= PEAK * counts.max())[0]] + BIN)


def middle(depths: Float[np.ndarray, "k h w"]) -> Float[np.ndarray, "h w"]:
    """The median depth of each pixel [m] in pictures of what stands still; 0 where less than half of them know it.

    >>> middle(np.array([[[1.0, 0.0]], [[1.2, 0.0]], [[1.1, 2.0]]])).tolist()
    [[1.1, 0.0]]
    """
    known = 2 * np.count_nonzero(depths > 0, axis=0) >= len(depths)
    found = np.zeros(depths.shape[1:])
    found[known] = np.nanmedian(np.where(depths[:, known] > 0, depths[:, known], np.nan), axis=0)
    return found


def raised(relief: Relief, low: float, high: float) -> Bool[np.ndarray, "h w"]:
    """The pixels of what is between two heights above the table [m], those that the view ignored left out: a cable that
    lies there, where depths are exact to a part of its thickness.
    """
    with np.errstate(invalid="ignore"):
        return (relief.points[..., 2] >= low) & (relief.points[..., 2] <= high)


def _inside(points: Float[np.ndarray, "... 3"], workspace: tuple[float, float]) -> Bool[np.ndarray, "..."]:
    x, y = points[..., 0], points[..., 1]
    return (x >= 0) & (y >= 0) & (x <= workspace[0]) & (y <= workspace[1])


def _mixed(inverse: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Which pixels are neither as near as the nearest of their neighbours nor as far as the farthest."""
    depth = 1.0 / np.maximum(inverse, 1e-6)
    return (depth - minimum_filter(depth, 3) > EDGE) & (maximum_filter(depth, 3) - depth > EDGE)
