"""Where something holds a cable that lies still: one force at a point of a rod that both grippers hold.

The rod is the chain of hinges of `cableway.rod.planar`, between gripper poses: link angles phi_1..phi_(N-1) that make
its energy least under a force at the middle of one link, found by Newton's method with the reaction of the right
gripper as a multiplier. Two numbers, the force, explain all keypoints, once for each link at which the contact may be,
and six more what the grasps are off.

Note:
    Not in the paper (Tang et al.), whose scenes are known.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cableway.geometry import polyline, se2
from cableway.geometry.groups import SE2
from cableway.rod.inverse import fit_keypoints
from cableway.rod.least_squares import Rule, advance, begin
from cableway.rod.planar import PlanarRod

NOISE = 0.0015
"""Standard deviation [m] of a keypoint of a cable at rest: noise of 2 mm in five frames, and what else differs."""

GRASP = np.array([5e-4, 5e-4, 0.02])
"""The same [m, m, rad] of a cable's end in its gripper."""

FORCE = 1000.0
"""The same of a force, in EI/L^2: 11 N on a cable of 0.3 m and 0.001 N m^2. Larger ones only fold it at a point."""

LARGEST = 3.0
"""Mean square of the residuals, in such deviations, up to which one contact explains what is seen."""

NEEDED = 0.25
"""Share of the squared residuals without any contact that one may leave."""

TOGETHER = 2.0
"""Keypoints that are off together, where a cable is not quite the rod, and count as one."""

LEAST_SPREAD = 0.1
"""Least mean square of the best contact's residuals, in such deviations: keypoints are known to 0.5 mm at best."""

LEAST_SHARE = 0.55
"""Probability of a place from which the contact may be there, over that of each if all were as likely."""

RULE = Rule(first=1e-3, least=1e-9, restart=1e-3, fall=1e-4, trials=30.0)
"""Of a fit; one of a few newtons takes ten."""

LEAST_KEYPOINTS = 3
"""Of a rod."""

FORCE_UNIT = 10.0
"""In which the search counts a force, in EI/L^2."""

EXACT, ITERATIONS, LARGEST_TURN = 1e-8, 25, 0.3
"""Of Newton's method: residual in EI/L at which it ends, steps at most, and what a link turns in one [rad]."""

LEAST_PART = 1 / 8
"""Of the way to other grippers and another force: where it cannot be led that far at once, the chain has no shape."""


def contacts_on(
    rod: PlanarRod, keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"]
) -> list[tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]]:
    """Where something may hold a cable: points of its centreline [m], and the directions of the force (unit vectors).

    One contact is at one of them, the likeliest first; they are half as far apart as keypoints, from the second to the
    last but one. None where no single contact explains the keypoints, or none is needed.

    Args:
        rod: Its length is that of the cable.
        keypoints: (n, 2) of the cable at rest [m].
        poses: (2, 3) of the grippers [m, m, rad].
    """
    chain = _Chain(rod)
    free = chain.fitted(chain.of_rod(fit_keypoints(rod, keypoints)[0]), keypoints, poses, None)
    tried = _at_each_link(chain, keypoints, poses)
    costs = np.array([fit.cost for fit in tried])
    explained = costs.min() <= min(LARGEST * keypoints.size, NEEDED * free.cost)
    if not explained or free.cost <= LEAST_SPREAD * keypoints.size:
        return []
    spread = max(TOGETHER * float(costs.min()) / keypoints.size, LEAST_SPREAD)
    shares = np.exp((costs.min() - costs) / (2 * spread))
    shares /= shares.sum()
    likely = [tried[k] for k in np.argsort(-shares) if shares[k] > LEAST_SHARE / len(shares)]
    return [(fit.place, fit.state.force / np.linalg.norm(fit.state.force)) for fit in likely]


