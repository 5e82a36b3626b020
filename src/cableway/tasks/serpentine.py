"""Tables with lanes that wind to and fro, as wide as the openings between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline, se2
from cableway.scene.obstacles import Box, Obstacle
from cableway.tasks.passages import way_between
from cableway.tasks.placement import DECIMALS, box_between
from cableway.tasks.setup import Draft, Setup


def serpentine(rng: np.random.Generator, width: float) -> Draft:
    """Two to four walls, each with an opening at the other end than the last; solvable because a motion winds through.

    Lanes and openings are all `width` [m] wide.
    """
    setup = Setup()
    lanes = _draw_lanes(rng, setup, width)
    walls, curve = lanes.walls(setup.size[0]), _winding(rng, setup, lanes)
    if rng.integers(2):
        walls, curve = [_transposed(wall) for wall in walls], curve[:, ::-1]
    obstacles: list[Obstacle] = [*walls]
    q = way_between(rng, setup, obstacles, curve, width)
    ways = "1 lane" if lanes.count == 2 else f"{lanes.count - 1} lanes"
    description = f"{ways} of {1000 * width:g} mm to wind through."
    return Draft(setup=setup, obstacles=tuple(obstacles), motion=q, description=description)


def _transposed(box: Box) -> Box:
    """The box with x and y exchanged."""
    (x, y), (width, height) = box.center, box.size
    return Box(center=(y, x), size=(height, width))


@dataclass(frozen=True, kw_only=True)
class _Lanes:
    """Horizontal walls one above the other, with lanes between.

    Attributes:
        low: (2,) lower left corner [m].
        span: Length of the lanes [m].
        count: Of the walls.
        thick: Thickness of the walls [m].
        width: Of lanes and openings [m].
        first: Side of the lowest opening: 0 left, 1 right; the next one is on the other side.
    """

    low: Float[np.ndarray, "2"]
    span: float
    count: int
    thick: float
    width: float
    first: int

    def foot(self, j: int) -> float:
        """Height [m] of the lower side of wall j."""
        return float(self.low[1]) + j * (self.thick + self.width)

    def opens_left(self, j: int) -> bool:
        """Side of the opening of wall j."""
        return (j + self.first) % 2 == 0

    def walls(self, table: float) -> list[Box]:
        """The walls, and blocks beside the lanes up to both sides of a table `table` [m] wide."""
        x, top = float(self.low[0]), self.foot(self.count) - self.width
        sides = [((0.0, x), (self.low[1], top)), ((x + self.span, table), (self.low[1], top))]
        for j in range(self.count):
            across = (x + self.width, x + self.span) if self.opens_left(j) else (x, x + self.span - self.width)
            sides.append((across, (self.foot(j), self.foot(j) + self.thick)))
        return [box_between(np.array([a, b]), np.array([c, d])) for (a, c), (b, d) in sides]

    def turn(self, j: int) -> Float[np.ndarray, "m 2"]:
        """A half circle round the end of wall j, from below it to above it."""
        at = self.width if self.opens_left(j) else self.span - self.width
        end = np.array([self.low[0] + at, self.foot(j) + self.thick / 2])
        side = -1 if self.opens_left(j) else 1
        arc = se2.direction(np.linspace(-np.pi / 2, np.pi / 2, 25)) * [side, 1]
        return end + (self.thick + self.width) / 2 * arc


def _draw_lanes(rng: np.random.Generator, setup: Setup, width: float) -> _Lanes:
    count, thick = int(rng.integers(2, 5)), round(rng.uniform(0.02, 0.05), DECIMALS)
    span = round(rng.uniform(max(0.2, 3 * width), 0.45), DECIMALS)
    height = count * thick + (count - 1) * width
    low = np.array([rng.uniform(0.02, setup.size[0] - span - 0.02), (setup.size[1] - height) / 2])
    return _Lanes(low=low.round(DECIMALS), span=span, count=count, thick=thick, width=width, first=int(rng.integers(2)))


def _winding(rng: np.random.Generator, setup: Setup, lanes: _Lanes) -> Float[np.ndarray, "m 2"]:
    """A curve round the ends of the walls and along the lanes, with room for the cable before the first and after."""
    path = np.vstack([lanes.turn(j) for j in range(lanes.count)])
    reach = 1.1 * setup.cable.length
    before = _tail(rng, path[0], lanes.opens_left(0), -1, reach)
    after = _tail(rng, path[-1], lanes.opens_left(lanes.count - 1), 1, reach)
    whole = np.vstack([before[::-1], path, after])
    return polyline.resample(whole, 2 + int(polyline.length(whole) / 0.004))


def _tail(rng: np.random.Generator, end: np.ndarray, opens_left: bool, upward: int, reach: float) -> np.ndarray:
    """A curve from `end` of a turn along the wall and then bending away from it."""
    s = np.linspace(0, reach, 100)
    bend = rng.uniform(0.5, 4.0) * np.clip(s / 0.1, 0, 1)
    angle = np.concatenate([[0.0], np.cumsum(bend[:-1] * s[1])])
    forward = 1 if opens_left else -1
    return end + np.cumsum(s[1] * se2.direction(angle), axis=0) * [forward, upward]
