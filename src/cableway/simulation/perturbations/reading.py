"""Perturbations from YAML files, and to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from cableway.core.checks import shown
from cableway.core.configuration import faults, from_mapping
from cableway.core.errors import InputError, SimulationError, TaskError
from cableway.core.provenance import describe
from cableway.scene.cable import Cable
from cableway.scene.files.document import Dumper, read_document
from cableway.scene.files.presets import preset_names, preset_values
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.perturbations.perturbation import Perturbation

FORMAT_VERSION = 1
"""The value of the key `cableway`."""

SECTIONS = (
    "cable", "grasp", "simulation", "sensing", "start", "obstacles", "pegs", "revealed", "faults", "table", "arms",
)  # fmt: skip
"""Keys of the file: fields of `Perturbation`."""


def read_perturbation(path: Path, task: Task) -> Perturbation:
    """The perturbation of a YAML file; what it leaves out is as in the task.

    Raises:
        FileFormatError: The file is missing or not YAML.
        InputError: A section or key is unknown, or a value is not allowed, or makes a task that cannot be.
    """
    document = read_document(path)
    content = document.data
    known = ("cableway", *SECTIONS)
    for key in content:
        if key not in known:
            raise InputError(f"{path}: unknown section {shown(key)}; known: {', '.join(known)}")
    if content.pop("cableway", None) != FORMAT_VERSION:
        raise InputError(f"{path}: cableway must be {FORMAT_VERSION}, the format version")
    if "cable" in content:
        content["cable"] = _cable(task.cable, content["cable"], f"{path}: cable")
    for fault in faults(Perturbation, content):
        raise document.locate(TaskError(fault.problem, fault.place))
    perturbation = from_mapping(Perturbation, content, str(path))
    if perturbation.simulation.control_step != CONTROL_STEP:
        raise InputError(f"{path}: simulation.control_step must be {CONTROL_STEP} s, the step of the controllers")
    note = f"The plant is perturbed as {path.name} says; planner and controller know only the task."
    try:
        perturbation.true_task(task)
    except (InputError, SimulationError) as error:
        raise InputError(f"{path}: with start, obstacles and pegs as here, {error}") from None
    return replace(perturbation, notes=(note,))


def perturbation_text(perturbation: Perturbation) -> str:
    """A YAML file from which `read_perturbation` gives the same perturbation, but for what is said of it."""
    nominal = describe(Perturbation())
    content: dict[str, Any] = {"cableway": FORMAT_VERSION}
    for section in SECTIONS:
        value = describe(getattr(perturbation, section))
        if isinstance(value, Mapping) and isinstance(usual := nominal[section], Mapping):
            value = {key: each for key, each in value.items() if each != usual[key]}
            if not value:
                continue
        if value != nominal[section]:
            content[section] = value
    if perturbation.cable is not None:
        content["cable"] = {key: each for key, each in content["cable"].items() if each is not None}
    return yaml.dump(content, Dumper=Dumper, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110)


def _cable(nominal: Cable, given: Any, where: str) -> dict[str, Any]:
    """The task's cable with what the file changes; of a preset all but the length."""
    if not isinstance(given, Mapping):
        raise InputError(f"{where} must be a mapping of keys to values, got {shown(given)}")
    values, preset = nominal.as_dict(), given.get("preset")
    if preset is not None:
        if preset not in preset_names():
            raise InputError(f"{where}.preset must be one of {', '.join(preset_names())}, got {shown(preset)}")
        values |= {**preset_values(preset), "length": nominal.length}
    return {**values, **given}
