"""The task file: its keys and the types of their values.

Sections are the records they become; how values fit together is checked by those (`cableway.scene.task` and its
neighbours). What messages say a value must be stands in the annotations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from cableway.core.configuration import Tagged, faults
from cableway.core.errors import TaskError
from cableway.scene.cable import Cable
from cableway.scene.files.document import Document
from cableway.scene.grippers import Grippers, Plug, Port
from cableway.scene.obstacles import Box, Disc
from cableway.scene.scene import Scene

FORMAT_VERSION = 1
"""The value of the key `cableway`."""

Point = Annotated[tuple[float, float], "two numbers [x, y]"]
Pose = Annotated[tuple[float, float, float], "three numbers [x, y, theta]"]


@dataclass(frozen=True)
class WorkspaceSection:
    """The key `workspace`."""

    size: Annotated[tuple[float, float], "[width, height] in metres"] = Scene.size


@dataclass(frozen=True)
class PolygonSection:
    """An obstacle of type `polygon`."""

    vertices: Annotated[list[Point], "a list of at least 3 points [x, y] in metres"]


@dataclass(frozen=True)
class PosesSection:
    """A shape given by gripper poses and a side, or by keypoints together with the poses that make them."""

    grippers: Annotated[tuple[Pose, Pose], "two poses [x, y, theta], left then right, in metres and radians"]
    bend: Annotated[Literal["left", "right"] | None, "left or right"] = None
    keypoints: Annotated[list[Point] | None, "a list of points [x, y] in metres"] = None


AnyObstacle = Annotated[
    Any,
    "a mapping with the key type and those of that type",
    Tagged({"box": Box, "polygon": PolygonSection, "disc": Disc}),
]
Shape = Annotated[list[Point] | PosesSection, "a list of keypoints [x, y] in metres, or a mapping of grippers and bend"]


@dataclass(frozen=True)
class TaskFile:
    """All keys of a task file, in their order."""

    cableway: Annotated[int, f"the format version, {FORMAT_VERSION}"]
    name: Annotated[str, "a short text"] = field(default="", kw_only=True)
    description: Annotated[str, "a text"] = field(default="", kw_only=True)
    workspace: Annotated[WorkspaceSection, "a mapping"] = field(default_factory=WorkspaceSection, kw_only=True)
    cable: Annotated[Cable, "a mapping"] = field(default_factory=Cable, kw_only=True)
    grippers: Annotated[Grippers, "a mapping"] = field(default_factory=Grippers, kw_only=True)
    obstacles: Annotated[list[AnyObstacle], "a list of obstacles"] = field(default_factory=list, kw_only=True)
    start: Shape
    goal: Shape
    plug: Annotated[Plug | None, "a mapping"] = field(default=None, kw_only=True)
    port: Annotated[Port | None, "a mapping"] = field(default=None, kw_only=True)


def validate(document: Document) -> Mapping[str, Any]:
    """The content of a task file with every key and type checked.

    Raises:
        TaskError: The format version is another one, or a key is unknown, missing or of the wrong type; where there
            are several faults, an unknown key before others and the one that stands first.
    """
    version = document.data.get("cableway", FORMAT_VERSION)
    if isinstance(version, int) and not isinstance(version, bool) and version != FORMAT_VERSION:
        raise document.locate(
            TaskError(f"is {version}, but this release reads format version {FORMAT_VERSION}", ("cableway",))
        )
    found = faults(TaskFile, document.data)
    first = min(found, key=lambda fault: (not fault.unknown, document.line(fault.place)), default=None)
    if first is not None:
        raise document.locate(TaskError(first.problem, first.place))
    return document.data
