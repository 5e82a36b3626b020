"""Random shapes of a cable, plans of the catalogue, and a plant that follows them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.geometry import polyline
from cableway.planning.planner import plan
from cableway.records import Measurement, Plan
from cableway.rod.inverse import equilibria_at
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.files.loading import load_task
from cableway.scene.grippers import Grippers
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.simulation.plant import CableSimulator, PlantConfig
from cableway.simulation.random_motion import MotionConfig, random_motion

LEAST_STABILITY = 15.0
"""Stability margin under which no shape is asked for: that of `cableway collect`; a verified plan keeps 20."""

LONGEST_GAP = 0.97
"""Greatest distance of the grippers, in lengths of the cable: that of `cableway collect`."""

TAUT = 0.99
"""Distance of the grippers, in lengths of the cable, beyond which a motion with its added shaking may overstretch."""

WIDEST_ANGLE = np.deg2rad(120)
"""Greatest angle of an end against the line between the grippers."""

GENTLE_BEND = 0.5
"""Angle [rad] between neighbouring links where a cable of 0.3 m is bent to a radius of 25 mm."""

ROOM = Scene(size=(4.0, 4.0))
"""Open space: its walls are out of reach."""

MIDDLE = np.array([2.0, 2.0])


def plant_at(
    q: Float[np.ndarray, "6"], cable: Cable, scene: Scene = ROOM, time_step: float = PlantConfig.time_step
) -> CableSimulator:
    """A plant whose cable lies at the rod coordinates q."""
    return CableSimulator(_task_at(q, cable, scene), PlantConfig(time_step=time_step))


def _task_at(q: Float[np.ndarray, "6"], cable: Cable, scene: Scene = ROOM) -> Task:
    shape = cable.rod.at_keypoints(cable.rod.shapes(q[None])[0])[0]
    return Task(name="accuracy", scene=scene, cable=cable, start=shape, goal=shape)


def _is_task(q: Float[np.ndarray, "6"]) -> bool:
    """Whether a default cable may begin there: collected motions also begin where it touches itself."""
    try:
        return bool(_task_at(q, Cable()))
    except TaskError:
        return False


def led(plant: CableSimulator, poses: Float[np.ndarray, "k 2 3"], wait: int = 0) -> Iterator[Measurement]:
    """Lead the grippers over `poses`, the first of which they have, then wait; what is measured after each step."""
    for action in np.concatenate([np.diff(poses, axis=0), np.zeros((wait, 2, 3))]):
        plant.step(action)
        yield plant.measure()


@cache
def catalogue_plan(name: str, seed: int) -> tuple[Task, Plan]:
    """A task of the catalogue and its verified plan."""
    task = load_task(name)
    return task, plan(task, seed=seed)


def motion_of_collect(
    rod: PlanarRod, steps: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "steps+1 2 3"]]:
    """Start and gripper poses of a random motion of `cableway collect`, moved to the middle of the room.

    One that pulls the grippers farther apart than `TAUT`, or whose start is none of a task, is drawn again.
    """
    moved = np.array([*MIDDLE, 0.0]) - [MotionConfig.area / 2, MotionConfig.area / 2, 0.0]
    while True:
        q, poses = random_motion(rod, MotionConfig(), steps, rng)
        start = q + [*moved, 0.0, 0.0, 0.0]
        if np.linalg.norm(poses[:, 1, :2] - poses[:, 0, :2], axis=1).max() <= TAUT * rod.length and _is_task(start):
            return start, poses + moved


def random_shape(rod: PlanarRod, rng: np.random.Generator, sharpest: float = np.inf) -> Float[np.ndarray, "6"]:
    """The stable shape of lowest energy between random gripper poses, of those bent by at most `sharpest` [rad]."""
    while True:
        left, right = rng.uniform(-WIDEST_ANGLE, WIDEST_ANGLE, 2)
        poses = np.array([[0.0, 0.0, left], [rng.uniform(0.1, LONGEST_GAP) * rod.length, 0.0, right]])
        found = equilibria_at(rod, poses, minimum_stability=LEAST_STABILITY)
        if len(found) and largest_bend(rod, found[0]) <= sharpest:
            return np.array([*MIDDLE, rng.uniform(-np.pi, np.pi), *found[0, 3:]])


def largest_bend(rod: PlanarRod, q: Float[np.ndarray, "6"]) -> float:
    """Largest angle [rad] between neighbouring links: |m + a x (p - c)/L|/N over the hinges p."""
    offsets = (rod.shapes(q[None])[0][0, 1::2] - q[:2]) / rod.length
    cos, sin = np.cos(q[2]), np.sin(q[2])
    force = np.array([cos * q[3] - sin * q[4], sin * q[3] + cos * q[4]])
    return float(np.abs(q[5] + force[0] * offsets[:, 1] - force[1] * offsets[:, 0]).max() / rod.hinges)


def line_to(q: Float[np.ndarray, "6"], rod: PlanarRod, rng: np.random.Generator) -> Float[np.ndarray, "t 6"]:
    """Rod coordinates in each control step on a line of stable shapes to q, with the grippers at full speed.

    It begins elsewhere, bent otherwise and gently.
    """
    for scale in np.repeat(0.9 ** np.arange(60), 5):
        start = q + scale * rng.normal(0, [0.05, 0.05, 0.4, 10.0, 6.0, 3.0])
        start[3:] -= rng.uniform(0, 0.8) * q[3:]
        line = start + np.linspace(0, 1, 101)[:, None] * (q - start)
        if largest_bend(rod, start) <= GENTLE_BEND and allowed(rod, line) and _is_task(start):
            return _at_full_speed(rod, line)
    raise RuntimeError(f"no line of stable shapes leads to {q.tolist()}")


def _at_full_speed(rod: PlanarRod, line: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "t 6"]:
    steps = np.abs(np.diff(rod.shapes(line)[1], axis=0))
    effort = np.maximum(np.linalg.norm(steps[..., :2], axis=-1) / Grippers.max_step, steps[..., 2] / Grippers.max_turn)
    along = np.concatenate([[0.0], np.cumsum(effort.max(axis=1))])
    share = np.interp(np.linspace(0, along[-1], int(np.ceil(along[-1])) + 1), along, np.linspace(0, 1, len(line)))
    return line[0] + share[:, None] * (line[-1] - line[0])


def allowed(rod: PlanarRod, line: Float[np.ndarray, "t 6"]) -> bool:
    """Whether all shapes of a line are stable enough, not taut, and free of crossings."""
    stations, poses = rod.shapes(line)
    gaps = np.linalg.norm(poses[:, 1, :2] - poses[:, 0, :2], axis=1)
    stable = rod.stability(line)[0].min() >= LEAST_STABILITY * (1 - 1e-6)
    return bool(
        stable
        and gaps.max() <= (LONGEST_GAP + 1e-6) * rod.length
        and not any(polyline.crosses_itself(shape[::2]) for shape in stations)
    )
