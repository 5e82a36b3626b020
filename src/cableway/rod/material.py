"""The material of a cable that is not quite the nominal one: another length, stiffer at one end, curved at rest, held
askew.

The estimator, the rod MPC and the rod of the learned models share these coordinates. The equilibria are those of
`cableway.rod.planar`, with the bend at hinge j ::

    phi_j = (e^{-b(u_j)} (m + a x (p_j - c)/L) + r(u_j)) / N,      b = sum_k b_k P_k,   r = sum_k r_k P_k,

u_j in (-1, 1) the place of the hinge along the rod and P_k the Legendre polynomials of degree 1 to K. b is the
logarithm of the stiffness, r the turn [rad] that the rod would have at rest, per its length. Their means are left
out: between clamped ends a uniform stiffness or rest curvature changes no shape, so neither can be estimated.

Parameters theta = (L, b_1..b_K, r_1..r_K, g_L, g_R): g = (dx, dy, dtheta) is where the end of the rod is in the frame
of the gripper that holds it, [m, m, rad].

Note:
    Not in the paper (Tang et al.), which adapts a network; these are the few numbers in which cables differ.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

from cableway.rod.held_rod import HeldRod

GRAVITY = 9.81
"""[m/s^2]."""

MODES = 4
"""K. Rest curvature that changes sign along the cable, and a stiff third, need more than a slope and a bulge; what
keypoints do not show stays at its prior."""

PARAMETERS = 1 + 2 * MODES + 6
"""Length of theta."""

LENGTH = 0
STIFFNESS = slice(1, 1 + MODES)
CURVATURE = slice(1 + MODES, 1 + 2 * MODES)
GRASPS = slice(1 + 2 * MODES, PARAMETERS)
ROD = slice(0, 1 + 2 * MODES)

NAMES = {
    "length": "m",
    **{f"stiffness mode {k}": "" for k in range(1, MODES + 1)},
    **{f"curvature mode {k}": "rad" for k in range(1, MODES + 1)},
    **{f"{side} grasp {axis}": unit for side in ("left", "right")
       for axis, unit in (("x", "m"), ("y", "m"), ("turn", "rad"))},
}  # fmt: skip
"""Names and units of theta, in its order."""


def modes(hinges: int, count: int = MODES) -> Float[np.ndarray, "K N"]:
    """P_k, k = 1 to `count`, at the hinges of a rod that has N of them, evenly spaced."""
    return modes_at((np.arange(hinges) + 0.5) / hinges, count)


def modes_at(places: Float[np.ndarray, "k"], count: int = MODES) -> Float[np.ndarray, "K k"]:
    """P_k, k = 1 to `count`, at shares (k,) of the length."""
    return np.ascontiguousarray(legendre.legvander(2 * places - 1, count)[:, 1:].T)


def nominal(rod: HeldRod) -> Float[np.ndarray, "p"]:
    """Parameters of a uniform rod held as it should be."""
    theta = np.zeros(PARAMETERS)
    theta[LENGTH] = rod.length
    return theta
