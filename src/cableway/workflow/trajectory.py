"""Gripper poses and joint positions by time, for a robot: a plan or a rollout in files that need no cableway."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.core.files import write_text
from cableway.core.provenance import PACKAGE, describe, versions
from cableway.geometry.groups import SE2
from cableway.motion.resampling import smoothed
from cableway.records import Plan, Rollout, Verdict
from cableway.scene.arm_models import ArmModel
from cableway.scene.cell import Way
from cableway.scene.described_arms import DescribedArms
from cableway.scene.files.loading import TaskSource, as_task
from cableway.scene.grippers import Grippers
from cableway.scene.task import CONTROL_STEP, Task
from cableway.verification import kind_of, require_verified, verify_record
from cableway.workflow import ros, urscript
from cableway.workflow.joint_motion import HandColumns, JointMotion, curve_of, joint_header, joint_motion, with_hands

FORMAT = "cableway trajectory 1"
SIDES = ("left", "right")
RATES = (1.0, 10_000.0)
"""Least and greatest rate [Hz]."""

UNEVEN = 1e-6
"""Difference [s] of control steps from which on they are not equal."""


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes:
        suffix: How its name ends.
        rate: Rows per second [Hz] where none is asked for; the record's own rows where None.
        per_arm: Whether there is a file for each arm.
    """

    suffix: str
    rate: float | None = None
    per_arm: bool = False


FORMATS = {
    "csv": Format(".csv"),
    "json": Format(".json"),
    "urscript": Format(".script", urscript.RATES[0], per_arm=True),
    "ros": Format(".yaml", 1 / CONTROL_STEP, per_arm=True),
}
"""By name. At one row per control step, the quintic splines of a ROS 2 controller are the curve itself."""

