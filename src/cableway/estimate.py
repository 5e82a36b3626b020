"""What a controller estimates while it runs, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

from cableway.core.quantities import estimate_text


@dataclass(frozen=True)
class Estimate:
    """A parameter that a controller estimates while it runs.

    Attributes:
        value: The estimate.
        deviation: Standard deviation of that.
        nominal: The value before any measurement.
        prior: Standard deviation of that; 0 for a number that was taken as known.
        unit: Of all four, "" for none.
    """

    value: float
    deviation: float
    nominal: float
    prior: float
    unit: str = ""

    @property
    def differs(self) -> bool:
        """Whether it is off by more than two standard deviations from its nominal value."""
        return abs(self.value - self.nominal) > 2 * self.deviation

    def __str__(self) -> str:
        return estimate_text(self.value, self.deviation, self.unit)
