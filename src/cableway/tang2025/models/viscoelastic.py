"""One control step of a planar visco-elastic rod between two grippers, differentiable and without any linear algebra
beyond 3 x 3.

The rod is the chain of `cableway.rod.planar` in units of its length: N hinges at spacing 1/N between N + 1
links, the first and last half as long. Its bends phi_j relax towards those of an equilibrium:

    phi_j + tau dphi_j/dt = u_j,      u_j = r_j + (m + a x (p_j - c)) / (N e_j),

with r_j the bend at rest, e_j the relative stiffness, and (a, m) the load that keeps the ends in the grippers. Mass
is left out: at tau = 0.1 s it answers fifty times faster than the bends relax.

Over a step h in which the grippers move evenly u is taken to change evenly, from u0 to u1, so

    phi(h) = g phi(0) + w0 u0 + w1 u1,   g = exp(-h/tau),   w1 = 1 - (1 - g) tau/h,   w0 = 1 - g - w1.

u0 follows from the speed of the grippers, three linear equations for the load. u1 depends on the shape at the end of
the step; going outward from the centre each bend needs only points already placed, so three unknowns are left, which
Newton's method finds. Its derivative is that of the last iteration alone (implicit function theorem).

The bends at the start come from the keypoints: the smoothest bends that give the directions of their chords. What
the nearest equilibrium leaves of them, d_j = phi_j - r_j - (m + a x (p_j - c)) / (N e_j), is lag where it is small and
the cable's own shape where it is large: a share of it is added to the bend at rest,

    r_j + KEPT d_j / (1 + (LAG / d)^8),      d^2 = N sum_j d_j^2.

Note:
    Not in the paper (Tang et al.).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cableway.rod.material import modes
from cableway.rod.planar import hinge_count
from cableway.scene.task import CONTROL_STEP

ITERATIONS = 4
"""Newton's iterations before the last, differentiable one."""

LONGEST_UPDATE = 20.0
"""Largest change of the load in one iteration; equilibria worth having have loads below 100."""

DAMPING = 1e-6
"""Added to the diagonal of the 3 x 3 normal equations: a straight rod's ends cannot be pulled apart by any load."""

LOAD_SCALE = (30.0, 30.0, 1.0)
"""Brings the derivatives of the ends by (a_x, a_y, m) to one size."""


LAG = 0.3
"""Size d of what an equilibrium leaves of the bends, rms curvature times length, above which it is not lag. One in
a hundred transitions of the nominal cable has more than 0.08; of cables of another simulator, 0.3 to 0.7 m long, half
have more than 0.4 to 1.2."""

KEPT = 0.95
"""Share that stays, so that at tau 0.11 s half is lost in 24 steps: what an uneven stiffness leaves is not the same for
long."""

MODES = 2
"""Of stiffness and rest curvature each."""


class Material(NamedTuple):
    """What a step depends on besides shape and motion.

    Attributes:
        relaxation: tau over the duration of the step.
        stiffness: (N,) relative stiffness e of each hinge.
        rest: (N,) bend of each hinge at rest [rad].
        grasp: (2,) direction of the cable's ends against the grippers' [rad].
        kept: Largest share that stays of what an equilibrium leaves of the bends.
    """

    relaxation: Float[Array, ""]
    stiffness: Float[Array, "N"]
    rest: Float[Array, "N"]
    grasp: Float[Array, "2"]
    kept: float


