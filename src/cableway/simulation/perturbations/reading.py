"""The file that says how the simulated plant differs from what planner and controller believe."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cableway.core.configuration import from_mapping
from cableway.core.errors import InputError
from cableway.scene.cable import Cable
from cableway.scene.files.document import read_document
from cableway.scene.files.presets import preset_names, preset_values
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.perturbations.grasp import GraspConfig
from cableway.simulation.perturbations.sensing import SensingConfig
from cableway.simulation.perturbations.setup import PlantSetup
from cableway.simulation.plant import PlantConfig

FORMAT_VERSION = 1
"""The value of the key `cableway`."""

SECTIONS = ("cableway", "cable", "grasp", "simulation", "sensing")


def read_plant(path: Path | None, task: Task) -> PlantSetup:
    """The plant of a YAML file; where None, the task's cable, seen as it is.

    Raises:
        FileFormatError: The file is missing or not YAML.
        InputError: A section or key is unknown, or a value is not allowed.
    """
    if path is None:
        return PlantSetup(cable=task.cable)
    content = read_document(path).data
    for key in content:
        if key not in SECTIONS:
            raise InputError(f"{path}: unknown section {key!r}; known: {', '.join(SECTIONS)}")
    if content.get("cableway") != FORMAT_VERSION:
        raise InputError(f"{path}: cableway must be {FORMAT_VERSION}, the version of the format")
    setup = PlantSetup(
        cable=_cable(task.cable, content.get("cable", {}), f"{path}: cable"),
        simulation=from_mapping(PlantConfig, content.get("simulation", {}), f"{path}: simulation"),
        grasp=from_mapping(GraspConfig, content.get("grasp", {}), f"{path}: grasp"),
        sensing=from_mapping(SensingConfig, content.get("sensing", {}), f"{path}: sensing"),
        notes=(f"The plant is that of {path.name}; planner and controller believe the task.",),
    )
    if setup.simulation.control_step != CONTROL_STEP:
        raise InputError(f"{path}: simulation.control_step must be {CONTROL_STEP} s, the step of the controllers")
    return setup


def _cable(believed: Cable, given: Any, where: str) -> Cable:
    """The task's cable with what the file changes; of a preset all but the length."""
    if not isinstance(given, Mapping):
        raise InputError(f"{where} must be a mapping of keys to values, got {given!r}")
    values, preset = believed.as_dict(), given.get("preset")
    if preset is not None:
        if preset not in preset_names():
            raise InputError(f"{where}.preset must be one of {', '.join(preset_names())}, got {preset!r}")
        values |= {**preset_values(preset), "length": believed.length}
    return from_mapping(Cable, {**values, **given}, where)
