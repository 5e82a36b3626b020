"""What stands in the scenes of random tasks in space."""

from __future__ import annotations

import math
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import FileFormatError
from cableway.core.reading import read_json
from cableway.geometry import rotations
from cableway.scene.obstacles import Disc
from cableway.scene.spatial.obstacles import ConvexMesh, Cuboid, Cylinder, Prism, SpatialObstacle, Sphere, length
from cableway.scene.spatial.scene import SpatialScene

DECIMALS = 4
"""Places and sizes are given to a tenth of a millimetre."""

YU_SCENES = 4
"""Of `yu_scene`."""

Size = tuple[float, float, float]


def rounded(values: Float[np.ndarray, "k"], decimals: int = DECIMALS) -> Any:
    """Numbers for a file, as a tuple."""
    return tuple(np.round(values, decimals).tolist())


def _turned(rng: np.random.Generator) -> Any:
    vector = rng.normal(size=4)
    return tuple((vector / length(vector)).tolist())


def floating(rng: np.random.Generator, size: Size) -> SpatialObstacle:
    """A box, a cylinder, a ball or a hull of ten points anywhere, turned anyhow, 4 to 25 cm large."""
    center, kind = rounded(rng.uniform(0.1, 0.9, 3) * size), int(rng.integers(4))
    if kind == 0:
        return Cuboid(center=center, size=rounded(rng.uniform(0.05, 0.25, 3)), orientation=_turned(rng))
    if kind == 1:
        axis = rotations.rotate(np.array(_turned(rng)), np.array([0.0, 0.0, 1.0]))
        radius, height = rounded(np.array([rng.uniform(0.02, 0.08), rng.uniform(0.1, 0.4)]))
        return Cylinder(center=center, radius=radius, height=height, axis=tuple(axis.tolist()))
    if kind == 2:
        return Sphere(center=center, radius=round(rng.uniform(0.03, 0.1), DECIMALS))
    return ConvexMesh(points=(center + 0.06 * rng.normal(size=(10, 3))).round(DECIMALS))


def standing(rng: np.random.Generator, size: Size, tallest: float) -> SpatialObstacle:
    """A box, or a post, on the table, 5 cm to `tallest` [m] high."""
    x, y = rng.uniform(0.1, 0.9, 2) * size[:2]
    height = round(rng.uniform(0.05, tallest), DECIMALS)
    if rng.integers(2):
        disc = Disc(center=rounded(np.array([x, y])), radius=round(rng.uniform(0.015, 0.06), DECIMALS), height=height)
        return Prism(section=disc)
    half = rng.uniform(-math.pi, math.pi) / 2
    turned = (math.cos(half), 0.0, 0.0, math.sin(half))
    extent = rounded(np.array([*rng.uniform(0.04, 0.2, 2), height]))
    return Cuboid(center=rounded(np.array([x, y, height / 2])), size=extent, orientation=turned)


def window(rng: np.random.Generator, size: Size, width: float) -> tuple[SpatialObstacle, ...]:
    """A wall across the middle, 2 cm thick, with a square window `width` [m] wide: four boxes."""
    x, thick = size[0] / 2, 0.02
    y, z = (round(rng.uniform(0.3, 0.7) * side, DECIMALS) for side in size[1:])
    w = width / 2
    spans = (
        ((0.0, y - w), (0.0, size[2])),
        ((y + w, size[1]), (0.0, size[2])),
        ((y - w, y + w), (0.0, z - w)),
        ((y - w, y + w), (z + w, size[2])),
    )
    return tuple(
        Cuboid(center=(x, sum(ys) / 2, sum(zs) / 2), size=(thick, ys[1] - ys[0], zs[1] - zs[0])) for ys, zs in spans
    )


def ridge(rng: np.random.Generator, size: Size) -> SpatialObstacle:
    """A low wall across the whole table, about its middle, 10 to 25 cm high."""
    height = round(rng.uniform(0.1, 0.25), DECIMALS)
    thick, x = rounded(np.array([rng.uniform(0.02, 0.1), rng.uniform(0.4, 0.6) * size[0]]))
    return Cuboid(center=(x, size[1] / 2, height / 2), size=(thick, size[1], height))


def yu_scene(number: int) -> SpatialScene:
    """One of the four public scenes of Yu et al. (IJRR 2024): its boxes, without the arms.

    The data are in `tasks/space/yu`, with their licence (MIT) beside them. The scene is moved so that its workspace
    begins at zero.
    """
    place = Path(str(resources.files("cableway.tasks.space"))) / "yu" / f"scene_{number}.json"
    return scene_of(read_json(place), str(place))


def scene_of(content: Any, where: str) -> SpatialScene:
    """The scene of boxes in a mapping of workspace (low, high) and boxes (center, size) [m].

    Raises:
        FileFormatError: It is no such mapping; the message begins with `where`.
    """
    try:
        workspace, boxes = content["workspace"], content["boxes"]
        low, high = (np.array(workspace[key], float) for key in ("low", "high"))
        moved = [(np.array(box["center"], float) - low, np.array(box["size"], float)) for box in boxes]
    except (KeyError, TypeError, ValueError):
        raise FileFormatError(f"{where}: not a scene with workspace (low, high) and boxes (center, size)") from None
    obstacles = tuple(Cuboid(center=rounded(center), size=rounded(size)) for center, size in moved)
    return SpatialScene(rounded(high - low), obstacles)
