"""Rotations of space as unit quaternions (w, x, y, z), in rows of arrays."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def product(a: Float[np.ndarray, "... 4"], b: Float[np.ndarray, "... 4"]) -> Float[np.ndarray, "... 4"]:
    """The rotations `b` followed by `a`."""
    (aw, ax, ay, az), (bw, bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate(a: Float[np.ndarray, "... 4"]) -> Float[np.ndarray, "... 4"]:
    """The rotations back."""
    return a * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(a: Float[np.ndarray, "... 4"], vectors: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """Vectors after rotations."""
    twice = 2 * np.cross(a[..., 1:], vectors)
    return vectors + a[..., :1] * twice + np.cross(a[..., 1:], twice)


def from_vector(v: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 4"]:
    """The rotations about vectors by their lengths [rad].

    >>> from_vector(np.array([0.0, 0.0, np.pi])).round(3).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    half = np.linalg.norm(v, axis=-1, keepdims=True) / 2
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * v], axis=-1)


def to_vector(a: Float[np.ndarray, "... 4"]) -> Float[np.ndarray, "... 3"]:
    """The rotation vectors [rad], at most half a turn long.

    >>> to_vector(np.array([-1.0, 0.0, 0.0, 0.0])).tolist()
    [0.0, 0.0, 0.0]
    """
    a = a * np.where(a[..., :1] < 0, -1.0, 1.0)
    sine = np.linalg.norm(a[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, a[..., :1])
    return a[..., 1:] * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0) + 0.0


def matrices(a: Float[np.ndarray, "... 4"]) -> Float[np.ndarray, "... 3 3"]:
    """The matrices, whose columns are the axes of the frames turned."""
    return np.stack([rotate(a, axis) for axis in np.eye(3)], axis=-1)


def from_matrices(m: Float[np.ndarray, "... 3 3"]) -> Float[np.ndarray, "... 4"]:
    """The quaternions of rotation matrices, w not negative (Shepperd 1978)."""
    trace = np.trace(m, axis1=-2, axis2=-1)
    squares = 1 + np.stack([trace, *(2 * m[..., k, k] - trace for k in range(3))], axis=-1)
    outer = np.zeros((*trace.shape, 4, 4))  # 4 a a'
    outer[..., np.arange(4), np.arange(4)] = squares
    for k, (i, j) in enumerate([(1, 2), (2, 0), (0, 1)]):
        outer[..., 0, 1 + k] = outer[..., 1 + k, 0] = m[..., j, i] - m[..., i, j]
        outer[..., 1 + i, 1 + j] = outer[..., 1 + j, 1 + i] = m[..., j, i] + m[..., i, j]
    best = squares.argmax(axis=-1)[..., None, None]
    rows = np.take_along_axis(outer, best, axis=-2)[..., 0, :]
    rows = rows * np.where(rows[..., :1] < 0, -1.0, 1.0)
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def least_turn(a: Float[np.ndarray, "... 3"], b: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 4"]:
    """The quaternions of the least turns from unit vectors to others."""
    half = np.concatenate([1 + np.sum(a * b, axis=-1, keepdims=True), np.cross(a, b)], axis=-1)
    half[..., 0] = np.maximum(half[..., 0], 1e-9)
    return half / np.linalg.norm(half, axis=-1, keepdims=True)
