"""Obstacles as a hand changes them: moved, turned, resized by a knob, added; always within the workspace."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from cableway.core.errors import Point, TaskError
from cableway.geometry import se2
from cableway.scene.files.loading import AnyDraft
from cableway.scene.obstacles import Box, Disc, Obstacle, Polygon, displaced
from cableway.scene.scene import Scene
from cableway.scene.task import Draft

Kind = Literal["box", "disc", "polygon"]

LEAST_SIZE = 0.005
"""Width, height or radius [m] below which a knob makes no obstacle smaller: it could not be grasped again."""

NEW_SIZE = 0.1
"""Width of an obstacle that is added, as a share of the shorter side of the workspace."""

SIDES = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Which way the sides of a box face that its knobs move, before turning."""


def middle_of(obstacle: Obstacle) -> Float[np.ndarray, "2"]:
    """Centre [m], about which it is turned."""
    return obstacle.vertices.mean(axis=0)


def angle_of(obstacle: Obstacle) -> float:
    """Turn [rad] of what has one."""
    return obstacle.angle if isinstance(obstacle, Box) else 0.0


def placed(obstacle: Obstacle, middle: Point) -> Obstacle:
    """The obstacle with its centre there [m]."""
    x, y = np.subtract(middle, middle_of(obstacle))
    return displaced(obstacle, (float(x), float(y)))


def turned(obstacle: Obstacle, by: float) -> Obstacle:
    """The obstacle turned about its centre [rad]."""
    if isinstance(obstacle, Box):
        return replace(obstacle, angle=float(se2.wrap_angle(obstacle.angle + by)))
    if isinstance(obstacle, Polygon):
        middle = middle_of(obstacle)
        return replace(obstacle, vertices=se2.transform(obstacle.vertices - middle, middle, by))
    return obstacle


def knobs(obstacle: Obstacle) -> Float[np.ndarray, "k 2"]:
    """Where it is taken to resize it [m]: the sides of a box, the corners of a polygon, the rim of a disc."""
    if isinstance(obstacle, Disc):
        return np.array([np.add(obstacle.center, (obstacle.radius, 0.0))])
    if isinstance(obstacle, Polygon):
        return obstacle.vertices
    local = np.array(SIDES) * np.array(obstacle.size) / 2
    return se2.transform(local, np.array(obstacle.center), obstacle.angle)


def pulled(obstacle: Obstacle, knob: int, to: Point) -> Obstacle:
    """The obstacle with one of its `knobs` pulled there [m]; the other side of a box stays where it is.

    Raises:
        TaskError: It is then no convex polygon.
    """
    if isinstance(obstacle, Disc):
        return replace(obstacle, radius=max(LEAST_SIZE, math.dist(to, obstacle.center)))
    if isinstance(obstacle, Polygon):
        vertices = obstacle.vertices.copy()
        vertices[knob] = to
        return replace(obstacle, vertices=vertices)
    axis = knob % 2
    outward = se2.transform(np.array([SIDES[knob]], dtype=float), np.zeros(2), obstacle.angle)[0]
    size = list(obstacle.size)
    fixed = np.array(obstacle.center) - outward * size[axis] / 2
    size[axis] = max(LEAST_SIZE, float(outward @ (np.array(to) - fixed)))
    x, y = fixed + outward * size[axis] / 2
    return replace(obstacle, center=(float(x), float(y)), size=(size[0], size[1]))


def new_obstacle(kind: Kind, scene: Scene) -> Obstacle:
    """One in the middle of the workspace, as high as the last one there is."""
    width, (x, y) = NEW_SIZE * min(scene.size), np.array(scene.size) / 2
    center, height = (float(x), float(y)), scene.obstacles[-1].height if scene.obstacles else None
    if kind == "disc":
        return Disc(center=center, radius=width / 2, height=height)
    if kind == "box":
        return Box(center=center, size=(2 * width, width), height=height)
    corners = width * np.array([[-0.7, -0.5], [0.7, -0.5], [0.0, 0.7]])
    return Polygon(vertices=corners + np.array(center), height=height)


def with_obstacle(draft: AnyDraft, index: int, obstacle: Any) -> AnyDraft:
    """The draft with another obstacle in the place of one, without that one where None, one more where it has none.

    Raises:
        TaskError: It is larger than the workspace, or in space wholly outside it.
    """
    there = draft.scene.obstacles
    new = () if obstacle is None else (obstacle,)
    if isinstance(draft, Draft):
        new = tuple(_inside(each, draft.scene.size) for each in new)
    return replace(draft, scene=replace(draft.scene, obstacles=(*there[:index], *new, *there[index + 1 :])))


def _inside(obstacle: Obstacle, size: tuple[float, float]) -> Obstacle:
    """The obstacle moved into the workspace."""
    low = obstacle.vertices.min(axis=0) - obstacle.rounding
    high = obstacle.vertices.max(axis=0) + obstacle.rounding
    if ((high - low) > size).any():
        raise TaskError("is larger than the workspace", ("obstacles",))
    by = np.maximum(0.0, -low) - np.maximum(0.0, high - size)
    return displaced(obstacle, (float(by[0]), float(by[1]))) if by.any() else obstacle
