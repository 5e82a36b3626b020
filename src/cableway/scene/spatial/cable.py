"""The cable in space: what it measures and weighs, how it bends and twists."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Annotated, Any

from cableway.core.errors import TaskError, UnknownNameError
from cableway.core.quantities import limit_text
from cableway.rod.spatial import SpatialRod
from cableway.scene import checks
from cableway.scene.cable import KEYPOINTS
from cableway.scene.checks import Quantity
from cableway.scene.files.presets import preset_names, preset_values


@dataclass(frozen=True, kw_only=True)
class SpatialCable:
    """A uniform, round cable, straight at rest, held at both ends in space.

    Attributes:
        length: Between the two grasps [m].
        radius: [m].
        keypoints: Number n of points at equal arc length, both ends included.
        bending_stiffness: B [N m^2].
        twist_ratio: C/B, twisting over bending stiffness; 2/3 for a solid round rod that keeps its volume.
        linear_density: [kg/m]; the weight is gamma = rho A g L^3/B.
        damping_time: Bending damping over bending stiffness [s].
        min_bend_radius: Smallest radius of curvature the cable may take [m]; 0 for none.
        max_twist: Greatest twist from end to end [rad].
        preset: Name of the preset the values come from, for the record.

    Raises:
        TaskError: A value is not finite or out of range.
    """

    length: Annotated[float, "a length", checks.LENGTH] = 0.3
    radius: Annotated[float, "a length", Quantity("m", 5e-5, 0.1)] = 0.004
    keypoints: Annotated[int, "a whole number"] = 13
    bending_stiffness: Annotated[float, "a number in N m^2", Quantity("N m^2", 1e-8, 1e3)] = 1e-3
    twist_ratio: Annotated[float, "a ratio", Quantity("", 0.01, 100.0)] = 2 / 3
    linear_density: Annotated[float, "a number in kg/m", Quantity("kg/m", 1e-5, 1e2)] = 0.03
    damping_time: Annotated[float, "a number in seconds", Quantity("s", 1e-3, 1e2)] = 0.1
    min_bend_radius: Annotated[float, "a length", Quantity("m", 0.0, 10.0)] = 0.0
    max_twist: Annotated[float, "an angle", Quantity("rad", 0.1, 100.0)] = 4 * math.pi
    preset: Annotated[str | None, "the name of a preset"] = None

    def __post_init__(self) -> None:
        checks.check_quantities(self, "cable")
        object.__setattr__(self, "keypoints", checks.integer(self.keypoints, ("cable", "keypoints"), *KEYPOINTS))
        if self.radius * 4 > self.length:
            raise TaskError(
                f"is {limit_text(self.radius)}, too thick for a length of {limit_text(self.length)}: at most a "
                "quarter of it",
                ("cable", "radius"),
            )

    @classmethod
    def of_preset(cls, name: str, **overrides: Any) -> SpatialCable:
        """The cable of a preset as far as it has a say in space, with fields given here instead of its own.

        >>> round(SpatialCable.of_preset("ethernet").weight, 1)
        18.5

        Raises:
            TaskError: No such preset; the message lists them. Or a value is out of range.
        """
        try:
            values: dict[str, Any] = {**preset_values(name)}
        except UnknownNameError:
            raise TaskError(f"must be one of {', '.join(preset_names())}, got {name!r}", ("cable", "preset")) from None
        known = {entry.name for entry in fields(cls)}
        kept = {key: value for key, value in values.items() if key in known}
        return cls(**{**kept, **overrides, "preset": name})

    @property
    def rod(self) -> SpatialRod:
        """The elastic rod that stands for the cable."""
        return SpatialRod.of_material(
            self.length, self.bending_stiffness, self.linear_density, self.keypoints, self.twist_ratio
        )

    @property
    def weight(self) -> float:
        """gamma = rho A g L^3/B."""
        return self.rod.weight