class RodParameters(eqx.Module):
    """What the motion of a cable between two grippers shows of its material; all 0 for the nominal cable.

    Stiffness and rest curvature are those of `cableway.rod.material`. The length is read from the keypoints in every
    step.

    Attributes:
        damping: Logarithm of tau over the control step of 0.1 s.
        stiffness: (b_1, b_2), modes of the logarithm of the stiffness.
        rest: (r_1, r_2), modes of the turn at rest [rad].
        grasp: Direction of the cable's ends against the grippers' [rad], left then right.
        kept: See `Material`; not learned.
    """

    damping: Float[Array, ""]
    stiffness: Float[Array, "K"]
    rest: Float[Array, "K"]
    grasp: Float[Array, "2"]
    kept: float = eqx.field(static=True)

    def __init__(self, damping_time: float = CONTROL_STEP, *, kept: float = KEPT) -> None:
        self.kept = kept
        self.damping = jnp.asarray(np.log(damping_time / CONTROL_STEP), jnp.float32)
        self.stiffness, self.rest, self.grasp = jnp.zeros(MODES), jnp.zeros(MODES), jnp.zeros(2)

    def __call__(
        self, keypoints: Float[Array, "n 2"], poses: Float[Array, "2 3"], action: Float[Array, "2 3"]
    ) -> Float[Array, "n 2"]:
        """Displacement [m] of the keypoints in one control step."""
        return rod_step(self.material(chain_hinges(len(keypoints))), keypoints, poses, action)

    def material(self, hinges: int) -> Material:
        """The material of a chain."""
        shapes = jnp.asarray(modes(hinges, MODES), jnp.float32)
        return Material(
            relaxation=jnp.exp(self.damping),
            stiffness=jnp.exp(self.stiffness @ shapes),
            rest=self.rest @ shapes / hinges,
            grasp=self.grasp,
            kept=self.kept,
        )

    def keeping_nothing(self) -> RodParameters:
        """The same rod, whose parameters alone have to explain the bends."""
        return jax.tree.unflatten(jax.tree.structure(RodParameters(kept=0.0)), jax.tree.leaves(self))


def chain_hinges(keypoints: int) -> int:
    """Number N of hinges, at least two for each chord: with one the chords would say more than there are links."""
    return max(hinge_count(keypoints), 2 * (keypoints - 1))


def rod_step(
    material: Material, keypoints: Float[Array, "n 2"], poses: Float[Array, "2 3"], action: Float[Array, "2 3"]
) -> Float[Array, "n 2"]:
    """Displacement of the keypoints, in their unit of length.

    The ends move exactly with the grippers: what Newton's method leaves at the right end, near a straight rod or a
    fold, is spread along the cable.
    """
    stride = chain_hinges(len(keypoints)) // (len(keypoints) - 1)
    angles = link_angles(keypoints, poses[:, 2] + material.grasp)
    before = positions(angles)
    length = _polyline_length(keypoints) / _polyline_length(before[::stride])
    motion = action / jnp.array([[length, length, 1.0]])
    bends = jnp.diff(angles)
    load, left = _explained(material, bends, before, angles)
    material = material._replace(rest=material.rest + material.kept * _not_lag(left) * left)
    start = _starting_bends(material, angles, before, motion)
    kept, weight = _relaxation(material.relaxation)
    offset = kept * bends + (1.0 - kept - weight) * start + weight * material.rest
    compliance = weight / (material.stiffness * len(bends))
    goal = _closure(
        before[-1] - before[0] + motion[1, :2] - motion[0, :2],
        angles[0] + motion[0, 2],
        angles[-1] - angles[0] + motion[1, 2] - motion[0, 2],
    )
    load = _load(offset, compliance, goal, load)
    shape, end_angles = _outward(load, offset, compliance)
    turn = angles[0] + motion[0, 2] - end_angles[0]
    after = (before[0] + motion[0, :2])[None] + _turned(shape - shape[:1], turn)
    missed = before[-1] + motion[1, :2] - after[-1]
    after = after + jnp.linspace(0.0, 1.0, len(after))[:, None] ** 2 * missed[None]
    return length * (after - before)[::stride]


def link_angles(keypoints: Float[Array, "n 2"], ends: Float[Array, "2"]) -> Float[Array, "l"]:
    """Angles [rad] of the links, running on without jumps, of the smoothest chain through the chords' directions.

    Args:
        keypoints: (n, 2).
        ends: Angles of the first and last link, up to full turns.
    """
    chords = keypoints[1:] - keypoints[:-1]
    directions = jnp.concatenate([_unit(ends[:1]), chords, _unit(ends[1:])])
    here, there = directions[:-1], directions[1:]
    turns = jnp.arctan2(here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0], jnp.sum(here * there, axis=1))
    wanted = jnp.concatenate([jnp.zeros(1), jnp.cumsum(turns)])
    matrix = jnp.asarray(_smoothing(len(keypoints)))
    angles = matrix @ wanted
    stride = (len(angles) - 1) // (len(keypoints) - 1)
    drawn = jnp.diff(positions(angles)[::stride], axis=0)
    plain = wanted[1:-1]
    c, s = jnp.cos(plain), jnp.sin(plain)
    bowed = jnp.arctan2(c * drawn[:, 1] - s * drawn[:, 0], c * drawn[:, 0] + s * drawn[:, 1])
    return ends[0] + angles - matrix[:, 1:-1] @ bowed


