"""Joint positions or gripper poses by time as a message of ROS 2, in YAML.

Each file holds one message with the fields of its definition and nothing else: what `ros2 topic pub` takes, and what
`rosidl_runtime_py.set_message_fields` fills a message with.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.geometry.groups import SE2
from cableway.robot.grasping import CLOSING
from cableway.workflow.joint_motion import require_2f_85

if TYPE_CHECKING:
    from cableway.workflow.trajectory import Trajectory

FRAME = "table"
"""`frame_id` of gripper poses."""

GRIPPER_JOINT, CLOSED, WIDEST = "robotiq_85_left_knuckle_joint", 0.7929, 0.085
"""Joint of a 2F-85 in ros2_robotiq_gripper, its position where the hand is closed [rad], and the distance of the
fingers where it is open, at 0 [m]; evenly between."""

NANO = 10**9


def message(trajectory: Trajectory, arm: int) -> str:
    """The message of an arm, or of a gripper, 0 for the left one: a JointTrajectory where there are joints, or a Path.

    Raises:
        InputError: There are joints, but no rate.
    """
    side = ("left", "right")[arm]
    if trajectory.joints is None:
        kind, content = "nav_msgs/msg/Path", _path(trajectory.times, trajectory.poses[:, arm])
    else:
        kind, content = "trajectory_msgs/msg/JointTrajectory", _joint_trajectory(trajectory, arm, side)
    header = {"message": kind, "arm": side, **trajectory.header}
    return _text(header, content)


def gripper_message(trajectory: Trajectory, arm: int) -> str:
    """A JointTrajectory of the hand of an arm: where it begins to open or to close, and where it has.

    Raises:
        InputError: It is no 2F-85.
    """
    require_2f_85(trajectory, "a message of ROS 2")
    hands, side = trajectory.hands, ("left", "right")[arm]
    assert hands is not None
    asked = hands.opening[:, arm]
    changes = np.flatnonzero(np.diff(asked))
    moves = [(trajectory.times[k], asked[k]) for k in changes]
    moves += [(trajectory.times[k] + CLOSING, asked[k + 1]) for k in changes]
    points = [
        {
            "positions": [float(CLOSED * (1 - opening / WIDEST))],
            "velocities": [],
            "accelerations": [],
            "effort": [],
            "time_from_start": _time(now),
        }
        for now, opening in sorted([(0.0, asked[0]), *moves])
    ]
    content = {"header": _header(0.0, ""), "joint_names": [f"{side}_{GRIPPER_JOINT}"], "points": points}
    header = {"message": "trajectory_msgs/msg/JointTrajectory", "gripper": side, **trajectory.header}
    return _text(header, content)


def _text(header: dict[str, Any], content: dict[str, Any]) -> str:
    comments = "".join(f"# {name}: {json.dumps(value)}\n" for name, value in header.items())
    return comments + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=1000)


def _joint_trajectory(trajectory: Trajectory, arm: int, side: str) -> dict[str, Any]:
    joints = trajectory.joints
    assert joints is not None
    if joints.velocities is None or joints.accelerations is None:
        raise InputError("a JointTrajectory has velocities and accelerations, and only a curve has these: give a rate")
    columns = (joints.positions, joints.velocities, joints.accelerations)
    return {
        "header": _header(0.0, ""),
        "joint_names": [f"{side}_{name}" for name in joints.names[arm]],
        "points": [
            {
                "positions": positions.tolist(),
                "velocities": velocities.tolist(),
                "accelerations": accelerations.tolist(),
                "effort": [],
                "time_from_start": _time(now),
            }
            for now, positions, velocities, accelerations in zip(
                trajectory.times, *(column[:, arm] for column in columns), strict=True
            )
        ],
    }


def _path(times: Float[np.ndarray, "k"], poses: Float[np.ndarray, "k 3"]) -> dict[str, Any]:
    """The plane of the table is z = 0; the orientation turns about z."""
    places, angles = SE2.position(poses).tolist(), poses[:, SE2.space].tolist()
    return {
        "header": _header(0.0, FRAME),
        "poses": [
            {
                "header": _header(now, FRAME),
                "pose": {
                    "position": {"x": x, "y": y, "z": 0.0},
                    "orientation": {"x": 0.0, "y": 0.0, "z": float(np.sin(turn / 2)), "w": float(np.cos(turn / 2))},
                },
            }
            for now, (x, y), turn in zip(times, places, angles, strict=True)
        ],
    }


def _header(now: float, frame: str) -> dict[str, Any]:
    return {"stamp": _time(now), "frame_id": frame}


def _time(now: float) -> dict[str, int]:
    """Fields of a builtin_interfaces/msg/Time or Duration."""
    sec, nanosec = divmod(round(float(now) * NANO), NANO)
    return {"sec": sec, "nanosec": nanosec}
