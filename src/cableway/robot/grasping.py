"""How the arms of a cell get to the cable and leave it: straight down with open hands, and straight up again.

Both hands open to either side of the cable's ends, as wide as there is room, `RISE` above where they hold the cable.
They come down together from rest to rest; at the goal the same is done backwards. What stands on the table is nearest
when they are down, so only there hands are compared with it, and links all the way.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.quantities import quantity
from cableway.geometry import polyline
from cableway.geometry.convex import polyline_distance
from cableway.records import Plan
from cableway.robot.branches import CLEARANCE, SINGULAR, SPEED_SHARE, ArmMotion, NoMotion, PackedCell
from cableway.robot.kinematics import branch_motion
from cableway.scene.bodies import Body, body_pairs, into_frame
from cableway.scene.cell import TOOLS, Cell, Way
from cableway.scene.clearance import PIECES, bodies_gap, body_clearance
from cableway.scene.gripper_bodies import OPENINGS, open_hand
from cableway.scene.grippers import SIDES, bodies_of_hands
from cableway.scene.task import CONTROL_STEP, ENDS, Task

CLOSING = 1.0
"""Time [s] that hands get to close or open, while arms stand: a 2F-85 takes up to 0.84 s for 42 mm at 50 mm/s, a third
of its speed."""

RISE = 0.1
"""Height [m] above where they hold the cable from which hands come down: the tips are then above posts of 10 cm."""

ROOM = 0.005
"""Clearance [m] of open hands; the judge asks for 4 mm."""

ACCELERATION_SHARE = 0.7
"""Share of the joints' limits of acceleration that is used, as in the rest of a plan."""

PEAK = 1.875
"""Greatest speed of a minimum-jerk motion over its mean speed."""

SLOWER = 1.2
"""Factor on the duration while joints would be too fast."""

MOST_STEPS = 200
"""Control steps after which that ends."""


HELD = "the hands hold the plug on its way into the port"
"""Why they do not open at the goal of a task with a port."""


class HandMotion(NamedTuple):
    """Arms that lower their open hands to the cable.

    Attributes:
        joints: (t, 2, 6) [rad], a control step from row to row.
        opening: Distance [m] of the fingers.
    """

    joints: Float[np.ndarray, "t 2 6"]
    opening: float


def with_hands(plan: Plan, motion: ArmMotion, task: Task) -> Plan:
    """A plan with the joints of its arms, and with their approach and retreat where there is room for them.

    `metadata["arms"]` says how the arms hold the cable, `opening` how wide the hands are open before and after [m], and
    `no_approach` or `no_retreat` why there is none, with the place.
    """
    described: dict[str, object] = {**motion.way.described(), "opening": [None, None]}
    found: dict[str, Float[np.ndarray, "t 2 6"]] = {}
    for index, (name, end) in enumerate(zip(("approach", "retreat"), ENDS, strict=True)):
        row = -index
        if index and task.port is not None:
            described["no_retreat"] = HELD
            continue
        hands = lowered(plan.poses[row], plan.shapes[row], motion.joints[row], task, motion.way)
        if isinstance(hands, NoMotion):
            x, y = hands.at
            described[f"no_{name}"] = f"at the {end}, {hands.reason} at ({x:.3f}, {y:.3f}) m"
        else:
            described["opening"][index] = hands.opening  # pyright: ignore[reportIndexIssue]
            found[name] = hands.joints[:: 1 - 2 * index].copy()
    metadata = {**plan.metadata, "arms": described}
    return replace(
        plan, joints=motion.joints, metadata=metadata, approach=found.get("approach"), retreat=found.get("retreat")
    )


def lowered(
    poses: Float[np.ndarray, "2 3"], keypoints: Float[np.ndarray, "n 2"], joints: Float[np.ndarray, "2 6"], task: Task,
    way: Way,
) -> HandMotion | NoMotion:  # fmt: skip
    """The motion down to the cable, hands open as wide as fits; or why there is none.

    Args:
        poses: Of the grippers as they hold the cable [m, m, rad].
        keypoints: Where it lies [m].
        joints: Of the arms there [rad].
        task: A task in a cell.
        way: How the arms hold the cable.
    """
    assert task.cell is not None
    line, fault = polyline.spline(keypoints[None], PIECES)[0], None
    for opening in OPENINGS:
        fault = _hands_fault(poses, line, opening, task)
        if fault is None:
            return _down(poses, joints, opening, task, way)
    assert fault is not None
    return fault


def hand_bodies(cell: Cell, opening: float) -> tuple[Body, ...]:
    """The pieces of both open hands of a cell, their fingers `opening` [m] apart."""
    return bodies_of_hands(open_hand(cell.tool, opening), cell.tilt)