CONVENTIONS = {
    "frame": "the task's: the plane of the table, right-handed, x to the right, y up, origin in the lower left corner "
    "of the workspace; theta counter-clockwise from +x, running on without jumps",
    "units": {"time": "s", "x": "m", "y": "m", "theta": "rad"},
    "tool_point": "where the cable's end is held; theta is the direction of the cable's tangent there, from the left "
    "end to the right one",
    "use": "open loop: nothing corrects the cable; not tried on hardware",
}
"""What the header of every file says."""


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """Gripper poses by time, from rest to rest.

    Attributes:
        times: (k,) [s], from 0.
        poses: (k, 2, 3) gripper poses [m, m, rad], left then right, angles without jumps.
        shapes: (k, n, 2) keypoints of the cable [m] at these times; None where they were not asked for.
        joints: Joints of the arms; None where the record has none.
        hands: How high and how wide open the hands are; None where the record has no approach or retreat.
        header: What a reader has to know, as plain data: frame, units, limits, where it comes from.
    """

    times: Float[np.ndarray, "k"]
    poses: Float[np.ndarray, "k 2 3"]
    shapes: Float[np.ndarray, "k n 2"] | None
    joints: JointMotion | None = None
    hands: HandColumns | None = None
    header: Mapping[str, Any]

    @classmethod
    def of(
        cls,
        record: Plan | Rollout,
        task: TaskSource,
        *,
        rate: float | None = None,
        cable: bool = False,
        unverified: bool = False,
        source: str = "the record",
        arms: DescribedArms | None = None,
    ) -> Trajectory:
        """The trajectory of a plan, or of what the grippers did in a rollout.

        Args:
            record: The plan or rollout.
            task: The task that it is of.
            rate: Rows per second [Hz], on the curve of `motion.resampling.smoothed`, which keeps the limits that the
                record's rows keep and takes two control steps more; the record's own rows where None.
            cable: Whether the shapes of the cable are in it.
            unverified: Whether a record that does not verify is taken, too.
            source: What the record is called in errors and in the header.
            arms: Two arms of any kind that are to follow a plan; see `workflow.described_arms.follow_plan` for what
                else it then raises.

        Raises:
            InputError: The record does not verify, or its curve does not; the rate is out of range; the rows of a
                rollout are not at equal times, and a rate is asked for; or there is one only.
        """
        task = as_task(task)
        verdict = verify_record(record, task) if unverified else require_verified(record, task, source)
        shapes = record.shapes if isinstance(record, Plan) else record.keypoints
        poses = record.poses.copy()
        poses[..., SE2.space :] = np.unwrap(poses[..., SE2.space :], axis=0)
        header, joints = _header(record, task, source), record.joints
        if rate is None:
            times, at = _times(record, source), None
            checked, how = "the rows", {"off_rows": {"distance": 0.0, "turn": 0.0}}
        else:
            times, at = _even_times(_times(record, source), rate, source)
            checked, how = _checked_curve(record, poses, task, source, unverified), {"rate": rate, **_curve(poses)}
            poses, shapes = smoothed(poses, at), smoothed(shapes, at)
        header |= {
            "verified": checked if verdict.passed else f"no: {_first(verdict)}",
            **how,
            "duration": float(times[-1]),
            "limits": limits_of(task.grippers),
            "reached": greatest_rates(times, poses),
        }
        motion, of_arms = None, describe(record.metadata.get("arms", {}))
        if arms is not None:
            from cableway.workflow.described_arms import arms_header, follow_plan  # with an extra, which few need

            followed = follow_plan(record, task, arms, source)
            motion = joint_motion(followed.joints, at, _step(record), None, followed.names)
            of_arms = arms_header(followed, arms)
        elif joints is not None:
            motion = joint_motion(joints, at, _step(record), _models(record, task))
        if motion is not None:
            header["joints"] = {"arms": of_arms, **joint_header(motion, times)}
        found = cls(times=times, poses=poses, shapes=shapes if cable else None, joints=motion, header=header)
        return with_hands(found, record, task, rate) if isinstance(record, Plan) else found

    def write(self, path: Path | str) -> list[Path]:
        """Write a file of the format that its name ends in (see `FORMATS`), or one for each arm; which they are.

        Where each arm has its own, "-left" and "-right" go before the ending.

        Raises:
            InputError: Its name ends otherwise, or the format cannot hold this trajectory.
        """
        path = Path(path)
        name = format_of(path)
        if not FORMATS[name].per_arm:
            texts = {path: self.to_json() if name == "json" else self.to_csv()}
        else:
            text = urscript.program if name == "urscript" else ros.message
            texts = {path.with_stem(f"{path.stem}-{side}"): text(self, arm) for arm, side in enumerate(SIDES)}
            if name == "ros" and self.hands is not None:
                texts |= {
                    path.with_stem(f"{path.stem}-{side}-gripper"): ros.gripper_message(self, arm)
                    for arm, side in enumerate(SIDES)
                }
        for each, content in texts.items():
            write_text(each, content)
        return list(texts)

    def to_csv(self) -> str:
        """Lines `# name: value` with the values as JSON, then names of columns, then a line for each row."""
        table = np.column_stack([self.times, self.poses.reshape(len(self.times), -1)])
        names = ["time", *(f"{side}_{name}" for side in SIDES for name in ("x", "y", "theta"))]
        for unit, values in self._joint_columns().items():
            table = np.column_stack([table, values.reshape(len(table), -1)])
            assert self.joints is not None
            names += [f"{side}_{name}{unit}" for arm, side in enumerate(SIDES) for name in self.joints.names[arm]]
        if self.hands is not None:
            table = np.column_stack([table, self.hands.height, self.hands.opening])
            names += [f"{side}_{name}" for name in HandColumns._fields for side in SIDES]
        if self.shapes is not None:
            table = np.column_stack([table, self.shapes.reshape(len(table), -1)])
            names += [f"{axis}{k}" for k in range(self.shapes.shape[1]) for axis in "xy"]
        text = io.StringIO()
        text.writelines(f"# {name}: {json.dumps(value, allow_nan=False)}\n" for name, value in self.header.items())
        csv.writer(text, lineterminator="\n").writerows([names, *table.tolist()])
        return text.getvalue()

    def to_json(self) -> str:
        """One object: `header`, `time` (k), `left` and `right` (k, 3), and what there is of the following.

        `left_joints`, `right_joints` (k, j), the same with `_velocity` and `_acceleration`, `left_height`,
        `right_height`, `left_opening`, `right_opening` (k), and `cable` (k, n, 2).
        """
        left, right = self.poses[:, 0], self.poses[:, 1]
        arrays = {"time": self.times, "left": left, "right": right}
        for quantity, values in self._joint_columns().items():
            arrays |= {f"{side}_joints{quantity}": values[:, arm] for arm, side in enumerate(SIDES)}
        for name, values in ({} if self.hands is None else self.hands._asdict()).items():
            arrays |= {f"{side}_{name}": values[:, arm] for arm, side in enumerate(SIDES)}
        if self.shapes is not None:
            arrays["cable"] = self.shapes
        content = {"header": dict(self.header), **{name: array.tolist() for name, array in arrays.items()}}
        return json.dumps(content, allow_nan=False) + "\n"

    def _joint_columns(self) -> dict[str, Float[np.ndarray, "k 2 j"]]:
        """What there is of the joints, by what their names end in."""
        if self.joints is None:
            return {}
        motion = self.joints
        columns = {"": motion.positions, "_velocity": motion.velocities, "_acceleration": motion.accelerations}
        return {name: values for name, values in columns.items() if values is not None}


def format_of(path: Path) -> str:
    """The format whose ending a file's name has.

    Raises:
        InputError: None has it.
    """
    found = [name for name, each in FORMATS.items() if each.suffix == path.suffix.lower()]
    if not found:
        *first, last = (each.suffix for each in FORMATS.values())
        raise InputError(f"{path}: the name of a trajectory's file must end in {', '.join(first)} or {last}")
    return found[0]


def limits_of(grippers: Grippers) -> dict[str, float | None]:
    """Limits of a gripper's speed, acceleration and jerk [m, s] and of those of its angle [rad, s]; None for none."""
    return {
        "speed": grippers.max_step / CONTROL_STEP,
        "turn_rate": grippers.max_turn / CONTROL_STEP,
        "acceleration": grippers.max_acceleration,
        "turn_acceleration": grippers.max_turn_acceleration,
        "jerk": grippers.max_jerk,
        "turn_jerk": grippers.max_turn_jerk,
    }


