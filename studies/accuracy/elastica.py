"""The continuous planar elastica between clamped ends: the reference, which shares nothing with the package.

In units of the length L, with angle theta, curvature kappa and force f = F L^2/EI, constant along the rod:

    x' = cos(theta)   y' = sin(theta)   theta' = kappa   kappa' = f_x sin(theta) - f_y cos(theta)

(Love, "A treatise on the mathematical theory of elasticity", section 262). The six end conditions fix x, y, theta,
kappa and f. It is solved by collocation to a relative residual of 1e-6.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipj, ellipk

MESH = 61
"""Points of the first mesh."""

RESIDUAL = 1e-6
"""Relative residual that is asked for; the keypoints change by less than 1e-7 L below it."""


def clamped_shape(
    length: float, poses: Float[np.ndarray, "2 3"], near: Float[np.ndarray, "v 2"], keypoints: int
) -> tuple[Float[np.ndarray, "n 2"], float]:
    """The elastica that grippers at `poses` hold.

    Args:
        length: L [m].
        poses: (2, 3) gripper poses (x, y, theta) [m, m, rad]; their difference in angle is the rod's turn.
        near: A polyline [m] of the shape wanted, where the grippers allow several; the first guess.
        keypoints: Number of points wanted.

    Returns:
        Points at equal arc length [m], both ends included, and the radius of the sharpest bend [m].

    Raises:
        RuntimeError: The collocation did not converge.
    """
    left, right = poses
    turn = _rotation(left[2])
    end = np.array([*((right[:2] - left[:2]) @ turn / length), right[2] - left[2]])
    s = np.linspace(0, 1, MESH)
    guess, force = _first_guess(s, (near - left[:2]) @ turn / length, end[2])

    def ends(a: np.ndarray, b: np.ndarray, f: np.ndarray) -> np.ndarray:
        return np.concatenate([a[:3], b[:3] - end])

    found = solve_bvp(_slopes, ends, s, guess, p=force, tol=RESIDUAL, max_nodes=20_000)
    if not found.success:
        raise RuntimeError(f"no elastica between {poses.tolist()}: {found.message}")
    points = found.sol(np.linspace(0, 1, keypoints))[:2].T
    return left[:2] + length * points @ turn.T, length / float(np.abs(found.y[3]).max())


def _rotation(angle: float) -> Float[np.ndarray, "2 2"]:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _slopes(s: np.ndarray, y: np.ndarray, f: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(y[2]), np.sin(y[2])
    return np.stack([cos, sin, y[3], f[0] * sin - f[1] * cos])


def _first_guess(s: np.ndarray, near: np.ndarray, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """State (4, len(s)) and force (2,) from a polyline that starts at the origin along x and turns by `turn`."""
    steps = np.diff(near, axis=0)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    arc /= arc[-1]
    angles = np.unwrap([0.0, *np.arctan2(steps[:, 1], steps[:, 0]), turn])[:-1]
    theta = np.interp(s, [0.0, *(arc[1:] + arc[:-1]) / 2, 1.0], [*angles, turn])
    kappa = np.gradient(theta, s)
    x, y = (np.interp(s, arc, near[:, axis]) for axis in (0, 1))
    # kappa = kappa_0 + f_x y - f_y x
    force = np.linalg.lstsq(np.column_stack([np.ones_like(s), y, -x]), kappa, rcond=None)[0][1:]
    return np.stack([x, y, theta, kappa]), force


def pushed_together(shortening: float, points: int) -> Float[np.ndarray, "points 2"]:
    """The closed form for parallel ends on one line, pushed together by `shortening` L; L = 1, bent to the left.

    With the complete integrals K, E of the modulus k for which 2 (1 - E/K) is the shortening, at the arc length s and
    u = 4 K s: theta = 2 asin(k sn u), x = (2 E(am u) - u)/(4 K), y = 2 k (1 - cn u)/(4 K).
    """
    k = float(brentq(lambda k: 2 * (1 - ellipe(k * k) / ellipk(k * k)) - shortening, 1e-6, 0.999_999))
    whole = float(ellipk(k * k))
    u = 4 * whole * np.linspace(0, 1, points)
    cn, amplitude = ellipj(u, k * k)[1], ellipj(u, k * k)[3]
    return np.column_stack([2 * ellipeinc(amplitude, k * k) - u, 2 * k * (1 - cn)]) / (4 * whole)
