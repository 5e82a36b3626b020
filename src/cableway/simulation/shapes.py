"""What the shape of a cable looks like: kinds of shapes, and whether it crosses itself."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from cableway.geometry import polyline
from cableway.rod.planar import PlanarRod

Kind = Literal["any", "bend", "s-shape", "near-straight"]
"""What a shape looks like; "any" leaves that to chance."""

BEND_TURN = 1.0
"""Angle [rad] by which a bend turns at least, to one side but for a tenth of it."""

S_TURN = 0.5
"""Angle [rad] by which an S-shape turns at least, to each side."""

STRAIGHT_CHORD = 0.93
"""Distance of the ends, as a share of the length, from which on a shape counts as near-straight."""


def kinds_of(rod: PlanarRod, q: Float[np.ndarray, "6"]) -> set[Kind]:
    """Which kinds of shape the equilibrium q is of; one that lies between them is of none but "any"."""
    stations = rod.shapes(q[None])[0][:, ::2]
    bends = _bends(stations)[0]
    turns = sorted((float(np.maximum(bends, 0).sum()), float(np.maximum(-bends, 0).sum())))
    chord = float(np.linalg.norm(stations[0, -1] - stations[0, 0]))
    found: set[Kind] = {"any"}
    if turns[1] >= BEND_TURN and turns[0] <= 0.1 * turns[1]:
        found.add("bend")
    if turns[0] >= S_TURN:
        found.add("s-shape")
    if chord >= STRAIGHT_CHORD * rod.length:
        found.add("near-straight")
    return found


def _bends(lines: Float[np.ndarray, "t v 2"]) -> Float[np.ndarray, "t v-2"]:
    """Angles [rad] between successive segments of polylines."""
    steps = np.diff(lines, axis=1)
    bends = np.diff(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
    return bends - 2 * np.pi * np.round(bends / (2 * np.pi))


def self_crossings(lines: Float[np.ndarray, "t v 2"]) -> Bool[np.ndarray, "t"]:
    """Which polylines cross themselves."""
    turned = np.cumsum(_bends(lines), axis=1)
    spread = np.maximum(turned.max(axis=1), 0) - np.minimum(turned.min(axis=1), 0)
    found = spread >= np.pi  # one whose directions lie within half a turn goes forward all along
    found[found] = polyline.cross_themselves(lines[found])
    return found
