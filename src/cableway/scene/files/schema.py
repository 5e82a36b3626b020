"""The task file: its keys, which are strict, and what a wrong one is told.

The models say which keys there are and of what type; values and how they fit together are checked by the records
they become (`cableway.scene.task` and its neighbours). The defaults are those of the records. Each field's
description completes "must be ..." in messages.
"""

from __future__ import annotations

import difflib
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError

from cableway.core.errors import Place, TaskError
from cableway.scene.cable import PROFILES, Cable
from cableway.scene.checks import shown
from cableway.scene.files.document import Document
from cableway.scene.grippers import Grippers
from cableway.scene.scene import Scene

FORMAT_VERSION = 1
"""The value of the key `cableway`."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    def given(self) -> dict[str, Any]:
        """The keys that stand in the file, with their values."""
        return {name: getattr(self, name) for name in type(self).model_fields if name in self.model_fields_set}


Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Profile = Annotated[list[float], Field(min_length=1)]
Pose = Annotated[list[float], Field(min_length=3, max_length=3)]
Poses = Annotated[list[Pose], Field(min_length=2, max_length=2)]


class WorkspaceSection(_Section):
    """The key `workspace`."""

    size: Pair = Field(default=list(Scene.size), description="[width, height] in metres")


class CableSection(_Section):
    """The key `cable`; what is given wins over the preset."""

    preset: str = Field(default="", description="the name of a preset")
    length: float = Field(default=Cable.length, description="a length in metres")
    radius: float = Field(default=Cable.radius, description="a length in metres")
    keypoints: int = Field(default=Cable.keypoints, description="a whole number")
    bending_stiffness: float = Field(default=Cable.bending_stiffness, description="a number in N m^2")
    stiffness_profile: Profile = Field(default=[*Cable.stiffness_profile], description="a list of factors")
    rest_curvature: Profile = Field(default=[*Cable.rest_curvature], description="a list of numbers in 1/m")
    yield_curvature: float = Field(default=Cable.yield_curvature, description="a number in 1/m")
    damping_time: float = Field(default=Cable.damping_time, description="a number in seconds")
    linear_density: float = Field(default=Cable.linear_density, description="a number in kg/m")
    friction: float = Field(default=Cable.friction, description="a Coulomb coefficient")
    drag: float = Field(default=Cable.drag, description="a number in N s/m^2")
    min_bend_radius: float = Field(default=Cable.min_bend_radius, description="a length in metres")


class GrippersSection(_Section):
    """The key `grippers`."""

    radius: float = Field(default=Grippers.radius, description="a length in metres")
    max_step: float = Field(default=Grippers.max_step, description="a length in metres")
    max_turn: float = Field(default=Grippers.max_turn, description="an angle in radians")
    separation: float = Field(default=Grippers.separation, description="a length in metres")


class BoxSection(_Section):
    """An obstacle of type `box`."""

    type: Literal["box"]
    center: Pair = Field(description="[x, y] in metres")
    size: Pair = Field(description="[width, height] in metres")
    angle: float = Field(default=0.0, description="an angle in radians")


class PolygonSection(_Section):
    """An obstacle of type `polygon`."""

    type: Literal["polygon"]
    vertices: list[Pair] = Field(description="a list of at least 3 points [x, y] in metres")


class DiscSection(_Section):
    """An obstacle of type `disc`."""

    type: Literal["disc"]
    center: Pair = Field(description="[x, y] in metres")
    radius: float = Field(description="a length in metres")


class PosesSection(_Section):
    """A shape given by gripper poses and a side, or by keypoints together with the poses that make them."""

    grippers: Poses = Field(description="two poses [x, y, theta], left then right, in metres and radians")
    bend: Literal["left", "right"] | None = Field(default=None, description="left or right")
    keypoints: list[Pair] | None = Field(default=None, description="a list of points [x, y] in metres")


class PlugSection(_Section):
    """The key `plug`."""

    length: float = Field(description="a length in metres")
    width: float = Field(description="a length in metres")


class PortSection(_Section):
    """The key `port`."""

    position: Pair = Field(description="[x, y] in metres")
    angle: float = Field(description="an angle in radians")
    standoff: float = Field(description="a length in metres")
    depth: float = Field(description="a length in metres")


_OBSTACLES: dict[str, type[_Section]] = {"box": BoxSection, "polygon": PolygonSection, "disc": DiscSection}


def _obstacle_tag(value: Any) -> str | None:
    kind = value.get("type") if isinstance(value, dict) else None
    return f"<{kind}>" if isinstance(kind, str) and kind in _OBSTACLES else None


def _shape_tag(value: Any) -> str:
    return "<poses>" if isinstance(value, dict) else "<keypoints>"


AnyObstacle = Annotated[
    Annotated[BoxSection, Tag("<box>")]
    | Annotated[PolygonSection, Tag("<polygon>")]
    | Annotated[DiscSection, Tag("<disc>")],
    Discriminator(_obstacle_tag),
]
Shape = Annotated[
    Annotated[list[Pair], Tag("<keypoints>")] | Annotated[PosesSection, Tag("<poses>")], Discriminator(_shape_tag)
]
_SHAPE = "a list of keypoints [x, y] in metres, or a mapping of grippers and bend"


class TaskFile(_Section):
    """All keys of a task file."""

    cableway: int = Field(description=f"the format version, {FORMAT_VERSION}")
    name: str = Field(default="", description="a short text")
    description: str = Field(default="", description="a text")
    workspace: WorkspaceSection = Field(default_factory=WorkspaceSection, description="a mapping")
    cable: CableSection = Field(default_factory=CableSection, description="a mapping")
    grippers: GrippersSection = Field(default_factory=GrippersSection, description="a mapping")
    obstacles: list[AnyObstacle] = Field(default_factory=list, description="a list of obstacles")
    start: Shape = Field(description=_SHAPE)
    goal: Shape = Field(description=_SHAPE)
    plug: PlugSection | None = Field(default=None, description="a mapping")
    port: PortSection | None = Field(default=None, description="a mapping")


_SECTIONS: dict[str, type[_Section]] = {
    "workspace": WorkspaceSection,
    "cable": CableSection,
    "grippers": GrippersSection,
    "plug": PlugSection,
    "port": PortSection,
    "<poses>": PosesSection,
    **{f"<{name}>": section for name, section in _OBSTACLES.items()},
}


_UNKNOWN = ("extra_forbidden", "invalid_key")
"""What Pydantic calls a key that is not in the schema: a text, or anything else."""


def validate(document: Document) -> TaskFile:
    """The content of a task file with every key and type checked.

    Raises:
        TaskError: The format version is another one, or a key is unknown, missing or of the wrong type; where there
            are several faults, an unknown key before others and the one that stands first.
    """
    version = document.data.get("cableway", FORMAT_VERSION)
    if isinstance(version, int) and version != FORMAT_VERSION:
        raise document.locate(
            TaskError(f"is {version}, but this release reads format version {FORMAT_VERSION}", ("cableway",))
        )
    try:
        return TaskFile.model_validate(document.data)
    except ValidationError as error:
        faults = [(fault["type"] not in _UNKNOWN, _explain(fault)) for fault in error.errors(include_url=False)]
    raise document.locate(min(faults, key=lambda fault: (fault[0], document.line(fault[1].place)))[1])


def _explain(fault: Any) -> TaskError:
    """Pydantic's account of one fault in our words."""
    steps, value, kind = fault["loc"], fault["input"], fault["type"]
    place: Place = tuple(step for step in steps if not _is_tag(step))
    if kind in _UNKNOWN:
        return TaskError(_unknown_key(str(place[-1]), steps[:-1]), (*place[:-1], str(place[-1])))
    if kind == "missing":
        return TaskError(f"is missing; it must be {_wanted(steps)}", place)
    if kind.startswith("union_tag") and isinstance(value, dict):
        found = f"got {shown(value['type'])}" if "type" in value else "it is missing"
        return TaskError(f"must be one of {', '.join(_OBSTACLES)}; {found}", (*place, "type"))
    if kind in ("too_short", "too_long"):
        return TaskError(f"must be {_wanted(steps)}, got {len(value)} values", place)
    if kind == "finite_number":
        return TaskError(f"must be a finite number, got {shown(value)}", place)
    found = "nothing" if value is None else shown(value)
    return TaskError(f"must be {_wanted(steps)}, got {found}", place)


def _is_tag(step: str | int) -> bool:
    return isinstance(step, str) and step.startswith("<") and step.endswith(">")


def _section(steps: tuple[str | int, ...]) -> type[_Section]:
    """The section that `steps` lead to."""
    return TaskFile if not steps else _SECTIONS[str(steps[-1])]


def _unknown_key(key: str, steps: tuple[str | int, ...]) -> str:
    known = list(_section(steps).model_fields)
    close = difflib.get_close_matches(key, known, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"is not a known key; {hint}known here: {', '.join(known)}"


def _wanted(steps: tuple[str | int, ...]) -> str:
    """What would be valid at a place: the description of its field, or of what stands in the field's lists."""
    last = max(i for i, step in enumerate(steps) if isinstance(step, str) and not _is_tag(step))
    name, below = str(steps[last]), [step for step in steps[last + 1 :] if isinstance(step, int)]
    if not below:
        return _section(steps[:last]).model_fields[name].description or "another value"
    if name == "obstacles":
        return "a mapping with the key type and those of that type"
    if len(below) == 2 or name in ("size", "center", "position", *PROFILES):
        return "a number"
    return "three numbers [x, y, theta]" if name == "grippers" else "two numbers [x, y]"
