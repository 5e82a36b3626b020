"""A plant in front of another one, which changes some of what goes in and out of it."""

from __future__ import annotations

from typing import Generic, Protocol, TypeVar

from cableway.records import Measurement
from cableway.scene.task import Task


class Simulated(Protocol):
    """What a layer passes on of the plant behind it."""

    @property
    def task(self) -> Task:
        """See `Layer`."""
        ...

    @property
    def control_step(self) -> float:
        """See `Layer`."""
        ...

    @property
    def unmodelled(self) -> tuple[str, ...]:
        """See `Layer`."""
        ...

    def measure(self) -> Measurement:
        """See `Layer`."""
        ...


P = TypeVar("P", bound=Simulated)


class Layer(Generic[P]):
    """A plant like the one behind it, as far as a subclass does not say otherwise.

    Attributes:
        plant: The one behind it.
    """

    def __init__(self, plant: P) -> None:
        self.plant = plant

    @property
    def task(self) -> Task:
        """What planner and controller know."""
        return self.plant.task

    @property
    def control_step(self) -> float:
        """Time [s] that one step takes."""
        return self.plant.control_step

    @property
    def unmodelled(self) -> tuple[str, ...]:
        """What the task holds that this plant leaves out, one sentence each, for reports."""
        return self.plant.unmodelled

    def measure(self) -> Measurement:
        """The truth after the last step."""
        return self.plant.measure()
