"""Maps from one plane to another by 3 or 4 points, as a camera that looks at a table makes them."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError

COLLINEAR = 1e-3
"""Area of a triangle, over that of the square around all points, below which its corners count as in line."""


def plane_map(source: Float[np.ndarray, "k 2"], target: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "3 3"]:
    """The map in homogeneous coordinates that takes 3 (affine) or 4 points (projective) exactly to others.

    >>> plane_map(np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]]), np.array([[1.0, 1.0], [2.0, 1.0], [1.0, 0.0]]))
    array([[ 0.5,  0. ,  1. ],
           [ 0. , -0.5,  1. ],
           [ 0. ,  0. ,  1. ]])

    Raises:
        InputError: There are neither 3 nor 4 points, three of them are in line, or they do not correspond: no view of
            the one plane orders them so.
    """
    if len(source) != len(target) or len(source) not in (3, 4):
        raise InputError(f"a plane is mapped by 3 or 4 pairs of points, got {len(source)} and {len(target)}")
    for points in (source, target):
        _require_spread(points)
    matrix = _basis(target) @ np.linalg.inv(_basis(source))
    depths = homogeneous(source) @ matrix[2]
    if depths.min() * depths.max() <= 0:
        raise InputError("the 4 points do not correspond: they must be listed in the same order around both planes")
    return matrix / depths[0]


def homogeneous(points: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 3"]:
    """The points with a third coordinate of 1."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def mapped(matrix: Float[np.ndarray, "3 3"], points: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 2"]:
    """The points after the map; NaN for those at or beyond the horizon, which are no points of the other plane."""
    image = homogeneous(points) @ matrix.T
    depth = np.where(image[..., 2:] > 0, image[..., 2:], np.nan)
    return image[..., :2] / depth


def _basis(points: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "3 3"]:
    """Columns that are the first three points, each weighted so that their sum is the fourth where there is one."""
    corners = homogeneous(points[:3]).T
    return corners if len(points) == 3 else corners * np.linalg.solve(corners, homogeneous(points[3]))


def _require_spread(points: Float[np.ndarray, "k 2"]) -> None:
    side = float(np.ptp(points, axis=0).max())
    for a, b, c in combinations(points, 3):
        if abs((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]) <= 2 * COLLINEAR * side**2:
            three = ", ".join(f"({x:g}, {y:g})" for x, y in (a, b, c))
            raise InputError(f"three of the points are in line: {three}")
