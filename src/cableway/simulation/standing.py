"""What stands on a table in a MuJoCo model, seen from above, with heights.

Of a model only bodies, geoms, their defaults and meshes given by their vertices are read, in the reference pose;
joints, actuators, plugins and whatever is in other files are not. MuJoCo says where the geoms are.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, tostring

import mujoco
import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import FileFormatError
from cableway.core.quantities import quantity
from cableway.core.reading import one_line
from cableway.core.xml import read_xml
from cableway.drawings.curves import arc_steps
from cableway.drawings.records import Drawing, LeftOut, Outline, circle_outline, require_points
from cableway.scene.obstacles import MINIMUM_AREA
from cableway.simulation.surroundings import collected_warnings

READ = {
    "mujoco": ("compiler", "default", "asset", "worldbody"),
    "default": ("default", "geom", "mesh"),
    "asset": ("mesh",),
    "worldbody": ("body", "frame", "geom"),
    "body": ("body", "frame", "geom"),
    "frame": ("body", "frame", "geom"),
}
"""Elements that are read, by the one that they are in."""

COMPILER = ("angle", "eulerseq", "coordinate", "fitaabb")
UNREAD = ("material", "hfield", "fluidshape", "fluidcoef", "user")
"""Attributes of the compiler that are read, and those of geoms that are not."""

TOLD = ("include", "replicate", "composite", "flexcomp", "flex", "attach", "plugin", "extension", "hfield")
"""Elements whose geoms would be missing: a model with one is refused."""

MOST_GEOMS = 5000

LOWEST = 1e-4
"""Height [m] up to which something is part of the table."""

OVERHEAD = 0.25
"""Height [m] of its lower side from which on something hangs above the table; a Robotiq 2F-85 is lower."""


def read_model(path: Path, tolerance: float, table: float = 0.0) -> Drawing:
    """The outlines of what stands on a table in a model in MuJoCo's XML format.

    What hangs lower than `OVERHEAD` counts as if it stood there.

    Args:
        path: The file.
        tolerance: How far outlines are from round geoms at most [m].
        table: Height of the table in the model [m].

    Raises:
        FileFormatError: It cannot be read, is no such model, or has parts in other files.
    """
    root = read_xml(path)
    if root.tag != "mujoco":
        raise FileFormatError(f"{path}: not a MuJoCo model: its root is <{one_line(root.tag)[:40]}>, not <mujoco>")
    model = _compiled(_understood(root, path), path)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    outlines: list[Outline] = []
    reasons: dict[str, list[str]] = {}
    hanging: list[LeftOut] = []
    for index in range(model.ngeom):
        name = _name(model, index)
        if model.geom_type[index] == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        found = _outline(model, data, index, name, table, tolerance, path)
        if isinstance(found, Outline):
            outlines.append(found)
        elif found.at is None:
            reasons.setdefault(found.why, []).append(name)
        else:
            hanging.append(found)
    told = [LeftOut(name + (f" and {len(more)} more" if more else ""), why) for why, (name, *more) in reasons.items()]
    return Drawing(tuple(outlines), (*hanging, *told), None, "m, as in MuJoCo")


def _understood(root: Element, path: Path) -> Element:
    """The elements that are read, and nothing else."""
    for element in root.iter():
        if element.tag in TOLD:
            raise FileFormatError(f"{path}: it has <{element.tag}>, which is not read: save the compiled model as XML")
        reference = next((name for name in element.keys() if name.startswith("file")), None)  # noqa: SIM118
        if reference is not None and element.tag == "mesh":
            raise FileFormatError(
                f"{path}: the mesh {one_line(element.get('name', element.get('file')))[:80]!r} is in another file, and "
                "nothing but this file is read: put boxes or cylinders in its place, or its vertices"
            )
    kept = Element("mujoco")
    _keep(root, kept)
    if sum(1 for each in kept.iter("geom")) > MOST_GEOMS:
        raise FileFormatError(f"{path}: it has more than {MOST_GEOMS} geoms")
    return kept


def _keep(element: Element, kept: Element) -> None:
    for child in element:
        if child.tag not in READ.get(element.tag, ()):
            continue
        attributes = {name: value for name, value in child.items() if _is_read(child.tag, name)}
        _keep(child, SubElement(kept, child.tag, attributes))


def _is_read(tag: str, name: str) -> bool:
    if tag == "compiler":
        return name in COMPILER
    return not (tag == "geom" and name in UNREAD) and not name.startswith(("file", "builtin", "plugin"))


def _compiled(root: Element, path: Path) -> mujoco.MjModel:
    text = tostring(root, encoding="unicode")
    with collected_warnings() as warnings:
        try:
            model = mujoco.MjModel.from_xml_string(text)
        except (ValueError, mujoco.FatalError) as error:
            raise FileFormatError(f"{path}: not a MuJoCo model: {one_line(error)}") from None
    if warnings:
        raise FileFormatError(f"{path}: not a sound MuJoCo model: {one_line(warnings[0])}")
    return model


def _name(model: mujoco.MjModel, index: int) -> str:
    name = model.geom(index).name
    if name:
        return f"geom {one_line(name)[:40]}"
    body = one_line(model.body(model.geom_bodyid[index]).name)[:40]
    return f"geom {index}{f' of {body}' if body else ''}"


def _outline(
    model: mujoco.MjModel, data: mujoco.MjData, index: int, name: str, table: float, tolerance: float, path: Path
) -> Outline | LeftOut:
    """What a geom is, seen from above."""
    turn = data.geom_xmat[index].reshape(3, 3)
    require_points(name, np.vstack([data.geom_xpos[index], model.geom_size[index], turn]), path)
    places, round_part = _extent(model, data, index)
    if places is None or round_part is None:
        return LeftOut(name, "a shape that is not read")
    reach = float(np.linalg.norm(round_part[2]))
    bottom, top = places[:, 2].min() - reach - table, places[:, 2].max() + reach - table
    if top <= LOWEST:
        return LeftOut(name, "no higher than the table")
    flat = round_part[:2]
    spread = np.linalg.svd(flat, compute_uv=False)
    require_points(name, np.vstack([places[:, :2], [spread]]), path)
    turns = np.linspace(0, 2 * np.pi, 2 * arc_steps(float(spread[0]), np.pi, tolerance) + 1)[:-1]
    ways = np.column_stack([np.cos(turns), np.sin(turns)])
    across = np.linalg.norm(ways @ flat, axis=1, keepdims=True)
    rim = ways @ flat @ flat.T / np.maximum(across, 1e-300)  # where an ellipse is farthest that way
    region = shapely.MultiPoint((places[:, None, :2] + rim).reshape(-1, 2)).convex_hull
    if not isinstance(region, shapely.Polygon) or region.area < MINIMUM_AREA:
        return LeftOut(name, "next to no area from above")
    if bottom > OVERHEAD:
        return LeftOut(name, f"hangs {quantity(bottom)} above the table", region)
    aside = float(np.abs(places[:, :2] - places[0, :2]).max())
    if aside < 1e-9 and spread[1] > 0 and spread[0] - spread[1] < 1e-9:
        return circle_outline(name, (*places[0, :2].tolist(), float(spread[0])), round(float(top), 6))
    return Outline(name, region, height=round(float(top), 6))


def _extent(
    model: mujoco.MjModel, data: mujoco.MjData, index: int
) -> tuple[Float[np.ndarray, "k 3"] | None, Float[np.ndarray, "3 r"] | None]:
    """Points [m], and the matrix of the ellipse or ellipsoid that is about each: the geom is their convex hull."""
    at, turn, size = data.geom_xpos[index], data.geom_xmat[index].reshape(3, 3), model.geom_size[index]
    kinds, axis = mujoco.mjtGeom, turn[:, 2]
    match model.geom_type[index]:
        case kinds.mjGEOM_BOX:
            corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
            return at + corners @ turn.T, np.zeros((3, 3))
        case kinds.mjGEOM_SPHERE:
            return at[None], size[0] * turn
        case kinds.mjGEOM_ELLIPSOID:
            return at[None], turn * size
        case kinds.mjGEOM_CAPSULE:
            return np.array([at - size[1] * axis, at + size[1] * axis]), size[0] * turn
        case kinds.mjGEOM_CYLINDER:
            return np.array([at - size[1] * axis, at + size[1] * axis]), size[0] * turn[:, :2]
        case kinds.mjGEOM_MESH:
            mesh = model.geom_dataid[index]
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            return at + model.mesh_vert[first : first + count] @ turn.T, np.zeros((3, 3))
        case _:
            return None, None
