"""Keypoints from pixels alone, without grippers or a rod: the points of the axis put into the order of a curve.

The order is the longest way through their shortest tree. A gap is bridged straight, and what is hidden at an end is not
there: the keypoints are those of what is seen.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree
from scipy.spatial.distance import cdist

from cableway.geometry import polyline

LEAST_POINTS = 8
"""Below that there is no curve."""

MOST_POINTS = 400
"""Points looked at; of more, evenly chosen ones."""

SMOOTHED = 5
"""Neighbours in a moving mean."""


def chained(
    points: Float[np.ndarray, "k 2"], count: int, before: Float[np.ndarray, "n 2"] | None = None
) -> Float[np.ndarray, "n 2"] | None:
    """Keypoints [m] at equal distances along a curve through points in no order; None where they are too few.

    >>> places = np.array([3, 0, 7, 5, 1, 8, 2, 6, 4, 9]) / 10
    >>> chained(np.column_stack([places, 0 * places]), 3)[1].round(3).tolist()
    [0.45, 0.0]

    Args:
        points: (k, 2) [m].
        count: Number of keypoints.
        before: Those of the picture before, which say at which end to begin; else where x is least.
    """
    if len(points) < LEAST_POINTS:
        return None
    chosen = points[np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS)).astype(int)]
    tree = minimum_spanning_tree(cdist(chosen, chosen) + 1e-9)
    first = int(np.argmax(dijkstra(tree, directed=False, indices=0)))
    away, back = dijkstra(tree, directed=False, indices=first, return_predecessors=True)
    way = [int(np.argmax(away))]
    while way[-1] != first:
        way.append(int(back[way[-1]]))
    line = chosen[way]
    line = np.vstack([line[:1], uniform_filter1d(line, SMOOTHED, axis=0, mode="nearest")[1:-1], line[-1:]])
    found = polyline.resample(line, count)
    if before is None:
        return found if found[0, 0] <= found[-1, 0] else found[::-1].copy()
    nearer = np.linalg.norm(found - before, axis=1).sum() <= np.linalg.norm(found[::-1] - before, axis=1).sum()
    return found if nearer else found[::-1].copy()
