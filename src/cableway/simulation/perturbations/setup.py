"""How a simulated plant differs from what planner and controller believe."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from cableway.core.provenance import describe
from cableway.scene.cable import Cable
from cableway.scene.task import Task
from cableway.simulation.perturbations.grasp import GraspConfig, GraspedCable
from cableway.simulation.perturbations.sensing import SensedPlant, SensingConfig
from cableway.simulation.plant import CableSimulator, PlantConfig


@dataclass(frozen=True, kw_only=True)
class PlantSetup:
    """A plant before it is built.

    Attributes:
        cable: The true cable.
        simulation: How it is simulated.
        grasp: How it is held.
        sensing: How it is seen and led.
        notes: Sentences for the reader of a report.
    """

    cable: Cable
    simulation: PlantConfig = field(default_factory=PlantConfig)
    grasp: GraspConfig = field(default_factory=GraspConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    notes: tuple[str, ...] = ()

    def build(self, task: Task, seed: int, believed: Task | None = None) -> SensedPlant:
        """The plant.

        Args:
            task: Where the cable lies and what stands there.
            seed: Of the noise.
            believed: The task that planner and controller believe, `task` where None.

        Raises:
            InputError: The cable does not fit the task.
            SimulationError: The start cannot be taken.
        """
        cable = CableSimulator(task, self.simulation, self.cable)
        as_believed = self.grasp == GraspConfig() and believed is None
        return SensedPlant(cable if as_believed else GraspedCable(cable, self.grasp, believed), self.sensing, seed)

    def as_dict(self) -> dict[str, Any]:
        """The resolved configuration as plain data."""
        parts = {"cable": self.cable, "grasp": self.grasp, "sensing": self.sensing}
        return {**describe(self.simulation), **{name: describe(part) for name, part in parts.items()}}