def positions(angles: Float[Array, "l"]) -> Float[Array, "l 2"]:
    """Middles of the links, and the two ends in place of those of the half links; the first at the origin."""
    half = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1) / (2 * (len(angles) - 1))
    return jnp.concatenate([jnp.zeros((1, 2)), jnp.cumsum(half[1:] + half[:-1], axis=0)])


@lru_cache
def _smoothing(count: int) -> Float[np.ndarray, "l m"]:
    """Link angles from (first link, chords, last link): least third differences, directions met to first order."""
    hinges = chain_hinges(count)
    stride, links = hinges // (count - 1), hinges + 1
    given = np.zeros((count + 1, links))
    given[0, 0] = given[-1, -1] = 1.0
    weights = np.array([0.5, *np.ones(stride - 1), 0.5]) / stride
    for chord in range(count - 1):
        given[chord + 1, chord * stride : (chord + 1) * stride + 1] = weights
    rough = np.diff(np.eye(links), n=3, axis=0)
    system = np.block([[rough.T @ rough, given.T], [given, np.zeros((count + 1, count + 1))]])
    right = np.vstack([np.zeros((links, count + 1)), np.eye(count + 1)])
    return np.linalg.solve(system, right)[:links].astype(np.float32)


def _relaxation(relaxation: Float[Array, ""]) -> tuple[Array, Array]:
    """g and w1 for tau/h."""
    kept = jnp.exp(-1.0 / relaxation)
    return kept, 1.0 - (1.0 - kept) * relaxation


def _starting_bends(material: Material, angles: Array, points: Array, motion: Array) -> Float[Array, "N"]:
    """u0: the bends that the hinges tend to while the grippers begin to move at the speed of the step."""
    bends, hinges = jnp.diff(angles), _hinges(angles, points)
    arms = points[-1:] - hinges
    basis = _basis(material, hinges, angles)
    push = jnp.stack([-arms[:, 1], arms[:, 0], jnp.ones_like(bends)])
    wanted = motion[1] - motion[0]
    across = points[-1] - points[0]
    wanted = wanted - motion[0, 2] * jnp.array([-across[1], across[0], 0.0])
    matrix = push @ basis
    right = material.relaxation * wanted + push @ (bends - material.rest)
    return material.rest + basis @ _solve(matrix, right)


def _basis(material: Material, hinges: Array, angles: Array) -> Float[Array, "N 3"]:
    """Bend of each hinge by the load (a_x, a_y, m), forces in the frame of the centre."""
    centre, direction = _centre(hinges, angles)
    arms = _turned(hinges - centre[None], -direction)
    return (
        jnp.stack([arms[:, 1], -arms[:, 0], jnp.ones(len(hinges))], axis=1)
        / (material.stiffness * len(hinges))[:, None]
    )


def _explained(
    material: Material, bends: Array, points: Array, angles: Array
) -> tuple[Float[Array, "3"], Float[Array, "N"]]:
    """The load whose equilibrium is nearest to the bends, and what it leaves of them."""
    basis, bent = _basis(material, _hinges(angles, points), angles), bends - material.rest
    load = _solve(basis.T @ basis, basis.T @ bent)
    return load, bent - basis @ load


def _not_lag(left: Float[Array, "N"]) -> Float[Array, ""]:
    """The share of what an equilibrium leaves of the bends that is the cable's own shape."""
    ratio = (len(left) * jnp.sum(left**2) / LAG**2) ** 4
    return ratio / (1.0 + ratio)


def _hinges(angles: Array, points: Array) -> Float[Array, "N 2"]:
    half = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1) / (2 * (len(angles) - 1))
    return points[:-1] + half[:-1]


