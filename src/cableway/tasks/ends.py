"""Tables whose difficulty lies in the shapes that a motion starts from and ends in."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import se2
from cableway.tasks import motion
from cableway.tasks.clutter import End, random_way, strewn
from cableway.tasks.setup import MARGIN, Draft, Setup


def straight(rng: np.random.Generator) -> Draft:
    """Nearly straight cables at both ends, obstacles set around a motion between."""
    return _between(rng, _straightened)


def s_shaped(rng: np.random.Generator) -> Draft:
    """S-shaped cables at both ends, obstacles set around a motion between."""
    return _between(rng, _bent_both_ways)


def table(rng: np.random.Generator) -> Draft:
    """Both ends of the cable face a wall at start and goal, so that neither can lead; solvable by a random walk.

    The cable backs away from the wall, goes through random equilibria and up to a wall again; obstacles are set around.
    """
    setup = Setup()
    start, goal = _facing_wall(rng, setup), _facing_wall(rng, setup)
    between = [_anywhere(rng, setup) for _ in range(int(rng.integers(1, 3)))]
    shapes = np.array([start[0], start[1], *between, goal[1], goal[0]])
    shapes[:, 2] = np.unwrap(shapes[:, 2])
    q = motion.through(shapes)
    motion.require_sound(q, setup, MARGIN)
    return strewn(rng, setup, q, int(rng.integers(2, 6)), (0.018, 0.06))


def _between(rng: np.random.Generator, end: End) -> Draft:
    setup = Setup()
    return strewn(rng, setup, random_way(rng, setup, end), int(rng.integers(4, 8)), (0.025, 0.08))


def _straightened(rng: np.random.Generator, q: np.ndarray, setup: Setup) -> Float[np.ndarray, "t 6"]:
    """On to a slight arc."""
    return _with_loads(rng, q, setup, np.array([0.0, 0.0, rng.choice((-1, 1)) * rng.uniform(0.55, 0.9)]))


def _bent_both_ways(rng: np.random.Generator, q: np.ndarray, setup: Setup) -> Float[np.ndarray, "t 6"]:
    """On to an S: the moment of a force across the cable changes its sign at the centre."""
    across = rng.choice((-1, 1)) * rng.uniform(12, 24)
    return _with_loads(rng, q, setup, np.array([rng.uniform(-12, 6), across, rng.uniform(-1, 1)]))


def _with_loads(rng: np.random.Generator, q: np.ndarray, setup: Setup, loads: np.ndarray) -> np.ndarray:
    def legs() -> np.ndarray:
        step = rng.normal(size=3) * [0.1 * setup.cable.length, 0.1 * setup.cable.length, 0.3]
        return motion.through(np.array([q, np.concatenate([q[:3] + step, loads])]))

    return motion.first_sound(legs, setup, MARGIN, "no room for that shape")


def _facing_wall(rng: np.random.Generator, setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """A U-shaped cable whose open side is close to a wall, and the same shape backed away from it."""
    turn = rng.choice((-1, 1)) * rng.uniform(2.7, 3.6)
    q = np.array([0.0, 0.0, 0.0, *rng.uniform(-3, 3, 2), turn])
    wall = int(rng.integers(4))
    outward = np.pi / 2 * wall
    poses = setup.rod.shapes(q[None])[1][0]
    facing = se2.direction(poses[1, 2]) - se2.direction(poses[0, 2])
    q[2] = outward - np.arctan2(facing[1], facing[0]) + rng.uniform(-0.2, 0.2)
    line = setup.rod.shapes(q[None])[0][0]
    normal, along = se2.direction(outward), se2.direction(outward + np.pi / 2)
    half = np.array(setup.size) / 2
    reach = float(np.abs(normal) @ half) - setup.thickness - MARGIN - rng.uniform(0.004, 0.02)
    low, high = (line @ along).min(), (line @ along).max()
    room = float(np.abs(along) @ half) - setup.thickness - MARGIN
    aside = rng.uniform(-room - low, room - high)
    q[:2] = half + (reach - (line @ normal).max()) * normal + aside * along
    back = q.copy()
    back[:2] -= rng.uniform(0.06, 0.15) * normal
    return q, back


def _anywhere(rng: np.random.Generator, setup: Setup) -> np.ndarray:
    """An equilibrium about the middle of the table."""
    middle = np.array(setup.size) * rng.uniform(0.35, 0.65, 2)
    return np.array([*middle, rng.uniform(-np.pi, np.pi), *rng.normal(0, 5, 2), rng.normal(0, 2)])
