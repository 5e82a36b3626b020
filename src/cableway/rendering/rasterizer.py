"""Which triangle is seen at each pixel, and how bright it is; compiled.

The inverse depth of a plane n . p = d at the pixel whose ray is r, with third coordinate 1, is n . r / d. So triangles
are filled row by row with that, clipped ones as well, and the nearest one at each pixel is kept. Colours come after
that, once for each pixel.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel

SLACK = 1e-9
"""By which a pixel may be outside a triangle [pixels], so that none between two triangles is left out."""

OFFSET = 0.003
"""Distance [m] off a surface, along its normal and towards the light, at which shadows are looked for: a few pixels of
the light's picture, so that surfaces throw none on themselves."""

CLOSE, BENT = 0.003, 0.9
"""Difference of depths over depth, and cosine of the angle between normals, up to which neighbours are one surface."""


@inlined
def _clipped(corners, near, out):
    """Write the polygon of a triangle in front of the plane z = near into `out` (4, 3); how many corners it has."""
    count = 0
    for i in range(3):
        ax, ay, az = corners[i, 0], corners[i, 1], corners[i, 2]
        j = (i + 1) % 3
        bx, by, bz = corners[j, 0], corners[j, 1], corners[j, 2]
        if az >= near:
            out[count, 0], out[count, 1], out[count, 2] = ax, ay, az
            count += 1
        if (az >= near) != (bz >= near):
            share = (near - az) / (bz - az)
            out[count, 0], out[count, 1], out[count, 2] = ax + share * (bx - ax), ay + share * (by - ay), near
            count += 1
    return count


@kernel
def rasterize(corners, lens, near, inverse_depth, nearest):
    """Write 1 / depth (h, w) and the index (h, w) of the nearest triangle where there is one.

    Args:
        corners: (f, 3, 3) of triangles in the camera's frame [m]; those that turn their back are left out.
        lens: (4,) focal lengths and principal point [pixels].
        near: Least depth [m] that is drawn, above 0.
        inverse_depth: Where to, 0 where nothing is drawn; nearer things that are there stay.
        nearest: Where to.
    """
    fx, fy, cx, cy = lens
    height, width = inverse_depth.shape
    polygon = np.empty((4, 3))
    for f in range(len(corners)):
        a, b, c = corners[f, 0], corners[f, 1], corners[f, 2]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        away = nx * a[0] + ny * a[1] + nz * a[2]
        if away >= 0.0:
            continue
        count = _clipped(corners[f], near, polygon)
        if count == 0:
            continue
        top, bottom, closest, farthest = np.inf, -np.inf, 0.0, np.inf
        for i in range(count):
            inverse = 1.0 / polygon[i, 2]
            closest, farthest = max(closest, inverse), min(farthest, inverse)
            polygon[i, 0] = cx + fx * polygon[i, 0] * inverse
            polygon[i, 1] = cy + fy * polygon[i, 1] * inverse
            top, bottom = min(top, polygon[i, 1]), max(bottom, polygon[i, 1])
        if not top <= bottom:
            continue
        across, down = nx / (fx * away), ny / (fy * away)
        first = nz / away - across * cx - down * cy
        for row in range(math.ceil(min(max(top, 0.0), height)), math.floor(min(bottom, height - 1.0)) + 1):
            left, right = np.inf, -np.inf
            for i in range(count):
                j = (i + 1) % count
                y, end = polygon[i, 1], polygon[j, 1]
                if min(y, end) <= row <= max(y, end) and y != end:
                    x = polygon[i, 0] + (row - y) / (end - y) * (polygon[j, 0] - polygon[i, 0])
                    left, right = min(left, x), max(right, x)
            if not left <= right:
                continue
            begin = math.ceil(min(max(left - SLACK, 0.0), width))
            for column in range(begin, math.floor(min(right + SLACK, width - 1.0)) + 1):
                inverse = min(max(first + across * column + down * row, farthest), closest)
                if inverse > inverse_depth[row, column]:
                    inverse_depth[row, column] = inverse
                    nearest[row, column] = f


@inlined
def _lit(x, y, z, turn, lens, shadow):
    """Share of the light that reaches a point [m]: the mean over three by three pixels of the light's picture."""
    depth = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + turn[2, 3]
    if depth <= OFFSET:
        return 1.0
    u = lens[2] + lens[0] * (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + turn[0, 3]) / depth
    v = lens[3] + lens[1] * (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + turn[1, 3]) / depth
    height, width = shadow.shape
    if not (1.0 <= u < width - 2.0 and 1.0 <= v < height - 2.0):
        return 1.0
    row, column, wanted = int(v), int(u), 1.0 / (depth - OFFSET)
    p, q, total = u - column, v - row, 0.0
    for i in range(0, 4, 3):
        for j in range(0, 4, 3):
            total += shadow[row + i - 1, column + j - 1] <= wanted
    if total == 0.0 or total == 4.0:  # far from the edge of a shadow
        return total / 4.0
    total = 0.0
    for i in range(4):
        down = 1.0 - q if i == 0 else q if i == 3 else 1.0
        for j in range(4):
            if shadow[row + i - 1, column + j - 1] <= wanted:
                total += down * (1.0 - p if j == 0 else p if j == 3 else 1.0)
    return total / 9.0


