"""Closed surfaces of triangles, and the bodies that a cell is made of: prisms, tubes and capsules.

The corners of a triangle run counter-clockwise as seen from outside. Curved surfaces have the normals of what they
stand for at each corner, so that they look smooth; flat ones that of their plane.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

ROUND = 24
"""Sides of a circle unless stated."""

FOLDED = 1e-6
"""Length of a sum of unit vectors below which it has no direction."""


class Surface(NamedTuple):
    """A closed surface.

    Attributes:
        corners: Of its triangles [m].
        normals: At these corners, of length 1, outwards.
    """

    corners: Float[np.ndarray, "f 3 3"]
    normals: Float[np.ndarray, "f 3 3"]

    def painted(self, color: tuple[float, float, float], label: int) -> Mesh:
        """The surface in one colour (sRGB from 0 to 1) and with one label, above 0."""
        count = len(self.corners)
        return Mesh(self.corners, self.normals, np.tile(np.array(color, float), (count, 1)), np.full(count, label))


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with colours and labels.

    Attributes:
        corners: Of the triangles in the world [m].
        normals: At these corners, of length 1, outwards.
        colors: sRGB of each triangle, from 0 to 1.
        labels: What each triangle belongs to, above 0.
    """

    corners: Float[np.ndarray, "f 3 3"]
    normals: Float[np.ndarray, "f 3 3"]
    colors: Float[np.ndarray, "f 3"]
    labels: Int[np.ndarray, "f"]

    @classmethod
    def joined(cls, parts: Iterable[Mesh]) -> Mesh:
        """Several as one."""
        fields = zip(*((part.corners, part.normals, part.colors, part.labels) for part in parts), strict=True)
        return cls(*map(np.concatenate, fields))

    def where(self, kept: Bool[np.ndarray, "f"]) -> Mesh:
        """Some of its triangles."""
        return Mesh(self.corners[kept], self.normals[kept], self.colors[kept], self.labels[kept])


def circle(center: tuple[float, float], radius: float, sides: int = ROUND) -> Float[np.ndarray, "k 2"]:
    """Vertices [m] of a regular polygon on a circle, counter-clockwise."""
    angles = np.arange(sides) * (2 * np.pi / sides)
    return np.array(center) + radius * np.column_stack([np.cos(angles), np.sin(angles)])


def prism(outline: Float[np.ndarray, "k 2"], heights: tuple[float, float], *, rounded: bool = False) -> Surface:
    """An upright prism of a convex outline [m], counter-clockwise, from one height [m] to another.

    Args:
        outline: Seen from above.
        heights: Of its lower and upper face.
        rounded: Whether its sides stand for a curved surface.
    """
    low, high = (np.column_stack([outline, np.full(len(outline), height)]) for height in heights)
    corners = np.concatenate([_bands(np.stack([low, high])), _fan(high), _fan(low[::-1])])
    normals = flat_normals(corners)
    if rounded:
        edges = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
        outwards = np.column_stack([edges[:, 1], -edges[:, 0], np.zeros(len(edges))])
        outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
        normals[: 2 * len(outline)] = _bands(np.stack([outwards, outwards]))
    return Surface(corners, normals)


def tube(points: Float[np.ndarray, "m 3"], radius: float, sides: int = 12) -> Surface:
    """A tube about a polyline [m] without repeated points, with flat ends.

    Its cross-sections turn along with the polyline as little as they can.
    """
    steps = np.diff(points, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    along = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    folded = np.linalg.norm(along, axis=1) < FOLDED
    along[:-1][folded[:-1]] = steps[folded[:-1]]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.empty_like(points)
    before = np.zeros(3)
    for row, tangent in enumerate(along):
        before = before - (before @ tangent) * tangent
        if np.linalg.norm(before) < FOLDED:
            other = np.eye(3)[np.abs(tangent).argmin()]
            before = other - (other @ tangent) * tangent
        before /= np.linalg.norm(before)
        aside[row] = before
    around = circle((0.0, 0.0), 1.0, sides)
    outwards = around[:, :1] * aside[:, None] + around[:, 1:] * np.cross(along, aside)[:, None]
    rings = points[:, None] + radius * outwards
    ends = np.concatenate([_fan(rings[0, ::-1]), _fan(rings[-1])])
    corners, normals = np.concatenate([_bands(rings), ends]), np.concatenate([_bands(outwards), flat_normals(ends)])
    return Surface(corners, normals)


def capsules(
    ends: Float[np.ndarray, "k 2 3"], radius: Float[np.ndarray, "k"], sides: int = ROUND, rings: int = 6
) -> Surface:
    """Segments [m] grown by radii [m]; spheres where the two ends are in one place.

    Args:
        ends: Of the segments.
        radius: Of each.
        sides: Of a cross-section.
        rings: Of each half of a sphere between its pole and its equator.
    """
    polar = np.arange(1, rings + 1) * (np.pi / 2 / rings)
    cap = np.empty((rings, sides, 3))
    cap[..., :2] = np.sin(polar)[:, None, None] * circle((0.0, 0.0), 1.0, sides)
    cap[..., 2] = np.cos(polar)[:, None]
    ball = np.concatenate(
        [cap * (1.0, 1.0, -1.0), cap[::-1]]
    )  # from near one pole to near the other, the equator twice
    pole = np.broadcast_to([0.0, 0.0, 1.0], (sides, 3))
    unit = np.concatenate([_bands(ball), _to_pole(ball[-1], pole), _to_pole(ball[0, ::-1], -pole)])
    second = np.repeat([0.0, 1.0], rings)[:, None, None] * np.ones((1, sides, 1))
    second = np.concatenate([_bands(second)[..., 0], np.ones((sides, 3)), np.zeros((sides, 3))])
    normals = unit @ np.swapaxes(_upright(ends[:, 1] - ends[:, 0]), 1, 2)[:, None]
    places = ends[:, 0, None, None] + second[..., None] * (ends[:, 1] - ends[:, 0])[:, None, None]
    corners = places + radius[:, None, None, None] * normals
    return Surface(corners.reshape(-1, 3, 3), normals.reshape(-1, 3, 3))


def _upright(directions: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3 3"]:
    """Frames as columns whose z axes are along directions; that of the world along none."""
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    z = np.where(length > 1e-12, directions / np.maximum(length, 1e-12), (0.0, 0.0, 1.0))
    helper = np.eye(3)[np.abs(z).argmin(axis=1)]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _bands(rings: Float[np.ndarray, "m k d"]) -> Float[np.ndarray, "f 3 d"]:
    """The triangles between rings that follow each other, each counter-clockwise as seen from the ring after it."""
    a, c = rings[:-1], rings[1:]
    b, d = np.roll(a, -1, axis=1), np.roll(c, -1, axis=1)
    pairs = np.stack([np.stack([a, b, d], axis=2), np.stack([a, d, c], axis=2)], axis=2)
    return pairs.reshape(-1, 3, rings.shape[2])


def _fan(ring: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "f 3 3"]:
    """The triangles of a convex polygon."""
    first = np.broadcast_to(ring[0], (len(ring) - 2, 3))
    return np.stack([first, ring[1:-1], ring[2:]], axis=1)


def _to_pole(ring: Float[np.ndarray, "k 3"], pole: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3 3"]:
    """The triangles between a ring and a point."""
    return np.stack([ring, np.roll(ring, -1, axis=0), pole], axis=1)


def flat_normals(corners: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "f 3 3"]:
    """The normals of triangles' planes at their corners."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.repeat(across[:, None], 3, axis=1)
