"""Tables without obstacles, for the control of shape alone."""

from __future__ import annotations

import numpy as np

from cableway.tasks import motion
from cableway.tasks.clutter import aside, random_way
from cableway.tasks.setup import MARGIN, Draft, Rejected, Setup

LEAST_CHANGE = 0.15
"""Least mean distance between a keypoint at the start and at a near goal, in lengths of the cable."""


def near(rng: np.random.Generator) -> Draft:
    """No obstacles; the goal is another shape beside the start, solvable by going straight there."""
    setup = Setup()
    middle = np.array(setup.size) * rng.uniform(0.35, 0.65, 2)
    loads = rng.normal(size=3) * [6.0, 6.0, 1.5]
    start = np.array([*middle, rng.uniform(-np.pi, np.pi), *loads])
    motion.require_sound(np.array([start, start]), setup, MARGIN)
    way = aside(rng, start, setup)
    ends = setup.rod.at_keypoints(setup.rod.shapes(way[[0, -1]])[0])
    if np.linalg.norm(ends[1] - ends[0], axis=1).mean() < LEAST_CHANGE * setup.cable.length:
        raise Rejected("the goal is near the start")
    return Draft(setup=setup, obstacles=(), motion=way, description="No obstacles; the goal is near.")


def far(rng: np.random.Generator) -> Draft:
    """No obstacles; the goal is across the table, solvable because it was drawn as the end of a motion."""
    setup = Setup()
    return Draft(setup=setup, obstacles=(), motion=random_way(rng, setup), description="No obstacles; the goal is far.")
