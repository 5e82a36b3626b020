"""Angles, rotations and rigid motions of the plane."""

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


def pose_step(before: Float[np.ndarray, "... 3"], after: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """The action (dx, dy, dtheta) [m, m, rad] from one pose (x, y, theta) to another, turning the short way."""
    step = np.asarray(after, float) - before
    step[..., 2] = wrap_angle(step[..., 2])
    return step


def pose_distance(
    a: Float[np.ndarray, "... 3"], b: Float[np.ndarray, "... 3"]
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Distance [m] and turn [rad] between poses (x, y, theta)."""
    step = pose_step(a, b)
    return np.linalg.norm(step[..., :2], axis=-1), np.abs(step[..., 2])


def attached(poses: Float[np.ndarray, "... 3"], offsets: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """Poses (x, y, theta) of what is at `offsets` in the frames at `poses` [m, m, rad].

    >>> attached(np.array([1.0, 0.0, np.pi / 2]), np.array([0.1, 0.0, 0.2])).round(3).tolist()
    [1.0, 0.1, 1.771]
    """
    c, s = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x, y, turn = np.moveaxis(offsets, -1, 0)
    return poses + np.stack([c * x - s * y, s * x + c * y, turn], axis=-1)


def bearing(ends: Float[np.ndarray, "... 3"], offsets: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """Poses of the frames in which what is at `ends` is at `offsets`; the inverse of `attached`."""
    angle = ends[..., 2] - offsets[..., 2]
    c, s = np.cos(angle), np.sin(angle)
    x, y, turn = np.moveaxis(offsets, -1, 0)
    return ends - np.stack([c * x - s * y, s * x + c * y, turn], axis=-1)
