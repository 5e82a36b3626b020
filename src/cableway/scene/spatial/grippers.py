"""Grippers in space: their limits, and the convex bodies that move with them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.geometry import rotations
from cableway.geometry.spatial_convex import Solid
from cableway.scene import checks
from cableway.scene.bodies import LEFT
from cableway.scene.checks import Quantity
from cableway.scene.gripper_bodies import AXIS, GRIPPER_BODIES
from cableway.scene.grippers import SIDES
from cableway.scene.spatial.obstacles import corners

MOST_PIECES = 12
"""Of a gripper."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GripperPiece:
    """A convex piece of a gripper: the hull of points, grown by a radius.

    Attributes:
        points: (k, 3) [m] in a frame at the end of the cable whose x axis points *outward* along the cable, away from
            it at either end, and whose z axis points to the hand. One point is a ball.
        radius: By which the hull is grown [m].

    Raises:
        TaskError: There are two or three points, they lie in a plane, or a ball has no radius.
    """

    points: Annotated[Float[np.ndarray, "k 3"], "a list of 1 or at least 4 points [x, y, z]"]
    radius: Annotated[float, "a length", Quantity("m", 0.0, 1.0)] = 0.0

    def __post_init__(self) -> None:
        checks.check_quantities(self)
        points = checks.rows(self.points, ("points",), (checks.COORDINATE,) * 3)
        if len(points) != 1:
            points = corners(points, ("points",))
        elif not self.radius:
            raise TaskError("must be positive for a single point, got 0", ("radius",))
        object.__setattr__(self, "points", points)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, GripperPiece)
            and self.radius == other.radius
            and np.array_equal(self.points, other.points)
        )

    def __hash__(self) -> int:
        return hash((self.radius, self.points.tobytes()))


def named_body(name: str) -> tuple[GripperPiece, ...]:
    """The pieces of a gripper of `scene.gripper_bodies`, which are layers above a table, round the axis of the cable.

    Raises:
        TaskError: There is no gripper of that name.
    """
    if name not in GRIPPER_BODIES:
        raise TaskError(f"must be one of {', '.join(GRIPPER_BODIES)}, or a list of pieces, got {name!r}", ("body",))
    return tuple(
        GripperPiece(points=np.array([(*vertex, level - AXIS) for level in part.heights for vertex in part.outline]))
        for part in GRIPPER_BODIES[name]
    )


@dataclass(frozen=True, eq=False)
class SpatialBody:
    """A rigid convex body on the frame of a gripper, whose x axis is along the cable, left to right.

    Attributes:
        name: For messages, such as "left gripper".
        side: `scene.bodies.LEFT` or `RIGHT`.
        points: (k, 3) [m] in the gripper's frame; one point is a ball.
        radius: By which their hull is grown [m].
    """

    name: str
    side: int
    points: Float[np.ndarray, "k 3"]
    radius: float = 0.0

    @property
    def reach(self) -> float:
        """Farthest point of the body from the origin of its frame [m]."""
        return float(np.linalg.norm(self.points, axis=1).max()) + self.radius

    def held_arc(self, radius: float) -> float:
        """Length [m], from its gripper on, of a cable of a radius [m] that the body may touch.

        A body in the way of a straight cable holds it as far as it reaches, and along half a turn of so long a chord;
        others hold nothing.
        """
        near, aside = self.radius + radius, self.points[:, 1:]
        if (aside.min(axis=0) > near).any() or (aside.max(axis=0) < -near).any():
            return 0.0
        inward = float(self.points[:, 0].max() if self.side == LEFT else -self.points[:, 0].min())
        return math.pi / 2 * max(0.0, inward + near)

    def placed(self, poses: Float[np.ndarray, "... 7"]) -> Float[np.ndarray, "... k 3"]:
        """`points` [m] in the world with the frame at `poses` [m, 1]."""
        poses = np.asarray(poses, float)[..., None, :]
        return poses[..., :3] + rotations.rotate(poses[..., 3:], self.points)

    def solid(self, pose: Float[np.ndarray, "7"]) -> Solid:
        """The ball or the hull, without `radius` for a hull, in the world."""
        points = self.placed(pose)
        return Solid.sphere(points[0], self.radius) if len(points) == 1 else Solid.hull(points)


@dataclass(frozen=True, kw_only=True)
class SpatialGrippers:
    """Bodies and limits of both grippers.

    Attributes:
        radius: Of a ball about each end of the cable that its gripper fills [m].
        max_step: Largest move in one control step of 0.1 s [m].
        max_turn: Largest turn in one control step [rad].
        separation: Least distance between the two ends [m]; never below what their balls need.
        body: What else of a gripper takes room: a name of `GRIPPER_BODIES` or pieces; None for the ball alone.

    Raises:
        TaskError: A value is not finite or out of range, or there is no such body.
    """

    radius: Annotated[float, "a length", Quantity("m", 1e-4, 0.5)] = 0.02
    max_step: Annotated[float, "a length", Quantity("m", 1e-5, 1.0)] = 0.0133
    max_turn: Annotated[float, "an angle", Quantity("rad", 1e-4, math.pi)] = 0.133
    separation: Annotated[float, "a length", Quantity("m", 0.0, 10.0)] = 0.0
    body: str | tuple[GripperPiece, ...] | None = field(default=None)

    def __post_init__(self) -> None:
        checks.check_quantities(self, "grippers")
        if isinstance(self.body, str):
            try:
                named_body(self.body)
            except TaskError as error:
                raise error.within("grippers") from None
        elif self.body is not None:
            if len(self.body) > MOST_PIECES:
                raise TaskError(f"must be at most {MOST_PIECES} pieces, got {len(self.body)}", ("grippers", "body"))
            object.__setattr__(self, "body", tuple(self.body))

    @property
    def bodies(self) -> tuple[SpatialBody, ...]:
        """The balls and the pieces of both grippers; pieces of the left one are mirror images, x outward."""
        pieces = named_body(self.body) if isinstance(self.body, str) else self.body or ()
        pieces = (GripperPiece(points=np.zeros((1, 3)), radius=self.radius), *pieces)
        mirrored = np.array([-1.0, 1.0, 1.0])
        return tuple(
            SpatialBody(name, side, piece.points * mirrored if side == LEFT else piece.points, piece.radius)
            for piece in pieces
            for name, side in SIDES
        )

    @property
    def least_span(self) -> float:
        """Least distance [m] between the ends: `separation`, or two radii where that is more."""
        return max(self.separation, 2 * self.radius)
