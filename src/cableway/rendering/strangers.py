"""What may be in a picture of a table and belongs to no task: another cable that lies there, a person's arm."""

from __future__ import annotations

import math

import numpy as np

from cableway.rendering.cell import Color, Label
from cableway.rendering.mesh import Mesh, capsules, tube

WAVES, SWING = (0.5, 1.5), 0.08
"""Of the lying cable: how many waves it has across the table, and their largest height as a share of the table's."""

POINTS = 80
"""Of its centre line."""

SKIN: Color = (0.80, 0.60, 0.48)
"""Of the arm."""

FIST, FOREARM = 0.045, 0.038
"""Radii of the arm [m]."""

ABOVE = 0.16
"""Height of its axis over the table [m]: over posts, and over the fingers of grippers."""

EVERY, OVER, REACHING = 6.0, 2.0, 0.5
"""Time [s] from one reach over the table to the next, how long each takes, and of it the way out or back."""


def lying_cable(size: tuple[float, float], radius: float, color: Color, seed: int) -> Mesh:
    """A cable that lies across a table from its left to its right edge, in waves.

    Args:
        size: Width and height of the workspace [m].
        radius: Of the cable [m].
        color: Its colour.
        seed: Of where it lies.
    """
    rng, (width, height) = np.random.default_rng(seed), size
    x = np.linspace(0.0, width, POINTS)
    first, last, phase = rng.uniform(0.15, 0.85), rng.uniform(0.15, 0.85), rng.uniform(0.0, 2 * math.pi)
    wave = SWING * rng.uniform(0.3, 1.0) * np.sin(phase + 2 * math.pi * rng.uniform(*WAVES) * x / width)
    y = height * np.clip(first + (last - first) * x / width + wave, 0.02, 0.98)
    return tube(np.column_stack([x, y, np.full(POINTS, radius)]), radius).painted(color, Label.STRANGER)


def reaching_arm(size: tuple[float, float], time: float, seed: int) -> Mesh | None:
    """A person's fist and forearm that reach over a table from its front, again and again; None while they do not.

    Args:
        size: Width and height of the workspace [m].
        time: From the begin on [s].
        seed: Of where they reach and when they do so first.
    """
    rng, (width, height) = np.random.default_rng(seed), size
    since = (time - rng.uniform(1.0, 3.0)) % EVERY if time >= 0 else EVERY
    target = np.array([width, height]) * rng.uniform(0.3, 0.7, 2)
    shoulder = np.array([target[0] + rng.uniform(-0.2, 0.2), -0.5])
    if since >= OVER:
        return None
    share = min(1.0, since / REACHING, (OVER - since) / REACHING)
    along = (target - shoulder) / np.linalg.norm(target - shoulder)
    fist = shoulder + share * (target - shoulder)
    ends = np.array([[fist, fist], [fist - 0.05 * along, fist - 0.6 * along]])
    ends = np.concatenate([ends, np.full((2, 2, 1), ABOVE)], axis=2)
    return capsules(ends, np.array([FIST, FOREARM])).painted(SKIN, Label.STRANGER)
