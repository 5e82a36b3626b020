"""What a page that plays by itself shows of a plan or a run in space: triangles and lines, as numbers in Base64."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline
from cableway.geometry.groups import SE3
from cableway.geometry.spatial_convex import chain_distance
from cableway.records import Plan, Rollout
from cableway.rendering.space import DIRECTION, surface_of
from cableway.scene.clearance import PIECES
from cableway.scene.spatial.task import SpatialTask
from cableway.studio.view.meshes import creases


def film_in_space(task: SpatialTask, record: Plan | Rollout) -> dict[str, Any]:
    """What `film_space.js.jinja` draws; lists of numbers are of 32 bits, row by row."""
    scene, ceiling = task.scene, task.scene.size[2]
    surfaces = [surface_of(obstacle.solid, ceiling) for obstacle in scene.obstacles]
    held = [(body.side, surface_of(body.solid(np.array(SE3.identity)), math.inf)) for body in task.bodies]
    if isinstance(record, Plan):
        lines, seen = _smooth(record.shapes), {}
        clearance = chain_distance(lines, scene.world)[0] - task.cable.radius
    else:
        lines, clearance = record.centreline, record.clearance
        seen = {
            "reference": _packed(_evenly(_smooth(record.reference), lines.shape[1])),
            "seen": _packed(record.observed),
        }
    return {
        "size": list(scene.size),
        "from": (-np.array(DIRECTION) / np.linalg.norm(DIRECTION)).tolist(),
        "solids": _triangles(surfaces),
        "edges": _packed(np.concatenate([np.zeros((0, 2, 3)), *map(creases, surfaces)])),
        "hands": [_triangles([surface for side, surface in held if side == hand]) for hand in (0, 1)],
        "radius": task.cable.radius,
        "points": lines.shape[1],
        "keypoints": task.cable.keypoints,
        "start": _packed(task.stations("start")),
        "goal": _packed(task.stations("goal")),
        "cables": _packed(lines),
        "poses": _packed(record.poses),
        "clearance": clearance.round(6).tolist(),
        **seen,
    }


def _smooth(shapes: Float[np.ndarray, "t n 3"]) -> Float[np.ndarray, "t k 3"]:
    return polyline.spline(shapes, PIECES)


def _evenly(lines: Float[np.ndarray, "t k 3"], count: int) -> Float[np.ndarray, "t m 3"]:
    """Lines as so many points each."""
    return lines[:, np.linspace(0, lines.shape[1] - 1, count).round().astype(int)]


def _triangles(surfaces: Sequence[Any]) -> tuple[str, str]:
    """Corners and normals of surfaces."""
    corners, normals = ([np.zeros((0, 3, 3)), *(each[part] for each in surfaces)] for part in (0, 1))
    return _packed(np.concatenate(corners)), _packed(np.concatenate(normals))


def _packed(numbers: Float[np.ndarray, "..."]) -> str:
    return base64.b64encode(np.ascontiguousarray(numbers, "<f4").tobytes()).decode()
