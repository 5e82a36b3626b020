"""A picture of triangles: colours, depth and what is seen at each pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float, Int, UInt8

from cableway.core.checks import shown
from cableway.core.errors import InputError
from cableway.rendering.camera import Camera
from cableway.rendering.mesh import Mesh
from cableway.rendering.rasterizer import rasterize, shade

NEAR = 0.01
"""Depth [m] before which a camera sees nothing."""

WIDEST = math.radians(150)
"""Angle of view of a lamp; beyond it there are no shadows."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Light:
    """One lamp, and light from everywhere.

    Attributes:
        position: Of the lamp [m].
        ambient: Share of its colour that a surface has without the lamp, from 0 to 1.
        shadows: Pixels across the picture from the lamp by which shadows are found; 0 for none.

    Raises:
        InputError: A number is not finite or out of range.
    """

    position: tuple[float, float, float]
    ambient: float = 0.5
    shadows: int = 1024

    def __post_init__(self) -> None:
        if len(self.position) != 3 or not all(map(math.isfinite, self.position)):
            raise InputError(f"position of a light must be three finite numbers, got {shown(self.position)}")
        if not 0 <= self.ambient <= 1:
            raise InputError(f"ambient must be from 0 to 1, got {self.ambient!r}")
        if self.shadows < 0:
            raise InputError(f"shadows must not be negative, got {self.shadows!r}")


@dataclass(frozen=True, eq=False)
class Picture:
    """What a camera sees.

    Attributes:
        color: sRGB from 0 to 255.
        depth: Of the middle of each pixel along the camera's z axis [m]; infinite where nothing is.
        label: That of the triangle there; 0 where nothing is.
    """

    color: UInt8[np.ndarray, "h w 3"]
    depth: Float[np.ndarray, "h w"]
    label: Int[np.ndarray, "h w"]


def render(
    mesh: Mesh,
    camera: Camera,
    light: Light,
    *,
    samples: int = 1,
    background: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Picture:
    """The picture of closed surfaces, their backs left out.

    Args:
        mesh: What there is.
        camera: From where.
        light: Illuminates it, by Lambert's law; its shadows are those of the whole mesh.
        samples: Of a pixel each way, whose mean is its colour: 1, or 3 to smooth edges.
        background: Colour where nothing is, sRGB from 0 to 1.

    Raises:
        InputError: `samples` is not an odd number, a corner of a triangle is not finite, or a colour out of range.
    """
    if not np.isfinite(mesh.corners).all():
        raise InputError("corners of a mesh must be finite numbers")
    if not all(((part >= 0) & (part <= 1)).all() for part in (mesh.colors, np.array(background))):
        raise InputError("colours of a mesh and a background must be from 0 to 1")
    if samples < 1 or samples % 2 == 0:
        raise InputError(f"samples must be an odd number, 1 for none that smooth edges, got {samples!r}")
    fine = camera.finer(samples)
    inverse_depth, nearest = _seen(mesh, fine)
    shadow, shade_from = _shadows(mesh, light)
    color = np.empty((camera.size[1], camera.size[0], 3), np.uint8)
    shade(
        inverse_depth,
        nearest,
        (mesh.corners, mesh.normals, mesh.colors),
        (_lens(fine), fine.pose[:3].copy()),
        np.array(light.position, float),
        float(light.ambient),
        shade_from,
        shadow,
        np.array(background, float),
        color,
    )
    middle = slice(samples // 2, None, samples)
    with np.errstate(divide="ignore"):
        depth = 1.0 / inverse_depth[middle, middle]
    return Picture(color, depth, np.append(mesh.labels, 0)[nearest[middle, middle]])


def labels(mesh: Mesh, camera: Camera) -> Int[np.ndarray, "h w"]:
    """What is seen at each pixel, as in `Picture.label`, without the time that colours take."""
    return np.append(mesh.labels, 0)[_seen(mesh, camera)[1]]


def _lens(camera: Camera) -> Float[np.ndarray, "4"]:
    return np.array([*camera.focal, *camera.center], float)


def _seen(mesh: Mesh, camera: Camera) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    """Inverse depths, and the nearest triangles, -1 for none."""
    shape = camera.size[::-1]
    inverse_depth, nearest = np.zeros(shape), np.full(shape, -1, np.int32)
    rasterize(camera.seen(mesh.corners), _lens(camera), NEAR, inverse_depth, nearest)
    return inverse_depth, nearest


def _shadows(
    mesh: Mesh, light: Light
) -> tuple[Float[np.ndarray, "h w"], tuple[Float[np.ndarray, "4"], Float[np.ndarray, "3 4"]]]:
    """The lamp's picture, its lens and the world in its frame."""
    if not light.shadows:
        return np.zeros((0, 0)), (np.ones(4), np.zeros((3, 4)))
    low, high = mesh.corners.min(axis=(0, 1)), mesh.corners.max(axis=(0, 1))
    points, place = np.array(list(product(*zip(low, high, strict=True)))), np.array(light.position, float)
    towards = (low + high) / 2 - place
    lamp = Camera.looking(place, towards, size=(light.shadows, light.shadows), view=1.0)
    at = lamp.seen(points)
    slope = float((np.abs(at[:, :2]).max(axis=1) / np.maximum(at[:, 2], NEAR)).max())
    lamp = Camera.looking(place, towards, size=lamp.size, view=min(2 * math.atan(slope), WIDEST))
    turn = np.column_stack([lamp.pose[:3, :3].T, lamp.seen(np.zeros(3))])
    return _seen(mesh, lamp)[0], (_lens(lamp), turn)