@inlined
def _brightness(corners, normals, x, y, z, light, ambient, turn, lens, shadow):
    """Share of its colour that a triangle has at a point [m] on it."""
    a, b, c = corners[0], corners[1], corners[2]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = x - a[0], y - a[1], z - a[2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    wu, wv = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
    area = uu * vv - uv * uv
    s, t = ((vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area) if area > 0.0 else (0.0, 0.0)
    r = 1.0 - s - t
    nx = r * normals[0, 0] + s * normals[1, 0] + t * normals[2, 0]
    ny = r * normals[0, 1] + s * normals[1, 1] + t * normals[2, 1]
    nz = r * normals[0, 2] + s * normals[1, 2] + t * normals[2, 2]
    lx, ly, lz = light[0] - x, light[1] - y, light[2] - z
    size, far = math.sqrt(nx * nx + ny * ny + nz * nz), math.sqrt(lx * lx + ly * ly + lz * lz)
    facing = (nx * lx + ny * ly + nz * lz) / (size * far) if size * far > 0.0 else 0.0
    if facing <= 0.0:
        return ambient
    off = OFFSET / size
    return ambient + (1.0 - ambient) * facing * _lit(x + off * nx, y + off * ny, z + off * nz, turn, lens, shadow)


@inlined
def _match(normals, colors, f, g):
    """Whether two triangles that are seen side by side look like one surface."""
    if f < 0 or g < 0:
        return False
    same = colors[f, 0] == colors[g, 0] and colors[f, 1] == colors[g, 1] and colors[f, 2] == colors[g, 2]
    a, b = normals[f, 0], normals[g, 0]
    return same and a[0] * b[0] + a[1] * b[1] + a[2] * b[2] > BENT


@kernel
def shade(inverse_depth, nearest, mesh, camera, light, ambient, shade_from, shadow, background, color):
    """Write colours (h, w, 3) from 0 to 255, each the mean of the samples of a pixel.

    Where all samples are of one even or curved piece of a surface it is looked at once, in their middle.

    Args:
        inverse_depth: (s h, s w) of the samples, see `rasterize`, with an odd s.
        nearest: The same.
        mesh: Corners, normals (f, 3, 3) and colours (f, 3) of the triangles, in the world.
        camera: Lens (4,) of the samples, and (3, 4) turn and place of the camera in the world.
        light: (3,) where it is [m].
        ambient: Share of the colour without light.
        shade_from: Lens (4,) of the light's picture, and (3, 4) the world in its frame.
        shadow: Inverse depths of that picture; no pixel where there are no shadows.
        background: (3,) colour where nothing is.
        color: Where to.
    """
    corners, normals, colors = mesh
    lens, pose = camera
    light_lens, turn = shade_from
    samples = len(nearest) // len(color)
    middle = samples // 2
    for row in range(color.shape[0]):
        for column in range(color.shape[1]):
            top, left = samples * row, samples * column
            center, depth = nearest[top + middle, left + middle], inverse_depth[top + middle, left + middle]
            alike = True
            for v in range(top, top + samples):
                for u in range(left, left + samples):
                    if nearest[v, u] != center and alike:
                        off = abs(inverse_depth[v, u] - depth)
                        alike = off <= CLOSE * depth and _match(normals, colors, nearest[v, u], center)
            first, last = (middle, middle + 1) if alike else (0, samples)
            red, green, blue, missed = 0.0, 0.0, 0.0, 0
            for v in range(top + first, top + last):
                for u in range(left + first, left + last):
                    f = nearest[v, u]
                    if f < 0:
                        missed += 1
                        continue
                    z = 1.0 / inverse_depth[v, u]
                    x, y = (u - lens[2]) / lens[0] * z, (v - lens[3]) / lens[1] * z
                    px = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
                    py = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
                    pz = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
                    bright = _brightness(corners[f], normals[f], px, py, pz, light, ambient, turn, light_lens, shadow)
                    red += bright * colors[f, 0]
                    green += bright * colors[f, 1]
                    blue += bright * colors[f, 2]
            count = (last - first) ** 2
            color[row, column, 0] = np.uint8(255.0 * (red + missed * background[0]) / count + 0.5)
            color[row, column, 1] = np.uint8(255.0 * (green + missed * background[1]) / count + 0.5)
            color[row, column, 2] = np.uint8(255.0 * (blue + missed * background[2]) / count + 0.5)
