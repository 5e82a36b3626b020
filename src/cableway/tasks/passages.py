"""Tables with a narrow passage that the cable is led through lengthwise."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import se2
from cableway.scene.obstacles import Obstacle, Polygon
from cableway.scene.scene import Scene
from cableway.tasks import motion
from cableway.tasks.clutter import aside
from cableway.tasks.placement import DECIMALS, Placement, swept_region
from cableway.tasks.setup import MARGIN, Draft, Rejected, Setup

PASSAGE_MARGIN = 0.0045
"""Clearance [m] that a witness keeps in a passage: a plan must keep 4 mm, and a 25 mm slot leaves 8.5 mm at most."""

STRETCH = (45, 110)
"""Fewest and most rows that a motion along part of a curve has, 0.04 lengths of the cable apart."""


def slot(rng: np.random.Generator, width: float) -> Draft:
    """A wall across the table with one slot, solvable because a motion was led through it."""
    return _passage(rng, width, rng.uniform(0.015, 0.04), f"A wall with a slot of {1000 * width:g} mm.")


def corridor(rng: np.random.Generator, width: float) -> Draft:
    """Two blocks with a straight corridor between, solvable because a motion was led through it."""
    return _passage(rng, width, rng.uniform(0.08, 0.2), f"A straight corridor of {1000 * width:g} mm.")


def _passage(rng: np.random.Generator, width: float, depth: float, description: str) -> Draft:
    """A wall as thick as the passage through it is deep [m], and a motion that leads through."""
    setup = Setup()
    wall, curve = _wall_with_passage(rng, setup, width, depth)
    q = way_between(rng, setup, wall, curve, width)
    placement = Placement(size=setup.size, forbidden=swept_region(q, setup, PASSAGE_MARGIN), obstacles=wall)
    placement.fill(rng, int(rng.integers(1, 6)), (0.02, 0.06))
    return Draft(setup=setup, obstacles=tuple(placement.obstacles), motion=q, description=description)


def way_between(
    rng: np.random.Generator,
    setup: Setup,
    obstacles: list[Obstacle],
    curve: Float[np.ndarray, "m 2"],
    width: float,
    whole: bool = True,
) -> Float[np.ndarray, "t 6"]:
    """Led along a curve between walls as far from them as a passage of `width` [m] allows, and aside at both ends.

    Args:
        rng: Source of the draw.
        setup: Table, cable and grippers.
        obstacles: What the curve leads between.
        curve: (m, 2) [m].
        width: [m].
        whole: Whether it must be led along all of the curve, or a part of it will do.

    Raises:
        Rejected: The motion is not sound, or comes nearer to the walls than `PASSAGE_MARGIN`.
    """
    scene = Scene(setup.size, tuple(obstacles))
    keep = setup.thickness + min(MARGIN, (width / 2 - setup.thickness) * 0.95)
    walls = motion.Walls(scene.world, keep, setup.thickness + PASSAGE_MARGIN)
    led = motion.led_along(curve if rng.integers(2) else curve[::-1], setup.rod, walls, whole)
    if not whole:
        led = motion.longest_run(led, setup, scene, PASSAGE_MARGIN)
        led = _part(rng, led)
    motion.require_sound(led, setup, PASSAGE_MARGIN)
    motion.require_free(led, setup, scene, PASSAGE_MARGIN)
    q = motion.joined(_beside(rng, led[0], setup, scene)[::-1], led, _beside(rng, led[-1], setup, scene))
    return q if rng.integers(2) else q[::-1]


def _part(rng: np.random.Generator, led: Float[np.ndarray, "t 6"]) -> Float[np.ndarray, "k 6"]:
    """Some rows of a motion, as many as `STRETCH` allows."""
    if len(led) < STRETCH[0]:
        raise Rejected("the way is too short")
    count = min(len(led), int(rng.integers(*STRETCH)))
    first = int(rng.integers(len(led) - count + 1))
    return led[first : first + count]


def _beside(rng: np.random.Generator, q: np.ndarray, setup: Setup, scene: Scene) -> Float[np.ndarray, "t 6"]:
    """A motion aside from q that keeps off the walls, as far as there is room."""
    for share in 0.75 ** np.arange(12):
        try:
            legs = aside(rng, q, setup, share)
            motion.require_free(legs, setup, scene, PASSAGE_MARGIN)
        except Rejected:
            continue
        return legs
    raise Rejected("no room aside")


def _wall_with_passage(
    rng: np.random.Generator, setup: Setup, width: float, depth: float
) -> tuple[list[Obstacle], Float[np.ndarray, "m 2"]]:
    """A wall from one side of the table to the other with a passage in it, and a curve through the passage."""
    length, half = setup.cable.length, np.array(setup.size) / 2
    tilt = rng.uniform(-0.35, 0.35)
    middle = half + rng.uniform(-1, 1, 2) * [0.15, 0.08]
    left, right = wall_with_gap(middle, tilt, width, depth, setup.size)
    curve = np.vstack([_branch(rng, length, depth, -1)[::-1], _branch(rng, length, depth, 1)[1:]])
    return [left, right], se2.transform(curve, middle, tilt + np.pi / 2)


def wall_with_gap(
    middle: np.ndarray, tilt: float, width: float, thick: float, size: tuple[float, float]
) -> tuple[Polygon, Polygon]:
    """The two parts of a wall through `middle` [m], its ends on the left and right walls of the table.

    Args:
        middle: (2,) [m], the middle of the gap.
        tilt: Of the wall [rad].
        width: Of the gap [m]; negative where the parts overlap.
        thick: [m].
        size: Of the table [m].
    """
    normal = np.array([-np.sin(tilt), np.cos(tilt)]) * thick / 2
    along = se2.direction(tilt)
    parts = []
    for side in (-1, 1):
        edge = middle + side * along * width / 2
        far = 0.0 if side < 0 else size[0]
        corners = []
        for offset in (normal, -normal):
            near = edge + offset
            corners.append((near, near + along * (far - near[0]) / along[0]))
        parts.append(Polygon(vertices=np.array([*corners[0], corners[1][1], corners[1][0]]).round(DECIMALS)))
    return parts[0], parts[1]


def _branch(rng: np.random.Generator, length: float, depth: float, side: int) -> Float[np.ndarray, "m 2"]:
    """A curve from the origin along +x or -x, straight within a passage of `depth` [m] and then bending."""
    reach = length * rng.uniform(1.05, 1.3) + depth / 2
    s = np.linspace(0.0, reach, 1 + int(reach / 0.004))
    onset = np.clip((s - depth / 2) / (0.2 * length), 0, 1)
    bend = rng.choice((-1, 1)) * rng.uniform(4, 8) * (0.3 / length) * onset
    angle = np.concatenate([[0.0], np.cumsum(bend[:-1] * s[1])])
    return side * np.vstack([[0.0, 0.0], np.cumsum(s[1] * se2.direction(angle[:-1]), axis=0)])
