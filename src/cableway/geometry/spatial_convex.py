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

from cableway.core.compiled import inlined, kernel
from cableway.geometry.convex import convex_distance

WALLS = ("left wall", "front wall", "table", "right wall", "back wall", "ceiling")

EXTRUDED, SPHERE, POLYHEDRON = 0, 1, 2

HALVINGS = 40
"""Of a segment, by golden sections, until its least distance is found: 1e-8 of its length."""

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True)
class Solid:
    """A convex obstacle.

    Attributes:
        kind: `EXTRUDED`, `SPHERE` or `POLYHEDRON`.
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


@dataclass(frozen=True)
class SpatialWorld:
    """Solids in a box-shaped workspace, packed.

    Attributes:
        solids: What was packed.
        arrays: What the kernels take as `world`: kinds (k,), centres (k, 3), axes (k, 3, 3), sections (k, v, 2), counts
            (k,), rounding (k,), half heights (k,), triangles (f, 3, 3), where those of each begin (k + 1,), boxes
            (k, 6), low and high corner of the workspace (2, 3).
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
    d, gradient, index = _point_distances(flat, world.arrays, float(ceiling))
    return d.reshape(shape), gradient.reshape(points.shape), index.reshape(shape)


def chain_distance(
    chains: Float[np.ndarray, "b m 3"], world: SpatialWorld, ceiling: float = math.inf
) -> tuple[Float[np.ndarray, "b"], Int[np.ndarray, "b"]]:
    """Least signed distance [m] over all points of each chain of segments, and to what; less its radius for capsules.

    Along a segment the signed distance to a convex set is a convex function, so its least value is found by golden
    sections.
    """
    return _chain_distances(np.ascontiguousarray(chains, dtype=float), world.arrays, float(ceiling))


@inlined
def _triangle_offset(px, py, pz, t, out):
    """The vector `out` from the nearest point of a triangle t (3, 3) to a point (Ericson 2005, 5.1.5)."""
    ux, uy, uz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    vx, vy, vz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    ax, ay, az = px - t[0, 0], py - t[0, 1], pz - t[0, 2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    au, av = ax * ux + ay * uy + az * uz, ax * vx + ay * vy + az * vz
    b, c = 0.0, 0.0  # the nearest point is t[0] + b u + c v
    d3, d4, d5, d6 = au - uu, av - uv, au - uv, av - vv
    vc, vb, va = au * d4 - d3 * av, d5 * av - au * d6, d3 * d6 - d5 * d4
    if au <= 0.0 and av <= 0.0:
        b, c = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        b, c = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        b, c = 0.0, 1.0
    elif vc <= 0.0 and au >= 0.0 and d3 <= 0.0:
        b, c = au / (au - d3), 0.0
    elif vb <= 0.0 and av >= 0.0 and d6 <= 0.0:
        b, c = 0.0, av / (av - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        c = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        b = 1.0 - c
    else:
        total = va + vb + vc
        b, c = vb / total, vc / total
    out[0], out[1], out[2] = ax - b * ux - c * vx, ay - b * uy - c * vy, az - b * uz - c * vz


@kernel
def polyhedron_distance(px, py, pz, triangles, first, last, gradient):
    """Signed distance of a point to a convex polyhedron, the triangles from `first` up to `last`."""
    deepest, nearest = -np.inf, np.inf
    offset = np.empty(3)
    for f in range(first, last):
        t = triangles[f]
        ux, uy, uz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
        vx, vy, vz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        size = math.sqrt(nx * nx + ny * ny + nz * nz)
        height = (nx * (px - t[0, 0]) + ny * (py - t[0, 1]) + nz * (pz - t[0, 2])) / size
        if height > deepest:
            deepest = height
            if nearest == np.inf:  # so far inside
                gradient[0], gradient[1], gradient[2] = nx / size, ny / size, nz / size
        if height > 0.0 and height * height < nearest:
            _triangle_offset(px, py, pz, t, offset)
            squared = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]
            if squared < nearest:
                nearest = squared
                size = math.sqrt(squared)
                for k in range(3):
                    gradient[k] = offset[k] / max(size, 1e-15)
    return deepest if nearest == np.inf else math.sqrt(nearest)


@kernel
def solid_distance(px, py, pz, world, k, gradient):
    """Signed distance of a point to solid k, and its gradient (3,)."""
    kinds, centres, axes, sections, counts, rounding, halves, triangles, begins, _, _ = world
    if kinds[k] == POLYHEDRON:
        return polyhedron_distance(px, py, pz, triangles, begins[k], begins[k + 1], gradient)
    x, y, z = px - centres[k, 0], py - centres[k, 1], pz - centres[k, 2]
    if kinds[k] == SPHERE:
        r = max(math.sqrt(x * x + y * y + z * z), 1e-15)
        gradient[0], gradient[1], gradient[2] = x / r, y / r, z / r
        return r - rounding[k]
    a = axes[k]
    u = a[0, 0] * x + a[0, 1] * y + a[0, 2] * z
    v = a[1, 0] * x + a[1, 1] * y + a[1, 2] * z
    w = a[2, 0] * x + a[2, 1] * y + a[2, 2] * z
    aside, gu, gv = convex_distance(u, v, sections[k], counts[k], rounding[k])
    above, gw = abs(w) - halves[k], 1.0 if w >= 0.0 else -1.0
    d = 0.0
    if aside > 0.0 and above > 0.0:
        d = math.sqrt(aside * aside + above * above)
        gu, gv, gw = gu * aside / d, gv * aside / d, gw * above / d
    elif aside > above:
        d, gw = aside, 0.0
    else:
        d, gu, gv = above, 0.0, 0.0
    for i in range(3):
        gradient[i] = gu * a[0, i] + gv * a[1, i] + gw * a[2, i]
    return d


@inlined
def wall_distance(px, py, pz, limits, gradient):
    """Signed distance of a point to the walls (positive inside the workspace), its gradient, and which one."""
    gradient[:] = 0.0
    least, wall = np.inf, 0
    for side in range(6):
        k = side % 3
        at = px if k == 0 else py if k == 1 else pz
        d = at - limits[0, k] if side < 3 else limits[1, k] - at
        if d < least:
            least, wall = d, side
    gradient[wall % 3] = 1.0 if wall < 3 else -1.0
    return least, wall


@inlined
def box_gap(low, high, box):
    """A lower bound of the signed distance between anything between two corners (3,) and what a box (6,) holds."""
    gap = -np.inf
    for k in range(3):
        gap = max(gap, max(box[k] - high[k], low[k] - box[3 + k]))
    return gap


@kernel
def nearest_solid(point, world, ceiling, gradient, trial):
    """Signed distance of a point (3,) to everything and which is nearest; `trial` (3,) is room to work in."""
    boxes, limits = world[9], world[10]
    d, index = ceiling, -1
    away, wall = wall_distance(point[0], point[1], point[2], limits, trial)
    gradient[:] = 0.0
    if away < d:
        d, index = away, len(boxes) + wall
        gradient[:] = trial
    for k in range(len(boxes)):
        if box_gap(point, point, boxes[k]) < d:
            away = solid_distance(point[0], point[1], point[2], world, k, trial)
            if away < d:
                d, index = away, k
                gradient[:] = trial
    return d, index


@kernel
def _point_distances(points, world, ceiling):
    m, trial = len(points), np.empty(3)
    d, gradient, index = np.empty(m), np.empty((m, 3)), np.empty(m, np.int64)
    for i in range(m):
        d[i], index[i] = nearest_solid(points[i], world, ceiling, gradient[i], trial)
    return d, gradient, index


@kernel
def points_keep(points, world, wanted):
    """Whether all points (m, 3) keep a distance from walls and obstacles; the cheapest tests come first."""
    boxes, limits = world[9], world[10]
    low, high, gradient = np.full(3, np.inf), np.full(3, -np.inf), np.empty(3)
    for i in range(len(points)):
        for k in range(3):
            low[k], high[k] = min(low[k], points[i, k]), max(high[k], points[i, k])
    for k in range(3):
        if low[k] - limits[0, k] < wanted or limits[1, k] - high[k] < wanted:
            return False
    for k in range(len(boxes)):
        if box_gap(low, high, boxes[k]) >= wanted:
            continue
        for i in range(len(points)):
            if box_gap(points[i], points[i], boxes[k]) >= wanted:
                continue
            if solid_distance(points[i, 0], points[i, 1], points[i, 2], world, k, gradient) < wanted:
                return False
    return True


@kernel
def _along(a, b, share, world, k, gradient):
    """Signed distance at a share of the way from a to b (3,)."""
    x, y, z = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])
    return solid_distance(x, y, z, world, k, gradient)


