"""Solids that the page draws, as vertices [m] and triangles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cableway.rendering import mesh
from cableway.rendering.mesh import Surface

ROUND = 40
"""Sides of a disc."""

TUBE = 4
"""Lines along a cable, from its left to its right side over its top; nothing is seen from below."""

CORD = 8
"""The same of one in space, seen from all sides."""

CREASE = math.radians(30.0)
"""Turn from one triangle to the next from which on the edge between them is drawn."""


class Mesh(NamedTuple):
    """Vertices and triangles.

    Attributes:
        vertices: (v, 3) [m].
        faces: (f, 3) indices of vertices, counter-clockwise from outside.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]


def faceted(surface: Surface) -> Mesh:
    """A surface whose triangles are shaded apart."""
    corners = surface.corners.reshape(-1, 3)
    return Mesh(corners, np.arange(len(corners)).reshape(-1, 3))


def welded(surface: Surface) -> Mesh:
    """A surface whose triangles share corners, and are shaded as one."""
    corners = surface.corners.reshape(-1, 3)
    first, faces = shared(corners)
    return Mesh(corners[first], faces)


def together(meshes: Sequence[Mesh]) -> Mesh:
    """Several as one."""
    begins = np.cumsum([0, *(len(each.vertices) for each in meshes)])
    faces = [each.faces + begin for each, begin in zip(meshes, begins[:-1], strict=True)]
    return Mesh(np.concatenate([each.vertices for each in meshes]), np.concatenate(faces))


def cord(line: Float[np.ndarray, "m 3"], radius: float) -> Mesh:
    """A cable along a line in space [m]; lines of as many points have the same triangles."""
    first, faces = _cord_faces(len(line))
    return Mesh(mesh.tube(line, radius, CORD).corners.reshape(-1, 3)[first], faces)


def creases(surface: Surface) -> Float[np.ndarray, "e 2 3"]:
    """The edges of a surface [m] at which it bends by more than `CREASE`."""
    a, b, c = surface.corners.swapaxes(0, 1)
    triangles = surface.corners[np.cross(b - a, c - a).any(axis=1)]  # at the poles of a ball some have no area
    corners = triangles.reshape(-1, 3)
    first, faces = shared(corners)
    normals = mesh.flat_normals(triangles)[:, 0]
    sides: dict[tuple[int, int], list[int]] = {}
    for face, (i, j, k) in enumerate(faces.tolist()):
        for pair in ((i, j), (j, k), (k, i)):
            sides.setdefault((min(pair), max(pair)), []).append(face)
    sharp = [
        pair
        for pair, at in sides.items()
        if len(at) == 2 and normals[at[0]] @ normals[at[1]] < np.cos(CREASE)
    ]  # fmt: skip
    return corners[first][np.array(sharp, dtype=int).reshape(-1, 2)]


def shared(corners: Float[np.ndarray, "k 3"]) -> tuple[Int[np.ndarray, "v"], Int[np.ndarray, "f 3"]]:
    """Which corners of triangles are the first in their place, and the triangles by these."""
    _, first, inverse = np.unique(corners.round(7), axis=0, return_index=True, return_inverse=True)
    return first, inverse.reshape(-1, 3)


@cache
def _cord_faces(points: int) -> tuple[Int[np.ndarray, "v"], Int[np.ndarray, "f 3"]]:
    """The same of a cord along so many points."""
    straight = np.arange(points)[:, None] * np.array([1.0, 0.0, 0.0])
    return shared(mesh.tube(straight, 0.1, CORD).corners.reshape(-1, 3))


def circle(radius: float, sides: int = ROUND) -> Float[np.ndarray, "sides 2"]:
    """Corners of a regular polygon about the origin [m]."""
    angles = 2 * np.pi * np.arange(sides) / sides
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def prism(outline: Float[np.ndarray, "k 2"], low: float, high: float) -> Mesh:
    """What stands on a convex outline [m], from one height to another, its bottom left open."""
    k = len(outline)
    # corners twice, so that sides and top are shaded apart
    top, bottom = (np.column_stack([outline, np.full(k, z)]) for z in (high, low))
    here, there = np.arange(k), np.roll(np.arange(k), -1)
    lid = np.column_stack([np.full(k - 2, 2 * k), 2 * k + 1 + np.arange(k - 2), 2 * k + 2 + np.arange(k - 2)])
    sides = np.vstack([np.column_stack([here, here + k, there + k]), np.column_stack([here, there + k, there])])
    return Mesh(np.vstack([top, bottom, top]), np.vstack([lid, sides]).astype(int))


def tube(line: Float[np.ndarray, "m 2"], radius: float, height: float) -> Mesh:
    """The upper half of a cable along a line [m], its middle at a height."""
    m = len(line)
    normal = _normals(line)
    angles = np.linspace(0.0, np.pi, TUBE)
    across, up = radius * np.cos(angles), height + radius * np.sin(angles)
    ring = line[:, None] + normal[:, None] * across[:, None]
    vertices = np.concatenate([ring, np.broadcast_to(up[:, None], (m, TUBE, 1))], axis=2).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(m - 1), np.arange(TUBE - 1), indexing="ij")
    a, b = (TUBE * row + column).ravel(), (TUBE * row + column + 1).ravel()
    faces = np.vstack([np.column_stack([a, a + TUBE, b + TUBE]), np.column_stack([a, b + TUBE, b])])
    return Mesh(vertices, faces[:, ::-1].astype(int))


def ribbon(line: Float[np.ndarray, "m 2"], width: float, height: float) -> Mesh:
    """A flat stripe along a line [m], seen from above."""
    m = len(line)
    aside = 0.5 * width * _normals(line)
    flat = np.vstack([line - aside, line + aside])
    here = np.arange(m - 1)
    faces = np.vstack(
        [np.column_stack([here, here + 1, m + here]), np.column_stack([here + 1, m + here + 1, m + here])]
    )
    return Mesh(np.column_stack([flat, np.full(2 * m, height)]), faces.astype(int))


def ring(inner: float, outer: float, height: float) -> Mesh:
    """A flat ring about the origin [m], seen from above."""
    inside, outside = circle(inner), circle(outer)
    flat = np.vstack([inside, outside])
    here, there = np.arange(ROUND), np.roll(np.arange(ROUND), -1)
    faces = np.vstack(
        [np.column_stack([here, here + ROUND, there + ROUND]), np.column_stack([here, there + ROUND, there])]
    )
    return Mesh(np.column_stack([flat, np.full(2 * ROUND, height)]), faces.astype(int))


def _normals(line: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 2"]:
    """To the left of a line, of length 1."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    return np.column_stack([-tangent[:, 1], tangent[:, 0]])
