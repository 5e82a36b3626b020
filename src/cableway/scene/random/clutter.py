"""Tables with obstacles strewn about a way that was drawn first."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.scene.random import motion
from cableway.scene.random.placement import Placement, swept_region
from cableway.scene.random.setup import MARGIN, Draft, Rejected, Setup

BEND = 7.0
"""Largest curvature [1/m] of a way for the 0.3 m cable, without its second wave; other lengths scale it."""


def clutter(rng: np.random.Generator) -> Draft:
    """Four to seven obstacles, solvable because they were set around a motion; one stands in the straight way."""
    return strewn(rng, Setup(), count=int(rng.integers(4, 8)), radii=(0.025, 0.08))


def dense(rng: np.random.Generator) -> Draft:
    """Ten to fourteen obstacles with gaps down to 25 mm, solvable because they were set around a motion."""
    return strewn(rng, Setup(), count=int(rng.integers(10, 15)), radii=(0.02, 0.075))


def strewn(rng: np.random.Generator, setup: Setup, count: int, radii: tuple[float, float]) -> Draft:
    """A way across the table and `count` obstacles around it, at least one of them in the straight line in q."""
    q = random_way(rng, setup)
    straight = swept_region(np.array([q[0], q[-1]]), setup, margin=0.0)
    placement = Placement(size=setup.size, forbidden=swept_region(q, setup))
    placement.fill(rng, 1, radii, within=straight)
    placement.fill(rng, count - 1, radii)
    return Draft(
        setup=setup,
        obstacles=tuple(placement.obstacles),
        motion=q,
        description=f"{count} obstacles set around a motion of the cable.",
    )


def random_way(rng: np.random.Generator, setup: Setup) -> Float[np.ndarray, "t 6"]:
    """Led along a random curve, and at both ends aside from it: a motion across the table."""
    length = setup.cable.length
    curve = motion.random_curve(
        rng,
        length * rng.uniform(1.7, 2.6),
        BEND * (0.3 / length) * rng.uniform(0.4, 1.0),
        length * rng.uniform(1.3, 2.5),
    )
    curve = motion.placed(rng, curve, setup.size, setup.thickness + MARGIN)
    led = motion.led_along(curve if rng.integers(2) else curve[::-1], setup.rod)
    q = motion.joined(aside(rng, led[0], setup)[::-1], led, aside(rng, led[-1], setup))
    motion.require_sound(q, setup, MARGIN)
    return q if rng.integers(2) else q[::-1]


def aside(rng: np.random.Generator, q: Float[np.ndarray, "6"], setup: Setup, share: float = 1.0) -> np.ndarray:
    """A short motion (t, 6) from q to a shape beside it, sound all the way; `share` scales how far that is."""
    length = setup.cable.length
    for _ in range(20):
        step = share * rng.normal(size=6) * [0.12 * length, 0.12 * length, 0.3, 6.0, 6.0, 1.5]
        legs = motion.through(np.array([q, q + step]))
        try:
            motion.require_sound(legs, setup, MARGIN)
        except Rejected:
            continue
        return legs
    raise Rejected("no room aside")