def greatest_rates(times: Float[np.ndarray, "k"], poses: Float[np.ndarray, "k 2 3"]) -> dict[str, float]:
    """What `limits_of` limits, as the differences of the rows have it, from rest before them to rest after them."""
    found: dict[str, float] = {}
    spacing, rates = np.diff(times), SE2.minus(poses[1:], poses[:-1])
    still = np.zeros((1, 2, SE2.dof))
    for move, turn in (("speed", "turn_rate"), ("acceleration", "turn_acceleration"), ("jerk", "turn_jerk")):
        rates = rates / spacing[:, None, None]
        found[move] = float(np.linalg.norm(SE2.position(rates), axis=2).max(initial=0.0))
        found[turn] = float(np.abs(rates[..., SE2.space :]).max(initial=0.0))
        rates = np.diff(np.concatenate([still, rates, still]), axis=0)
        spacing = np.concatenate([spacing[:1], (spacing[1:] + spacing[:-1]) / 2, spacing[-1:]])
    return found


def _header(record: Plan | Rollout, task: Task, source: str) -> dict[str, Any]:
    """What does not depend on the rate."""
    n = task.cable.keypoints
    return {
        "format": FORMAT,
        "task": task.name,
        "source": {"kind": kind_of(record), "file": source, "seed": describe(record.metadata.get("seed"))},
        **CONVENTIONS,
        "grippers": {"left": "holds keypoint 0", "right": f"holds keypoint {n - 1}"},
        "control_step": CONTROL_STEP,
        "versions": describe(record.metadata.get("versions", {})),
        "written_by": f"{PACKAGE} {versions()[PACKAGE]}",
    }


def _times(record: Plan | Rollout, source: str) -> Float[np.ndarray, "t"]:
    """When its rows are [s], from 0."""
    if isinstance(record, Plan):
        return CONTROL_STEP * np.arange(record.steps + 1)
    if record.steps < 1 or (np.diff(record.times) <= 0).any():
        raise InputError(f"{source}: needs two rows or more, each later than the one before")
    return record.times - record.times[0]


def _models(record: Plan | Rollout, task: Task) -> tuple[ArmModel, ArmModel] | None:
    """Of the arms at the left and the right end; None where it is not said which arms hold them."""
    way = Way.of_record(record.metadata)
    return None if way is None or task.cell is None else task.cell.models_of(way)


def _step(record: Plan | Rollout) -> float:
    """Mean time [s] from row to row."""
    return CONTROL_STEP if isinstance(record, Plan) else float(np.diff(record.times).mean())


def _even_times(
    rows: Float[np.ndarray, "t"], rate: float, source: str
) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Times [s] at a rate [Hz] until the end of the curve, and the places in the rows that belong to them."""
    if not RATES[0] <= rate <= RATES[1]:
        raise InputError(f"the rate must be from {RATES[0]:g} to {RATES[1]:g} Hz, got {rate!r}")
    steps = np.diff(rows)
    step = float(steps.mean())
    if np.abs(steps - step).max() > UNEVEN:
        raise InputError(f"{source}: its rows are {steps.min():.4g} to {steps.max():.4g} s apart, for a rate they must "
                         "be at equal times; CSV and JSON take them as they are, without a rate")  # fmt: skip
    times = np.arange(int(np.ceil((len(rows) + 1) * step * rate - 1e-9)) + 1) / rate
    return times, np.minimum(times / step - 1, len(rows))


def _curve(poses: Float[np.ndarray, "t 2 3"]) -> dict[str, Any]:
    """What the header says of the curve."""
    distance, turn = SE2.distance(smoothed(poses, np.arange(len(poses), dtype=float)), poses)
    return {
        "curve": "uniform cubic B-spline of the rows, from one control step before the first to one after the last: it "
        "keeps what limits of speed, acceleration and jerk the rows keep",
        "off_rows": {"distance": float(distance.max()), "turn": float(turn.max())},
    }


def _checked_curve(
    record: Plan | Rollout, poses: Float[np.ndarray, "t 2 3"], task: Task, source: str, unverified: bool
) -> str:
    """What of a record was verified, its curve with it where it is a plan's.

    Raises:
        InputError: The curve does not verify, and has to.
    """
    if not isinstance(record, Plan) or unverified:
        return "the rows"
    at = np.arange(-1.0, len(poses) + 1)
    curve = replace(
        record,
        shapes=smoothed(record.shapes, at),
        poses=smoothed(poses, at),
        q=None,
        stages=None,
        joints=curve_of(record.joints),
        approach=curve_of(record.approach),
        retreat=curve_of(record.retreat),
    )
    require_verified(curve, task, f"{source}, as a curve")
    return "the rows, and the curve at each control step"


def _first(verdict: Verdict) -> str:
    return str(verdict.failures()[0])