def hands_clearance(
    poses: Float[np.ndarray, "t 2 3"], lines: Float[np.ndarray, "t m 2"], opening: float, task: Task
) -> tuple[Float[np.ndarray, "t 2"], Float[np.ndarray, "t"]]:
    """Clearances [m] of open hands that are down at gripper poses [m, m, rad].

    Returns:
        Of each from the scene and the cable along `lines` [m], and of one from the other.
    """
    assert task.cell is not None
    bodies, radius = hand_bodies(task.cell, opening), task.cable.radius
    room = np.full((len(poses), len(SIDES)), np.inf)
    for body in bodies:
        gaps = [body_clearance(body, poses, task.scene)]
        if body.meets_cable(radius):
            gaps.append(polyline_distance(into_frame(lines, poses[:, body.side]), body.world)[0] - radius)
        room[:, body.side] = np.min([room[:, body.side], *gaps], axis=0)
    return room, bodies_gap(body_pairs(bodies), poses)


def _hands_fault(
    poses: Float[np.ndarray, "2 3"], line: Float[np.ndarray, "m 2"], opening: float, task: Task
) -> NoMotion | None:
    """Why hands open so far have no room where they hold the cable; None where they have."""
    room, apart = hands_clearance(poses[None], line[None], opening, task)
    side = int(room[0].argmin())
    if min(room.min(), apart[0]) >= ROOM:
        return None
    if apart[0] < room.min():
        x, y = poses[:, :2].mean(axis=0)
        return NoMotion(f"the open hands come {_near(apart[0])} each other", (float(x), float(y)))
    x, y = poses[side, :2]
    who = f"the open hand of the {SIDES[side][0]}"
    return NoMotion(f"{who} comes {_near(room[0, side])} an obstacle or the cable", (float(x), float(y)))


def _near(gap: float) -> str:
    return f"within {quantity(float(gap))} of" if gap > 0 else f"{quantity(-float(gap))} into"


def _down(
    poses: Float[np.ndarray, "2 3"], joints: Float[np.ndarray, "2 6"], opening: float, task: Task, way: Way
) -> HandMotion | NoMotion:
    """The motion of the arms straight down to gripper poses, with the joints there; or why there is none."""
    assert task.cell is not None
    packed = PackedCell(task, task.cell, tool=TOOLS[task.cell.tool].opened(opening))
    at, steps = (float(poses[:, 0].mean()), float(poses[:, 1].mean())), PEAK * RISE / task.grippers.max_step
    while steps <= MOST_STEPS:
        share = np.linspace(0.0, 1.0, int(np.ceil(steps)) + 1)
        raised = RISE * (1 - share**3 * (10 - 15 * share + 6 * share**2))
        found = np.empty((len(raised), 2, 6))
        for side, (name, _) in enumerate(SIDES):
            arm, turn, branch = way.of(side)
            flanges = packed.flanges(arm, np.repeat(poses[side : side + 1], len(raised), axis=0), side, turn, raised)
            if branch_motion(packed.lengths[arm], flanges, branch, SINGULAR, found[:, side]) < len(raised):
                away = (float(poses[side, 0]), float(poses[side, 1]))
                return NoMotion(f"the arm at the {name} does not reach {quantity(RISE)} above it", away)
        found = np.unwrap(found, axis=0)
        found += 2 * np.pi * np.round((joints - found[-1]) / (2 * np.pi))
        found[-1] = joints
        if _keeps_limits(found, packed, way):
            return _with_room(found, opening, packed, way, at)
        steps *= SLOWER
    return NoMotion("the joints of an arm have no room to open and rise", at)


def _keeps_limits(joints: Float[np.ndarray, "t 2 6"], packed: PackedCell, way: Way) -> bool:
    """Whether joints keep their limits, from rest to rest."""
    models = packed.cell.models_of(way)
    speeds = np.diff(np.pad(joints, ((1, 1), (0, 0), (0, 0)), mode="edge"), axis=0) / CONTROL_STEP
    changes = np.diff(speeds, axis=0) / CONTROL_STEP
    return all(
        (np.abs(joints[:, side]) <= model.position_limit).all()
        and (np.abs(speeds[:, side]) <= SPEED_SHARE * np.array(model.speed_limit)).all()
        and (np.abs(changes[:, side]) <= ACCELERATION_SHARE * np.array(model.acceleration_limit)).all()
        for side, model in enumerate(models)
    )


def _with_room(
    joints: Float[np.ndarray, "t 2 6"], opening: float, packed: PackedCell, way: Way, at: tuple[float, float]
) -> HandMotion | NoMotion:
    """The motion, where links keep their clearance in it."""
    placed = [packed.placed(arm, joints[:, side]) for side, arm in enumerate(way.holders)]
    gaps = packed.gaps(way.holders, placed[0][0], placed[1][0])
    least = float(min(gaps.min(), *(clearance.min() for _, clearance in placed)))
    if least >= CLEARANCE:
        return HandMotion(joints, opening)
    return NoMotion(f"links come {_near(least)} something as the hands come down", at)
