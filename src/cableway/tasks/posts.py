"""Tables with posts that grippers with bodies are led between."""

from __future__ import annotations

import numpy as np

from cableway.scene.grippers import Grippers
from cableway.tasks.clutter import random_way, strewn
from cableway.tasks.setup import Draft, Setup

BODIES = ("2f-85", "2f-85-long-fingers")
HEIGHTS = (0.05, 0.1)
"""Of the posts [m]."""

EDGE = 0.001
"""Height [m] of the table's edge, which keeps the cable on it and grippers pass above."""


def posts(rng: np.random.Generator) -> Draft:
    """Eight to twelve posts of 5 or 10 cm between which a 2F-85 with usual or long fingers leads a cable.

    Solvable because they were set around a motion of the cable and of all that its grippers are.
    """
    body, height = BODIES[int(rng.integers(2))], HEIGHTS[int(rng.integers(2))]
    setup = _setup(body, height)
    return strewn(rng, setup, random_way(rng, setup), int(rng.integers(8, 13)), (0.01, 0.05))


def scattered(rng: np.random.Generator, setup: Setup) -> Draft:
    """Four to seven boxes and posts, solvable as `posts` is."""
    return strewn(rng, setup, random_way(rng, setup), int(rng.integers(4, 8)), (0.025, 0.08))


def crowded(rng: np.random.Generator, setup: Setup) -> Draft:
    """Fourteen to eighteen boxes and posts, solvable as `posts` is."""
    return strewn(rng, setup, random_way(rng, setup), int(rng.integers(14, 19)), (0.01, 0.05))


def _setup(body: str, height: float) -> Setup:
    return Setup(size=(0.8, 0.8), grippers=Grippers(body=body), height=height, wall_height=EDGE)


SETUPS = tuple(_setup(body, height) for height in HEIGHTS for body in BODIES)
"""Both grippers between obstacles of either height."""
