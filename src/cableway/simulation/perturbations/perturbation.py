"""How a simulated plant differs from its task, which is all that planner and controller know."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Checked, Choice, NotNegative
from cableway.core.errors import InputError, SimulationError
from cableway.core.provenance import describe
from cableway.records import Plan
from cableway.rod.inverse import nearest_equilibrium
from cableway.scene.cable import Cable
from cableway.scene.cell import Way
from cableway.scene.task import Task
from cableway.simulation.arms import ArmDrive
from cableway.simulation.handling import HandlingPlant
from cableway.simulation.perturbations.faults import FaultConfig, FaultyPlant
from cableway.simulation.perturbations.grasp import GraspConfig, GraspedCable, Offset
from cableway.simulation.perturbations.sensing import SensedPlant, SensingConfig
from cableway.simulation.plant import CableSimulator, PlantConfig
from cableway.simulation.table_plant import TableConfig, TablePlant


@dataclass(frozen=True, kw_only=True)
class Perturbation(Checked):
    """A simulated plant relative to its task; by default the plant is the task.

    >>> Perturbation(cable=Cable(friction=0.3), sensing=SensingConfig(keypoint_noise=0.001)).grasp == GraspConfig()
    True

    Attributes:
        cable: The true cable; the task's where None.
        grasp: How the grippers hold it.
        sensing: Noise, lost frames and delays between plant and controller.
        start: Offsets of the left and right gripper from the task's start, in the world frame [m, m, rad]. The cable
            starts in the stable shape nearest to the task's.
        obstacles: Displacement [m] of each obstacle, in the order of the task; none moves where empty.
        pegs: Discs (x, y, radius) [m] that the task does not have.
        revealed: Time [s] from which the controller knows of displacements and pegs; never where None. The plan does
            not.
        faults: What goes wrong with robot, link and camera.
        simulation: How the planar plant is simulated.
        table: The table plant instead, where not None; `simulation` means nothing then.
        arms: Of a task in a cell: "simulated" with their servos, or "exact" where they are wherever the grippers are.
        notes: Sentences for the reader of a report.

    Raises:
        InputError: An offset or a displacement is not finite.
    """

    cable: Cable | None = None
    grasp: GraspConfig = field(default_factory=GraspConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    start: tuple[Offset, Offset] | None = None
    obstacles: tuple[tuple[float, float], ...] = ()
    pegs: tuple[tuple[float, float, float], ...] = ()
    revealed: NotNegative[float] | None = 0.0
    faults: FaultConfig = field(default_factory=FaultConfig)
    simulation: PlantConfig = field(default_factory=PlantConfig)
    table: TableConfig | None = None
    arms: Annotated[Literal["simulated", "exact"], Choice("arms")] = "simulated"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start is not None and not np.isfinite(self.start).all():
            raise InputError(f"start must be finite offsets, got {self.start!r}")
        if not np.isfinite(self.obstacles).all():
            raise InputError(f"obstacles must be finite displacements, got {self.obstacles!r}")
        if not np.isfinite(self.pegs).all():
            raise InputError(f"pegs must be discs (x, y, radius) of finite numbers, got {self.pegs!r}")

    def true_cable(self, task: Task) -> Cable:
        """The cable of the plant."""
        return self.cable or task.cable

    def friction_number(self, task: Task) -> float:
        """`Cable.friction_number` of the plant's cable on the plant's table, across or along it, whichever is more."""
        cable = self.true_cable(task)
        on_table = 0.0 if self.table is None else self.table.friction * max(1.0, self.table.across)
        return cable.friction_number(max(cable.friction, on_table))

    def resolved(self, task: Task) -> Perturbation:
        """With the table that the simulated arms of a cell stand at; without one, as rough as the cable's own is."""
        if task.cell is None or self.arms == "exact" or self.table is not None:
            return self
        return replace(self, table=TableConfig(friction=self.true_cable(task).friction))

    def known_task(self, task: Task) -> Task:
        """What the controller knows from `revealed` on: the task, with the obstacles and pegs where they are.

        Raises:
            InputError: There is not one displacement for each obstacle of the task.
            TaskError: A displaced obstacle or a peg touches the start or the goal.
        """
        if not (self.obstacles or self.pegs):
            return task
        if self.obstacles and len(self.obstacles) != len(task.scene.obstacles):
            raise InputError(
                f"obstacles must be one displacement for each of the task's {len(task.scene.obstacles)} obstacles, "
                f"got {len(self.obstacles)}"
            )
        return replace(task, scene=task.scene.changed(self.obstacles, self.pegs))

    def true_task(self, task: Task) -> Task:
        """The task as the plant has it, apart from the cable: start and obstacles where they are.

        Raises:
            InputError: There is not one displacement for each obstacle of the task.
            TaskError: The displaced start or an obstacle makes a task that cannot be.
            SimulationError: No shape of the task's cable is stable between the displaced grippers.
        """
        known = self.known_task(task)
        if self.start is None:
            return known
        return replace(known, start=_start_between(task, np.array(self.start)), start_poses=None)

    def build(self, task: Task, seed: int = 0, plan: Plan | None = None) -> SensedPlant | FaultyPlant:
        """The plant.

        Args:
            task: What planner and controller know.
            seed: Of noise and lost frames.
            plan: Whose arms hold the cable, and as it says, in a cell; where it says nothing grippers float.

        Raises:
            InputError: Cable or displacements do not fit the task.
            SimulationError: The plant cannot take the start.
        """
        sensed = SensedPlant(self.resolved(task)._cable_plant(task, plan), self.sensing, seed)
        known_at_once = not (self.obstacles or self.pegs) or self.revealed == 0
        if self.faults == FaultConfig() and known_at_once:
            return sensed
        return FaultyPlant(sensed, self.faults, task, self.revealed)

    def _cable_plant(self, task: Task, plan: Plan | None) -> CableSimulator | GraspedCable | TablePlant:
        """The cable between the grippers."""
        if self.table is not None:
            true, drive = self.true_task(task), None
            if plan is not None and self.arms == "simulated" and true.cell is not None:
                drive = _arms_of(plan, true, self.table, self.grasp.hold)
            kind = TablePlant if drive is None else HandlingPlant
            return kind(true, self.cable, self.grasp, self.table, self.known_task(task), drive)
        plant = CableSimulator(self.true_task(task), self.simulation, self.cable)
        if self.grasp == GraspConfig() and self.start is None and not (self.obstacles or self.pegs):
            return plant
        return GraspedCable(plant, self.grasp, self.known_task(task))

    def as_dict(self, task: Task) -> dict[str, Any]:
        """The resolved configuration as plain data, for the record of a run."""
        names = ["grasp", "sensing", "start", "obstacles", "pegs", "revealed", "faults", "table"]
        names += [] if task.cell is None else ["arms"]
        parts = {name: describe(getattr(self, name)) for name in names}
        return {**describe(self.simulation), "cable": describe(self.true_cable(task)), **parts}


def _arms_of(plan: Plan, task: Task, table: TableConfig, hold: float) -> ArmDrive | None:
    """The arms of a cell as a plan has them; None where it does not say how they hold the cable."""
    way = Way.of_record(plan.metadata)
    if way is None or plan.joints is None:
        return None
    return ArmDrive(task, way, plan.joints[0], table.time_step, hold)


def _start_between(task: Task, offsets: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "n 2"]:
    """Keypoints [m] of the stable shape between the displaced grippers that is nearest to the task's start."""
    rod = task.cable.rod
    poses = rod.shapes(task.start_equilibrium[None])[1][0] + offsets
    found = nearest_equilibrium(rod, poses, task.start)
    if found is None:
        raise SimulationError("the cable has no stable shape between the displaced grippers")
    return rod.at_keypoints(rod.shapes(found[None])[0])[0]
