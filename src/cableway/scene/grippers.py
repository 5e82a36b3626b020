"""The grippers, the plug that the right one may hold, and the port it goes to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.core.quantities import quantity
from cableway.geometry import se2
from cableway.scene import checks
from cableway.scene.bodies import LEFT, RIGHT, Body
from cableway.scene.checks import Quantity
from cableway.scene.gripper_bodies import MOST_LIFT, BodyPart, Tilt, gripper_body, lift_of

PlugLength = Annotated[float, "a length", Quantity("m", 1e-4, 1.0)]

SIDES = (("left gripper", LEFT), ("right gripper", RIGHT))
"""What messages call the grippers, and the side of their bodies."""

RAMPS = ("max_acceleration", "max_turn_acceleration", "max_jerk", "max_turn_jerk")
"""Limits of grippers that are not set by default."""


def bodies_of_hands(parts: tuple[BodyPart, ...], tilt: float) -> tuple[Body, ...]:
    """The pieces of both grippers as bodies, tilted outward [rad]."""
    lift = lift_of(parts, tilt)
    return tuple(body for part in parts for name, side in SIDES for body in part.bodies(name, side, tilt, lift))


@dataclass(frozen=True, kw_only=True)
class Grippers:
    """Footprint and limits of both grippers.

    Attributes:
        radius: Of the disc each gripper covers [m].
        max_step: Largest move in one control step [m].
        max_turn: Largest turn in one control step [rad].
        separation: Least distance between the two grippers' centres [m]; never below what their discs need.
        body: What else of a gripper takes room: a name of `GRIPPER_BODIES` or pieces; None for the disc alone.
        tilt: By which hands lean outward from straight down [rad], away from the cable along its tangent.
        max_acceleration: Of a gripper's position along a plan [m/s²]; None for no limit.
        max_turn_acceleration: Of its angle [rad/s²].
        max_jerk: Of its position [m/s³].
        max_turn_jerk: Of its angle [rad/s³].

    Raises:
        TaskError: A value is not finite or out of range, there is no such body, or it is tilted too far.

    Note:
        A plan with one of the last four starts and ends at rest: velocity, acceleration and jerk are the first,
        second and third differences of the rows, with the first and last row repeated before and after.
    """

    radius: Annotated[float, "a length", Quantity("m", 1e-4, 0.5)] = 0.004
    max_step: Annotated[float, "a length", Quantity("m", 1e-5, 1.0)] = 0.0133
    max_turn: Annotated[float, "an angle", Quantity("rad", 1e-4, math.pi)] = 0.133
    separation: Annotated[float, "a length", Quantity("m", 0.0, 10.0)] = 0.0
    body: str | tuple[BodyPart, ...] | None = None
    tilt: Tilt = 0.0
    max_acceleration: Annotated[float | None, "a number", Quantity("m/s^2", 1e-3, 1e3)] = None
    max_turn_acceleration: Annotated[float | None, "a number", Quantity("rad/s^2", 1e-2, 1e4)] = None
    max_jerk: Annotated[float | None, "a number", Quantity("m/s^3", 1e-3, 1e5)] = None
    max_turn_jerk: Annotated[float | None, "a number", Quantity("rad/s^3", 1e-2, 1e6)] = None

    def __post_init__(self) -> None:
        checks.check_quantities(self, "grippers")
        try:
            pieces = gripper_body(self.body)
        except TaskError as error:
            raise error.within("grippers") from None
        if self.body is not None and not isinstance(self.body, str):
            object.__setattr__(self, "body", pieces)
        if (lift := lift_of(pieces, self.tilt)) > MOST_LIFT:
            who = self.body if isinstance(self.body, str) else "such grippers"
            above = f"fingers of {who} keep off the table only {quantity(lift)} higher, limit {quantity(MOST_LIFT)}"
            raise TaskError(f"must be less: {above}, got {self.tilt:g}", ("grippers", "tilt"))

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The discs and the pieces of both grippers."""
        return (*(Body.disc(name, side, self.radius) for name, side in SIDES), *self.pieces)

    @property
    def pieces(self) -> tuple[Body, ...]:
        """What both grippers have beyond their discs."""
        return bodies_of_hands(gripper_body(self.body), self.tilt)

    def efforts(self, motion: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2"]:
        """Share of a control step's limits that the motion [m, m, rad] of each gripper takes."""
        return np.maximum(np.linalg.norm(motion[:, :2], axis=1) / self.max_step, np.abs(motion[:, 2]) / self.max_turn)

    @property
    def has_ramps(self) -> bool:
        """Whether acceleration or jerk is limited."""
        return any(getattr(self, name) is not None for name in RAMPS)

    @property
    def least_span(self) -> float:
        """Least distance [m] between the centres: `separation`, or two radii where that is more."""
        return max(self.separation, 2 * self.radius)


@dataclass(frozen=True, kw_only=True)
class Plug:
    """A rigid plug that ends the cable: the right gripper holds both, and the plug is ahead, along the tangent there.

    Attributes:
        length: How far it reaches ahead [m].
        width: [m].

    Raises:
        TaskError: A value is not positive and finite.
    """

    length: PlugLength
    width: PlugLength

    def __post_init__(self) -> None:
        checks.check_quantities(self, "plug")

    @property
    def body(self) -> Body:
        """The plug as a body on the right gripper."""
        return Body.box("plug", RIGHT, self.length, self.width)


@dataclass(frozen=True)
class Alignment:
    """Where the tip of a plug is, seen along a port.

    Attributes:
        depth: How far [m] it is in; negative before the mouth.
        lateral: How far [m] it is to the left of the port's axis.
        angle: Turn [rad] of the plug from that axis.
    """

    depth: Float[np.ndarray, "..."]
    lateral: Float[np.ndarray, "..."]
    angle: Float[np.ndarray, "..."]


@dataclass(frozen=True, kw_only=True)
class Port:
    """Where the plug goes.

    Attributes:
        position: Mouth of the port (x, y) [m].
        angle: Direction of insertion [rad].
        standoff: Distance [m] of the plug's tip before the mouth at the goal.
        depth: How far [m] the plug goes in.

    Raises:
        TaskError: A value is not finite or out of range.
    """

    position: checks.Point
    angle: checks.Radians
    standoff: Annotated[float, "a length", Quantity("m", 0.0, 1.0)]
    depth: Annotated[float, "a length", Quantity("m", 0.0, 1.0)]

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", checks.pair(self.position, ("port", "position"), checks.COORDINATE))
        checks.check_quantities(self, "port")

    def pose(self, plug: Plug, depth: float) -> Float[np.ndarray, "3"]:
        """The rear of an aligned plug [m, m, rad] whose tip is `depth` [m] in; negative before the mouth."""
        return np.array([*self.position + (depth - plug.length) * se2.direction(self.angle), self.angle])

    def alignment(self, plug: Plug, poses: Float[np.ndarray, "... 3"]) -> Alignment:
        """Where the tip is with the rear at `poses` [m, m, rad]."""
        poses = np.asarray(poses, float)
        offset = poses[..., :2] + plug.length * se2.direction(poses[..., 2]) - self.position
        along, aside = se2.direction(self.angle), se2.direction(self.angle + np.pi / 2)
        return Alignment(offset @ along, offset @ aside, se2.wrap_angle(poses[..., 2] - self.angle))
