"""The judge's own geometry of the plane: points as complex numbers, curves as B-splines.

Nothing here is shared with planner, controllers or simulator, so that a mistake of theirs is not repeated.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import make_interp_spline

from cableway.scene.grippers import Plug, Port


def curve_through(keypoints: Float[np.ndarray, "... n space"], pieces: int) -> Float[np.ndarray, "... m space"]:
    """The cable through keypoints [m], `pieces` segments between neighbours: the interpolating cubic B-spline."""
    count = keypoints.shape[-2]
    spline = make_interp_spline(np.arange(count), keypoints, k=min(3, count - 1), axis=-2)
    return spline(np.arange(pieces * (count - 1) + 1) / pieces)


def at_equal_arcs(lines: Float[np.ndarray, "t m 2"], count: int) -> Float[np.ndarray, "t count 2"]:
    """`count` points [m] at equal arc length along each polyline, both ends included."""
    steps = np.linalg.norm(np.diff(lines, axis=1), axis=2)
    arcs = np.concatenate([np.zeros((len(lines), 1)), np.cumsum(steps, axis=1)], axis=1)
    rows = [
        [np.interp(np.linspace(0.0, arc[-1], count), arc, column) for column in line.T]
        for arc, line in zip(arcs, lines, strict=True)
    ]
    return np.swapaxes(np.array(rows), 1, 2)


def turn(angle: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """The same angle [rad] the short way round, from -pi to pi."""
    return np.angle(np.exp(1j * np.asarray(angle)))


def pose_distance(
    a: Float[np.ndarray, "... 3"], b: Float[np.ndarray, "... 3"]
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Distance [m] and turn [rad] between poses."""
    return np.hypot(b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]), np.abs(turn(b[..., 2] - a[..., 2]))


def plug_outline(plug: Plug, poses: Float[np.ndarray, "t 3"], spacing: float) -> Float[np.ndarray, "t k 2"]:
    """Points [m] at most `spacing` apart round a plug with its rear at `poses` [m, m, rad]; the last is the first."""
    corners = np.array([0, plug.length]).repeat(2) + 0.5j * plug.width * np.array([-1, 1, 1, -1])
    corners = corners[[0, 3, 2, 1]]
    return outline_at(np.stack([corners.real, corners.imag], axis=-1), poses, spacing)


def outline_at(
    outline: Float[np.ndarray, "v 2"], poses: Float[np.ndarray, "t 3"], spacing: float
) -> Float[np.ndarray, "t k 2"]:
    """Points [m] at most `spacing` apart round an outline in frames at `poses` [m, m, rad]; the last is the first."""
    corners = outline[:, 0] + 1j * outline[:, 1]
    points = [corners[0]]
    for a, b in pairwise([*corners, corners[0]]):
        points.extend(np.linspace(a, b, int(np.ceil(abs(b - a) / spacing - 1e-9)) + 1)[1:])
    at = (poses[:, 0] + 1j * poses[:, 1])[:, None] + np.exp(1j * poses[:, 2])[:, None] * np.array(points)
    return np.stack([at.real, at.imag], axis=-1)


class Alignment(NamedTuple):
    """Where the tip of a plug is, along a port and beside its axis [m, m], and its turn from that axis [rad]."""

    depth: Float[np.ndarray, "t"]
    lateral: Float[np.ndarray, "t"]
    angle: Float[np.ndarray, "t"]


def alignment(plug: Plug, port: Port, poses: Float[np.ndarray, "t 3"]) -> Alignment:
    """How a plug with its rear at `poses` [m, m, rad] lies in its port."""
    tips = poses[:, 0] + 1j * poses[:, 1] + plug.length * np.exp(1j * poses[:, 2])
    offset = (tips - complex(*port.position)) * np.exp(-1j * port.angle)
    return Alignment(offset.real, offset.imag, turn(poses[:, 2] - port.angle))