def _centre(hinges: Array, angles: Array) -> tuple[Array, Array]:
    """The middle of the chain and its direction there."""
    count = len(hinges)
    if count % 2:
        return hinges[count // 2], 0.5 * (angles[count // 2] + angles[count // 2 + 1])
    return 0.5 * (hinges[count // 2 - 1] + hinges[count // 2]), angles[count // 2]


def _load(offset: Array, compliance: Array, goal: Array, guess: Array) -> Float[Array, "3"]:
    """The load under which the ends stand as `goal` says."""

    def update(load: Array, offset: Array, compliance: Array, goal: Array) -> Array:
        def ends(load: Array) -> Array:
            shape, angles = _outward(load, offset, compliance)
            return _closure(shape[-1] - shape[0], angles[0], angles[1] - angles[0])

        fixed = jax.lax.stop_gradient(load)
        matrix = jax.lax.stop_gradient(jax.jacfwd(ends)(fixed))
        step = _solve(matrix, goal - ends(load))
        return load + step * jnp.minimum(1.0, LONGEST_UPDATE / (jnp.max(jnp.abs(step)) + 1e-9))

    still = [jax.lax.stop_gradient(value) for value in (offset, compliance, goal)]
    found = jax.lax.fori_loop(0, ITERATIONS, lambda _, load: update(load, *still), jax.lax.stop_gradient(guess))
    return update(jax.lax.stop_gradient(found), offset, compliance, goal)


def _closure(across: Array, first: Array, turn: Array) -> Float[Array, "3"]:
    """Right end in the frame of the left one, and how much further the right end is turned."""
    return jnp.append(_turned(across, -first), turn)


def _outward(load: Array, offset: Array, compliance: Array) -> tuple[Float[Array, "l 2"], Float[Array, "2"]]:
    """Middles of the links and both ends in the frame of the centre, and the angles of the end links.

    Bend j is offset_j + compliance_j (m + a x p_j).
    """
    hinges = len(offset)
    each, half = hinges // 2, 1.0 / (2 * hinges)
    side = jnp.array([-1.0, 1.0])

    def from_centre(row: Array) -> Float[Array, "k 2"]:
        return jnp.stack([row[:each][::-1], row[hinges - each :]], axis=1)

    def advance(state: tuple[Array, Array, Array], hinge: tuple[Array, Array]) -> tuple[Any, Array]:
        x, y, angle = state
        x, y = x + side * half * jnp.cos(angle), y + side * half * jnp.sin(angle)
        bend = hinge[0] + hinge[1] * (load[2] + load[0] * y - load[1] * x)
        angle = angle + side * bend
        x, y = x + side * half * jnp.cos(angle), y + side * half * jnp.sin(angle)
        return (x, y, angle), jnp.stack([x, y], axis=1)

    zero = jnp.zeros(2)
    start, begun = (zero, zero, zero), jnp.zeros((1, 2))
    if hinges % 2:
        angle = side * 0.5 * (offset[each] + compliance[each] * load[2])
        start = (side * half * jnp.cos(angle), side * half * jnp.sin(angle), angle)
        begun = jnp.stack(start[:2], axis=1)
    (_, _, angle), points = jax.lax.scan(advance, start, (from_centre(offset), from_centre(compliance)))
    return jnp.concatenate([points[::-1, 0], begun, points[:, 1]]), angle


def _solve(matrix: Float[Array, "3 3"], right: Float[Array, "3"]) -> Float[Array, "3"]:
    """Damped least-squares solution of matrix x = right, unrolled."""
    scaled = matrix * jnp.array([LOAD_SCALE])
    normal = scaled.T @ scaled
    normal = normal + DAMPING * jnp.trace(normal) * jnp.eye(3)
    a, b, c = normal
    rows = jnp.stack([jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)])
    return jnp.array(LOAD_SCALE) * (rows.T @ (scaled.T @ right)) / (a @ rows[0])


def _turned(points: Array, angle: Array) -> Array:
    c, s = jnp.cos(angle), jnp.sin(angle)
    return points @ jnp.array([[c, s], [-s, c]])


def _unit(angle: Float[Array, "1"]) -> Float[Array, "1 2"]:
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)


def _polyline_length(points: Float[Array, "k 2"]) -> Float[Array, ""]:
    return jnp.sum(jnp.sqrt(jnp.sum(jnp.diff(points, axis=0) ** 2, axis=1)))
