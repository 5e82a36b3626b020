"""Arms of one's own, of the structure of those in `cableway.scene.arm_models`: other lengths, limits and capsules."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from cableway.core.errors import TaskError
from cableway.scene import checks
from cableway.scene.arm_models import ARM_MODELS, JOINT_NAMES, PLACE, ArmModel, Capsule, Metres
from cableway.scene.checks import ANGLE, Quantity, Radians

TWISTS = (90, 0, 0, 90, -90, 0)
"""Of the Denavit-Hartenberg parameters, from base to flange [degrees]."""

LENGTHS = ((1, 0), (0, 1), (0, 2), (1, 3), (1, 4), (1, 5))
"""Column (a or d) and row of the parameters that may be other than zero: d1, a2, a3, d4, d5, d6."""

NEEDED = ((0, 1), (0, 2), (1, 5))
"""Of these, by which the inverse kinematics divides."""

SHORTEST, NOTHING, ROUNDED = 0.01, 1e-6, 3e-4
"""Least of them [m], what counts as zero of the others [m], and of differences of twists [rad], as in 1.571."""

KNOWN = "the only structure known is that of a UR: twists of 90, 0, 0, 90, -90, 0 degrees and d1, a2, a3, d4, d5, d6"
"""What messages say of that."""

RANGE = Quantity("rad", 1e-3, 4 * math.pi)
SPEED, ACCELERATION = Quantity("rad/s", 1e-3, 10 * math.pi), Quantity("rad/s²", 1e-2, 1e4)
TORQUE, STIFFNESS = Quantity("N m", 1e-2, 1e4), Quantity("N m/rad", 1.0, 1e6)
LIMITS = {
    "position_limit": RANGE,
    "speed_limit": SPEED,
    "acceleration_limit": ACCELERATION,
    "torque_limit": TORQUE,
    "stiffness": STIFFNESS,
}
SIX = "six numbers, from base to flange"


@dataclass(frozen=True, kw_only=True)
class OwnArm:
    """An arm as a file gives it.

    Attributes:
        name: As messages write it.
        like: The model of `ARM_MODELS` whose masses it has, and whose limits and stiffness where it states none.
        dh: a [m], d [m] and alpha [rad] of each joint's Denavit-Hartenberg parameters: from a frame to the next, turned
            and moved by d about and along z, then moved by a and turned by alpha along and about x.
        capsules: That hold its links, at least one for each of the seven frames.
        position_limit: Of each joint to either side [rad]. It must keep links that are less than three joints apart
            from each other.
        speed_limit: Of each joint [rad/s].
        acceleration_limit: Of each joint [rad/s²].
        torque_limit: Of each joint [N m].
        stiffness: With which the servo of each joint holds its position [N m/rad].

    Raises:
        TaskError: The arm is of another structure, a link is without a capsule, or a number is out of range.
    """

    name: Annotated[str, "a short text"]
    like: Annotated[str, ", ".join(ARM_MODELS)]
    dh: Annotated[
        tuple[Annotated[tuple[Metres, Metres, Radians], "three numbers [a, d, alpha]"], ...], "a list of six rows"
    ]
    capsules: Annotated[tuple[Capsule, ...], "a list of capsules"]
    position_limit: Annotated[tuple[Annotated[float, "a number", RANGE], ...] | None, SIX] = None
    speed_limit: Annotated[tuple[Annotated[float, "a number", SPEED], ...] | None, SIX] = None
    acceleration_limit: Annotated[tuple[Annotated[float, "a number", ACCELERATION], ...] | None, SIX] = None
    torque_limit: Annotated[tuple[Annotated[float, "a number", TORQUE], ...] | None, SIX] = None
    stiffness: Annotated[tuple[Annotated[float, "a number", STIFFNESS], ...] | None, SIX] = None

    def __post_init__(self) -> None:
        if self.like not in ARM_MODELS:
            raise TaskError(f"must be one of {', '.join(ARM_MODELS)}, got {self.like!r}", ("like",))
        rows = checks.rows(self.dh, ("dh",), (PLACE, PLACE, ANGLE))
        _check_structure(rows.tolist())
        object.__setattr__(self, "dh", tuple(tuple(row) for row in rows.tolist()))
        object.__setattr__(self, "capsules", tuple(self.capsules))
        without = set(range(len(JOINT_NAMES) + 1)) - {each.frame for each in self.capsules}
        if without:
            raise TaskError(f"must hold every link, there is none of frame {min(without)}", ("capsules",))
        for name, quantity in LIMITS.items():
            if (values := getattr(self, name)) is not None:
                found = checks.profile(values, (name,), len(JOINT_NAMES), quantity)
                if len(found) != len(JOINT_NAMES):
                    raise TaskError(f"must be {SIX}, got {len(found)}", (name,))
                object.__setattr__(self, name, found)

    @property
    def model(self) -> ArmModel:
        """What the arm is."""
        stated = {name: value for name in LIMITS if (value := getattr(self, name)) is not None}
        lengths = tuple(self.dh[row][column] for column, row in LENGTHS)
        return replace(ARM_MODELS[self.like], name=self.name, lengths=lengths, capsules=self.capsules, **stated)


def _check_structure(rows: list[list[float]]) -> None:
    """Raise a TaskError where Denavit-Hartenberg parameters are not those of an arm whose inverse is known."""
    if len(rows) != len(JOINT_NAMES):
        raise TaskError(f"has {len(rows)} joints, and {KNOWN}", ("dh",))
    for index, row in enumerate(rows):
        off = math.remainder(row[2] - math.radians(TWISTS[index]), 2 * math.pi)
        if abs(off) > ROUNDED:
            raise TaskError(
                f"is {math.degrees(row[2]):.6g} degrees, not {TWISTS[index]}, and {KNOWN}", ("dh", index, 2)
            )
        for column in range(2):
            place, value = ("dh", index, column), row[column]
            if (column, index) not in LENGTHS and abs(value) > NOTHING:
                raise TaskError(f"is {value:g} m, not 0, and {KNOWN}", place)
            if (column, index) in NEEDED and abs(value) < SHORTEST:
                raise TaskError(f"is {value:g} m, less than {SHORTEST:g} m, and {KNOWN}", place)
