"""Perturbations of tasks in space from YAML files, and to them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
import yaml

from cableway.core.checks import Checked, NotNegative, shown
from cableway.core.configuration import faults, from_mapping
from cableway.core.errors import InputError, TaskError
from cableway.geometry.groups import SE3
from cableway.scene.files.document import Dumper, read_document
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.perturbations.reading import FORMAT_VERSION
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.simulation.spatial_plant import SpatialConfig

MOST_SHIFT, MOST_TURN = 0.01, 1.0
"""Largest shift [m] and turn [rad] of a grasp; farther off, the ends are not at the task's start."""

FIXED = ("keypoints", "radius")
"""Of the cable, as in the task: what is seen and judged is told by them."""

Offset = Annotated[
    tuple[float, float, float, float, float, float],
    f"[x, y, z] of at most {MOST_SHIFT} m and a rotation vector of at most {MOST_TURN} rad",
]


Displacement = Annotated[tuple[float, float, float], "[x, y, z]"]


@dataclass(frozen=True, kw_only=True)
class GraspSection:
    """The key `grasp`: where the cable's ends are in the gripper frames.

    Raises:
        InputError: A number is out of range.
    """

    left: Offset = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    right: Offset = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for side, offset in (("left", self.left), ("right", self.right)):
            if not (np.linalg.norm(offset[:3]) <= MOST_SHIFT and np.linalg.norm(offset[3:]) <= MOST_TURN):
                raise InputError(f"grasp.{side} must be {get_args(Offset)[1]}, got {shown(list(offset))}")


@dataclass(frozen=True, kw_only=True)
class SpatialSections(Checked):
    """The keys of the file, but for `cableway` and `cable`."""

    grasp: GraspSection = field(default_factory=GraspSection)
    spatial: SpatialConfig = field(default_factory=SpatialConfig)
    obstacles: Annotated[tuple[Displacement, ...], "a list of displacements [x, y, z]"] = ()
    revealed: NotNegative[float] | None = 0.0


def read_spatial_perturbation(path: Path, task: SpatialTask) -> SpatialPerturbation:
    """The perturbation of a YAML file; what it leaves out is as in the task.

    Raises:
        FileFormatError: The file is missing or not YAML.
        InputError: A section or key is unknown, or a value is not allowed.
    """
    document = read_document(path)
    content = document.data
    known = ("cableway", "cable", *(each.name for each in fields(SpatialSections)))
    for key in content:
        if key not in known:
            raise InputError(f"{path}: unknown section {shown(key)} for a task in space; known: {', '.join(known)}")
    if content.pop("cableway", None) != FORMAT_VERSION:
        raise InputError(f"{path}: cableway must be {FORMAT_VERSION}, the format version")
    cable = None
    if "cable" in content:
        given = content.pop("cable")
        for fault in faults(SpatialCable, given):
            raise document.locate(TaskError(fault.problem, ("cable", *fault.place)))
        try:
            cable = _cable(task.cable, given)
        except TaskError as error:
            raise document.locate(error) from None
    for fault in faults(SpatialSections, content):
        raise document.locate(TaskError(fault.problem, fault.place))
    rest = from_mapping(SpatialSections, content, str(path))
    offsets = np.array([rest.grasp.left, rest.grasp.right])
    perturbation = SpatialPerturbation(
        cable=cable, grasps=SE3.plus(np.tile(SE3.identity, (2, 1)), offsets), config=rest.spatial,
        obstacles=rest.obstacles, revealed=rest.revealed,
    )  # fmt: skip
    try:
        perturbation.true_task(task)
    except InputError as error:
        raise InputError(f"{path}: with obstacles as here, {error}") from None
    return perturbation


def spatial_perturbation_text(perturbation: SpatialPerturbation) -> str:
    """A YAML file from which `read_spatial_perturbation` gives the same perturbation."""
    content: dict[str, Any] = {"cableway": FORMAT_VERSION}
    if perturbation.cable is not None:
        values = {each.name: getattr(perturbation.cable, each.name) for each in fields(SpatialCable)}
        content["cable"] = {name: value for name, value in values.items() if name != "preset"}
    offsets = SE3.minus(perturbation.grasps, np.tile(SE3.identity, (2, 1)))
    if offsets.any():
        content["grasp"] = dict(zip(("left", "right"), offsets.tolist(), strict=True))
    if perturbation.config != SpatialConfig():
        content["spatial"] = {each.name: getattr(perturbation.config, each.name) for each in fields(SpatialConfig)}
    if perturbation.obstacles:
        content["obstacles"] = [list(by) for by in perturbation.obstacles]
        content["revealed"] = perturbation.revealed
    return yaml.dump(content, Dumper=Dumper, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110)


def _cable(nominal: SpatialCable, given: dict[str, Any]) -> SpatialCable:
    """The task's cable with what the file changes; of a preset all but the length and what is `FIXED`.

    Raises:
        TaskError: A value is out of range or `FIXED`, or there is no such preset.
    """
    for name in FIXED:
        if given.get(name, value := getattr(nominal, name)) != value:
            raise TaskError(f"must be {value}, as in the task", ("cable", name))
    if (preset := given.get("preset")) is not None:
        kept = {name: getattr(nominal, name) for name in ("length", *FIXED)}
        return SpatialCable.of_preset(preset, **{**kept, **{key: given[key] for key in given if key != "preset"}})
    values = {each.name: getattr(nominal, each.name) for each in fields(nominal)}
    return SpatialCable(**{**values, **given, "preset": None})
