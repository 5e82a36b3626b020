"""Tables with a narrow passage that the cable is led through lengthwise."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import se2
from cableway.scene.obstacles import Obstacle, Polygon
from cableway.scene.random import motion
from cableway.scene.random.clutter import aside
from cableway.scene.random.placement import DECIMALS, Placement, swept_region
from cableway.scene.random.setup import MARGIN, Draft, Rejected, Setup
from cableway.scene.scene import Scene

PASSAGE_MARGIN = 0.0055
"""Clearance [m] that a witness keeps in a passage: a plan must keep 4 mm, and a 25 mm slot leaves 8.5 mm at most."""


def slot(rng: np.random.Generator, width: float) -> Draft:
    """A wall across the table with one slot, solvable because a motion was led through it."""
    setup = Setup()
    wall, curve = _wall_with_slot(rng, setup, width)
    world = Scene(setup.size, wall).world
    keep = setup.thickness + min(MARGIN, (width / 2 - setup.thickness) * 0.95)
    led = motion.led_along(curve if rng.integers(2) else curve[::-1], setup.rod, world, keep)
    motion.require_sound(led, setup, PASSAGE_MARGIN)
    q = motion.joined(aside(rng, led[0], setup)[::-1], led, aside(rng, led[-1], setup))
    region = swept_region(q, setup, PASSAGE_MARGIN)
    placement = Placement(size=setup.size, forbidden=region, obstacles=wall)
    if any(region.intersects(solid) for solid in Scene(setup.size, tuple(wall)).solids):
        raise Rejected("touches the wall")
    placement.fill(rng, int(rng.integers(1, 6)), (0.02, 0.06))
    return Draft(
        setup=setup,
        obstacles=tuple(placement.obstacles),
        motion=q,
        description=f"A wall with a slot of {1000 * width:g} mm.",
    )


def _wall_with_slot(
    rng: np.random.Generator, setup: Setup, width: float
) -> tuple[list[Obstacle], Float[np.ndarray, "m 2"]]:
    """A wall from one side of the table to the other with a slot in it, and a curve through the slot."""
    length, half = setup.cable.length, np.array(setup.size) / 2
    thick, tilt = rng.uniform(0.015, 0.04), rng.uniform(-0.35, 0.35)
    middle = half + rng.uniform(-1, 1, 2) * [0.15, 0.08]
    left, right = _crossings(middle, tilt, width, thick, setup.size)
    curve = np.vstack([_branch(rng, length, -1)[::-1], _branch(rng, length, 1)[1:]])
    return [left, right], se2.transform(curve, middle, tilt + np.pi / 2)


def _crossings(
    middle: np.ndarray, tilt: float, width: float, thick: float, size: tuple[float, float]
) -> tuple[Polygon, Polygon]:
    """The two parts of a wall through `middle`, its ends on the left and right walls of the table."""
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


def _branch(rng: np.random.Generator, length: float, side: int) -> Float[np.ndarray, "m 2"]:
    """A curve from the origin along +x or -x, at first straight and then bending."""
    reach = length * rng.uniform(1.05, 1.3)
    s = np.linspace(0.0, reach, 1 + int(reach / 0.004))
    bend = (
        rng.choice((-1, 1)) * rng.uniform(4, 8) * (0.3 / length) * np.clip((s - 0.05 * length) / (0.2 * length), 0, 1)
    )
    angle = np.concatenate([[0.0], np.cumsum(bend[:-1] * s[1])])
    return side * np.vstack([[0.0, 0.0], np.cumsum(s[1] * se2.direction(angle[:-1]), axis=0)])
