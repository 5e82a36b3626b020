"""Motions of the rod through its equilibria, drawn at random or led along a curve.

A motion is a polyline in rod coordinates q; every point of it is an equilibrium (`cableway.rod.planar`), so that
it is a true motion of the cable wherever its stability margin stays positive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline, se2
from cableway.geometry.convex import ConvexWorld, polyline_distance, signed_distance
from cableway.motion import terms
from cableway.motion.interpolation import rows_at, subdivided
from cableway.motion.sweeps import swept_shapes
from cableway.motion.time_parametrization import at_equal_effort, gripper_effort
from cableway.motion.validity import first_fault
from cableway.rod.inverse import fit_keypoints
from cableway.rod.planar import PlanarRod
from cableway.scene.bodies import body_pairs
from cableway.scene.clearance import bodies_gap, cable_gap
from cableway.scene.grippers import Grippers
from cableway.scene.scene import Scene
from cableway.tasks.setup import Rejected, Setup

LEAST_STABILITY = 25.0
"""Stability margin below which a motion is rejected; a verified plan keeps 20."""

HELD_STABILITY = 38.0
"""Stability margin below which a shape that is led along a curve leaves the curve."""

HELD_SPAN = 0.975
"""Distance between the grippers, in lengths of the cable, above which it leaves the curve too."""

SLACK_BEND = 0.5
"""Moment added to the first guess, so that a straight curve does not make a straight cable."""

PUSH, STIFFEN, SLACKEN, PULL = 10.0, 3.0, 100.0, 0.007
"""Weights of clearance, stability and slack, and of the loads (without it they run away), against the distance from
the curve."""

LIMIT_SHARE = 0.7
"""Share of the gripper limits that a row takes."""

SWEEP_STEP = 0.0015
"""Largest move [m] of a station between two shapes of a sweep."""

MOST_ENERGY = 25.0
"""Largest bending energy [EI/L]: that of a full circle is 20."""

LONGEST_SPAN = 0.994
"""Largest distance between the grippers, in lengths of the cable: tauter cables amplify every error of length."""


@dataclass(frozen=True)
class Walls:
    """What a rod is led between.

    Attributes:
        world: Obstacles and walls.
        keep: How far [m] its stations stay from them, as far as they can.
        least: How far [m] they must.
    """

    world: ConvexWorld
    keep: float
    least: float


def in_steps(q: Float[np.ndarray, "t dof"], rod: PlanarRod, grippers: Grippers) -> Float[np.ndarray, "k dof"]:
    """The same polyline in q with rows that take at most `LIMIT_SHARE` of the gripper limits each."""
    fine = subdivided(len(q), 8)
    effort = gripper_effort(rod.shapes(rows_at(q, fine))[1], grippers.max_step, grippers.max_turn)
    return rows_at(q, at_equal_effort(fine, effort / LIMIT_SHARE))


def joined(*motions: Float[np.ndarray, "_ 6"]) -> Float[np.ndarray, "t 6"]:
    """Motions one after the other; the turn of the centre runs on without jumps."""
    rows = np.vstack(motions)
    rows[:, 2] = np.unwrap(rows[:, 2])
    return rows


def require_sound(q: Float[np.ndarray, "t 6"], setup: Setup, margin: float) -> None:
    """Reject a motion that is unstable, taut or crossing itself somewhere, or nearer than `margin` [m] to a wall."""
    rod = setup.rod
    rows = in_steps(q, rod, setup.grippers)
    most_span = np.full(len(rows), LONGEST_SPAN * rod.length)
    most_span[[0, -1]] = np.inf
    fault = first_fault(
        rod,
        rows,
        stability=LEAST_STABILITY,
        most_span=most_span,
        least_span=max(2 * setup.thickness + margin, setup.grippers.least_span),
        most_energy=MOST_ENERGY,
    )
    if fault:
        raise Rejected(fault)
    lines, poses = rod.shapes(rows)
    bodies = setup.grippers.bodies
    apart, off = bodies_gap(body_pairs(bodies), poses), cable_gap(bodies, lines, poses, setup.cable, margin)
    if min(apart.min(), off.min()) < margin:
        raise Rejected("grippers meet")
    low, high = lines.min(axis=(0, 1)), lines.max(axis=(0, 1))
    keep = setup.thickness + margin
    if (low < keep).any() or (high > np.array(setup.size) - keep).any():
        raise Rejected("outside")


def first_sound(
    draw: Callable[[], Float[np.ndarray, "t 6"]], setup: Setup, margin: float, reason: str, tries: int = 20
) -> Float[np.ndarray, "t 6"]:
    """The first motion drawn that `require_sound` lets pass.

    Raises:
        Rejected: None of some tries does; for that `reason`.
    """
    for _ in range(tries):
        q = draw()
        try:
            require_sound(q, setup, margin)
        except Rejected:
            continue
        return q
    raise Rejected(reason)


def require_free(q: Float[np.ndarray, "t 6"], setup: Setup, scene: Scene, margin: float) -> None:
    """Reject a motion on which cable or grippers come nearer than `margin` [m] to an obstacle or wall."""
    lines = swept_shapes(setup.rod, q, SWEEP_STEP)
    slack = margin + SWEEP_STEP / 2
    cable = polyline_distance(lines, scene.world)[0] - setup.cable.radius
    tips = signed_distance(lines[:, [0, -1]], scene.world)[0] - setup.grippers.radius
    if cable.min() < slack or tips.min() < slack:
        raise Rejected("touches a wall")


def longest_run(q: Float[np.ndarray, "t 6"], setup: Setup, scene: Scene, margin: float) -> np.ndarray:
    """The longest run of rows between which the motion is sound and keeps `margin` [m] from everything.

    Raises:
        Rejected: There is none.
    """
    good = [_is_good(q[i : i + 2], setup, scene, margin) for i in range(len(q) - 1)]
    edges = np.flatnonzero(np.diff([False, *good, False]))
    if not len(edges):
        raise Rejected("nowhere sound")
    k = 2 * int(np.argmax(edges[1::2] - edges[::2]))
    return q[edges[k] : edges[k + 1] + 1]


def _is_good(q: np.ndarray, setup: Setup, scene: Scene, margin: float) -> bool:
    try:
        require_sound(q, setup, margin)
        require_free(q, setup, scene, margin)
    except Rejected:
        return False
    return True


def random_curve(rng: np.random.Generator, length: float, bend: float, wavelength: float) -> Float[np.ndarray, "m 2"]:
    """A smooth curve from the origin along +x whose curvature is a sum of waves.

    Args:
        rng: Source of the draw.
        length: [m].
        bend: Amplitude of the curvature [1/m].
        wavelength: Length of the longest wave [m]; the second is half as long.
    """
    s = np.linspace(0.0, length, 1 + int(np.ceil(length / 0.004)))
    first, second = (np.sin(2 * np.pi * (s * k / wavelength + rng.uniform())) for k in (1, 2))
    curvature = bend * (first + 0.4 * rng.uniform(-1, 1) * second)
    step = s[1]
    angle = np.concatenate([[0.0], np.cumsum(curvature[:-1] * step)])
    return np.vstack([[0.0, 0.0], np.cumsum(step * se2.direction(angle[:-1] + curvature[:-1] * step / 2), axis=0)])


def placed(
    rng: np.random.Generator, curve: Float[np.ndarray, "m 2"], size: tuple[float, float], inset: float
) -> Float[np.ndarray, "m 2"]:
    """A curve turned and moved at random so that it keeps `inset` [m] from the walls."""
    turned = se2.transform(curve, np.zeros(2), rng.uniform(0, 2 * np.pi))
    low, high = turned.min(axis=0) - inset, turned.max(axis=0) + inset
    room = np.array(size) - (high - low)
    if (room < 0).any():
        raise Rejected("too long for the table")
    return turned - low + rng.uniform(0, 1, 2) * room


def led_along(
    curve: Float[np.ndarray, "m 2"], rod: PlanarRod, walls: Walls | None = None, whole: bool = True
) -> Float[np.ndarray, "t 6"]:
    """The rod led along a curve from one end to the other, each shape the nearest equilibrium to its piece of curve.

    Args:
        curve: Longer than the rod; the right gripper goes first.
        rod: The rod.
        walls: What the rod is also kept away from.
        whole: Whether it must come to the end; else the longest run along which it can be led is enough.

    Raises:
        Rejected: The curve is too short, or the rod cannot be led along the whole of it.
    """
    travel = float(polyline.length(curve)) - rod.length
    if travel <= 0:
        raise Rejected("the curve is shorter than the cable")
    shifts = np.linspace(0.0, travel, 2 + int(travel / (0.04 * rod.length)))
    ahead = np.linspace(0.0, rod.length, rod.keypoints)
    targets = [polyline.point_at(curve, shift + ahead) for shift in shifts]
    best, rows, q = [], [], None
    for target in targets:
        q = _fit(rod, _first_guess(rod, target) if q is None else q, target, walls)
        flaw = _flaw(rod, q, walls)
        if flaw and whole:
            raise Rejected(flaw)
        rows = [] if flaw else [*rows, q]
        q = None if flaw else q
        best = max(best, rows, key=len)
    if len(best) < 2:
        raise Rejected("nowhere sound")
    return smoothed(joined(np.array(best)))


def smoothed(q: Float[np.ndarray, "t 6"]) -> Float[np.ndarray, "t 6"]:
    """Rows averaged with their neighbours, the ends kept: equilibria too, without the jitter of fitting one by one."""
    out = q.copy()
    for _ in range(2):
        out[1:-1] = 0.25 * out[:-2] + 0.5 * out[1:-1] + 0.25 * out[2:]
    return out


def _first_guess(rod: PlanarRod, target: np.ndarray) -> np.ndarray:
    return fit_keypoints(rod, target)[0] + [0, 0, 0, 0, 0, SLACK_BEND]


def _flaw(rod: PlanarRod, q: np.ndarray, walls: Walls | None) -> str:
    """Why a shape will not do, or nothing."""
    return first_fault(
        rod,
        q[None],
        stability=LEAST_STABILITY,
        most_span=LONGEST_SPAN * rod.length,
        most_energy=MOST_ENERGY,
        room=None if walls is None else (walls.world, walls.least),
    )


def _fit(rod: PlanarRod, q: np.ndarray, target: np.ndarray, walls: Walls | None, iterations: int = 20) -> np.ndarray:
    """Damped Gauss-Newton steps from q towards keypoints `target`, kept stable and off walls.

    Note:
        One step in five makes the cost rise, where terms begin to count, so that `cableway.rod.least_squares` would end
        elsewhere, and every frozen random task with it.
    """
    scale, loads = rod.units, rod.loads
    for _ in range(iterations):
        stations, dstations, poses, dposes = rod.jacobians(q[None])
        missed = (rod.at_keypoints(stations)[0] - target).ravel() / rod.length
        lack, by_q = terms.stability_shortfall(rod, q[None], HELD_STABILITY)
        over, by_poses = terms.span_excess(poses, HELD_SPAN * rod.length, 0.0)
        rows = [
            (missed, rod.at_keypoints(dstations)[0].reshape(len(missed), -1) / rod.length),
            (PULL * q[loads] / scale[loads], PULL * np.diag(1 / scale)[loads]),
            (STIFFEN * lack / HELD_STABILITY, STIFFEN * by_q / HELD_STABILITY),
            (SLACKEN * over[0] / rod.length, SLACKEN * np.einsum("ckj,kji->ci", by_poses[0], dposes[0]) / rod.length),
        ]
        if walls is not None:
            short, slope = terms.clearance_shortfall(stations[0], walls.world, walls.keep)
            rows.append((PUSH * short / rod.length, PUSH * np.einsum("sk,skj->sj", slope, dstations[0]) / rod.length))
        residual, jacobian = (np.concatenate(part) for part in zip(*rows, strict=True))
        jacobian = jacobian * scale
        normal = jacobian.T @ jacobian + 1e-5 * np.eye(rod.dof)
        step = -np.linalg.solve(normal, jacobian.T @ residual)
        largest = float(np.abs(step).max())
        q = q + scale * step * min(1.0, 0.5 / (largest + 1e-12))
        if largest < 1e-5:
            break
    return q


def through(q: Float[np.ndarray, "k 6"], rows: int = 12) -> Float[np.ndarray, "t 6"]:
    """Straight lines in q from row to row, with `rows` pieces each."""
    legs = [a + np.linspace(0, 1, rows + 1)[:, None] * (b - a) for a, b in pairwise(q)]
    return joined(*legs)
