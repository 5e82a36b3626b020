"""Angles and rotations of points in the plane; `cableway.geometry.groups` has the poses."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def wrap_angle(angle: Float[np.ndarray, "..."] | float) -> Float[np.ndarray, "..."]:
    """The same angle [rad] in (-pi, pi].

    >>> float(wrap_angle(3 * np.pi / 2)) == -np.pi / 2
    True
    """
    return np.pi - np.mod(np.pi - np.asarray(angle, float), 2 * np.pi)


def rotation(angle: float) -> Float[np.ndarray, "2 2"]:
    """The matrix that turns column vectors by `angle` [rad], counter-clockwise."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def transform(
    points: Float[np.ndarray, "... 2"], translation: Float[np.ndarray, "2"], angle: float
) -> Float[np.ndarray, "... 2"]:
    """Turn points [m] by `angle` [rad] about the origin, then move them by `translation` [m]."""
    return points @ rotation(angle).T + translation


def direction(angle: Float[np.ndarray, "..."] | float) -> Float[np.ndarray, "... 2"]:
    """Unit vectors at `angle` [rad] from +x.

    >>> direction(0.0).tolist()
    [1.0, 0.0]
    """
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
