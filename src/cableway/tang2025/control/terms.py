"""The terms of the horizon's cost, each as residuals whose squares are summed and halved.

A term gives its residuals and a function from the derivative of the shapes (H, n, 2, a) to that of the residuals
(m, a), a the number of unknowns; the derivative of the gripper poses by the actions is a constant. Symbols are those
of Tang et al., "Neural MPC Design".
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Float

from cableway.geometry import convex
from cableway.motion.terms import clearance_shortfall, span_excess

Term = tuple[Float[np.ndarray, "m"], Callable[[Float[np.ndarray, "H n 2 a"]], Float[np.ndarray, "m a"]]]

Profile = Literal["hinge", "barrier"]

LEAST_BARRIER_SHARE = 0.1
"""Share of the threshold below which the barrier goes on as a straight line, so that contact has a finite cost."""


def tracking(shapes: Float[np.ndarray, "H n 2"], wanted: Float[np.ndarray, "H n 2"], weight: float) -> Term:
    """lambda_1 (s - s_ref)^T (s - s_ref) / 2 at every step of the horizon."""
    root = np.sqrt(weight)
    return root * (shapes - wanted).ravel(), lambda by_actions: root * by_actions.reshape(-1, by_actions.shape[-1])


def deviation(
    values: Float[np.ndarray, "..."],
    wanted: Float[np.ndarray, "..."],
    weights: Float[np.ndarray, "..."],
    derivative: Float[np.ndarray, "... a"],
) -> Term:
    """Half the weighted squares of how far numbers, linear in the actions, are from what is wanted of them.

    With the actions themselves this is lambda_3 a^T R a / 2 of the paper.

    Note:
        The paper wants no motion; here the wanted motion is the plan's own, which the tracker then only corrects.
    """
    root = np.sqrt(np.broadcast_to(weights, values.shape)).ravel()
    rows = root[:, None] * derivative.reshape(root.size, -1)
    return root * (values - wanted).ravel(), lambda _: rows


def clearance(
    points: Float[np.ndarray, "p 2"],
    world: convex.ConvexWorld,
    radius: float,
    threshold: float,
    weight: float,
    profile: Profile,
) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k 2"], np.ndarray]:
    """Residuals of the points nearer than `threshold` to an obstacle or wall, their derivative by those points [1/m].

    With clearance phi (signed distance less `radius`) and threshold d, half the square of the residual is
    weight (d - phi)^2 / 2 for the hinge, weight (1/phi - 1/d)^2 for the barrier, both 0 from phi = d on.

    Note:
        The paper's lambda_2/phi^2 jumps at d, where this starts at 0 with slope 0, and has no value at contact and
        beyond, where this goes on as a straight line of the residual; near contact both grow alike. The paper takes
        phi from the centreline; the surface is what touches.

    Returns:
        Residuals, derivative, and the indices of the points that have one.
    """
    short, slope = clearance_shortfall(points, world, radius + threshold)
    near = np.flatnonzero(short)
    short, slope = short[near], slope[near]
    if profile == "hinge":
        root = np.sqrt(weight)
        return root * short, root * slope, near
    root, phi = np.sqrt(2 * weight), threshold - short
    clipped = np.maximum(phi, LEAST_BARRIER_SHARE * threshold)
    residual = root * (1 / clipped - 1 / threshold + (clipped - phi) / clipped**2)
    return residual, root * slope / clipped[:, None] ** 2, near


def separation(
    poses: Float[np.ndarray, "H 2 3"],
    derivative: Float[np.ndarray, "H 2 3 a"],
    least: float,
    most: Float[np.ndarray, "H"],
    weight: float,
) -> Term:
    """weight/2 times the squares of how far the distance between the grippers [m] is outside [least, most]."""
    over, slope = span_excess(poses, most, least)
    row, side = np.nonzero(over)
    root = np.sqrt(weight)
    return root * over[row, side], lambda _: root * np.einsum("kgx,kgxa->ka", slope[row, side], derivative[row])
