"""Obstacles of random kind and size, set where a motion did not sweep."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import shapely
from jaxtyping import Float

from cableway.geometry import polyline
from cableway.motion.sweeps import swept_shapes
from cableway.scene.bodies import outer_bodies
from cableway.scene.obstacles import Box, Disc, Obstacle, Polygon, to_shapely
from cableway.tasks.motion import SWEEP_STEP
from cableway.tasks.setup import GAP, MARGIN, Rejected, Setup

DECIMALS = 4
"""Obstacles are given in tenths of millimetres."""


def swept_region(q: Float[np.ndarray, "t 6"], setup: Setup, margin: float = MARGIN) -> shapely.Geometry:
    """What cable and grippers, as low as obstacles are high, sweep on a motion, grown by `margin` [m]."""
    lines = swept_shapes(setup.rod, q, SWEEP_STEP)
    cable = shapely.linestrings(lines)
    tips = np.asarray(shapely.points(lines[:, [0, -1]])).ravel()
    grown = [
        shapely.buffer(cable, setup.cable.radius + margin + SWEEP_STEP / 2, quad_segs=4),
        shapely.buffer(tips, setup.grippers.radius + margin + SWEEP_STEP / 2, quad_segs=4),
    ]
    poses = polyline.end_poses(lines)
    for body in outer_bodies(setup.grippers.pieces, [setup.height]):
        outlines = body.placed(poses[:, body.side])
        between = np.concatenate([outlines[:-1], outlines[1:]], axis=1) if len(lines) > 1 else outlines
        grown.append(shapely.buffer(shapely.convex_hull(shapely.multipoints(between)), margin, quad_segs=4))
    return shapely.union_all(np.concatenate(grown))


@dataclass(kw_only=True)
class Placement:
    """Obstacles set one after the other, at least `gap` from each other and from the walls.

    Attributes:
        size: Of the workspace [m].
        forbidden: Where none may stand.
        gap: Least distance [m] between two of them, and between one and a wall.
        obstacles: Those that stand, first those that the draw starts from.
    """

    size: tuple[float, float]
    forbidden: shapely.Geometry
    gap: float = GAP
    obstacles: list[Obstacle] = field(default_factory=list)

    def __post_init__(self) -> None:
        width, height = self.size
        self._solids = [to_shapely(obstacle) for obstacle in self.obstacles]
        self._inside = shapely.box(self.gap, self.gap, width - self.gap, height - self.gap)
        shapely.prepare(self.forbidden)

    def fill(
        self, rng: np.random.Generator, count: int, radii: tuple[float, float], within: shapely.Geometry | None = None
    ) -> None:
        """Set `count` more obstacles, each as large as its place allows.

        Args:
            rng: Source of the draw.
            count: How many.
            radii: Least and largest radius [m] of the circle about an obstacle.
            within: What each of them overlaps, if given.

        Raises:
            Rejected: There is no room for so many.
        """
        wanted = len(self.obstacles) + count
        for _ in range(60 * count):
            if len(self.obstacles) == wanted:
                return
            self._try(rng, radii, within)
        if len(self.obstacles) < wanted:
            raise Rejected("no room for so many obstacles")

    def _try(self, rng: np.random.Generator, radii: tuple[float, float], within: shapely.Geometry | None) -> None:
        center, kind, angle = rng.uniform(0, 1, 2) * self.size, rng.integers(3), rng.uniform(0, np.pi)
        radius, form = radii[0] + (radii[1] - radii[0]) * rng.uniform(0.4, 1.0), rng.uniform(0, 1, 6)
        while radius >= radii[0]:
            obstacle = _obstacle(int(kind), center, radius, angle, form)
            solid = to_shapely(obstacle)
            if self._free(solid) and (within is None or solid.intersects(within)):
                self.obstacles.append(obstacle)
                self._solids.append(solid)
                return
            radius *= 0.8

    def _free(self, solid: shapely.Polygon) -> bool:
        if not self._inside.contains(solid) or shapely.intersects(self.forbidden, solid):
            return False
        return not self._solids or float(shapely.distance(solid, np.array(self._solids)).min()) >= self.gap


def box_between(low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> Box:
    """The box with these corners [m], to a tenth of a millimetre."""
    low, high = np.round(low, DECIMALS), np.round(high, DECIMALS)
    center, size = ((low + high) / 2).round(DECIMALS + 1), (high - low).round(DECIMALS)
    return Box(center=(float(center[0]), float(center[1])), size=(float(size[0]), float(size[1])))


def _obstacle(kind: int, center: np.ndarray, radius: float, angle: float, form: np.ndarray) -> Obstacle:
    """A box, polygon or disc within a circle; `form` (6,) in [0, 1] sets its proportions."""
    x, y = (round(float(value), DECIMALS) for value in center)
    if kind == 0:
        half = 0.2 + 0.55 * form[0]
        width, height = 2 * radius * np.cos(half), 2 * radius * np.sin(half)
        size = (round(float(width), DECIMALS), round(float(height), DECIMALS))
        return Box(center=(x, y), size=size, angle=round(float(angle), DECIMALS))
    if kind == 1:
        count = 3 + int(3 * form[0])
        turns = angle + 2 * np.pi * (np.arange(count) + 0.6 * (form[1 : count + 1] - 0.5)) / count
        corners = np.array([x, y]) + radius * np.column_stack([np.cos(turns), np.sin(turns)])
        return Polygon(vertices=corners.round(DECIMALS))
    return Disc(center=(x, y), radius=round(0.8 * radius, DECIMALS))
