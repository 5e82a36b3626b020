"""The limits of a held cable's shapes: what is asked for, and what a task allows.

`Margins` are chosen; `ShapeLimits` are what they come to for one task, as numbers that the compiled kernels read.
A new constraint is one more field here and one more line in `motion.validity`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cableway.core.checks import Bounds, Checked
from cableway.scene.bodies import Body, padded
from cableway.scene.cable import Cable
from cableway.scene.task import Draft, Task


@dataclass(frozen=True, kw_only=True)
class Margins(Checked):
    """What a shape keeps beyond not touching and not snapping.

    Attributes:
        clearance: Of cable and bodies from obstacles and walls, and of bodies from each other and the cable [m].
        stability: Least stability margin.
        gripper_span: Greatest distance of the grippers, in lengths of the cable.
        self_distance: Of the cable's surface from itself [m].
    """

    clearance: Annotated[float, Bounds(0, 1)] = 0.005
    stability: Annotated[float, Bounds(0, 40)] = 15.0
    gripper_span: Annotated[float, Bounds(1e-3, 1)] = 0.985
    self_distance: Annotated[float, Bounds(0, 1)] = 0.001


@dataclass(frozen=True, kw_only=True)
class SoftLimits:
    """What costs a shape nothing; the shortfalls of `cableway.motion.terms` are against it.

    Attributes:
        margin: Clearance of the cable's surface, the gripper discs and the plug that is asked for [m].
        room: Clearance of all of these that is asked for where the way is wide [m].
        stability_wanted: Margin mu under which a shape is pushed back.
        span_wanted: Distance between the grippers over L above which the cable is given slack.
        separation_margin: Distance between the grippers beyond the least one that the task allows [m].
        bend_share: Of the curvature that the cable allows.
    """

    margin: float = 0.010
    room: float = 0.025
    stability_wanted: float = 34.0
    span_wanted: float = 0.97
    separation_margin: float = 0.002
    bend_share: float = 0.95


class ShapeLimits(NamedTuple):
    """What a shape of one task must keep.

    Attributes:
        cable_distance: Of the centre line from obstacles and walls [m].
        stability: Least stability margin.
        least_span: Least distance of the grippers [m].
        most_span: Greatest distance of the grippers [m].
        sharpest_turn: Greatest sine of the turn at a hinge.
        apart: Stations along the rod from which on it could touch itself.
        self_distance: Of such stations from each other [m].
        bodies_apart: Distance of the bodies of the two grippers [m].
        bodies_off_cable: Distance of the centre line from bodies that could meet it [m].
    """

    cable_distance: float
    stability: float
    least_span: float
    most_span: float
    sharpest_turn: float
    apart: int
    self_distance: float
    bodies_apart: float
    bodies_off_cable: float


BODY_SPACING = 0.008
"""Distance [m] between the points round a body. A corner between two of them, at clearance d, is nearer by at most
`BODY_SPACING`^2 / (8 d): 0.8 mm at 10 mm."""


class BodyPoints(NamedTuple):
    """Points on the outlines of a task's bodies, whose clearance costs in trajectory optimisation and control.

    Attributes:
        side: (k,) gripper that each moves with.
        at: (k, 2) where it is in that gripper's frame [m].
        rounding: (k,) by which it is grown [m].
        lowest: (k,) height of the lowest point of its body above the table [m].
    """

    side: Int[np.ndarray, "k"]
    at: Float[np.ndarray, "k 2"]
    rounding: Float[np.ndarray, "k"]
    lowest: Float[np.ndarray, "k"]

    @classmethod
    def of(cls, task: Task) -> BodyPoints:
        """The centre of each disc, and points `BODY_SPACING` apart round all else that could touch an obstacle."""
        bodies = task.outer_bodies
        points = [each.outline if len(each.outline) == 1 else each.boundary(BODY_SPACING)[:-1] for each in bodies]
        counts = [len(each) for each in points]
        rounding = np.array([body_rounding(body, task.cable) for body in bodies])
        sides = np.array([body.side for body in bodies], dtype=np.int64)
        lowest = np.array([body.heights[0] for body in bodies])
        return cls(
            np.repeat(sides, counts), np.concatenate(points), np.repeat(rounding, counts), np.repeat(lowest, counts)
        )


class BodyMeetings(NamedTuple):
    """What bodies could meet besides obstacles, and what that costs in control: the other gripper's and the cable.

    Each meeting is of one outline, with points `BODY_SPACING` apart round a body of the other gripper, or with the
    cable, which has no points here.

    Attributes:
        side: (m,) gripper that each outline moves with.
        outline: (m, v, 2) [m] in its frame, rows past `counts` unused.
        counts: (m,) vertices of each.
        reach: (m,) [m] of the outline from its gripper; together with that of the body that it meets.
        begins: (m + 1,) index of the first point of each meeting; the last one is their number.
        at: (k, 2) where the points are in the frame of the other gripper [m].
    """

    side: Int[np.ndarray, "m"]
    outline: Float[np.ndarray, "m v 2"]
    counts: Int[np.ndarray, "m"]
    reach: Float[np.ndarray, "m"]
    begins: Int[np.ndarray, "m+1"]
    at: Float[np.ndarray, "k 2"]

    @classmethod
    def of(cls, task: Task) -> BodyMeetings:
        """Those of `Task.body_pairs`, each way, and of the bodies that could meet the cable; none of discs."""
        pairs = [pair for a, b in task.body_pairs for pair in ((a, b), (b, a))]
        over = [body for body in task.bodies if body.meets_cable(task.cable.radius)]
        points = [one.boundary(BODY_SPACING)[:-1] for one, _ in pairs] + [np.zeros((0, 2))] * len(over)
        met = [other for _, other in pairs] + over
        reach = [one.reach + other.reach for one, other in pairs] + [body.reach for body in over]
        outline, counts = padded([body.outline for body in met])
        begins = np.cumsum([0, *map(len, points)], dtype=np.int64)
        sides = np.array([body.side for body in met], dtype=np.int64)
        return cls(sides, outline, counts, np.array(reach, float), begins, np.concatenate([np.zeros((0, 2)), *points]))


def sharpest_turn_of(task: Draft) -> float:
    """Greatest sine of the turn at a hinge that the cable's least bend radius allows; infinite where it has none."""
    radius, rod = task.cable.min_bend_radius, task.cable.rod
    return math.sin(min(math.pi / 2, rod.length / rod.hinges / radius)) if radius > 0 else math.inf


def stations_apart(task: Draft) -> int:
    """Stations along the rod from which on it could touch itself: half a turn of the cable's own thickness."""
    rod = task.cable.rod
    return math.ceil(math.pi * task.cable.radius * 2 * rod.hinges / rod.length) + 1


def body_rounding(body: Body, cable: Cable) -> float:
    """By how much a body's outline is grown [m]: a disc about the cable's end is at least as thick as the cable."""
    return max(body.rounding, cable.radius) if len(body.outline) == 1 else body.rounding
