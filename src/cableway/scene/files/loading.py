"""Tasks from YAML files and from the catalogue; cables from presets."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from cableway.core.checks import shown
from cableway.core.errors import InputError, TaskError, UnknownNameError
from cableway.core.quantities import limit_text, quantity, told_apart
from cableway.rod.inverse import shape_between
from cableway.scene import checks
from cableway.scene.cable import Cable
from cableway.scene.cell import Cell
from cableway.scene.files.cells import cell_of, named_cell
from cableway.scene.files.document import read_document
from cableway.scene.files.presets import preset_names, preset_values
from cableway.scene.files.schema import CellFile, planar_obstacle, validate, with_steps
from cableway.scene.files.spatial import SpatialTaskFile, is_spatial, spatial_task
from cableway.scene.gripper_bodies import BodyPart
from cableway.scene.grippers import Grippers, Plug, Port
from cableway.scene.obstacles import Obstacle
from cableway.scene.scene import Scene
from cableway.scene.spatial.task import SpatialDraft, SpatialTask
from cableway.scene.task import ENDS, Draft, Task

SUFFIXES = (".yaml", ".yml")
"""Endings of task files."""

TaskSource = Task | str | os.PathLike[str]
"""A task, its name in the catalogue, or the path of its YAML file."""

AnyTask = Task | SpatialTask
"""A task on the table or in space."""

AnyDraft = Draft | SpatialDraft
"""What a task says, on the table or in space, whether or not a cable can do it."""


def load_task(source: str | os.PathLike[str]) -> AnyTask:
    """The task of a catalogue name or of a YAML file; one in space where the workspace has three sizes.

    Args:
        source: A name of `task_names()`, or a path: a `Path`, or a text with a path separator or ending in .yaml
            or .yml.

    Raises:
        UnknownNameError: No such task in the catalogue; the message lists them.
        FileFormatError: The file is missing, a folder, unreadable, not YAML, empty or no mapping.
        TaskError: The file says something that no task can be; the message has file, line and place.
    """
    if not isinstance(source, str | os.PathLike):
        raise InputError(f"a task is loaded by its name or from a path, got {shown(source)}")
    document = read_document(_task_path(source))
    in_space = is_spatial(document)
    content = validate(document, SpatialTaskFile) if in_space else validate(document)
    try:
        if in_space:
            return spatial_task(content, _name_from(document.path), document.path.parent)
        return _task(content, document.path)
    except TaskError as error:
        raise document.locate(error) from None


def load_planar_task(source: str | os.PathLike[str]) -> Task:
    """As `load_task`, of a task on the table.

    Raises:
        InputError: As there, or the task is in space.
    """
    return as_task(load_task(source))


def _in_space(task: SpatialTask) -> InputError:
    return InputError(
        f"the task {task.name!r} is in space, where there are only plans, runs, pictures, checks and the studio so "
        "far (cableway plan, run, show, check, studio); give a task on the table, whose workspace has two sizes"
    )


def as_task(task: TaskSource | SpatialTask) -> Task:
    """A task on the table that is given as such, or by what `load_task` reads.

    Raises:
        InputError: It is neither, there is no such task, or it is in space.
    """
    task = load_task(task) if isinstance(task, str | os.PathLike) else task
    if isinstance(task, Task):
        return task
    if isinstance(task, SpatialTask):
        raise _in_space(task)
    raise InputError(f"a task must be a Task, a name of the catalogue or the path of a YAML file, got {shown(task)}")


def as_any_task(task: TaskSource | SpatialTask) -> AnyTask:
    """As `as_task`, or a task in space.

    Raises:
        InputError: It is neither, or there is no such task.
    """
    found = load_task(task) if isinstance(task, str | os.PathLike) else task
    return found if isinstance(found, SpatialTask) else as_task(found)


def as_draft(task: TaskSource) -> Draft:
    """As `as_task`, but one that contradicts itself as far as it could be read.

    Raises:
        InputError: There is no such task, or its values make none.
    """
    try:
        return as_task(task)
    except TaskError as error:
        if not isinstance(error.draft, Draft):
            raise
        return error.draft


def as_any_draft(task: TaskSource | SpatialTask) -> AnyDraft:
    """As `as_any_task`, but one that contradicts itself as far as it could be read.

    Raises:
        InputError: There is no such task, or its values make none.
    """
    try:
        return as_any_task(task)
    except TaskError as error:
        if not isinstance(error.draft, Draft | SpatialDraft):
            raise
        return error.draft


def task_names() -> tuple[str, ...]:
    """Names of the tasks in the catalogue."""
    return tuple(sorted(path.stem for path in _catalogue().glob("*.yaml")))


def catalogue_file(name: str) -> Path:
    """The YAML file of a task in the catalogue.

    Raises:
        UnknownNameError: No such task; the message lists them.
    """
    if name not in task_names():
        raise UnknownNameError("task", name, task_names())
    return _catalogue() / f"{name}.yaml"


def cable_from_preset(name: str, **overrides: Any) -> Cable:
    """The cable of a preset, as long as the first of its lengths, with fields of `Cable` given here instead of its own.

    >>> cable_from_preset("usb", length=0.25).radius
    0.004

    Raises:
        UnknownNameError: No such preset; the message lists them.
        TaskError: A value is out of range.
    """
    return Cable(**{**preset_values(name), **overrides, "preset": name})


def _catalogue() -> Path:
    return Path(str(resources.files("cableway.scene.files"))) / "catalogue"


def _task_path(source: str | os.PathLike[str]) -> Path:
    if not isinstance(source, str):
        return Path(source)
    separators = {os.sep, os.altsep or os.sep}
    if source.endswith(SUFFIXES) or any(separator in source for separator in separators):
        return Path(source)
    meant = next((source + suffix for suffix in SUFFIXES if os.path.isfile(source + suffix)), None)
    if meant and source not in task_names():
        raise InputError(f"no task of the catalogue is named {source!r}; for the file that is here, write {meant}")
    return catalogue_file(source)


def _task(content: Mapping[str, Any], path: Path) -> Task:
    """The task that a valid file means; places in errors are those of the file."""
    cable = cable_of_section(content.get("cable", {}))
    plug, port = content.get("plug"), content.get("port")
    scene, wrong = _scene(content)
    shapes: dict[str, Any] = {}
    for end in ENDS:
        shapes[end], shapes[f"{end}_poses"], faults = _shape(end, content[end], cable)
        wrong += faults
    values: dict[str, Any] = {
        "name": content.get("name", _name_from(path)),
        "description": content.get("description", ""),
        "scene": scene,
        "cable": cable,
        "grippers": _grippers(content.get("grippers", {})),
        "plug": None if plug is None else Plug(**plug),
        "port": None if port is None else Port(**port),
        **shapes,
    }
    if (cell := content.get("cell")) is not None:
        values |= _in_cell(named_cell(cell) if isinstance(cell, str) else cell_of(cell), values)
    try:
        if not wrong:
            return Task(**values)
        draft = Draft(**values)
        raise wrong[0].of(draft, (*wrong[1:], *draft.faults()))
    except TaskError as error:
        first, *others = (_as_in_file(fault, content) for fault in error.faults)
        raise first.of(error.draft, others) from None


def load_cell(source: str | os.PathLike[str]) -> Cell:
    """The cell of a name of `CELLS` or of a YAML file.

    Raises:
        UnknownNameError: There is none of that name; the message lists them.
        TaskError: The file is not one of a cell; the message has the place.
        FileFormatError: It cannot be read.
    """
    path = Path(source)
    if isinstance(source, str) and path.suffix not in SUFFIXES:
        return named_cell(source)
    document = read_document(path)
    content = validate(document, CellFile)
    try:
        return cell_of({key: value for key, value in content.items() if key not in ("cableway", "units", "angles")})
    except TaskError as error:
        raise document.locate(TaskError(error.problem, error.place[1:])) from None


def _in_cell(cell: Cell, values: Mapping[str, Any]) -> dict[str, Any]:
    """What a cell changes in a task: grippers that state no body have its tool, the scene its heights."""
    grippers = values["grippers"]
    if grippers.body is None:
        grippers = replace(grippers, body=cell.tool, tilt=cell.tilt)
    return {"cell": cell, "grippers": grippers, "scene": cell.furnished(values["scene"])}


def _scene(content: Mapping[str, Any]) -> tuple[Scene, list[TaskError]]:
    """The scene, and which of its obstacles are not inside it."""
    obstacles = tuple(_obstacle(index, section) for index, section in enumerate(content.get("obstacles", [])))
    try:
        return Scene(**content.get("workspace", {}), obstacles=obstacles), []
    except TaskError as error:
        if error.draft is None:
            raise
        return error.draft, list(error.faults)


def _name_from(path: Path) -> str:
    return re.sub(r"[^\w .+-]", "-", path.stem).lstrip(" .+-") or "task"


def cable_of_section(section: Mapping[str, Any]) -> Cable:
    """The cable of the section `cable` of a file, whose numbers are in metres.

    Raises:
        TaskError: There is no such preset, or a value is out of range.
    """
    name = section.get("preset")
    if name is None:
        return Cable(**section)
    try:
        return Cable(**{**preset_values(name), **section})
    except UnknownNameError:
        raise TaskError(f"must be one of {', '.join(preset_names())}, got {name!r}", ("cable", "preset")) from None


def _grippers(section: Mapping[str, Any]) -> Grippers:
    given = with_steps(section)
    if isinstance(given.get("body"), list):
        given["body"] = tuple(_body_part(index, part) for index, part in enumerate(given["body"]))
    return Grippers(**given)


def _body_part(index: int, section: Mapping[str, Any]) -> BodyPart:
    try:
        return BodyPart(**section)
    except TaskError as error:
        raise error.within("grippers", "body", index) from None


def _obstacle(index: int, section: Mapping[str, Any]) -> Obstacle:
    try:
        return planar_obstacle(section)
    except TaskError as error:
        raise error.within("obstacles", index) from None


def _shape(end: str, section: Any, cable: Cable) -> tuple[Any, Any, list[TaskError]]:
    """Keypoints and, where the file states them, gripper poses of one end; no keypoints where the poses have none."""
    if not isinstance(section, Mapping):
        return section, None, []
    poses = checks.rows(section["grippers"], (end, "grippers"), checks.POSE)
    keypoints: Any = section.get("keypoints")
    bend: Any = section.get("bend")
    if (keypoints is None) == (bend is None):
        raise TaskError("must have either bend or keypoints in addition to grippers", (end,))
    if keypoints is not None:
        return keypoints, poses, []
    left, right = poses[:, :2]
    gap, (x, y) = float(np.linalg.norm(right - left)), (left + right) / 2
    if gap > cable.length * (1 + 1e-9):
        problem = (
            f"are {told_apart(gap, cable.length)} apart, farther than the cable is long ({limit_text(cable.length)})"
        )
        return None, poses, [TaskError(problem, (end, "grippers"), at=(float(x), float(y)))]
    try:
        q = shape_between(cable.rod, poses, bend)
    except InputError:
        problem = (
            f"asks for a bend to the {bend}, but no stable shape of the cable ({limit_text(cable.length)}) between "
            f"these grippers ({quantity(gap)} apart) lies on that side: try the other side, other poses, or keypoints"
        )
        return None, poses, [TaskError(problem, (end, "bend"), at=(float(x), float(y)))]
    return cable.rod.at_keypoints(cable.rod.shapes(q[None])[0])[0], poses, []


def _as_in_file(error: TaskError, content: Mapping[str, Any]) -> TaskError:
    """An error of a task with the place that its values have in the file."""
    if not error.place or error.place[0] not in ("start", "goal", "start_poses", "goal_poses"):
        return error
    end, *rest = str(error.place[0]).removesuffix("_poses"), *error.place[1:]
    section = content[end]
    problem, place = error.problem, (end, "grippers", *rest)
    if not str(error.place[0]).endswith("_poses"):
        if not (rest and isinstance(section, Mapping)) or str(rest[0]) in section:
            return error
        stated = section.get("keypoints") is not None
        problem = problem if stated else f"keypoint {rest[0]} {problem}"
        place = (end, "keypoints", *rest) if stated else (end,)
    return TaskError(problem, place, at=error.at)
