"""A task in space: where a cable hangs between two grippers, where it shall hang, and what stands between.

Twelve numbers are an end of the task: with weight, the pose of the cable's centre and the force and moment there give
the shape and both gripper poses at once (`cableway.rod.spatial`), and every choice of them is an equilibrium. Gripper
poses do not fix the shape, and keypoints do not fix how the cable is rolled; files may state those, and the twelve
numbers are found when they are read.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from cableway.core.brief import Shown
from cableway.core.errors import InputError, TaskError
from cableway.core.quantities import limit_text, size_text
from cableway.rod.spatial import SpatialRod
from cableway.scene import checks
from cableway.scene.cell import Cell
from cableway.scene.checks import Quantity
from cableway.scene.spatial import validity
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.grippers import SpatialBody, SpatialGrippers
from cableway.scene.spatial.scene import SpatialScene, recorded_displacements
from cableway.scene.task import ENDS, NAME, End

LOAD = Quantity("", -1000.0, 1000.0)
"""A force in B/L^2 or a moment in B/L; stable shapes have up to some hundreds."""

EQUILIBRIUM = (*[checks.COORDINATE] * 3, *[checks.ANGLE] * 3, *[LOAD] * 6)
"""The twelve numbers of a shape."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SpatialDraft(Shown):
    """What a task in space says, whether or not a cable can do it; see `SpatialTask`.

    Attributes:
        name: For folders and reports: letters, digits, spaces and any of . _ + -
        scene: Workspace and obstacles.
        cable: The cable.
        start: (12,) equilibrium as `cableway.rod.spatial` has it: centre [m], rotation vector [rad], force [B/L^2] and
            moment [B/L] in the centre's frame; None where none was found.
        goal: (12,) the same.
        grippers: Bodies and limits.
        description: One sentence.
        cell: Arms that hold the grippers, which stand on the table; None for grippers alone.

    Raises:
        TaskError: A value is of the wrong form.
    """

    name: str
    scene: SpatialScene
    cable: SpatialCable
    start: Float[np.ndarray, "12"] | None
    goal: Float[np.ndarray, "12"] | None
    grippers: SpatialGrippers = field(default_factory=SpatialGrippers)
    description: str = ""
    cell: Cell | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and NAME.fullmatch(self.name)):
            raise TaskError(
                f"must be letters, digits, spaces or any of . _ + -, got {checks.shown(self.name)}", ("name",)
            )
        if self.cell is not None and self.cell.tilt:
            raise TaskError("must be 0 in space, where hands take hold from any side", ("cell", "tilt"))
        if self.cell is not None and self.grippers.body not in (None, self.cell.tool):
            problem = (
                f"must be left out, or be the cell's tool, {self.cell.tool}, got {checks.shown(self.grippers.body)}"
            )
            raise TaskError(problem, ("grippers", "body"))
        for end in ENDS:
            if (value := getattr(self, end)) is not None:
                row = np.array(checks.numbers(value, (end, "equilibrium"), EQUILIBRIUM))
                row.setflags(write=False)
                object.__setattr__(self, end, row)

    @property
    def rod(self) -> SpatialRod:
        """The cable's rod."""
        return self.cable.rod

    @cached_property
    def bodies(self) -> tuple[SpatialBody, ...]:
        """What moves with the grippers."""
        return self.grippers.bodies

    def stations(self, end: End) -> Float[np.ndarray, "s 3"]:
        """The cable's centre line [m] at start or goal, at the stations of its rod."""
        return self._held(end)[0]

    def keypoints(self, end: End) -> Float[np.ndarray, "n 3"]:
        """Keypoints [m] at start or goal, left gripper first, at equal arc length."""
        return self.rod.at_keypoints(self.stations(end)[None])[0]

    def gripper_poses(self, end: End) -> Float[np.ndarray, "2 7"]:
        """Gripper poses at start or goal: position [m] and unit quaternion (w, x, y, z), x along the cable."""
        return self._held(end)[1]

    def _held(self, end: End) -> tuple[Float[np.ndarray, "s 3"], Float[np.ndarray, "2 7"]]:
        stations, poses = self.rod.shapes(np.array(getattr(self, end))[None])
        return stations[0], poses[0]

    def kept(self, end: End) -> dict[str, float]:
        """What start or goal keeps: least clearance [m] of the cable and of the grippers' bodies from obstacles and
        walls, stability margin, twist [rad] and distance of the grippers [m]."""
        return validity.kept_at(getattr(self, end), self.scene, self.cable, self.bodies)

    def faults(self) -> Iterator[TaskError]:
        """Why no cable can do it."""
        for end in ENDS:
            if (q := getattr(self, end)) is not None:
                yield from validity.end_faults(end, q, self.scene, self.cable, self.grippers)

    def in_cell(self, cell: Cell) -> Self:
        """The same task with arms.

        Raises:
            TaskError: The cell's tools lean, or are not the body of the grippers.
        """
        return replace(self, cell=cell)

    def unchecked(self) -> SpatialDraft:
        """The same, whether or not a cable can do it."""
        return SpatialDraft(**{entry.name: getattr(self, entry.name) for entry in fields(SpatialDraft)})

    def checked(self) -> SpatialTask:
        """The task, if a cable can do it.

        Raises:
            TaskError: It cannot.
        """
        return SpatialTask(**{entry.name: getattr(self, entry.name) for entry in fields(SpatialDraft)})


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SpatialTask(SpatialDraft):
    """A start, a goal, the cable and the scene in space.

    Raises:
        TaskError: An end is unstable or outside the workspace; the cable or a gripper is in an obstacle, a wall, the
            table or another part of both; it is bent or twisted too much. It has the draft and all its faults.
    """

    start: Float[np.ndarray, "12"]
    goal: Float[np.ndarray, "12"]

    def __post_init__(self) -> None:
        super().__post_init__()
        faults = list(self.faults())
        if faults:
            raise faults[0].of(self.unchecked(), faults[1:])

    def as_recorded(self, metadata: Mapping[str, Any]) -> SpatialTask:
        """The task with its obstacles where the metadata of a rollout have them.

        Raises:
            InputError: The rollout is of a task with other obstacles.
        """
        by = recorded_displacements(metadata)
        if by and len(by) != len(self.scene.obstacles):
            raise InputError(f"the rollout is of a task with {len(by)} obstacles, not {len(self.scene.obstacles)}")
        return replace(self, scene=self.scene.changed(by)) if by else self

    def _facts(self) -> Iterator[str]:
        obstacles = len(self.scene.obstacles)
        yield repr(self.name)
        yield f"cable {limit_text(self.cable.length)}, weight {self.cable.weight:.1f}"
        yield f"{obstacles} obstacle{'s'[: obstacles != 1]} in {size_text(self.scene.size)}"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the task to a YAML file; see `save_task`."""
        from cableway.scene.files.saving import save_task  # which reads and writes this class

        save_task(self, path)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SpatialTask):
            return NotImplemented
        pairs = ((getattr(self, entry.name), getattr(other, entry.name)) for entry in fields(self))
        return all(np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b for a, b in pairs)

    __hash__ = None  # pyright: ignore[reportAssignmentType]
