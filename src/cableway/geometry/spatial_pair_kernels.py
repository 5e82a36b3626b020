"""Compiled kernels of the distance between two convex sets, each the hull of corners that something may grow.

The distance is that of the origin from the set of all differences a - b: by the algorithm of Gilbert, Johnson and
Keerthi (IEEE J. Robotics Autom. 4, 1988) where they are apart, and the depth, the least move that parts them, by
expanding a polytope from within (van den Bergen 2003, 4.3.8) where they overlap. `a` is a hull with a volume; `b` is
any hull, grown by a disc of radius `disc` across `axis`, as a cylinder is a segment that is so grown.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel
from cableway.geometry.spatial_convex_kernels import EXTRUDED, SPHERE, nearest_on_triangle

CLOSE = 1e-6
"""Error of a distance or a depth [m]."""

STEPS = 48
"""At most, to find a distance; a box and a box take up to eight, and something round some twenty."""

FLAT = 1e-12
"""Height [m] of a tetrahedron that is as good as none."""

ALONG = 1e-9
"""Sine of the angle to its axis below which a direction has no point of a disc that is farthest."""

CORNERS = 96
"""Of the polytope, at most; its error is then that of something round, some 0.1% of its radius."""

ROOM = 13
"""Rows of three numbers that `core_gap` works in."""


@inlined
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _cross(a, b, out):
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _farthest(n, a, b, disc, axis, w):
    """The difference w (3,) of `a` and `b` that is farthest along n; the index of its corner of `a`."""
    best, at = -np.inf, 0
    for i in range(len(a)):
        along = _dot(n, a[i])
        if along > best:
            best, at = along, i
    least, other = np.inf, 0
    for i in range(len(b)):
        along = _dot(n, b[i])
        if along < least:
            least, other = along, i
    for k in range(3):
        w[k] = a[at, k] - b[other, k]
    if disc > 0.0:
        up = _dot(n, axis)
        x, y, z = n[0] - up * axis[0], n[1] - up * axis[1], n[2] - up * axis[2]
        size = math.sqrt(x * x + y * y + z * z)
        if size > ALONG:
            w[0], w[1], w[2] = w[0] + disc * x / size, w[1] + disc * y / size, w[2] + disc * z / size
    return at


@kernel
def _on_triangle(p, q, r, share):
    """Squared distance of the origin from a triangle, and the shares (3,) of its corners in the nearest point."""
    b, c = nearest_on_triangle(0.0, 0.0, 0.0, p, q, r)
    share[0], share[1], share[2] = 1.0 - b - c, b, c
    squared = 0.0
    for k in range(3):
        squared += (p[k] + b * (q[k] - p[k]) + c * (r[k] - p[k])) ** 2
    return squared


@kernel
def _nearest_on_simplex(w, count, share, trial):
    """Shares (4,) of the first `count` of four points w (4, 3) in their hull's point nearest to the origin.

    Returns:
        Whether they enclose the origin.
    """
    share[:] = 0.0
    if count == 1:
        share[0] = 1.0
        return False
    if count == 2:
        x, y, z = w[1, 0] - w[0, 0], w[1, 1] - w[0, 1], w[1, 2] - w[0, 2]
        along = -(x * w[0, 0] + y * w[0, 1] + z * w[0, 2]) / max(x * x + y * y + z * z, 1e-300)
        share[1] = min(1.0, max(0.0, along))
        share[0] = 1.0 - share[1]
        return False
    if count == 3:
        _on_triangle(w[0], w[1], w[2], share)
        return False
    best, inside = np.inf, True
    for left_out in range(4):
        i, j, k = (left_out + 1) % 4, (left_out + 2) % 4, (left_out + 3) % 4
        ux, uy, uz = w[j, 0] - w[i, 0], w[j, 1] - w[i, 1], w[j, 2] - w[i, 2]
        vx, vy, vz = w[k, 0] - w[i, 0], w[k, 1] - w[i, 1], w[k, 2] - w[i, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        origin = -(nx * w[i, 0] + ny * w[i, 1] + nz * w[i, 2])
        other = origin + nx * w[left_out, 0] + ny * w[left_out, 1] + nz * w[left_out, 2]
        if origin * other > 0.0 and abs(other) > FLAT * math.sqrt(nx * nx + ny * ny + nz * nz):
            continue
        inside = False
        squared = _on_triangle(w[i], w[j], w[k], trial)
        if squared < best:
            best = squared
            share[:] = 0.0
            share[i], share[j], share[k] = trial[0], trial[1], trial[2]
    return inside


@kernel
def core_gap(a, b, disc, axis, enough, room, normal, at):
    """Distance [m] of the hull of a (k, 3) from that of b (m, 3), grown; 0 where they overlap.

    Args:
        a: Corners.
        b: Corners.
        disc: By which `b` is grown across `axis`.
        axis: (3,) unit vector.
        enough: Where they are at least this far apart, what is returned is only known to be as much, and no more than
            their distance; `normal` and `at` then say nothing.
        room: (ROOM, 3) to work in.
        normal: (3,) filled with the unit vector from `b` to `a`, the slope of the distance by moves of `a`.
        at: (3,) filled with the point of `a` nearest to `b`.
    """
    w, own, v, new, share, trial = room[0:4], room[4:8], room[8], room[9], room[10:12].ravel(), room[12]
    for k in range(3):
        v[k] = 0.5 * (a[0, k] + a[-1, k] - b[0, k] - b[-1, k])
    count, size, before = 0, 0.0, np.inf
    for _ in range(STEPS):
        size = math.sqrt(_dot(v, v))
        if size < CLOSE:
            return 0.0
        for k in range(3):
            normal[k] = -v[k] / size
        corner = _farthest(normal, a, b, disc, axis, new)
        lower = -_dot(normal, new)
        if lower >= enough:
            return lower
        if count > 0 and (size - lower <= CLOSE or size >= before):
            break
        before = size if count > 0 else np.inf
        for k in range(3):
            w[count, k], own[count, k] = new[k], a[corner, k]
        count += 1
        if _nearest_on_simplex(w, count, share, trial):
            return 0.0
        kept = 0
        v[:] = 0.0
        for i in range(count):
            if share[i] > 0.0:
                part = share[i]
                share[kept] = part
                for k in range(3):
                    w[kept, k], own[kept, k] = w[i, k], own[i, k]
                    v[k] += part * w[i, k]
                kept += 1
        count = kept
    at[:] = 0.0
    for i in range(count):
        for k in range(3):
            at[k] += share[i] * own[i, k]
    for k in range(3):
        normal[k] = v[k] / size
    return size


@kernel
def core_depth(a, b, disc, axis, normal, at):
    """Depth [m] of the hull of a (k, 3) in that of b (m, 3), grown: the least move that parts them; see `core_gap`.

    `normal` (3,) is the direction of that move of `a`, `at` (3,) the deepest point of `a`.
    """
    w, own = np.empty((CORNERS, 3)), np.empty((CORNERS, 3))
    faces, planes = np.empty((2 * CORNERS, 3), np.int64), np.empty((2 * CORNERS, 4))
    rim = np.empty((6 * CORNERS, 2), np.int64)
    n, new, middle, share = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    _begin(a, b, disc, axis, w, own, faces, planes, n, middle)
    count, sides = 4, 4
    while True:
        nearest = 0
        for f in range(1, sides):
            if planes[f, 3] < planes[nearest, 3]:
                nearest = f
        for k in range(3):
            n[k] = planes[nearest, k]
        corner = _farthest(n, a, b, disc, axis, new)
        if count == CORNERS or _dot(n, new) - planes[nearest, 3] < CLOSE:
            break
        w[count], own[count] = new, a[corner]
        sides = _grow(w, count, faces, planes, sides, rim)
        count += 1
    i, j, k = faces[nearest]
    for m in range(3):
        middle[m] = planes[nearest, 3] * n[m]
    _on_triangle(w[i] - middle, w[j] - middle, w[k] - middle, share)
    for m in range(3):
        at[m] = share[0] * own[i, m] + share[1] * own[j, m] + share[2] * own[k, m]
        normal[m] = -n[m]
    return planes[nearest, 3]


@kernel
def _begin(a, b, disc, axis, w, own, faces, planes, n, middle):
    """The polytope's first four corners, which lie in no plane, and its faces, outward; `n` and `middle` are room."""
    middle[:] = 0.0
    for i in range(4):  # four corners that lie in no plane
        if i == 0:
            n[0], n[1], n[2] = 1.0, 0.0, 0.0
        elif i == 1:
            n[0] = -1.0
        elif i == 2:
            x, y, z = w[1, 0] - w[0, 0], w[1, 1] - w[0, 1], w[1, 2] - w[0, 2]
            n[0], n[1], n[2] = y, -x, 0.0
            if abs(z) > abs(x) and abs(z) > abs(y):
                n[0], n[1], n[2] = 0.0, z, -y
        else:
            _cross(w[1] - w[0], w[2] - w[0], n)
        size = math.sqrt(_dot(n, n))
        for k in range(3):
            n[k] /= size
        own[i] = a[_farthest(n, a, b, disc, axis, w[i])]
        if i >= 2 and abs(_dot(n, w[i]) - _dot(n, w[0])) < CLOSE:
            n[:] = -n
            own[i] = a[_farthest(n, a, b, disc, axis, w[i])]
        for k in range(3):
            middle[k] += 0.25 * w[i, k]
    for left_out in range(4):
        i, j, k = (left_out + 1) % 4, (left_out + 2) % 4, (left_out + 3) % 4
        if _plane(w, i, j, k, planes[left_out]) < _dot(planes[left_out], middle):
            i, j = j, i
            _plane(w, i, j, k, planes[left_out])
        faces[left_out, 0], faces[left_out, 1], faces[left_out, 2] = i, j, k


