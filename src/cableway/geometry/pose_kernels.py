"""Compiled kernels of rotations and poses in space: rotation vectors, unit quaternions (w, x, y, z), turned points."""

from __future__ import annotations

import math

from cableway.core.compiled import inlined

TURNED = 1e-12
"""Half the sine of half an angle below which a rotation is none."""


@inlined
def quaternion_of(v, out):
    """The unit quaternion (4,) of a rotation vector (3,)."""
    angle = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    factor = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    out[0] = math.cos(0.5 * angle)
    for k in range(3):
        out[1 + k] = factor * v[k]


@inlined
def vector_of(a, out):
    """The rotation vector (3,), at most half a turn, of a unit quaternion (4,)."""
    sine = math.sqrt(a[1] * a[1] + a[2] * a[2] + a[3] * a[3])
    factor = 2.0
    if sine > TURNED:
        factor = 2.0 * math.atan2(sine, abs(a[0])) / sine
    if a[0] < 0.0:
        factor = -factor
    for k in range(3):
        out[k] = factor * a[1 + k]


@inlined
def product(a, b, out):
    """The rotation b followed by a."""
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]


@inlined
def turned(pose, at, out):
    """The point `at` (3,) of the frame at a pose (7,), in the world."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    a = 2.0 * (y * at[2] - z * at[1])
    b = 2.0 * (z * at[0] - x * at[2])
    c = 2.0 * (x * at[1] - y * at[0])
    out[0] = pose[0] + at[0] + w * a + y * c - z * b
    out[1] = pose[1] + at[1] + w * b + z * a - x * c
    out[2] = pose[2] + at[2] + w * c + x * b - y * a
