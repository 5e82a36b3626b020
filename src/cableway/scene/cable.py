"""The cable: what it measures and how it bends."""

from __future__ import annotations

from dataclasses import dataclass, fields

from cableway.errors import TaskError
from cableway.rod.equilibrium import Rod
from cableway.scene import checks

KEYPOINTS = (3, 200)
"""Least and largest number of keypoints."""


@dataclass(frozen=True, kw_only=True)
class Cable:
    """A uniform cable held at both ends.

    Attributes:
        length: Between the two grasps [m].
        radius: [m].
        keypoints: Number n of points at equal arc length, both ends included.
        bending_stiffness: EI [N m^2].
        damping_time: tau [s]: bending damping over bending stiffness, how the shape lags.
        linear_density: [kg/m].
        friction: Coulomb coefficient on the table.
        min_bend_radius: Smallest radius of curvature the cable may take [m]; 0 for none.
        preset: Name of the preset the values come from, for the record.

    Raises:
        TaskError: A value is not finite or out of range.
    """

    length: float = 0.3
    radius: float = 0.004
    keypoints: int = 13
    bending_stiffness: float = 1e-3
    damping_time: float = 0.1
    linear_density: float = 0.03
    friction: float = 0.0
    min_bend_radius: float = 0.0
    preset: str | None = None

    def __post_init__(self) -> None:
        for name in ("length", "radius", "bending_stiffness", "damping_time", "linear_density"):
            object.__setattr__(self, name, checks.real(getattr(self, name), ("cable", name), positive=True))
        for name in ("friction", "min_bend_radius"):
            object.__setattr__(self, name, checks.real(getattr(self, name), ("cable", name), minimum=0.0))
        object.__setattr__(self, "keypoints", checks.integer(self.keypoints, ("cable", "keypoints"), *KEYPOINTS))
        if self.radius * 4 > self.length:
            raise TaskError(
                f"is {self.radius!r} m, too thick for a length of {self.length!r} m: at most a quarter of it",
                ("cable", "radius"),
            )

    @property
    def rod(self) -> Rod:
        """The rod that stands for the cable in planning."""
        return Rod(self.length, self.keypoints)

    def as_dict(self) -> dict[str, float | int | str | None]:
        """All fields by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}
