"""Compiled kernels of signed distance in space; `cableway.geometry.spatial_convex` is what to call.

A `world` is `SpatialWorld.arrays`; `gradient` and `trial` (3,) are filled in.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel
from cableway.geometry.convex import convex_distance

EXTRUDED, SPHERE, POLYHEDRON = 0, 1, 2

HALVINGS = 40
"""Of a segment, by golden sections, until its least distance is found: 1e-8 of its length."""

LEAST = 1e-300
"""What is divided by where a triangle has no extent."""

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


@inlined
def nearest_on_triangle(px, py, pz, p, q, r):
    """The point p + b (q - p) + c (r - p) of a triangle that is nearest to a point (Ericson 2005, 5.1.5): b and c."""
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    ax, ay, az = px - p[0], py - p[1], pz - p[2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    au, av = ax * ux + ay * uy + az * uz, ax * vx + ay * vy + az * vz
    b, c = 0.0, 0.0
    d3, d4, d5, d6 = au - uu, av - uv, au - uv, av - vv
    vc, vb, va = au * d4 - d3 * av, d5 * av - au * d6, d3 * d6 - d5 * d4
    if au <= 0.0 and av <= 0.0:
        b, c = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        b, c = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        b, c = 0.0, 1.0
    elif vc <= 0.0 and au >= 0.0 and d3 <= 0.0:
        b, c = au / max(au - d3, LEAST), 0.0
    elif vb <= 0.0 and av >= 0.0 and d6 <= 0.0:
        b, c = 0.0, av / max(av - d6, LEAST)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        c = (d4 - d3) / max((d4 - d3) + (d5 - d6), LEAST)
        b = 1.0 - c
    else:
        total = va + vb + vc
        b, c = vb / total, vc / total
    return b, c


@inlined
def _triangle_offset(px, py, pz, t, out):
    """The vector `out` from the nearest point of a triangle t (3, 3) to a point."""
    b, c = nearest_on_triangle(px, py, pz, t[0], t[1], t[2])
    for k, x in enumerate((px, py, pz)):
        out[k] = (x - t[0, k]) - b * (t[1, k] - t[0, k]) - c * (t[2, k] - t[0, k])


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
    kinds, centres, axes, sections, counts, rounding, halves, triangles, begins, _, _, _, _ = world
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
def point_distances(points, world, ceiling):
    """`nearest_solid` of each point (m, 3), with its gradient: (m,), (m, 3), (m,)."""
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
def _segment_distance(a, b, world, k, ceiling, gradient):
    """Least signed distance over a segment to solid k, by golden sections; above a ceiling, something above it."""
    low, high = 0.0, 1.0
    length = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = _along(a, b, left, world, k, gradient), _along(a, b, right, world, k, gradient)
    least = min(at_left, at_right)
    if least - left * length >= ceiling:
        return least
    least = min(least, min(_along(a, b, 0.0, world, k, gradient), _along(a, b, 1.0, world, k, gradient)))
    for _ in range(HALVINGS):
        least = min(least, min(at_left, at_right))
        if least - (left - low) * length >= ceiling:
            return least
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
def chain_distances(chains, world, ceiling):
    """Least signed distance over each chain of segments (b, m, 3) below a ceiling, and to what: (b,), (b,)."""
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
                    away = _segment_distance(a, b, world, k, d[i], gradient)
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
