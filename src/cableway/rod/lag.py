"""How far a rod with bending damping trails behind its equilibria while its grippers move.

With bending moments EI (phi + tau dphi/dt) the link angles of a rod that is led slowly are those of the equilibrium
plus d, where on the changes that keep the ends in place (C d = 0) ::

    K d = -tau K_0 dtheta/dt,      K_0 = N^2 tridiag(-k_i, k_i + k_{i+1}, -k_{i+1}),      K = K_0 + diag(a . e_i)

(`cableway.rod.planar` has the symbols; k_j are the factors on the stiffness of the hinges, 1 for a uniform rod). A rod
near a fold, where K is nearly singular, trails far behind.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import se2
from cableway.rod.planar import PlanarRod


def lag(rod: PlanarRod, q: Float[np.ndarray, "t 6"]) -> Float[np.ndarray, "t-1"]:
    """Largest distance [m] of a hinge to its equilibrium when each step between rows lasts as long as tau.

    In steps of another duration it is tau over that times as much, up to the time it takes to build up.
    """
    stations, poses = rod.shapes(q)
    links = _links(stations)
    angles = np.column_stack([poses[:, 0, 2], np.arctan2(links[..., 1], links[..., 0]), poses[:, 1, 2]])
    bends = rod.bending[0] * np.diff(se2.wrap_angle(np.diff(angles, axis=0)), axis=1)
    moment = -(rod.hinges**2) * np.diff(bends, axis=1)
    middle = (q[:-1] + q[1:]) / 2
    along = _links(rod.shapes(middle)[0]) / (rod.length / rod.hinges)
    solved = np.linalg.solve(_border(rod, middle, along), np.pad(moment, ((0, 0), (0, 2)))[..., None])[:, :-2, 0]
    across = np.stack([-along[..., 1], along[..., 0]], axis=2) * rod.length / rod.hinges
    return np.linalg.norm(np.cumsum(solved[..., None] * across, axis=1), axis=2).max(1)


def _links(stations: Float[np.ndarray, "t s 2"]) -> Float[np.ndarray, "t l 2"]:
    """The links between the first and the last hinge."""
    return np.diff(stations[:, 1::2], axis=1)


def _border(rod: PlanarRod, q: np.ndarray, along: np.ndarray) -> np.ndarray:
    """[[K, C'], [C, 0]] (t, N + 1, N + 1), softened by next to nothing where C has one row only (a straight rod)."""
    free, square = rod.hinges - 1, rod.hinges**2
    c, s = np.cos(q[:, 2]), np.sin(q[:, 2])
    load = np.stack([c * q[:, 3] - s * q[:, 4], s * q[:, 3] + c * q[:, 4]], axis=1)
    out = np.zeros((len(q), free + 2, free + 2))
    stiffness = square * rod.bending[0]
    beside = np.diag(stiffness[1:-1], k=1)
    out[:, :free, :free] = np.diag(stiffness[:-1] + stiffness[1:]) - beside - beside.T
    out[:, range(free), range(free)] += np.einsum("tik,tk->ti", along, load)
    out[:, :free, free], out[:, :free, free + 1] = -along[..., 1], along[..., 0]
    out[:, free:, :free] = out[:, :free, free:].swapaxes(1, 2)
    out[:, range(free, free + 2), range(free, free + 2)] = -1e-9
    return out
