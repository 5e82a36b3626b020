"""Where a held cable may be.

A configuration q of the rod is free where cable and bodies keep their distances from obstacles, walls and each other,
the rod is stable, the grippers are neither too far apart nor too near, no hinge bends too sharply, and the cable keeps
away from itself. `FreeSpace` asks that of the shapes of one task; between two configurations every shape is an
equilibrium (`cableway.rod.planar`), so a motion is checked at shapes a few millimetres apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from cableway.geometry.convex import ConvexWorld, polyline_distance
from cableway.geometry.groups import SE2
from cableway.motion import kernels
from cableway.motion.limits import Margins, ShapeLimits, body_rounding, sharpest_turn_of, stations_apart
from cableway.rod.held_rod import HeldRod
from cableway.scene.bodies import Body, pack
from cableway.scene.clearance import bodies_gap, body_clearance, cable_gap
from cableway.scene.task import Draft, Task

STRAIGHTER = 1e-3
"""Share of the length from which the grippers are farther apart than they were."""


@dataclass(frozen=True)
class FreeSpace:
    """The configurations of a task's cable that are free.

    Attributes:
        rod: The rod.
        arrays: What the kernels take as `space`.
    """

    rod: HeldRod
    arrays: tuple[Any, ...]

    @classmethod
    def of(cls, task: Task, margins: Margins) -> FreeSpace:
        """What a task allows with some margins: never more than its own start and goal keep."""
        return cls.around(np.array(task_ends(task)), task, margins)

    @classmethod
    def around(cls, kept: Float[np.ndarray, "k dof"], task: Draft, margins: Margins) -> FreeSpace:
        """What margins allow in the scene of a task: never more than some shapes keep, if there are any."""
        rod = task.cable.rod
        stations, poses = rod.shapes(kept)
        spans = gripper_spans(poses)
        turns = [kernels.sharpest_turn(shape, rod.length) for shape in stations]
        apart, off = stations_apart(task), cable_gap(task.bodies, stations, poses, task.cable, margins.clearance)
        selves = min((kernels.self_distance(shape, apart) for shape in stations), default=math.inf)
        cable_distance = task.cable.radius + margins.clearance
        limits = ShapeLimits(
            cable_distance=min(cable_distance, _least(task.scene.signed_distance(stations)) - 1e-6),
            stability=min(margins.stability, _least(rod.stability(kept)[0]) - 1e-6),
            least_span=min(task.grippers.least_span, _least(spans) - 1e-9),
            most_span=max(margins.gripper_span * rod.length, float(spans.max(initial=0.0)) + 1e-9),
            sharpest_turn=max([sharpest_turn_of(task), *turns]),
            apart=apart,
            self_distance=min(2 * task.cable.radius + margins.self_distance, selves - 1e-9),
            bodies_apart=min(margins.clearance, _least(bodies_gap(task.body_pairs, poses)) - 1e-6),
            bodies_off_cable=task.cable.radius + min(margins.clearance, _least(off) - 1e-6),
        )
        outer = task.outer_bodies
        distances = [_body_distance(body, poses, task, margins) if body in outer else -math.inf for body in task.bodies]
        bodies = pack(task.bodies, distances, task.body_pairs, task.cable.radius, margins.clearance)
        return cls(rod, (rod.arrays, task.scene.world.arrays, limits, bodies))

    def are_free(self, q: Float[np.ndarray, "k dof"]) -> Bool[np.ndarray, "k"]:
        """Which configurations are free."""
        return kernels.are_free(np.ascontiguousarray(q, float), self.arrays)


def first_fault(
    rod: HeldRod,
    q: Float[np.ndarray, "t dof"],
    *,
    stability: float,
    most_span: Float[np.ndarray, "t"] | float,
    least_span: float = 0.0,
    most_energy: float = math.inf,
    room: tuple[ConvexWorld, float] | None = None,
) -> str:
    """What is wrong with some shapes of a rod that are wanted for random tasks or data, or "".

    Args:
        rod: The rod.
        q: Its shapes.
        stability: Least stability margin.
        most_span: Greatest distance of the grippers [m].
        least_span: Least distance of the grippers [m].
        most_energy: Greatest bending energy [EI/L].
        room: Obstacles and walls, and the distance [m] that the centre line keeps from them.
    """
    stations, poses = rod.shapes(q)
    spans = gripper_spans(poses)
    if (spans > most_span).any():
        return "taut"
    if (spans < least_span).any():
        return "grippers meet"
    if rod.stability(q, ceiling=stability)[0].min() < stability:
        return "unstable"
    if math.isfinite(most_energy) and rod.energy(q).max() > most_energy:
        return "wound up"
    if room is not None and polyline_distance(stations, room[0])[0].min() < room[1]:
        return "touches a wall"
    return "crosses itself" if any(kernels.crosses_itself(shape) for shape in stations) else ""


def task_ends(task: Task) -> tuple[Float[np.ndarray, "dof"], Float[np.ndarray, "dof"]]:
    """The equilibria of start and goal, the shorter turn apart."""
    start, goal = task.start_equilibrium, task.goal_equilibrium
    return start, task.cable.rod.written_near(goal, start)


def gripper_spans(poses: Float[np.ndarray, "t 2 pose"]) -> Float[np.ndarray, "t"]:
    """Distance [m] between the grippers in each row."""
    at = SE2.position(poses)
    return np.linalg.norm(at[:, 1] - at[:, 0], axis=1)


def is_pulled_straight(poses: Float[np.ndarray, "t 2 pose"], length: float, most: float) -> bool:
    """Whether the grippers pull a cable straight: they come farther apart than a share of its length on the way, or
    farther than at its beginning or end where that is straight itself.

    Args:
        poses: (T+1, 2, 3) [m, m, rad].
        length: Of the cable [m].
        most: The share.
    """
    spans = gripper_spans(poses) / length
    bent = np.flatnonzero(spans <= most)
    if not len(bent):
        return False
    limits = np.full(len(spans), most)
    limits[: bent[0]], limits[bent[-1] + 1 :] = spans[0] + STRAIGHTER, spans[-1] + STRAIGHTER
    return bool((spans > limits).any())


def _least(values: Float[np.ndarray, "..."]) -> float:
    return float(values.min(initial=math.inf))


def _body_distance(body: Body, kept: Float[np.ndarray, "k 2 pose"], task: Draft, margins: Margins) -> float:
    """Distance [m] that the outline of a body keeps."""
    least = _least(body_clearance(body, kept, task.scene)) + body.rounding - 1e-6
    return min(body_rounding(body, task.cable) + margins.clearance, least)
