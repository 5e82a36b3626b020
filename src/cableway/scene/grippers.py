"""The grippers, the plug that the right one may hold, and the port it goes to."""

from __future__ import annotations

from dataclasses import dataclass

from cableway.scene import checks


@dataclass(frozen=True, kw_only=True)
class Grippers:
    """Footprint and limits of both grippers.

    Attributes:
        radius: Of the disc each gripper covers [m].
        max_step: Largest move in one control step [m].
        max_turn: Largest turn in one control step [rad].
        separation: Least distance between the two grippers' centres [m]; 0 for none.

    Raises:
        TaskError: A value is not finite or out of range.
    """

    radius: float = 0.004
    max_step: float = 0.0133
    max_turn: float = 0.133
    separation: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radius", "max_step", "max_turn"):
            object.__setattr__(self, name, checks.real(getattr(self, name), ("grippers", name), positive=True))
        separation = checks.real(self.separation, ("grippers", "separation"), minimum=0.0)
        object.__setattr__(self, "separation", separation)


@dataclass(frozen=True, kw_only=True)
class Plug:
    """A rigid plug ahead of the right gripper, along its tangent.

    Attributes:
        length: How far it reaches ahead [m].
        width: [m].

    Raises:
        TaskError: A value is not positive and finite.
    """

    length: float
    width: float

    def __post_init__(self) -> None:
        for name in ("length", "width"):
            object.__setattr__(self, name, checks.real(getattr(self, name), ("plug", name), positive=True))


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

    position: tuple[float, float]
    angle: float
    standoff: float
    depth: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", checks.pair(self.position, ("port", "position")))
        object.__setattr__(self, "angle", checks.real(self.angle, ("port", "angle")))
        for name in ("standoff", "depth"):
            object.__setattr__(self, name, checks.real(getattr(self, name), ("port", name), minimum=0.0))
