"""Convex obstacles in space packed for the compiled kernels, and signed distance to them and to the workspace's walls.

An obstacle is a sphere, a convex polyhedron, or a convex polygon with a rounding, extruded along its own z axis: boxes,
cylinders (a single vertex with a rounding) and prisms of planar obstacles, whose height may be unlimited. Signed
distance is positive outside, and negative inside by the depth below the surface. The walls of the workspace are
obstacles, whose indices follow in the order of `WALLS`; the floor is the table.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from cableway.geometry import spatial_convex_kernels as kernels
from cableway.geometry import spatial_pair_kernels as pairs
from cableway.geometry.spatial_convex_kernels import EXTRUDED, POLYHEDRON, SPHERE

LONG = 1e3
"""Half the height [m] of what is of unlimited height, where the distance of a body from it is measured."""

WALLS = ("left wall", "front wall", "table", "right wall", "back wall", "ceiling")


@dataclass(frozen=True)
class Solid:
    """A convex obstacle.

    Attributes:
        kind: `EXTRUDED`, `SPHERE` or `POLYHEDRON` of the kernels.
        centre: (3,) origin of its frame [m].
        axes: (3, 3) rows are the axes of its frame.
        section: (v, 2) polygon, counter-clockwise, that is extruded along the frame's z axis [m].
        rounding: By which the polygon is grown, or the radius of a sphere [m].
        half: Half the height [m]; may be infinite.
        triangles: (f, 3, 3) of a polyhedron in the world, outward [m].
    """

    kind: int
    centre: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    section: Float[np.ndarray, "v 2"]
    rounding: float
    half: float
    triangles: Float[np.ndarray, "f 3 3"]

    @classmethod
    def box(
        cls, centre: Float[np.ndarray, "3"], size: Float[np.ndarray, "3"], axes: Float[np.ndarray, "3 3"] | None = None
    ) -> Solid:
        """A box with edges of these lengths [m] along the rows of `axes`."""
        x, y, z = np.asarray(size, float) / 2
        return cls.extruded(np.array([[-x, -y], [x, -y], [x, y], [-x, y]]), centre, z, axes=axes)

    @classmethod
    def cylinder(
        cls, centre: Float[np.ndarray, "3"], radius: float, height: float, axes: Float[np.ndarray, "3 3"] | None = None
    ) -> Solid:
        """A cylinder about the third row of `axes`."""
        return cls.extruded(np.zeros((1, 2)), centre, height / 2, radius, axes)

    @classmethod
    def sphere(cls, centre: Float[np.ndarray, "3"], radius: float) -> Solid:
        """A ball."""
        return cls(SPHERE, np.array(centre, float), np.eye(3), np.zeros((1, 2)), radius, 0.0, np.zeros((0, 3, 3)))

    @classmethod
    def extruded(
        cls,
        section: Float[np.ndarray, "v 2"],
        centre: Float[np.ndarray, "3"],
        half: float,
        rounding: float = 0.0,
        axes: Float[np.ndarray, "3 3"] | None = None,
    ) -> Solid:
        """A convex polygon (counter-clockwise), grown by `rounding`, from -half to half along the third row of `axes`.

        In the plane of the first two rows, grown corners are round; the edges at top and bottom are sharp.
        """
        axes = np.eye(3) if axes is None else np.array(axes, float)
        flat = np.array(section, float)
        return cls(EXTRUDED, np.array(centre, float), axes, flat, rounding, half, np.zeros((0, 3, 3)))

    @classmethod
    def hull(cls, points: Float[np.ndarray, "k 3"]) -> Solid:
        """The convex hull of points [m], which must not lie in a plane."""
        from scipy.spatial import ConvexHull  # here, since planar tasks are read without it

        points = np.array(points, float)
        found, middle = ConvexHull(points), points.mean(axis=0)
        triangles = points[found.simplices]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        inward = np.sum(normals * (triangles[:, 0] - middle), axis=1) < 0
        triangles[inward] = triangles[inward][:, ::-1]
        return cls(POLYHEDRON, middle, np.eye(3), np.zeros((1, 2)), 0.0, 0.0, triangles)

    @property
    def bounds(self) -> Float[np.ndarray, "6"]:
        """Least x, y, z and greatest x, y, z [m]."""
        if self.kind == POLYHEDRON:
            corners = self.triangles.reshape(-1, 3)
            return np.concatenate([corners.min(0), corners.max(0)])
        if self.kind == SPHERE:
            return np.concatenate([self.centre - self.rounding, self.centre + self.rounding])
        flat = self.section @ self.axes[:2]
        up = np.where(np.abs(self.axes[2]) < 1e-12, 0.0, np.abs(self.axes[2]))
        reach = np.where(up > 0, up * self.half if math.isfinite(self.half) else np.inf, 0.0)
        reach = reach + self.rounding * np.sqrt(np.maximum(0.0, 1.0 - up**2))
        return np.concatenate([self.centre + flat.min(0) - reach, self.centre + flat.max(0) + reach])

    @property
    def corners(self) -> Float[np.ndarray, "c 3"]:
        """Of the hull [m] that `rounding` grows: a polyhedron's, a sphere's centre, those of what is extruded."""
        if self.kind == POLYHEDRON:
            return np.unique(self.triangles.reshape(-1, 3), axis=0)
        if self.kind == SPHERE:
            return self.centre[None]
        up = min(self.half, LONG) * self.axes[2]
        flat = self.centre + self.section @ self.axes[:2]
        return np.concatenate([flat - up, flat + up])


@dataclass(frozen=True)
class SpatialWorld:
    """Solids in a box-shaped workspace, packed.

    Attributes:
        solids: What was packed.
        arrays: What the kernels take as `world`: kinds (k,), centres (k, 3), axes (k, 3, 3), sections (k, v, 2), counts
            (k,), rounding (k,), half heights (k,), triangles (f, 3, 3), where those of each begin (k + 1,), boxes
            (k, 6), low and high corner of the workspace (2, 3), `Solid.corners` (c, 3), where those of each begin
            (k + 1,).
    """

    solids: tuple[Solid, ...]
    arrays: tuple[Any, ...]

    @classmethod
    def of(
        cls, solids: Sequence[Solid], size: Float[np.ndarray, "3"], origin: Float[np.ndarray, "3"] | None = None
    ) -> SpatialWorld:
        """Solids in a workspace of a size [m] with its low corner at `origin`, or at zero."""
        most, count = max((len(each.section) for each in solids), default=1), len(solids)
        sections = np.zeros((count, most, 2))
        for row, each in zip(sections, solids, strict=True):
            row[: len(each.section)] = each.section
        begins = np.cumsum([0, *(len(each.triangles) for each in solids)], dtype=np.int64)
        corners = [np.zeros((0, 3)), *(each.corners for each in solids)]
        low = np.zeros(3) if origin is None else np.array(origin, float)
        arrays = (
            np.array([each.kind for each in solids], dtype=np.int64),
            np.array([each.centre for each in solids], float).reshape(count, 3),
            np.array([each.axes for each in solids], float).reshape(count, 3, 3),
            sections,
            np.array([len(each.section) for each in solids], dtype=np.int64),
            np.array([each.rounding for each in solids], float),
            np.array([each.half for each in solids], float),
            np.concatenate([np.zeros((0, 3, 3)), *(each.triangles for each in solids)]),
            begins,
            np.array([each.bounds for each in solids], float).reshape(count, 6),
            np.array([low, low + np.asarray(size, float)]),
            np.concatenate(corners),
            np.cumsum([len(each) for each in corners], dtype=np.int64),
        )
        return cls(tuple(solids), arrays)


def signed_distance(
    points: Float[np.ndarray, "... 3"], world: SpatialWorld, ceiling: float = math.inf
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "... 3"], Int[np.ndarray, "..."]]:
    """Signed distance [m] of points to the nearest obstacle or wall, its gradient, and which one that is.

    Where nothing is nearer than `ceiling` [m], that is the distance, the gradient is zero and the index -1.
    """
    points = np.asarray(points, float)
    flat, shape = np.ascontiguousarray(points.reshape(-1, 3)), points.shape[:-1]
    d, gradient, index = kernels.point_distances(flat, world.arrays, float(ceiling))
    return d.reshape(shape), gradient.reshape(points.shape), index.reshape(shape)


def chain_distance(
    chains: Float[np.ndarray, "b m 3"], world: SpatialWorld, ceiling: float = math.inf
) -> tuple[Float[np.ndarray, "b"], Int[np.ndarray, "b"]]:
    """Least signed distance [m] over all points of each chain of segments, and to what; less its radius for capsules.

    Along a segment the signed distance to a convex set is a convex function, so its least value is found by golden
    sections.
    """
    return kernels.chain_distances(np.ascontiguousarray(chains, dtype=float), world.arrays, float(ceiling))


def hull_distance(points: Float[np.ndarray, "k 3"], solid: Solid) -> float:
    """Distance [m] of a point, or of the hull of points that lie in no plane, from a solid.

    Negative by the depth, the least move that parts them, where they overlap.

    >>> box = Solid.box(np.zeros(3), np.array([0.2, 0.2, 0.2]))
    >>> tip = np.array([[0.0, 0, 0.3], [0.1, 0, 0.3], [0, 0.1, 0.3], [0, 0, 0.13]])
    >>> round(hull_distance(tip, box), 6), round(hull_distance(tip - (0, 0, 0.05), box), 6)
    (0.03, -0.02)
    """
    world = SpatialWorld.of([solid], np.ones(3)).arrays
    if len(points) == 1:
        x, y, z = points[0]
        return kernels.solid_distance(x, y, z, world, 0, np.empty(3))
    return pairs.hull_distance(np.ascontiguousarray(points, float), world, 0)
