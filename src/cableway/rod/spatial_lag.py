"""How far a rod in space with damping trails behind its equilibria while its grippers move.

As in the plane (`cableway.rod.lag`), but links turn in three ways. With moments D (phi + tau dphi/dt) at hinges, where
D = N diag(kappa, 1, 1) along and across the rod, the links of a rod that is led slowly are turned away from the
equilibrium by d, where on the changes that hold the ends (C d = 0) ::

    H d = -tau K_0 omega

omega are the angular velocities of the links, their roll included: a bent cable that rolls about itself bends and
unbends. K_0 couples neighbours by D; H has besides what the moment m in a hinge and the force n in a link do, ::

    d' H d = sum D (d' - d).(d' - d) + m.(d' x d) + sum h (n.t (d.d) - (n.d) (t.d))

with d and d' of the links before and after the hinge.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import rotations
from cableway.rod.spatial import SpatialRod

X = np.array([1.0, 0.0, 0.0])


def spatial_lag(rod: SpatialRod, q: Float[np.ndarray, "t 12"]) -> Float[np.ndarray, "t-1"]:
    """Largest distance [m] of a hinge to its equilibrium when each step between rows lasts as long as tau.

    In steps of another duration it is tau over that times as much, up to the time it takes to build up.
    """
    carried = frames(rod, q)
    steps = rotations.product(carried[1:], rotations.conjugate(carried[:-1]))
    turned = rotations.to_vector(np.where(steps[..., :1] < 0, -steps, steps))
    hessian, damping, closure = matrices(rod, q[:-1], carried[:-1])
    rows, links = turned.shape[:2]
    load = -np.einsum("tij,tj->ti", damping, turned.reshape(rows, -1))
    free = 3 * (links - 2)
    matrix = np.zeros((rows, free + 3, free + 3))
    matrix[:, :free, :free] = hessian[:, 3:-3, 3:-3]
    matrix[:, :free, free:] = closure[:, 3:-3]
    matrix[:, free:, :free] = closure[:, 3:-3].swapaxes(1, 2)
    matrix[:, range(free, free + 3), range(free, free + 3)] = -1e-9  # a straight rod holds its ends in two ways only
    away = np.linalg.solve(matrix, np.pad(load[:, 3:-3], ((0, 0), (0, 3)))[..., None])[:, :free]
    moved = np.cumsum(closure[:, 3:-3].reshape(rows, links - 2, 3, 3) * away.reshape(rows, -1, 3, 1), axis=1)
    return rod.length * np.linalg.norm(moved.sum(axis=2), axis=2).max(axis=1)


def matrices(
    rod: SpatialRod, q: Float[np.ndarray, "t 12"], carried: Float[np.ndarray, "t links 4"]
) -> tuple[Float[np.ndarray, "t m m"], Float[np.ndarray, "t m m"], Float[np.ndarray, "t m 3"]]:
    """H, K_0 and C by turns of all links about the world's axes, those in the grippers included."""
    rows, links, count = len(q), carried.shape[1], rod.hinges
    tangents, share = rotations.rotate(carried, X), np.full(links, 1 / count)
    share[[0, -1]] /= 2
    before, after, every = np.arange(count), np.arange(1, links), np.arange(links)
    t, u = tangents[:, :-1], tangents[:, 1:]
    along = (t + u) / np.linalg.norm(t + u, axis=2, keepdims=True)
    bend = 2 * np.cross(t, u) / (1 + np.sum(t * u, axis=2, keepdims=True))
    bending = rod.stiffness[:, None]
    moment = bending * bend + q[:, None, 9:10] * along
    beyond = (rod.twist * (count / bending) - 1)[..., None]
    stiff = bending[..., None] * (np.eye(3) + beyond * along[..., :, None] * along[..., None, :])
    damping = np.zeros((rows, links, 3, links, 3))
    for a, b, sign in ((before, before, 1), (after, after, 1), (before, after, -1), (after, before, -1)):
        damping[:, a, :, b] += sign * stiff.swapaxes(0, 1)
    centre = rotations.rotate(rotations.from_vector(q[:, None, 3:6]), np.eye(3))
    heights = (every - count // 2) / count
    force = np.einsum("tk,tkx->tx", q[:, 6:9], centre)[:, None] + rod.weight * heights[:, None] * [0.0, 0.0, 1.0]
    pulled = force[..., :, None] * tangents[..., None, :]
    tension = np.sum(force * tangents, axis=2)[..., None, None]
    hessian, turning = damping.copy(), _crossed(moment).swapaxes(0, 1) / 2
    hessian[:, before, :, after] -= turning
    hessian[:, after, :, before] += turning
    pull = share[:, None, None] * (tension * np.eye(3) - (pulled + pulled.swapaxes(2, 3)) / 2)
    hessian[:, every, :, every] += pull.swapaxes(0, 1)
    closure, size = -_crossed(share[:, None] * tangents), 3 * links
    return hessian.reshape(rows, size, size), damping.reshape(rows, size, size), closure.reshape(rows, size, 3)


def _crossed(a: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3 3"]:
    """The matrices with x . A y = a . (x x y)."""
    out = np.zeros((*a.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i, j], out[..., j, i] = a[..., k], -a[..., k]
    return out


def frames(rod: SpatialRod, q: Float[np.ndarray, "t 12"]) -> Float[np.ndarray, "t links 4"]:
    """Orientations of all links, those in the grippers included, carried from the left one and twisted evenly."""
    stations, poses = rod.shapes(q)
    corners = np.concatenate([stations[:, :1], stations[:, 1::2], stations[:, -1:]], axis=1)
    tangents = np.diff(corners, axis=1)
    tangents /= np.linalg.norm(tangents, axis=2, keepdims=True)
    found = [poses[:, 0, 3:]]
    twist = q[:, 9:10] / rod.twist / rod.hinges
    for link in range(1, tangents.shape[1]):
        onward = rotations.least_turn(tangents[:, link - 1], tangents[:, link])
        found.append(rotations.product(rotations.product(onward, found[-1]), rotations.from_vector(twist * X)))
    return np.stack(found, axis=1)
