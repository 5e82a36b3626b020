"""Task files in space: their keys, and the task that they mean.

A file is of a task in space if the size of its workspace has three values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float

from cableway.core.configuration import Tagged
from cableway.core.errors import InputError, TaskError
from cableway.core.quantities import limit_text, quantity, told_apart
from cableway.geometry import rotations
from cableway.rod.inverse import equilibria_at, meet_poses
from cableway.rod.spatial_inverse import fit_shape
from cableway.scene import checks
from cableway.scene.checks import AngleUnit, LengthUnit, Quantity
from cableway.scene.files.cells import cell_of, named_cell, stated_cell
from cableway.scene.files.document import Document
from cableway.scene.files.schema import FORMAT_VERSION, CellKey, Speed, TurnSpeed, planar_obstacle, with_steps
from cableway.scene.files.schema import AnyObstacle as PlanarObstacle
from cableway.scene.files.stl import read_stl
from cableway.scene.gripper_bodies import GRIPPER_BODIES
from cableway.scene.obstacles import Box, Disc, Polygon
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.grippers import GripperPiece, SpatialGrippers
from cableway.scene.spatial.obstacles import (
    ConvexMesh,
    Cuboid,
    Cylinder,
    Place,
    Prism,
    Quaternion,
    SpatialObstacle,
    Sphere,
    unit,
)
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import LOAD, SpatialDraft, SpatialTask
from cableway.scene.task import ENDS
from cableway.scene.validity import ROD_TOLERANCE

Number = "a number"
C = Annotated[float, Number, checks.COORDINATE]
A = Annotated[float, Number, checks.ANGLE]
Load = Annotated[float, Number, LOAD]
Part = Annotated[float, Number, Quantity("", -1.001, 1.001)]
Point = Annotated[tuple[C, C, C], "three numbers [x, y, z]"]
Turn = Annotated[tuple[Part, Part, Part, Part], "a unit quaternion [w, x, y, z]"]
Pose = Annotated[tuple[C, C, C, Part, Part, Part, Part], "seven numbers [x, y, z, w, x, y, z]"]
Side = Annotated[float, Number, checks.WORKSPACE]

STARTS = 129
"""First guesses of the shapes between two grippers."""

NEAR = 0.05
"""Distance, in lengths of the cable, that a stated equilibrium may be from the shape between stated grippers."""


@dataclass(frozen=True)
class WorkspaceSection:
    """The key `workspace`."""

    size: Annotated[tuple[Side, Side, Side], "[x, y, z], or [width, height] for a task on the table"]


@dataclass(frozen=True, kw_only=True)
class PieceSection:
    """A piece of a gripper."""

    points: Annotated[list[Point], "a list of 1 or at least 4 points [x, y, z]"]
    radius: Annotated[float, "a length", Quantity("m", 0.0, 1.0)] = 0.0


@dataclass(frozen=True, kw_only=True)
class GrippersSection(SpatialGrippers):
    """The key `grippers`: those of the record, and speeds in place of the largest step and turn."""

    body: Annotated[  # pyright: ignore[reportIncompatibleVariableOverride]  # as it stands in the file
        str | list[PieceSection] | None, f"{', '.join(GRIPPER_BODIES)}, or a list of pieces"
    ] = None
    max_speed: Speed = None
    max_turn_speed: TurnSpeed = None


@dataclass(frozen=True, kw_only=True)
class MeshSection:
    """An obstacle of type `mesh`: the convex hull of points or of an STL file, moved to where it stands."""

    points: Annotated[list[Point] | None, "a list of at least 4 points [x, y, z]"] = None
    file: Annotated[str | None, "the path of an STL file"] = None
    scale: Annotated[float, "a factor", Quantity("", 1e-6, 1e6)] = 1.0
    position: Place = (0.0, 0.0, 0.0)
    orientation: Quaternion = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class PrismSection:
    """An obstacle of type `prism`."""

    section: PlanarObstacle


@dataclass(frozen=True, kw_only=True)
class EndSection:
    """The key `start` or `goal`."""

    equilibrium: Annotated[
        tuple[C, C, C, A, A, A, Load, Load, Load, Load, Load, Load] | None,
        "twelve numbers: centre [x, y, z], rotation vector, force, moment",
    ] = None
    grippers: Annotated[tuple[Pose, Pose] | None, "two poses [x, y, z, w, x, y, z], left then right"] = None
    keypoints: Annotated[list[Point] | None, "a list of points [x, y, z]"] = None
    orientations: Annotated[tuple[Turn, Turn] | None, "two unit quaternions [w, x, y, z], left then right"] = None


AnyObstacle = Annotated[
    Any,
    "a mapping with the key type and those of that type",
    Tagged({"box": Cuboid, "cylinder": Cylinder, "sphere": Sphere, "mesh": MeshSection, "prism": PrismSection}),
]


@dataclass(frozen=True)
class SpatialTaskFile:
    """All keys of a task file in space, in their order."""

    cableway: Annotated[int, f"the format version, {FORMAT_VERSION}"]
    units: Annotated[LengthUnit, "m, cm or mm"] = field(default="m", kw_only=True)
    angles: Annotated[AngleUnit, "rad or deg"] = field(default="rad", kw_only=True)
    name: Annotated[str, "a short text"] = field(default="", kw_only=True)
    description: Annotated[str, "a text"] = field(default="", kw_only=True)
    workspace: Annotated[WorkspaceSection, "a mapping"]
    cable: Annotated[SpatialCable, "a mapping"] = field(default_factory=SpatialCable, kw_only=True)
    grippers: Annotated[GrippersSection, "a mapping"] = field(default_factory=GrippersSection, kw_only=True)
    obstacles: Annotated[list[AnyObstacle], "a list of obstacles"] = field(default_factory=list, kw_only=True)
    start: Annotated[EndSection, "a mapping of equilibrium, grippers, or keypoints and orientations"]
    goal: Annotated[EndSection, "a mapping of equilibrium, grippers, or keypoints and orientations"]
    cell: CellKey = field(default=None, kw_only=True)


def is_spatial(document: Document) -> bool:
    """Whether a task file is of a task in space: the size of its workspace has three values."""
    workspace = document.data.get("workspace")
    size = workspace.get("size") if isinstance(workspace, Mapping) else None
    return isinstance(size, list) and len(size) == 3


def spatial_task(content: Mapping[str, Any], name: str, folder: Path) -> SpatialTask:
    """The task that a valid file means; places in errors are those of the file.

    Args:
        content: As `schema.validate` returns it.
        name: Of a task that states none.
        folder: Of the file, to which paths in it are relative.

    Raises:
        TaskError: No cable can do it; it has the draft and all its faults where there is something to draw.
    """
    cable = spatial_cable(content.get("cable", {}))
    values: dict[str, Any] = {
        "name": content.get("name", name),
        "description": content.get("description", ""),
        "scene": SpatialScene(content["workspace"]["size"], obstacles_of(content.get("obstacles", []), folder)),
        "cable": cable,
        "grippers": _grippers(content.get("grippers", {})),
    }
    if (cell := content.get("cell")) is not None:
        values["cell"] = named_cell(cell) if isinstance(cell, str) else cell_of(cell)
    wrong: list[TaskError] = []
    for end in ENDS:
        try:
            values[end] = equilibrium_of(end, content[end], cable)
        except TaskError as error:
            values[end] = None
            wrong.append(error)
    if not wrong:
        return SpatialTask(**values)
    draft = SpatialDraft(**values)
    raise wrong[0].of(draft, (*wrong[1:], *draft.faults()))


def spatial_cable(section: Mapping[str, Any]) -> SpatialCable:
    """The cable of a section `cable`."""
    given = dict(section)
    preset = given.pop("preset", None)
    return SpatialCable(**given) if preset is None else SpatialCable.of_preset(preset, **given)


def _grippers(section: Mapping[str, Any]) -> SpatialGrippers:
    given = with_steps(section)
    if isinstance(given.get("body"), list):
        given["body"] = tuple(_piece(index, piece) for index, piece in enumerate(given["body"]))
    return SpatialGrippers(**given)


def _piece(index: int, section: Mapping[str, Any]) -> GripperPiece:
    try:
        return GripperPiece(**section)
    except TaskError as error:
        raise error.within("grippers", "body", index) from None


def obstacles_of(sections: list[Mapping[str, Any]], folder: Path) -> tuple[SpatialObstacle, ...]:
    """The obstacles of a section `obstacles`."""
    found = []
    for index, section in enumerate(sections):
        try:
            found.append(_obstacle(section, folder))
        except TaskError as error:
            raise error.within("obstacles", index) from None
    return tuple(found)


_PLAIN = {"box": Cuboid, "cylinder": Cylinder, "sphere": Sphere}


def _obstacle(section: Mapping[str, Any], folder: Path) -> SpatialObstacle:
    kind, given = section["type"], {key: value for key, value in section.items() if key != "type"}
    if kind in _PLAIN:
        return _PLAIN[kind](**given)
    if kind == "mesh":
        return _mesh(given, folder)
    try:
        return Prism(section=planar_obstacle(given["section"]))
    except TaskError as error:
        raise error.within("section") from None


def _mesh(given: Mapping[str, Any], folder: Path) -> ConvexMesh:
    points, file = given.get("points"), given.get("file")
    if (points is None) == (file is None):
        raise TaskError("must have either points or a file")
    if points is None:
        try:
            points = read_stl(folder / str(file))
        except InputError as error:
            raise TaskError(f"cannot be used: {error}", ("file",)) from None
    turned = rotations.from_vector(np.zeros(3))
    if "orientation" in given:
        turned = np.array(unit(given["orientation"], 4, ("orientation",)))
    moved = rotations.rotate(turned, given.get("scale", 1.0) * np.array(points, float)) if len(points) else points
    if not {"scale", "position", "orientation"} & given.keys():
        moved = points
    else:
        moved = moved + np.array(given.get("position", (0.0, 0.0, 0.0)))
    try:
        return ConvexMesh(points=moved)
    except TaskError as error:
        raise (TaskError(error.problem, ("file",)) if file is not None else error) from None


def equilibrium_of(end: str, section: Mapping[str, Any], cable: SpatialCable) -> Float[np.ndarray, "12"]:
    """The twelve numbers of a section `start` or `goal`.

    Raises:
        TaskError: It states too little or too much, or there is no such shape.
    """
    given = {key for key in ("equilibrium", "grippers", "keypoints", "orientations") if section.get(key) is not None}
    if given == {"equilibrium"}:
        return np.array(section["equilibrium"], float)
    if given == {"keypoints", "orientations"}:
        return _through_keypoints(end, section, cable)
    if "grippers" in given and given <= {"equilibrium", "grippers"}:
        return _between_grippers(end, section, cable)
    if given == {"keypoints"}:
        problem = "needs orientations beside keypoints, which do not say how the cable is rolled about itself"
        raise TaskError(problem, (end,))
    found = ", ".join(sorted(given)) or "nothing"
    raise TaskError(
        f"must have equilibrium, or grippers (and equilibrium near by), or keypoints and orientations; got {found}",
        (end,),
    )


def _through_keypoints(end: str, section: Mapping[str, Any], cable: SpatialCable) -> Float[np.ndarray, "12"]:
    keypoints = np.array(section["keypoints"], float).reshape(-1, 3)
    if len(keypoints) != cable.keypoints:
        problem = f"has {len(keypoints)} keypoints, not the {cable.keypoints} of cable.keypoints"
        raise TaskError(problem, (end, "keypoints"))
    turns = [unit(turn, 4, (end, "orientations")) for turn in section["orientations"]]
    q, distance = fit_shape(cable.rod, keypoints, np.array(turns))
    if distance > ROD_TOLERANCE * cable.length:
        problem = (
            f"are not those of a shape that the cable can have with such orientations of its ends: the nearest one is "
            f"{quantity(distance)} off, more than {ROD_TOLERANCE:.0%} of cable.length"
        )
        raise TaskError(problem, (end, "keypoints"), at=_at(keypoints.mean(axis=0)))
    return q


def _between_grippers(end: str, section: Mapping[str, Any], cable: SpatialCable) -> Float[np.ndarray, "12"]:
    rows = [(*pose[:3], *unit(pose[3:], 4, (end, "grippers"))) for pose in section["grippers"]]
    poses, rod = np.array(rows), cable.rod
    gap, middle = float(np.linalg.norm(poses[1, :3] - poses[0, :3])), _at(poses[:, :3].mean(axis=0))
    if gap > cable.length * (1 + 1e-9):
        far = f"are {told_apart(gap, cable.length)} apart, farther than the cable is long ({limit_text(cable.length)})"
        raise TaskError(far, (end, "grippers"), at=middle)
    if section.get("equilibrium") is None:
        found = equilibria_at(rod, poses, starts=STARTS)
        if not len(found):
            problem = (
                "are poses between which no stable shape of the cable was found: try other poses, or give its "
                "equilibrium or keypoints"
            )
            raise TaskError(problem, (end, "grippers"), at=middle)
        return found[0]
    near = np.array(section["equilibrium"], float)
    met = meet_poses(rod, poses, near[None])
    away = np.inf if not len(met) else float(np.abs(rod.shapes(met)[0] - rod.shapes(near[None])[0]).max())
    if away > NEAR * cable.length:
        problem = f"is not near a shape between the grippers that {end}.grippers states"
        raise TaskError(problem, (end, "equilibrium"), at=middle)
    return met[0]


def _at(point: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    x, y, z = point
    return float(x), float(y), float(z)


def spatial_content(task: SpatialDraft) -> dict[str, Any]:
    """What a task file says of a task in space, its ends by their twelve numbers."""
    cable = {key: value for key, value in vars(task.cable).items() if value is not None}
    body = task.grippers.body
    pieces = body if body is None or isinstance(body, str) else [_stated_piece(piece) for piece in body]
    grippers = {key: value for key, value in {**_plain(task.grippers), "body": pieces}.items() if value is not None}
    ends: dict[str, Any] = {
        end: None if (q := getattr(task, end)) is None else {"equilibrium": q.tolist()} for end in ENDS
    }
    return {
        "cableway": FORMAT_VERSION,
        "name": task.name,
        "description": task.description,
        "workspace": {"size": list(task.scene.size)},
        "cable": cable,
        "grippers": grippers,
        "obstacles": [_stated_obstacle(obstacle) for obstacle in task.scene.obstacles],
        **ends,
        **({} if task.cell is None else {"cell": stated_cell(task.cell)}),
    }


def _stated_piece(piece: GripperPiece) -> dict[str, Any]:
    return {"points": piece.points.tolist(), "radius": piece.radius}


def _plain(record: Any) -> dict[str, Any]:
    """The fields of a record, tuples as lists."""
    return {key: list(value) if isinstance(value, tuple) else value for key, value in vars(record).items()}


def _stated_obstacle(obstacle: SpatialObstacle) -> dict[str, Any]:
    if isinstance(obstacle, Prism):
        kinds = {Box: "box", Polygon: "polygon", Disc: "disc"}
        section = _plain(obstacle.section)
        if isinstance(obstacle.section, Polygon):
            section["vertices"] = obstacle.section.vertices.tolist()
        stated = {key: value for key, value in section.items() if value is not None}
        return {"type": "prism", "section": {"type": kinds[type(obstacle.section)], **stated}}
    if isinstance(obstacle, ConvexMesh):
        return {"type": "mesh", "points": obstacle.points.tolist()}
    kind = next(name for name, record in _PLAIN.items() if isinstance(obstacle, record))
    return {"type": kind, **_plain(obstacle)}
