"""Joints and hands of a trajectory: rows or curves of them, and what goes before and after a plan.

The approach comes first, then hands close while the arms stand; after the plan they open, and the retreat follows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.motion.resampling import smoothed
from cableway.records import Plan
from cableway.robot.cell_kinematics import CellKinematics
from cableway.robot.grasping import CLOSING
from cableway.robot.ur_arm import joint_names
from cableway.scene.arm_models import ArmModel
from cableway.scene.cell import Way
from cableway.scene.task import CONTROL_STEP, Task

if TYPE_CHECKING:
    from cableway.workflow.trajectory import Trajectory

CURVE_OF_JOINTS = "smoothed joint by joint: where the arms carry the grippers is near the gripper poses, not just there"
"""What the header says of joints at a rate."""


@dataclass(frozen=True, kw_only=True)
class JointMotion:
    """Joints of the left and the right arm at the times of a trajectory.

    Attributes:
        names: Of the j joints of each arm.
        positions: (k, 2, j) [rad], without jumps.
        velocities: (k, 2, j) [rad/s]; None of rows that are no curve.
        accelerations: (k, 2, j) [rad/s²]; None of rows that are no curve.
        models: Of the two arms; None where it is not said which they are.
    """

    names: tuple[tuple[str, ...], tuple[str, ...]]
    positions: Float[np.ndarray, "k 2 j"]
    velocities: Float[np.ndarray, "k 2 j"] | None = None
    accelerations: Float[np.ndarray, "k 2 j"] | None = None
    models: tuple[ArmModel, ArmModel] | None = None


class HandColumns(NamedTuple):
    """The hands at the times of a trajectory, left then right.

    Attributes:
        height: (k, 2) of where they hold the cable, or would, above the table [m].
        opening: (k, 2) distance of the fingers that they are asked for [m]; 0 where they close on the cable.
    """

    height: Float[np.ndarray, "k 2"]
    opening: Float[np.ndarray, "k 2"]


def joint_motion(
    rows: Float[np.ndarray, "t 2 j"], at: Float[np.ndarray, "k"] | None, step: float,
    models: tuple[ArmModel, ArmModel] | None, names: tuple[tuple[str, ...], tuple[str, ...]] | None = None,
) -> JointMotion:  # fmt: skip
    """Joints at fractional indices of rows that are a time [s] apart; the rows themselves where there are none.

    Without names of joints they are those of `joint_names`.
    """
    names = names or (joint_names(rows.shape[2]), joint_names(rows.shape[2]))
    if at is None:
        return JointMotion(names=names, positions=rows, models=models)
    positions, velocities, accelerations = (smoothed(rows, at, order) / step**order for order in range(3))
    return JointMotion(
        names=names, positions=positions, velocities=velocities, accelerations=accelerations, models=models
    )


def curve_of(rows: Float[np.ndarray, "t 2 j"] | None) -> Float[np.ndarray, "t+2 2 j"] | None:
    """The curve of rows at each control step; None of none."""
    return None if rows is None else smoothed(rows, np.arange(-1.0, len(rows) + 1))


def joint_header(motion: JointMotion, times: Float[np.ndarray, "k"]) -> dict[str, Any]:
    """What the header says of the joints; speeds and accelerations by the differences of rows, from rest to rest."""
    spacing = np.diff(times)[:, None, None]
    speeds = np.diff(motion.positions, axis=0) / spacing
    still = np.zeros_like(speeds[:1])
    changes = np.diff(np.concatenate([still, speeds, still]), axis=0)
    between = np.concatenate([spacing[:1], (spacing[1:] + spacing[:-1]) / 2, spacing[-1:]])
    header = {
        "names": list(motion.names[0]) if motion.names[0] == motion.names[1] else [list(each) for each in motion.names],
        "unit": "rad",
        "reached": {
            "speed": float(np.abs(speeds).max(initial=0.0)),
            "acceleration": float(np.abs(changes / between).max(initial=0.0)),
        },
    }
    if motion.models is not None:
        header["models"] = [model.name for model in motion.models]
    return header if motion.velocities is None else {**header, "curve": CURVE_OF_JOINTS}


def with_hands(trajectory: Trajectory, plan: Plan, task: Task, rate: float | None) -> Trajectory:
    """The trajectory of a plan with its approach before and its retreat after, where there are any.

    Args:
        trajectory: Of the plan alone.
        plan: The plan, verified.
        task: The task.
        rate: Rows per second [Hz]; one per control step where None.
    """
    way, joints = Way.of_record(plan.metadata), trajectory.joints
    if joints is None or way is None or (plan.approach is None and plan.retreat is None):
        return trajectory
    assert task.cell is not None
    step = CONTROL_STEP if rate is None else 1 / rate
    parts, wide = [joints], [np.zeros(len(trajectory.times))]
    before, after = plan.metadata["arms"]["opening"]
    if plan.approach is not None:
        down = _sampled(plan.approach, rate, joints.models)
        closing = _standing(down, -1, round(CLOSING / step) - 1)
        parts, wide = [down, closing, *parts], [np.full(_rows(down), before), np.zeros(_rows(closing)), *wide]
    wait = sum(map(_rows, parts[:-1]))
    if plan.retreat is not None:
        up = _sampled(plan.retreat, rate, joints.models)
        opening = _standing(up, 0, round(CLOSING / step) - 1)
        parts, wide = [*parts, opening, up], [*wide, np.full(_rows(opening) + _rows(up), after)]
    motion, asked = _joined(parts), np.concatenate(wide)
    times, pad = step * np.arange(len(asked)), (wait, len(asked) - wait - len(trajectory.times))
    poses, shapes = (
        None if rows is None else np.pad(rows, [pad, (0, 0), (0, 0)], mode="edge")
        for rows in (trajectory.poses, trajectory.shapes)
    )
    assert poses is not None
    changes = np.flatnonzero(np.diff(asked, prepend=np.nan) != 0)
    header = {
        **trajectory.header,
        "duration": float(times[-1]),
        "joints": {**trajectory.header["joints"], **joint_header(motion, times)},
        "hands": {
            "tool": task.cell.tool,
            "plan": [float(times[wait]), float(times[-1 - pad[1]])],
            "commands": [{"time": float(times[k]), "opening": float(asked[k])} for k in changes],
        },
    }
    hands = HandColumns(CellKinematics(task, way).heights(motion.positions), np.column_stack([asked, asked]))
    return replace(trajectory, times=times, poses=poses, shapes=shapes, joints=motion, hands=hands, header=header)


def require_2f_85(trajectory: Trajectory, what: str) -> None:
    """Refuse to put the openings of another hand than a 2F-85 into positions of one.

    Raises:
        InputError: The hands are others; the message says `what` has no commands for them.
    """
    tool = trajectory.header["hands"]["tool"]
    if not tool.startswith("2f-85"):
        raise InputError(
            f"{what} has commands for the hands of a 2F-85 only, and the cell's tool is {tool}; CSV and JSON have how "
            "wide they are to open [m]"
        )


def _rows(motion: JointMotion) -> int:
    return len(motion.positions)


def _sampled(
    rows: Float[np.ndarray, "t 2 j"], rate: float | None, models: tuple[ArmModel, ArmModel] | None
) -> JointMotion:
    """Rows as they are, or a curve at a rate [Hz] from rest to rest."""
    if rate is None:
        return joint_motion(rows, None, CONTROL_STEP, models)
    count = int(np.ceil((len(rows) + 1) * CONTROL_STEP * rate - 1e-9)) + 1
    at = np.minimum(np.arange(count) / rate / CONTROL_STEP - 1, len(rows))
    return joint_motion(rows, at, CONTROL_STEP, models)


def _standing(motion: JointMotion, row: int, count: int) -> JointMotion:
    """Rows of arms that stand as they do in a row of a motion."""
    still = np.zeros_like(motion.positions[:1]).repeat(count, axis=0)
    curve = None if motion.velocities is None else still
    return replace(
        motion, positions=motion.positions[[row]].repeat(count, axis=0), velocities=curve, accelerations=curve
    )


def _joined(parts: list[JointMotion]) -> JointMotion:
    """Motions one after the other."""

    def column(name: str) -> Float[np.ndarray, "k 2 j"] | None:
        found = [getattr(part, name) for part in parts]
        return None if found[0] is None else np.concatenate(found)

    positions = column("positions")
    assert positions is not None
    return replace(
        parts[0], positions=positions, velocities=column("velocities"), accelerations=column("accelerations")
    )
