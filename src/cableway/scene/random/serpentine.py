"""Tables with lanes that wind to and fro, as wide as the openings between them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import se2
from cableway.scene.obstacles import Box, Obstacle
from cableway.scene.random.passages import way_between
from cableway.scene.random.placement import DECIMALS
from cableway.scene.random.setup import Draft, Rejected, Setup


def serpentine(rng: np.random.Generator, width: float) -> Draft:
    """Two to four walls, each with an opening at the other end than the last; solvable because a motion winds through.

    Lanes and openings are all `width` [m] wide.
    """
    setup = Setup()
    count, thick = int(rng.integers(2, 5)), round(rng.uniform(0.02, 0.05), DECIMALS)
    height = count * thick + (count - 1) * width
    span = round(rng.uniform(max(0.2, 3 * width), 0.45), DECIMALS)
    low = np.array([rng.uniform(0.02, setup.size[0] - span - 0.02), (setup.size[1] - height) / 2]).round(DECIMALS)
    first = int(rng.integers(2))
    walls = _walls(setup, low, span, count, thick, width, first)
    curve = _winding(rng, setup, low, span, count, thick, width, first)
    if rng.integers(2):
        walls, curve = [_transposed(wall) for wall in walls], curve[:, ::-1]
    q = way_between(rng, setup, walls, curve, width)
    description = f"{count - 1} lanes of {1000 * width:g} mm to wind through."
    return Draft(setup=setup, obstacles=tuple(walls), motion=q, description=description)


def _box(low: tuple[float, float], high: tuple[float, float]) -> Box:
    x, y, w, h = (
        round(float(v), DECIMALS + 1)
        for v in ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, high[0] - low[0], high[1] - low[1])
    )
    return Box(center=(x, y), size=(w, h))


def _transposed(wall: Obstacle) -> Obstacle:
    assert isinstance(wall, Box)
    return Box(center=wall.center[::-1], size=wall.size[::-1])


def _walls(
    setup: Setup, low: np.ndarray, span: float, count: int, thick: float, width: float, first: int
) -> list[Obstacle]:
    """Blocks on both sides of the lanes, and the walls between; `first` is the side of the first opening, 1 right."""
    (x, y), table = low, setup.size[0]
    top = y + count * thick + (count - 1) * width
    walls: list[Obstacle] = [_box((0.0, y), (x, top)), _box((x + span, y), (table, top))]
    for j in range(count):
        foot = y + j * (thick + width)
        left = (j + first) % 2 == 0  # the opening is on the left
        ends = (x + width, x + span) if left else (x, x + span - width)
        walls.append(_box((ends[0], foot), (ends[1], foot + thick)))
    return walls


def _winding(
    rng: np.random.Generator,
    setup: Setup,
    low: np.ndarray,
    span: float,
    count: int,
    thick: float,
    width: float,
    first: int,
) -> Float[np.ndarray, "m 2"]:
    """A curve along the middles of the lanes, round the ends of the walls, and out into the rooms at both ends."""
    radius = (thick + width) / 2
    pieces = []
    for j in range(count):
        left = (j + first) % 2 == 0
        tip = low + [width if left else span - width, j * (thick + width) + thick / 2]
        turn = np.linspace(-np.pi / 2, np.pi / 2, 25)
        arc = tip + radius * se2.direction(turn) * [-1 if left else 1, 1]
        pieces.append(arc)
    path = np.vstack(pieces)
    reach = setup.cable.length * 1.1
    ends = []
    for end, inner, side in ((path[0], path[1], -1), (path[-1], path[-2], 1)):
        heading = np.arctan2(*(end - inner)[::-1])
        heading = np.pi * np.round(heading / np.pi)
        away = side * np.cos(heading)  # turns away from the walls
        s = np.linspace(0, reach, 100)
        bend = rng.uniform(0.5, 4.0) * away * np.clip(s / 0.1, 0, 1)
        angle = heading + np.concatenate([[0.0], np.cumsum(bend[:-1] * s[1])])
        ends.append(end + np.cumsum(s[1] * se2.direction(angle), axis=0))
    if min(e.min() for e in ends) < 0 or max(e.max() for e in ends) > 0.7:
        raise Rejected("outside")
    return _fine(np.vstack([ends[0][::-1], path, ends[1]]))


def _fine(path: np.ndarray) -> np.ndarray:
    from cableway.geometry import polyline

    return polyline.resample(path, 2 + int(polyline.length(path) / 0.004))
