"""The equilibrium of a rod in space nearest to keypoints and to the orientations of both grippers.

Keypoints alone leave one of the twelve numbers open: how the rod is rolled about itself. Shapes between gripper poses
are `cableway.rod.inverse.equilibria_at`, as in the plane.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from cableway.core.compiled import kernel
from cableway.core.errors import InputError
from cableway.core.time_limit import checkpoint
from cableway.geometry import rotations
from cableway.rod import spatial_kernels
from cableway.rod.fitting import EXACT
from cableway.rod.inverse import meet_poses
from cableway.rod.least_squares import COST, add_row, advance, begin, clear
from cableway.rod.spatial import SpatialRod

TURN_WEIGHT = 0.2
"""Of a gripper's turn [rad] beside a keypoint's distance in lengths of the rod."""

FULL_TURNS = (0, 1, -1, 2, -2)
"""Of twist, beyond what the orientations say, that a fit starts from: orientations do not count full turns."""

NEAR = 0.05
"""Move of any point, in lengths of the rod, above which a step of the weight is too long."""

ENOUGH = 1e-9
"""Distance, in lengths of the rod, at which a fit is exact and no other start is tried."""


def fit_shape(
    rod: SpatialRod,
    keypoints: Float[np.ndarray, "n 3"],
    orientations: Float[np.ndarray, "2 4"] | None = None,
    guess: Float[np.ndarray, "12"] | None = None,
) -> tuple[Float[np.ndarray, "12"], float]:
    """The equilibrium q whose keypoints, and gripper orientations, are nearest to given ones.

    Args:
        rod: The rod; its length is kept whatever the length of `keypoints`.
        keypoints: (n, 3) [m], at equal arc length.
        orientations: (2, 4) of the grippers, unit quaternions (w, x, y, z), x along the cable; None leaves the roll of
            the rod, and with it the twist, as the first guess has them.
        guess: q to start from, before `HeldRod.guesses`.

    Returns:
        q (12,) and the stacked distance of the keypoints [m], turns counted with `TURN_WEIGHT` lengths each.

    Raises:
        InputError: A shape or a quaternion is not what it should be.
    """
    keypoints = np.array(keypoints, float)
    if keypoints.shape != (rod.keypoints, 3) or not np.isfinite(keypoints).all():
        raise InputError(f"keypoints must be finite and of shape ({rod.keypoints}, 3), got {keypoints.shape}")
    weight, wanted = 0.0, np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    if orientations is not None:
        weight, wanted = TURN_WEIGHT, unit_quaternions(orientations)
    guesses = [] if guess is None else [np.array(guess, float)]
    guesses += _twisted(rod, rod.guesses(keypoints[None])[0], None if orientations is None else wanted)
    best, least = guesses[0], math.inf
    for q in guesses:
        cost = _fit(q, keypoints, wanted, weight, *rod.arrays, rod.stride)
        if cost < least:
            best, least = q, cost
        if math.sqrt(2 * least) < ENOUGH:
            break
    return best, math.sqrt(2 * least) * rod.length


def fit_sequence(
    rod: SpatialRod,
    keypoints: Float[np.ndarray, "t n 3"],
    orientations: Float[np.ndarray, "t 2 4"] | None,
    first: Float[np.ndarray, "12"],
) -> Float[np.ndarray, "t 12"]:
    """Equilibria near one shape after the other, each found from the one before, the first one from `first`.

    Args:
        rod: The rod.
        keypoints: (t, n, 3) [m], of anything as long as the rod.
        orientations: (t, 2, 4) wanted of the grippers, unit quaternions; they count by `TURN_WEIGHT`. None leaves them
            free.
        first: (12,) q.
    """
    found, q = np.empty((len(keypoints), 12)), np.array(first, float)
    weight = 0.0 if orientations is None else TURN_WEIGHT
    wanted = np.tile([1.0, 0.0, 0.0, 0.0], (len(keypoints), 2, 1)) if orientations is None else orientations
    for row, shape, turns in zip(found, keypoints, wanted, strict=True):
        checkpoint()
        _fit(q, np.ascontiguousarray(shape), np.ascontiguousarray(turns), weight, *rod.arrays, rod.stride)
        row[:] = q
    return found


WEIGHT_STEP = 2.0
"""Steps of the weight in `under_weight`, which are halved where one fails."""

LEAST_WEIGHT_STEP = 0.02
"""Step at which one that still fails is where the shape ends."""


def under_weight(rod: SpatialRod, q: Float[np.ndarray, "12"], weight: float) -> Float[np.ndarray, "12"] | None:
    """The stable equilibrium that a shape becomes as the weight of its rod changes little by little, the grippers held.

    Args:
        rod: The rod that has the shape.
        q: (12,) a stable equilibrium of it.
        weight: The weight gamma in the end.

    Returns:
        q (12,) of `replace(rod, weight=weight)`; None where the rod bends over to another shape on the way.
    """
    poses, at, step = rod.end_poses(q[None])[0], rod.weight, WEIGHT_STEP
    keypoints = rod.at_keypoints(rod.shapes(q[None])[0])  # stations are more where a rod is heavier
    while at != weight:
        following = at + float(np.clip(weight - at, -step, step))
        changed = replace(rod, weight=following)
        met = meet_poses(changed, poses, q[None])
        found = changed.at_keypoints(changed.shapes(met)[0])
        near = len(met) and np.abs(found - keypoints).max() < NEAR * rod.length
        if near and changed.stability(met)[0][0] > 0:
            q, keypoints, at, step = met[0], found, following, 2 * step
        elif step < LEAST_WEIGHT_STEP:
            return None
        else:
            step /= 2
    return q


def unit_quaternions(rows: Float[np.ndarray, "... 4"]) -> Float[np.ndarray, "... 4"]:
    """Quaternions (w, x, y, z) as they are, once it is sure that they are rotations.

    Raises:
        InputError: One has not length 1 (within 1e-3).

    >>> unit_quaternions(np.array([1.0, 1.0, 0.0, 0.0]))
    Traceback (most recent call last):
    cableway.core.errors.InputError: a quaternion (w, x, y, z) must have length 1, got [1.0, 1.0, 0.0, 0.0]
    """
    rows = np.array(rows, float)
    sizes = np.linalg.norm(rows, axis=-1, keepdims=True)
    wrong = ~(np.abs(sizes[..., 0] - 1) < 1e-3)
    if rows.shape[-1] != 4 or wrong.any():
        raise InputError(f"a quaternion (w, x, y, z) must have length 1, got {rows[wrong][0].round(6).tolist()}")
    return rows / sizes


def _twisted(rod: SpatialRod, q: np.ndarray, wanted: np.ndarray | None) -> list[np.ndarray]:
    """Guesses that differ in roll and twist, so that the ends are turned as `wanted`, up to full turns."""
    if wanted is None:
        return [q]
    ends = rod.end_poses(q[None])[0, :, 3:]
    rolls = rotations.to_vector(rotations.product(rotations.conjugate(ends), wanted))[:, 0]
    out = []
    for turns in FULL_TURNS:
        left, right = rolls[0], rolls[1] + 2 * np.pi * turns
        turned = q.copy()
        about = rotations.from_vector(np.array([(left + right) / 2, 0.0, 0.0]))
        turned[3:6] = rotations.to_vector(rotations.product(rotations.from_vector(q[3:6]), about))
        for at in (6, 9):  # the load stays in the world
            turned[at : at + 3] = rotations.rotate(rotations.conjugate(about), q[at : at + 3])
        turned[9] += rod.twist * (right - left)
        out.append(turned)
    return sorted(out, key=lambda each: abs(each[9]))


@kernel
def _turned_by(found, wanted, out):
    """The rotation vector (3,) from one orientation to another, at most half a turn: found wanted^-1."""
    w = found[0] * wanted[0] + found[1] * wanted[1] + found[2] * wanted[2] + found[3] * wanted[3]
    spatial_kernels.cross(found[1:], wanted[1:], out)
    for k in range(3):
        out[k] = found[1 + k] * wanted[0] - found[0] * wanted[1 + k] - out[k]
    sine = math.sqrt(spatial_kernels.dot(out, out))
    factor = 2.0 * math.atan2(sine, abs(w)) / sine if sine > 1e-12 else 2.0
    for k in range(3):
        out[k] *= factor if w >= 0.0 else -factor


@kernel
def _fit(q, keypoints, wanted, weight, p, stiff, stride):
    """Move q (12,) to the nearest equilibrium, in place; half the squared distance, in squared lengths."""
    count, length = 2 * len(stiff) + 1, p[0]
    stations, dstations = np.empty((count, 3)), np.empty((count, 3, 12))
    poses, dposes = np.empty((2, 7)), np.empty((2, 6, 12))
    search, rates, turns, changes = begin(q), np.empty(12), np.empty((3, 3)), np.empty((3, 3))
    scale = np.array([length, length, length, 1.0, 1.0, 1.0, 10.0, 10.0, 10.0, 3.0, 3.0, 3.0])
    off = np.empty(3)
    while True:
        spatial_kernels.held_shape(search.trial, p, stiff, stations, dstations, poses, dposes)
        spatial_kernels.turns_of(search.trial[3:6], turns)
        clear(search)
        cost = 0.0
        for row in range(3 * len(keypoints) + 6):
            factor = 1.0 / length
            if row < 3 * len(keypoints):
                i, k = row // 3, row % 3
                residual = (stations[i * stride, k] - keypoints[i, k]) / length
                for a in range(12):
                    rates[a] = dstations[i * stride, k, a]
            else:
                side, k = (row - 3 * len(keypoints)) // 3, row % 3
                factor = weight
                if k == 0:
                    _turned_by(poses[side, 3:], wanted[side], off)
                    spatial_kernels.changes_of(off, changes)
                residual = weight * off[k]
                for a in range(12):
                    rates[a] = 0.0
                    for m in range(3):
                        rates[a] += changes[k, m] * dposes[side, 3 + m, a]
            first, second, third = rates[3], rates[4], rates[5]
            for a in range(3):  # the search changes the rotation vector
                rates[3 + a] = first * turns[0, a] + second * turns[1, a] + third * turns[2, a]
            for a in range(12):
                rates[a] *= factor * scale[a]
            add_row(search.trial_normal, search.trial_gradient, rates, residual, 1.0, 0)
            cost += residual * residual
        if not advance(search, 0.5 * cost, scale, EXACT):
            break
    q[:] = search.x
    return search.state[COST]