@kernel
def _segment_distance(a, b, world, k, gradient):
    """Least signed distance over a segment to solid k, by golden sections."""
    low, high = 0.0, 1.0
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = _along(a, b, left, world, k, gradient), _along(a, b, right, world, k, gradient)
    least = min(_along(a, b, 0.0, world, k, gradient), _along(a, b, 1.0, world, k, gradient))
    for _ in range(HALVINGS):
        least = min(least, min(at_left, at_right))
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            at_left = _along(a, b, left, world, k, gradient)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            at_right = _along(a, b, right, world, k, gradient)
    return least


@kernel
def _chain_distances(chains, world, ceiling):
    boxes, limits = world[9], world[10]
    d, index, gradient = np.full(len(chains), ceiling), np.full(len(chains), -1), np.empty(3)
    low, high = np.empty(3), np.empty(3)
    for i in range(len(chains)):
        for j in range(chains.shape[1]):
            p = chains[i, j]
            away, wall = wall_distance(p[0], p[1], p[2], limits, gradient)
            if away < d[i]:
                d[i], index[i] = away, len(boxes) + wall
        for j in range(chains.shape[1] - 1):
            a, b = chains[i, j], chains[i, j + 1]
            for k in range(3):
                low[k], high[k] = min(a[k], b[k]), max(a[k], b[k])
            for k in range(len(boxes)):
                if box_gap(low, high, boxes[k]) < d[i]:
                    away = _segment_distance(a, b, world, k, gradient)
                    if away < d[i]:
                        d[i], index[i] = away, k
    return d, index


@kernel
def self_distance(stations, apart):
    """Least distance [m] between two stations at least `apart` places from each other; infinite if there are none."""
    least = np.inf
    for i in range(len(stations) - apart):
        for j in range(i + apart, len(stations)):
            squared = 0.0
            for k in range(3):
                squared += (stations[j, k] - stations[i, k]) ** 2
            least = min(least, squared)
    return math.sqrt(least)