@kernel
def _grow(w, count, faces, planes, sides, rim):
    """Faces of the polytope with corner `count`, those that it sees replaced by others to their rim; their number."""
    rims, f = 0, 0
    while f < sides:
        if _dot(planes[f], w[count]) - planes[f, 3] <= 0.1 * CLOSE:
            f += 1
            continue
        for e in range(3):
            i, j, twin = faces[f, e], faces[f, (e + 1) % 3], -1
            for r in range(rims):
                if rim[r, 0] == j and rim[r, 1] == i:
                    twin = r
            if twin < 0:
                rim[rims, 0], rim[rims, 1] = i, j
                rims += 1
            else:
                rims -= 1
                rim[twin] = rim[rims]
        sides -= 1
        faces[f], planes[f] = faces[sides], planes[sides]
    for r in range(rims):
        faces[sides, 0], faces[sides, 1], faces[sides, 2] = rim[r, 0], rim[r, 1], count
        if _plane(w, rim[r, 0], rim[r, 1], count, planes[sides]) == np.inf:
            planes[sides, 3] = np.inf  # of no extent
        sides += 1
    return sides


@kernel
def _plane(w, i, j, k, plane):
    """The plane (4,) through three points: its unit normal and distance from the origin, infinite if they are in line.

    Returns:
        The distance.
    """
    _cross(w[j] - w[i], w[k] - w[i], plane)
    size = math.sqrt(_dot(plane, plane))
    if size < 1e-18:
        plane[:3], plane[3] = 0.0, np.inf
        return np.inf
    for m in range(3):
        plane[m] /= size
    plane[3] = _dot(plane, w[i])
    return plane[3]


@kernel
def signed_gap(a, b, disc, axis, enough, room, normal, at):
    """`core_gap`, negative by the depth where they overlap."""
    gap = core_gap(a, b, disc, axis, enough, room, normal, at)
    return gap if gap > 0.0 else -core_depth(a, b, disc, axis, normal, at)


@inlined
def solid_core(world, k):
    """What the distance from solid k of a world takes: corners, disc and axis, and by what the whole is grown [m]."""
    kinds, axes, rounding, corners, first = world[0], world[2], world[5], world[11], world[12]
    disc = rounding[k] if kinds[k] == EXTRUDED else 0.0
    grown = rounding[k] if kinds[k] == SPHERE else 0.0
    return corners[first[k] : first[k + 1]], disc, axes[k, 2], grown


@kernel
def hull_distance(corners, world, k):
    """`signed_gap` of the hull of corners (c, 3) from solid k of a world."""
    normal, at = np.empty(3), np.empty(3)
    solid, disc, axis, grown = solid_core(world, k)
    return signed_gap(corners, solid, disc, axis, np.inf, np.empty((ROOM, 3)), normal, at) - grown