def _at_each_link(chain: _Chain, keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"]) -> list[_Fit]:
    """The best contact at each link between the outermost keypoints.

    Started from the parts on either side as they are seen; then, there and back, from the contact at the link before.
    """
    outermost = int(chain.keypoints[1])
    links = range(outermost, chain.hinges - outermost + 1, max(1, outermost // 2))
    fits = [chain.fitted(chain.of_parts(keypoints, poses, link), keypoints, poses, link) for link in links]
    there = range(1, len(fits))
    for k, before in (*((k, k - 1) for k in there), *((k - 1, k) for k in reversed(there))):
        if np.isfinite(fits[before].cost):
            again = chain.fitted(fits[before].state, keypoints, poses, links[k])
            fits[k] = min(fits[k], again, key=lambda fit: fit.cost)
    return fits


class _State(NamedTuple):
    """A chain that rests: link angles (N+1,), reaction (2,) and force (2,), in EI/L^2, and gripper poses (2, 3), in
    lengths.
    """

    angles: Float[np.ndarray, "m"]
    reaction: Float[np.ndarray, "2"]
    force: Float[np.ndarray, "2"]
    poses: Float[np.ndarray, "2 3"]


class _Tangent(NamedTuple):
    """What the derivatives of a chain at rest are made of.

    Attributes:
        system: Of the free angles and the reaction, symmetric.
        stiffness: Second derivative of the energy by all angles.
        across: (m, 2) derivative of each link's vector by its angle.
    """

    system: Float[np.ndarray, "m m"]
    stiffness: Float[np.ndarray, "m m"]
    across: Float[np.ndarray, "m 2"]


class _Fit(NamedTuple):
    """Squared residuals of the best force at a link, where that is [m], and the chain."""

    cost: float
    place: Float[np.ndarray, "2"]
    state: _State


class _Chain:
    """The links of a rod, in units of its length and of EI/L."""

    def __init__(self, rod: PlanarRod) -> None:
        hinges, (factor, turn) = rod.hinges, rod.bending
        self.rod, self.hinges = rod, hinges
        self.keypoints = np.arange(0, hinges + 1, hinges // (rod.keypoints - 1))
        self.lengths = np.full(hinges + 1, 1 / hinges)
        self.lengths[[0, -1]] /= 2
        # row i: which share of each link lies before the station in the middle of link i, or at an end
        self.before = np.tril(np.ones((hinges + 1, hinges + 1)), -1) + np.eye(hinges + 1) / 2
        self.before[0], self.before[-1] = 0.0, 1.0
        steps = np.diff(np.eye(hinges + 1), axis=0)
        self.bending = hinges * steps.T @ (factor[:, None] * steps)
        self.preload = steps.T @ (factor * turn)

    def of_rod(self, q: Float[np.ndarray, "6"]) -> _State:
        """The rod with these coordinates."""
        (stations,), (poses,) = self.rod.shapes(q[None])
        links = np.diff(np.concatenate([stations[:1], stations[1::2], stations[-1:]]), axis=0)
        angles = np.unwrap(np.arctan2(links[:, 1], links[:, 0]))
        return _State(angles, se2.rotation(q[2]) @ q[3:5], np.zeros(2), self._scaled(poses))

    def of_parts(self, keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"], link: int) -> _State:
        """The links as they are seen, under the forces of two rods fitted to either side of a link."""
        seen = polyline.spline(keypoints, int(self.keypoints[1]))
        along, forces = np.gradient(seen, axis=0), []
        for part in (seen[: link + 1], seen[link:]):
            share = (len(part) - 1) / self.hinges
            part = part if len(part) >= LEAST_KEYPOINTS else np.stack([part[0], part.mean(axis=0), part[1]])
            q = fit_keypoints(PlanarRod(share * self.rod.length, len(part)), part)[0]
            forces.append(se2.rotation(q[2]) @ q[3:5] / share**2)
        angles = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
        return _State(angles, forces[1], forces[0] - forces[1], self._scaled(poses))

    def fitted(
        self, start: _State, keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"], link: int | None
    ) -> _Fit:
        """The force at a link, none where that is None, and the grasps that explain keypoints [m] best.

        Args:
            start: Nearly a chain at rest, from which the search begins, with its force.
            keypoints: (n, 2) [m].
            poses: (2, 3) of the grippers [m, m, rad].
            link: At whose middle the force is.
        """
        size, forces = self.rod.length, 0 if link is None else 2
        deviations = np.array([*np.full(forces, FORCE / FORCE_UNIT), *np.ones(6)])
        units = np.array([*np.full(forces, FORCE_UNIT), *np.tile(GRASP / [size, size, 1.0], 2)])
        held, best = self._scaled(poses), start
        search, cost = begin(np.concatenate([start.force[:forces] / FORCE_UNIT, np.zeros(6)])), np.inf
        while True:
            x = search.trial * units
            force = x[:2] if forces else np.zeros(2)
            trial = np.inf
            with suppress(np.linalg.LinAlgError):  # a straight chain is no start, nor where one ends
                if found := self._led(best, held + x[forces:].reshape(2, 3), force, link or 0):
                    state, tangent = found
                    off = (self._stations(state, self.keypoints) - keypoints / size).ravel() * size / NOISE
                    slope = self._slope(tangent, link).reshape(off.size, -1) * units * size / NOISE
                    prior = search.trial / deviations
                    trial = float(off @ off + prior @ prior)
                    search.trial_normal[:] = slope.T @ slope + np.diag(deviations**-2.0)
                    search.trial_gradient[:] = slope.T @ off + prior / deviations
                    if trial < cost:
                        cost, best = trial, state
            if not advance(search, 0.5 * trial, np.ones(forces + 6), RULE):
                break
        return _Fit(cost, size * self._stations(best, np.array([link or 0]))[0], best)

    def _scaled(self, poses: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 3"]:
        return poses / [self.rod.length, self.rod.length, 1.0]

    def _stations(self, state: _State, links: Int[np.ndarray, "k"]) -> Float[np.ndarray, "k 2"]:
        """Middles of links, or the ends."""
        return state.poses[0, :2] + self.before[links] @ (self.lengths[:, None] * _along(state.angles))

    def _slope(self, tangent: _Tangent, link: int | None) -> Float[np.ndarray, "n 2 u"]:
        """Derivative of the keypoints by the force, if there is one, and both gripper poses."""
        system, stiffness, across = tangent
        free = self.hinges - 1
        loads = np.zeros((free + 2, 8))
        loads[:free, :2] = 0.0 if link is None else (self.before[link][:, None] * across)[1:-1]
        loads[free:, 2:4], loads[free:, 5:7] = np.eye(2), -np.eye(2)
        for column, end in ((4, 0), (7, -1)):
            loads[:free, column], loads[free:, column] = -stiffness[1:-1, end], across[end]
        turned = np.zeros((self.hinges + 1, 8))
        turned[1:-1] = np.linalg.solve(system, loads)[:free]
        turned[0, 4] = turned[-1, 7] = 1.0
        slope = np.einsum("kj,jc,jx->kcx", self.before[self.keypoints], across, turned)
        slope[..., 2:4] += np.eye(2)
        return slope if link is not None else slope[..., 2:]

    def _led(
        self, state: _State, poses: Float[np.ndarray, "2 3"], force: Float[np.ndarray, "2"], link: int
    ) -> tuple[_State, _Tangent] | None:
        """The chain under other grippers and another force at a link; None where it has no shape near that it had.

        Led there in parts, where that is needed.
        """
        begun, share, part = state, 0.0, 1.0
        found = None
        while share < 1.0:
            to = min(1.0, share + part)
            there = begun.poses + to * SE2.minus(poses, begun.poses)
            tried = self._at_rest(state, there, begun.force + to * (force - begun.force), link)
            if tried is None:
                part /= 2
                if part < LEAST_PART:
                    return None
            else:
                found, state, share, part = tried, tried[0], to, 2 * part
        return found

    def _at_rest(
        self, state: _State, poses: Float[np.ndarray, "2 3"], force: Float[np.ndarray, "2"], link: int
    ) -> tuple[_State, _Tangent] | None:
        """By Newton's method from another chain at rest; None where that does not get there.

        Raises:
            LinAlgError: The chain is straight: no turn of a link brings its ends nearer or farther.
        """
        angles, reaction, free = state.angles.copy(), state.reaction.copy(), self.hinges - 1
        angles[[0, -1]] += se2.wrap_angle(poses[:, 2] - angles[[0, -1]])
        for _ in range(ITERATIONS):
            along = self.lengths[:, None] * _along(angles)
            across = np.column_stack([-along[:, 1], along[:, 0]])
            carried = reaction + self.before[link][:, None] * force
            unbalanced = self.bending @ angles - self.preload - np.sum(carried * across, axis=1)
            gap = poses[0, :2] + along.sum(axis=0) - poses[1, :2]
            stiffness = self.bending + np.diag(np.sum(carried * along, axis=1))
            system = np.zeros((free + 2, free + 2))
            system[:free, :free] = stiffness[1:-1, 1:-1]
            system[:free, free:], system[free:, :free] = -across[1:-1], -across[1:-1].T
            left = np.concatenate([unbalanced[1:-1], -gap])
            if np.abs(left).max() < EXACT:
                return _State(angles, reaction, force, poses), _Tangent(system, stiffness, across)
            step = np.linalg.solve(system, -left)
            step *= LARGEST_TURN / max(LARGEST_TURN, np.abs(step[:free]).max())
            angles[1:-1] += step[:free]
            reaction += step[free:]
        return None


def _along(angles: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m 2"]:
    """Unit vectors."""
    return np.column_stack([np.cos(angles), np.sin(angles)])
