"""Obstacles in space as a hand changes them: by a frame that moves and turns with them, by their sizes, added."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from cableway.geometry import rotations
from cableway.scene.obstacles import Box, Disc
from cableway.scene.spatial.obstacles import ConvexMesh, Cuboid, Cylinder, Prism, SpatialObstacle, Sphere
from cableway.scene.spatial.scene import SpatialScene
from cableway.studio import obstacles as hands
from cableway.studio.obstacles import LEAST_SIZE, NEW_SIZE

Kind = Literal["box", "cylinder", "ball"]

Size = tuple[float, float, float]


def frame_of(obstacle: SpatialObstacle) -> Float[np.ndarray, "7"]:
    """Pose of a frame [m, 1] at the middle of an obstacle, or on the table where it stands, turned as that is."""
    middle, turn = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    if isinstance(obstacle, Prism):
        middle[:2] = hands.middle_of(obstacle.section)
        turn = rotations.from_vector(np.array([0.0, 0.0, hands.angle_of(obstacle.section)]))
    elif isinstance(obstacle, ConvexMesh):
        middle = obstacle.points.mean(axis=0)
    else:
        middle = np.array(obstacle.center)
        if isinstance(obstacle, Cuboid):
            turn = np.array(obstacle.orientation)
        elif isinstance(obstacle, Cylinder):
            turn = _upright_to(np.array(obstacle.axis))
    return np.concatenate([middle, turn])


def placed(obstacle: SpatialObstacle, frame: Float[np.ndarray, "7"]) -> SpatialObstacle:
    """The obstacle with its frame there [m, 1]; what stands on the table keeps standing.

    Raises:
        TaskError: It cannot be so.
    """
    before = frame_of(obstacle)
    if isinstance(obstacle, Prism):
        by = rotations.to_vector(rotations.product(frame[3:], rotations.conjugate(before[3:])))[2]
        x, y = frame[:2].tolist()
        return replace(obstacle, section=hands.turned(hands.placed(obstacle.section, (x, y)), float(by)))
    if isinstance(obstacle, ConvexMesh):
        about = obstacle.points - before[:3]
        return ConvexMesh(points=frame[:3] + rotations.rotate(frame[3:], about))
    x, y, z = frame[:3].tolist()
    if isinstance(obstacle, Cuboid):
        w, a, b, c = frame[3:].tolist()
        return replace(obstacle, center=(x, y, z), orientation=(w, a, b, c))
    if isinstance(obstacle, Cylinder):
        a, b, c = rotations.rotate(frame[3:], np.array([0.0, 0.0, 1.0])).tolist()
        return replace(obstacle, center=(x, y, z), axis=(a, b, c))
    return replace(obstacle, center=(x, y, z))


def turns(obstacle: SpatialObstacle) -> bool:
    """Whether an obstacle differs from itself once it is turned."""
    return not isinstance(obstacle, Sphere) and not (isinstance(obstacle, Prism) and isinstance(obstacle.section, Disc))


def size_of(obstacle: SpatialObstacle) -> Size | None:
    """Sizes [m] along the axes of its frame, 0 for a height without end; None of what has more than these."""
    if isinstance(obstacle, Cuboid):
        return obstacle.size
    if isinstance(obstacle, Cylinder):
        return 2 * obstacle.radius, 2 * obstacle.radius, obstacle.height
    if isinstance(obstacle, Sphere):
        return 2 * obstacle.radius, 2 * obstacle.radius, 2 * obstacle.radius
    if isinstance(obstacle, Prism):
        height = obstacle.section.height or 0.0
        if isinstance(obstacle.section, Box):
            return (*obstacle.section.size, height)
        if isinstance(obstacle.section, Disc):
            return 2 * obstacle.section.radius, 2 * obstacle.section.radius, height
    return None


def resized(obstacle: SpatialObstacle, size: Size) -> SpatialObstacle:
    """The obstacle with other sizes [m]; of what is round, the one that changed counts.

    Raises:
        TaskError: It cannot be so.
    """
    before = size_of(obstacle)
    if before is None or np.allclose(size, before, rtol=0.0, atol=1e-9):
        return obstacle
    width = next((new for new, old in zip(size, before, strict=True) if abs(new - old) > 1e-9), size[0])
    if isinstance(obstacle, Cuboid):
        return replace(obstacle, size=size)
    if isinstance(obstacle, Sphere):
        return replace(obstacle, radius=max(LEAST_SIZE, width) / 2)
    across = size[1] if abs(size[0] - before[0]) < 1e-9 else size[0]
    if isinstance(obstacle, Cylinder):
        return replace(obstacle, radius=max(LEAST_SIZE, across) / 2, height=size[2])
    assert isinstance(obstacle, Prism)
    section = replace(obstacle.section, height=size[2] if size[2] > 0 else None)
    if isinstance(section, Box):
        section = replace(section, size=(size[0], size[1]))
    elif isinstance(section, Disc):
        section = replace(section, radius=max(LEAST_SIZE, across) / 2)
    return replace(obstacle, section=section)


def new_obstacle(kind: Kind, scene: SpatialScene) -> SpatialObstacle:
    """One in the middle of the workspace."""
    x, y, z = (side / 2 for side in scene.size)
    width = NEW_SIZE * min(scene.size)
    if kind == "ball":
        return Sphere(center=(x, y, z), radius=width)
    if kind == "cylinder":
        return Cylinder(center=(x, y, z), radius=width / 2, height=2 * width)
    return Cuboid(center=(x, y, z), size=(2 * width, width, width))


def _upright_to(axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4"]:
    """The rotation by the least angle that turns the z axis to a direction."""
    about = np.cross([0.0, 0.0, 1.0], axis)
    sine = float(np.linalg.norm(about))
    if sine < 1e-12:
        about, sine = np.array([1.0, 0.0, 0.0]), 1.0
    else:
        about = about / sine
    return rotations.from_vector(math.acos(float(np.clip(axis[2], -1.0, 1.0))) * about)
