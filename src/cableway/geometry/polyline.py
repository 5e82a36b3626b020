"""Polylines: length, resampling at equal arc length, area, self-crossing."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float


def arc_length(points: Float[np.ndarray, "... m space"]) -> Float[np.ndarray, "... m"]:
    """Arc length [m] from the first vertex to each vertex.

    >>> arc_length(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 5.0]])).tolist()
    [0.0, 5.0, 6.0]
    """
    steps = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    zero = np.zeros((*steps.shape[:-1], 1))
    return np.concatenate([zero, np.cumsum(steps, axis=-1)], axis=-1)


def length(points: Float[np.ndarray, "... m space"]) -> Float[np.ndarray, "..."]:
    """Length [m] of each polyline; 0 for a single vertex."""
    return arc_length(points)[..., -1]


def point_at(points: Float[np.ndarray, "m space"], s: Float[np.ndarray, "k"]) -> Float[np.ndarray, "k space"]:
    """The points at arc lengths `s` [m] along one polyline, held at its ends outside."""
    arc = arc_length(points)
    return np.column_stack([np.interp(s, arc, part) for part in points.T])


def resample(points: Float[np.ndarray, "m space"], count: int) -> Float[np.ndarray, "count space"]:
    """`count` points at equal arc length along one polyline, both ends included.

    >>> resample(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]), 3).tolist()
    [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]
    """
    return point_at(points, np.linspace(0.0, float(length(points)), count))


def spline(points: Float[np.ndarray, "... m space"], pieces: int) -> Float[np.ndarray, "... k space"]:
    """A cubic spline through the vertices, `pieces` segments for each one given: the cable between keypoints.

    >>> spline(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]), 2).shape
    (7, 2)
    """
    from scipy.interpolate import CubicSpline

    m = points.shape[-2]
    return CubicSpline(np.linspace(0, 1, m), points, axis=-2)(np.linspace(0, 1, pieces * (m - 1) + 1))


def end_poses(points: Float[np.ndarray, "... m 2"]) -> Float[np.ndarray, "... 2 3"]:
    """Both ends of polylines [m] with their directions along them [m, m, rad]."""
    steps = points[..., [1, -1], :] - points[..., [0, -2], :]
    return np.concatenate([points[..., [0, -1], :], np.arctan2(steps[..., 1], steps[..., 0])[..., None]], axis=-1)


def remove_repeated(points: Float[np.ndarray, "m space"], tolerance: float = 1e-9) -> Float[np.ndarray, "k space"]:
    """The polyline without vertices closer than `tolerance` [m] to the one before; the first one stays."""
    keep = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > tolerance])
    return points[keep]


def signed_area(points: Float[np.ndarray, "m 2"]) -> float:
    """Area [m^2] between a polyline and its chord, positive where the polyline lies left of the chord.

    >>> signed_area(np.array([[0.0, 0.0], [0.5, 1.0], [1.0, 0.0]]))
    0.5
    """
    x, y = (points - points[0]).T
    return float(0.5 * np.sum(x[1:] * y[:-1] - x[:-1] * y[1:]))


def crosses_itself(points: Float[np.ndarray, "m 2"]) -> bool:
    """Whether two segments of a polyline that are not neighbours meet.

    >>> crosses_itself(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.5, -1.0]]))
    True
    >>> crosses_itself(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]))
    False
    """
    return bool(cross_themselves(points[None])[0])


def cross_themselves(lines: Float[np.ndarray, "t m 2"]) -> Bool[np.ndarray, "t"]:
    """Which polylines have two segments that meet and are not neighbours."""
    a, b = lines[:, :-1], lines[:, 1:]
    d, offset = b - a, lines[:, None] - a[:, :, None]
    side = d[:, :, None, 0] * offset[..., 1] - d[:, :, None, 1] * offset[..., 0]
    straddles = side[..., :-1] * side[..., 1:] <= 0
    line, i, j = np.nonzero(straddles & straddles.swapaxes(1, 2))
    low, high = np.minimum(a, b), np.maximum(a, b)
    near = ((low[line, i] <= high[line, j]) & (low[line, j] <= high[line, i])).all(axis=-1)  # decides if all in line
    found = np.zeros(len(lines), bool)
    found[line[near & (j > i + 1)]] = True
    return found
