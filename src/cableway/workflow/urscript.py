"""Joint positions by time as a program for an arm of Universal Robots, in URScript."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.core.quantities import quantity
from cableway.robot.ur_arm import GAIN, JOINTS, LOOKAHEAD, beyond_range
from cableway.scene.arm_models import UR5E
from cableway.workflow.joint_motion import require_2f_85

if TYPE_CHECKING:
    from cableway.workflow.trajectory import Trajectory

RATES = (125.0, 250.0, 500.0)
"""[Hz]: a row takes a whole number of the controller's cycles, of 8 ms (CB3) or 2 ms (e-Series)."""

AT_START = 0.002
"""Difference [rad] of a joint to the first row at which the program still starts: 2 mm for a tool 1 m away."""

SETTLING = 0.2
"""Time [s] for which the last row is held, for the arm to get there."""

DECELERATION = 2.0
"""Of `stopj` [rad/s²]."""

SIGNAL = 0
"""Standard digital input that starts both arms."""


GRIPPER = ("127.0.0.1", 63352, "gripper")
"""Where the maker's software of the 2F-85 (the Robotiq URCap) takes commands on the controller, and what a program
calls that."""

OPEN, WIDEST, CLOSED = 0, 0.085, 255
"""Positions of a 2F-85 that is open, `WIDEST` [m], and closed; evenly between."""

SPEED, FORCE = 85, 0
"""Of its fingers, of 255: 50 mm/s of 20 to 150, and the least force, 20 N of 20 to 235."""


def program(trajectory: Trajectory, arm: int) -> str:
    """The program of an arm, 0 for the left one: it checks the start, waits for the signal, follows the rows, stops.

    Raises:
        InputError: There are no joints, or not six; the rate is none of `RATES`; a row is beyond what the arm can do,
            a UR5e where it is not said which it is; or there are commands for other hands than a 2F-85's.
    """
    side = ("left", "right")[arm]
    rows, rate = _rows(trajectory, arm, side), trajectory.header["rate"]
    period = f"{1 / rate:.3f}"
    header = "".join(f"# {name}: {json.dumps(value)}\n" for name, value in trajectory.header.items())
    servo = f"0, 0, {{}}, {LOOKAHEAD}, {GAIN:g})"  # without acceleration and speed, which the maker does not use yet
    lines = [
        "def away(q, start):",
        "  local most = 0.0",
        "  local i = 0",
        f"  while i < {len(JOINTS)}:",
        "    if norm(q[i] - start[i]) > most:",
        "      most = norm(q[i] - start[i])",
        "    end",
        "    i = i + 1",
        "  end",
        "  return most",
        "end",
        *_gripper_ready(trajectory, arm),
        f"start = {_list(rows[0])}",
        *_halt_unless_at_start(side),
        f"if get_standard_digital_in({SIGNAL}):",
        *_halt(f"Digital input {SIGNAL} is on already. Switch it off, then start this program again."),
        "end",
        f"while not get_standard_digital_in({SIGNAL}):",
        "  sync()",
        "end",
        *_halt_unless_at_start(side),
        *_servo_lines(trajectory, arm, rows, servo.format(period)),
        f"servoj({_list(rows[-1])}, {servo.format(SETTLING)}",
        f"stopj({DECELERATION})",
    ]
    body = "".join(f"  {line}\n" for line in lines)
    title = f"# {side} arm, one row every {period} s, joints: {', '.join(JOINTS)} [rad]\n"
    return f"{title}{header}def cableway_{side}():\n{body}end\n"


def _servo_lines(trajectory: Trajectory, arm: int, rows: Float[np.ndarray, "k 6"], rest: str) -> list[str]:
    """A line for each row, and one before each row with which the hand is to open or close."""
    lines, hands = [], trajectory.hands
    asked = np.zeros(len(rows)) if hands is None else hands.opening[:, arm]
    for index, row in enumerate(rows):
        if index and asked[index] != asked[index - 1]:
            lines.append(_gripper_to(asked[index]))
        lines.append(f"servoj({_list(row)}, {rest}")
    return lines


def _gripper_ready(trajectory: Trajectory, arm: int) -> list[str]:
    """The hand is made ready and opens, before the arm is where it starts; nothing without commands for it."""
    if trajectory.hands is None:
        return []
    require_2f_85(trajectory, "URScript")
    address, port, name = GRIPPER
    settings = {"ACT": 1, "GTO": 1, "SPE": SPEED, "FOR": FORCE}
    return [
        f'socket_open("{address}", {port}, "{name}")',
        *(f'socket_set_var("{variable}", {value}, "{name}")' for variable, value in settings.items()),
        _gripper_to(trajectory.hands.opening[0, arm]),
    ]


def _gripper_to(opening: float) -> str:
    position = round(CLOSED + (OPEN - CLOSED) * min(opening / WIDEST, 1.0))
    return f'socket_set_var("POS", {position}, "{GRIPPER[2]}")'


def _rows(trajectory: Trajectory, arm: int, side: str) -> Float[np.ndarray, "k 6"]:
    if trajectory.joints is None:
        raise InputError(
            "a program for an arm needs joint positions, and the record has none: only runs in a cell with arms have"
        )
    if "described" in trajectory.header["joints"]["arms"]:
        raise InputError(
            "URScript is for arms of Universal Robots in a cell; these are described by a file of their own"
        )
    rows = trajectory.joints.positions[:, arm]
    if rows.shape[1] != len(JOINTS):
        raise InputError(f"a program in URScript needs {len(JOINTS)} joints an arm, and the record has {rows.shape[1]}")
    rate = trajectory.header.get("rate")
    if rate not in RATES:
        shown = "none" if rate is None else f"{rate:g}"
        raise InputError(f"the rate of a program in URScript must be 125, 250 or 500 Hz, got {shown}")
    model = UR5E if trajectory.joints.models is None else trajectory.joints.models[arm]
    if beyond := beyond_range(rows, model):
        raise InputError(f"the {side} arm {beyond}")
    speeds = np.abs(np.diff(rows, axis=0)).max(axis=0) * rate
    worst = int((speeds / model.speed_limit).argmax())
    if speeds[worst] > model.speed_limit[worst]:
        raise InputError(
            f"the {JOINTS[worst]} of the {side} arm turns at {quantity(float(speeds[worst]), 'rad/s')}, and that of a "
            f"{model.name} reaches {quantity(model.speed_limit[worst], 'rad/s')}; make the plan again with a lower "
            "--speed"
        )
    return rows


def _halt_unless_at_start(side: str) -> list[str]:
    said = f"The {side} arm is not at the start of its program. Move it there, then start the program again."
    return [f"if away(get_actual_joint_positions(), start) > {AT_START}:", *_halt(said), "end"]


def _halt(said: str) -> list[str]:
    return [f'  popup("{said}", title="cableway", error=True, blocking=True)', "  halt"]


def _list(row: Float[np.ndarray, "6"]) -> str:
    return f"[{', '.join(f'{value:.9f}' for value in row)}]"
