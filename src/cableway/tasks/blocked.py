"""Tables without a way: start and goal are parted by walls with no gap, or one that is too narrow."""

from __future__ import annotations

import numpy as np
import shapely

from cableway.geometry import se2
from cableway.scene.cable import Cable
from cableway.scene.grippers import Grippers
from cableway.scene.obstacles import Obstacle, Polygon
from cableway.scene.scene import Scene
from cableway.tasks import motion
from cableway.tasks.passages import wall_with_gap
from cableway.tasks.placement import DECIMALS, Placement, swept_region
from cableway.tasks.setup import MARGIN, Draft, Rejected, Setup

THICK = 0.02
"""Thickness [m] of the walls about a pocket."""


def blocked(rng: np.random.Generator) -> Draft:
    """A wall, or a pocket about the goal, that is closed or has a gap narrower than the grippers or than the cable."""
    setup, gap, description = _setup(rng)
    pocket = bool(rng.integers(2))
    goal = _shape(rng, setup, upper=None if pocket else True)
    walls = _pocket(rng, setup, goal, gap) if pocket else _wall(rng, setup, gap)
    start = _shape(rng, setup, upper=None if pocket else False)
    scene = Scene(setup.size, tuple(walls))
    for q in (start, goal):
        motion.require_sound(q[None], setup, MARGIN)
        motion.require_free(q[None], setup, scene, MARGIN)
    inside = shapely.convex_hull(shapely.union_all(scene.solids))
    if pocket and shapely.intersects(swept_region(start[None], setup), inside):
        raise Rejected("start in the pocket")
    ends = shapely.union(swept_region(start[None], setup), swept_region(goal[None], setup))
    placement = Placement(size=setup.size, forbidden=ends, obstacles=walls)
    placement.fill(rng, int(rng.integers(0, 5)), (0.02, 0.06))
    place = "The goal lies in a pocket" if pocket else "A wall crosses the table"
    return Draft(
        setup=setup,
        obstacles=tuple(placement.obstacles),
        motion=np.array([start, goal]),
        solvable=False,
        description=f"{place}, {description}; there is no way.",
    )


def _setup(rng: np.random.Generator) -> tuple[Setup, float, str]:
    """Cable and grippers, the width of the gap [m], 0 for none, and words for it."""
    case, share = int(rng.integers(3)), rng.uniform(0.3, 0.8)
    if case == 0:
        return Setup(), 0.0, "closed"
    if case == 1:
        radius = round(rng.uniform(0.008, 0.016), 4)
        gap = round(2 * radius * share, DECIMALS)
        return Setup(grippers=Grippers(radius=radius)), gap, f"its gap of {1000 * gap:.1f} mm too narrow for a gripper"
    radius = round(rng.uniform(0.006, 0.01), 4)
    gap = round(2 * radius * share, DECIMALS)
    words = f"its gap of {1000 * gap:.1f} mm too narrow for the cable"
    return Setup(cable=Cable(radius=radius), grippers=Grippers(radius=radius / 2)), gap, words


def _shape(rng: np.random.Generator, setup: Setup, upper: bool | None) -> np.ndarray:
    """An equilibrium on the table, in its upper or lower part or anywhere."""
    low, high = {None: (0.15, 0.85), True: (0.65, 0.85), False: (0.15, 0.35)}[upper]
    x, y = np.array(setup.size) * [rng.uniform(0.2, 0.8), rng.uniform(low, high)]
    turn = rng.uniform(-np.pi, np.pi) if upper is None else rng.uniform(-0.5, 0.5) + np.pi * rng.integers(2)
    return np.array([x, y, turn, *rng.normal(0, 6, 2), rng.normal(0, 2)])


def _wall(rng: np.random.Generator, setup: Setup, gap: float) -> list[Obstacle]:
    middle = np.array(setup.size) / 2 + rng.uniform(-1, 1, 2) * [0.2, 0.03]
    # without a gap the two parts overlap
    width = gap if gap else -0.01
    return list(wall_with_gap(middle, rng.uniform(-0.2, 0.2), width, rng.uniform(0.01, 0.04), setup.size))


def _pocket(rng: np.random.Generator, setup: Setup, goal: np.ndarray, gap: float) -> list[Obstacle]:
    """Four walls about a shape; one of them has the gap, if there is one."""
    line = setup.rod.shapes(goal[None])[0][0]
    room = setup.thickness + MARGIN + rng.uniform(0.01, 0.04)
    angle = float(rng.uniform(0, np.pi))
    turned = line @ se2.rotation(angle)
    low, high = turned.min(axis=0) - room, turned.max(axis=0) + room
    (x0, y0), (x1, y1), t = low, high, THICK
    spans = [((x0 - t, y0 - t), (x1 + t, y0)), ((x0 - t, y1), (x1 + t, y1 + t))]
    spans += [((x0 - t, y0 - t), (x0, y1 + t)), ((x1, y0 - t), (x1 + t, y1 + t))]
    if gap:
        (a, b), (c, d) = spans.pop(0)
        at = rng.uniform(x0 + gap, x1 - gap)
        spans += [((a, b), (at - gap / 2, d)), ((at + gap / 2, b), (c, d))]
    walls = []
    for (a, b), (c, d) in spans:
        corners = np.array([[a, b], [c, b], [c, d], [a, d]]) @ se2.rotation(angle).T
        if (corners < 0).any() or (corners > setup.size).any():
            raise Rejected("outside")
        walls.append(Polygon(vertices=corners.round(DECIMALS)))
    return walls
