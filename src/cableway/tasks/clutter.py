"""Tables with obstacles strewn about a way that was drawn first."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from cableway.scene.cable import Cable
from cableway.scene.grippers import Grippers
from cableway.tasks import motion
from cableway.tasks.placement import Placement, swept_region
from cableway.tasks.setup import MARGIN, Draft, Setup

BEND = 7.0
"""Largest curvature [1/m] of a way for the 0.3 m cable, without its second wave; other lengths scale it."""


def clutter(rng: np.random.Generator) -> Draft:
    """Four to seven obstacles, solvable because they were set around a motion; one stands in the straight way."""
    return strewn(rng, Setup(), random_way(rng, Setup()), int(rng.integers(4, 8)), (0.025, 0.08))


def dense(rng: np.random.Generator) -> Draft:
    """Ten to fourteen obstacles with gaps down to 25 mm, solvable because they were set around a motion."""
    return strewn(rng, Setup(), random_way(rng, Setup()), int(rng.integers(10, 15)), (0.02, 0.075))


def sizes(rng: np.random.Generator) -> Draft:
    """Cables of 0.17 m to 0.5 m on tables two to three times as long; solvable as clutter is."""
    length = round(rng.uniform(0.17, 0.5), 3)
    width, height = (round(float(side), 2) for side in length * rng.uniform(2.0, 3.0, 2))
    setup = Setup(
        size=(width, height),
        cable=Cable(length=length, radius=round(rng.uniform(0.002, 0.005), 4)),
        grippers=Grippers(radius=round(rng.uniform(0.003, 0.008), 4)),
    )
    return strewn(rng, setup, random_way(rng, setup), int(rng.integers(4, 9)), (0.08 * length, 0.25 * length))


def strewn(rng: np.random.Generator, setup: Setup, q: np.ndarray, count: int, radii: tuple[float, float]) -> Draft:
    """A motion q (t, 6) and `count` obstacles around it, at least one of them in the straight line in q."""
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


End = Callable[[np.random.Generator, np.ndarray, Setup], np.ndarray]
"""Makes a motion (t, 6) from a shape q to another one."""


def random_way(rng: np.random.Generator, setup: Setup, end: End | None = None) -> Float[np.ndarray, "t 6"]:
    """Led along a random curve, and at both ends on to another shape, by `end` or else aside."""
    length, end = setup.cable.length, end or aside
    curve = motion.random_curve(
        rng,
        length * rng.uniform(1.7, 2.6),
        BEND * (0.3 / length) * rng.uniform(0.4, 1.0),
        length * rng.uniform(1.3, 2.5),
    )
    curve = motion.placed(rng, curve, setup.size, setup.thickness + MARGIN)
    led = motion.led_along(curve if rng.integers(2) else curve[::-1], setup.rod)
    q = motion.joined(end(rng, led[0], setup)[::-1], led, end(rng, led[-1], setup))
    motion.require_sound(q, setup, MARGIN)
    return q if rng.integers(2) else q[::-1]


def aside(rng: np.random.Generator, q: Float[np.ndarray, "6"], setup: Setup, share: float = 1.0) -> np.ndarray:
    """A short motion (t, 6) from q to a shape beside it, sound all the way; `share` scales how far that is."""
    spread = np.array([0.12 * setup.cable.length] * 2 + [0.3, 6.0, 6.0, 1.5])

    def legs() -> np.ndarray:
        return motion.through(np.array([q, q + share * rng.normal(size=len(q)) * spread]))

    return motion.first_sound(legs, setup, MARGIN, "no room aside")
