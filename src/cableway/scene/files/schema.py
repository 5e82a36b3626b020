"""The task file: its keys and the types of their values.

Sections are the records they become; how values fit together is checked by those (`cableway.scene.task` and its
neighbours). What messages say a value must be stands in the annotations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from cableway.core.configuration import Tagged, changed, faults
from cableway.core.errors import Place, TaskError
from cableway.scene import checks
from cableway.scene.cable import Cable
from cableway.scene.cell import CELLS, TOOLS, MountedArm
from cableway.scene.checks import AngleUnit, LengthUnit, Quantity
from cableway.scene.files.document import Document
from cableway.scene.gripper_bodies import GRIPPER_BODIES, Tilt
from cableway.scene.gripper_bodies import Height as Level
from cableway.scene.grippers import Grippers, Plug, Port
from cableway.scene.obstacles import Box, Disc, Height, Obstacle, Polygon
from cableway.scene.scene import Scene
from cableway.scene.task import CONTROL_STEP

FORMAT_VERSION = 1
"""The value of the key `cableway`."""

Number = "a number"
Coordinate, Angle = Annotated[float, Number, checks.COORDINATE], Annotated[float, Number, checks.ANGLE]
Side = Annotated[float, Number, checks.WORKSPACE]
Point = Annotated[tuple[Coordinate, Coordinate], "two numbers [x, y]"]
Pose = Annotated[tuple[Coordinate, Coordinate, Angle], "three numbers [x, y, theta]"]
Speed = Annotated[float | None, "a number", Quantity("m/s", 1e-4, 10.0)]
TurnSpeed = Annotated[float | None, "a number", Quantity("rad/s", 1e-3, 10 * math.pi)]


@dataclass(frozen=True)
class WorkspaceSection:
    """The key `workspace`."""

    size: Annotated[tuple[Side, Side], "[width, height]"] = Scene.size
    wall_height: Height = None


@dataclass(frozen=True, kw_only=True)
class BodyPartSection:
    """A piece of a gripper."""

    outline: Annotated[list[Point], "a list of at least 3 points [x, y]"]
    heights: Annotated[tuple[Level, Level], "[lowest, highest]"]


@dataclass(frozen=True, kw_only=True)
class GrippersSection(Grippers):
    """The key `grippers`: those of the record, and speeds in place of the largest step and turn."""

    body: Annotated[  # pyright: ignore[reportIncompatibleVariableOverride]  # as it stands in the file
        str | list[BodyPartSection] | None, f"{', '.join(GRIPPER_BODIES)}, or a list of pieces"
    ] = None
    max_speed: Speed = None
    max_turn_speed: TurnSpeed = None


@dataclass(frozen=True)
class PolygonSection:
    """An obstacle of type `polygon`."""

    vertices: Annotated[list[Point], "a list of at least 3 points [x, y]"]
    height: Height = None


@dataclass(frozen=True)
class PosesSection:
    """A shape given by gripper poses and a side, or by keypoints together with the poses that make them."""

    grippers: Annotated[tuple[Pose, Pose], "two poses [x, y, theta], left then right"]
    bend: Annotated[Literal["left", "right"] | None, "left or right"] = None
    keypoints: Annotated[list[Point] | None, "a list of points [x, y]"] = None


AnyObstacle = Annotated[
    Any,
    "a mapping with the key type and those of that type",
    Tagged({"box": Box, "polygon": PolygonSection, "disc": Disc}),
]
Shape = Annotated[list[Point] | PosesSection, "a list of keypoints [x, y], or a mapping of grippers and bend"]


@dataclass(frozen=True, kw_only=True)
class CellSection:
    """The key `cell`."""

    name: Annotated[str, "a short text"]
    arms: Annotated[list[MountedArm], "a list of two arms"]
    tool: Annotated[str, ", ".join(TOOLS)] = "2f-85"
    tilt: Tilt = 0.0
    obstacle_height: Height = None
    wall_height: Height = None


CellKey = Annotated[str | CellSection | None, f"{', '.join(CELLS)}, or a mapping"]


@dataclass(frozen=True)
class TaskFile:
    """All keys of a task file, in their order."""

    cableway: Annotated[int, f"the format version, {FORMAT_VERSION}"]
    units: Annotated[LengthUnit, "m, cm or mm"] = field(default="m", kw_only=True)
    angles: Annotated[AngleUnit, "rad or deg"] = field(default="rad", kw_only=True)
    name: Annotated[str, "a short text"] = field(default="", kw_only=True)
    description: Annotated[str, "a text"] = field(default="", kw_only=True)
    workspace: Annotated[WorkspaceSection, "a mapping"] = field(default_factory=WorkspaceSection, kw_only=True)
    cable: Annotated[Cable, "a mapping"] = field(default_factory=Cable, kw_only=True)
    grippers: Annotated[GrippersSection, "a mapping"] = field(default_factory=GrippersSection, kw_only=True)
    obstacles: Annotated[list[AnyObstacle], "a list of obstacles"] = field(default_factory=list, kw_only=True)
    start: Shape
    goal: Shape
    plug: Annotated[Plug | None, "a mapping"] = field(default=None, kw_only=True)
    port: Annotated[Port | None, "a mapping"] = field(default=None, kw_only=True)
    cell: CellKey = field(default=None, kw_only=True)


@dataclass(frozen=True)
class CellFile(CellSection):
    """All keys of a file with a cell."""

    cableway: Annotated[int, f"the format version, {FORMAT_VERSION}"]
    units: Annotated[LengthUnit, "m, cm or mm"] = field(default="m", kw_only=True)
    angles: Annotated[AngleUnit, "rad or deg"] = field(default="rad", kw_only=True)


_OBSTACLES = {"box": Box, "polygon": Polygon, "disc": Disc}


def planar_obstacle(section: Mapping[str, Any]) -> Obstacle:
    """The obstacle of a valid mapping with the key type."""
    return _OBSTACLES[section["type"]](**{key: value for key, value in section.items() if key != "type"})


def with_steps(section: Mapping[str, Any]) -> dict[str, Any]:
    """A section `grippers` with a largest step and turn in place of the speeds that a file may give."""
    given = dict(section)
    for step, speed in (("max_step", "max_speed"), ("max_turn", "max_turn_speed")):
        value = given.pop(speed, None)
        if value is None:
            continue
        if step in given:
            raise TaskError(f"and grippers.{step} say the same twice: give one of them", ("grippers", speed))
        given[step] = CONTROL_STEP * value
    return given


def validate(document: Document, kind: type = TaskFile) -> dict[str, Any]:
    """The content of a task file, or of another one, with every key and type checked, in metres and radians whatever
    its units are.

    Args:
        document: The file.
        kind: The dataclass whose fields are its keys.

    Raises:
        TaskError: The format version is another one, or a key is unknown, missing, of the wrong type or out of bounds;
            where there are several faults, an unknown key before others and the one that stands first.
    """
    version = document.data.get("cableway", FORMAT_VERSION)
    if isinstance(version, int) and not isinstance(version, bool) and version != FORMAT_VERSION:
        raise document.locate(
            TaskError(f"is {version}, but this release reads format version {FORMAT_VERSION}", ("cableway",))
        )
    found = faults(kind, document.data)
    first = min(found, key=lambda fault: (not fault.unknown, document.line(fault.place)), default=None)
    if first is not None:
        raise document.locate(TaskError(first.problem, first.place))
    lengths, angles = checks.length_unit(document.data.get("units", "m")), document.data.get("angles", "rad")

    def read(number: float, notes: tuple[Any, ...], place: Place) -> float:
        quantity = next((note for note in notes if isinstance(note, Quantity)), None)
        return number if quantity is None else quantity.read(number, place, lengths, angles)

    try:
        return changed(kind, document.data, read)
    except TaskError as error:
        raise document.locate(error) from None
