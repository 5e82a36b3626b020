"""A plant in front of another one, which changes some of what goes in and out of it."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Protocol, TypeVar, cast

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
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

    def state(self) -> Any:
        """See `Layer`."""
        ...

    def restore(self, state: Any) -> None:
        """See `Layer`."""
        ...


@dataclass(frozen=True)
class LayerState:
    """State of a `Layer`.

    Attributes:
        plant: Of the plant behind it.
        own: What the layer itself remembers, by name.
    """

    plant: Any
    own: Mapping[str, Any]


P = TypeVar("P", bound=Simulated)


class Layer(Generic[P]):
    """A plant like the one behind it, as far as a subclass does not say otherwise.

    Attributes:
        plant: The one behind it.
    """

    remembers: ClassVar[tuple[str, ...]] = ()
    """Names of the attributes that change during a run."""

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

    @property
    def can_grasp(self) -> bool:
        """Whether the plant has arms that can take hold of the cable and let go of it."""
        return getattr(self.plant, "can_grasp", False)

    def let_go(self, joints: Float[np.ndarray, "t 2 6"], opening: float) -> float:
        """See `HandlingPlant.let_go`."""
        return cast(Any, self.plant).let_go(joints, opening)

    def measure(self) -> Measurement:
        """The truth after the last step."""
        return self.plant.measure()

    def state(self) -> LayerState:
        """A copy of the whole state, to branch a run from."""
        return LayerState(self.plant.state(), {name: deepcopy(getattr(self, name)) for name in self.remembers})

    def restore(self, state: LayerState) -> None:
        """Go back to a state of this plant; what follows is the same bit for bit.

        Raises:
            InputError: The state is that of another plant.
        """
        own = {name: np.shape(getattr(self, name)) for name in self.remembers}
        if own != {name: np.shape(value) for name, value in state.own.items()}:
            raise InputError("the state belongs to a plant with other delays or another number of keypoints")
        self.plant.restore(state.plant)
        for name, value in state.own.items():
            setattr(self, name, deepcopy(value))
