"""The plug at the right end: its clearance, and how well it goes into its port."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.core.quantities import quantity
from cableway.outcome import PORT_ANGLE, PORT_DEPTH, PORT_LATERAL
from cableway.records import Check
from cableway.scene.task import Task
from cableway.verification.ends import Ends
from cableway.verification.geometry import alignment, plug_outline
from cableway.verification.swept import closest_approach, to_scene

MOUTH = 0.001
"""Distance [m] before the mouth of a port up to which what the port is in counts as an obstacle for the plug."""

OUTLINE_SPACING = 0.002
"""Distance [m] of the vertices round a plug: the depth of an overlap is that of the deepest of them."""


@dataclass(frozen=True)
class Inserted:
    """How a plug went into its port.

    Attributes:
        inserted: Whether it is in: aligned (`outcome.PORT_LATERAL`, `PORT_ANGLE`) from the mouth on, and deep enough.
        depth: How far [m] it is in at the end; negative before the mouth.
        lateral_at_mouth: Distance [m] of the tip from the port's axis when it reaches the mouth; None if it never did.
        angle_at_mouth: Turn [rad] from that axis then.
        lateral: The same distance [m] at the end.
        angle: The same turn [rad] at the end.
    """

    inserted: bool
    depth: float
    lateral_at_mouth: float | None
    angle_at_mouth: float | None
    lateral: float
    angle: float

    def __str__(self) -> str:
        pairs = [("at the port", self.lateral_at_mouth, self.angle_at_mouth), ("at the end", self.lateral, self.angle)]
        parts = [
            f"{quantity(lateral)} and {quantity(angle, 'rad')} off {where}"
            for where, lateral, angle in pairs
            if lateral is not None and angle is not None
        ]
        return f"{'yes' if self.inserted else 'no'}, {quantity(self.depth)} deep, {', '.join(parts)}"


def require_port(task: Task) -> None:
    """Refuse a task without a port.

    Raises:
        InputError: It has none.
    """
    if task.port is None:
        raise InputError(f"task {task.name!r} has no port")


def plug_clearance(
    poses: Float[np.ndarray, "t 3"], task: Task, limit: float, ends: Ends | None = None, *, inserting: bool = False
) -> list[Check]:
    """Least clearance of the plug's outline over a motion of the right end; nothing where there is no plug.

    Args:
        poses: (t, 3) right ends [m, m, rad].
        task: The task.
        limit: Least clearance [m]; contact fails in any case.
        ends: Where start and goal may keep less.
        inserting: Whether the motion is the insertion into the port. What the port is in then counts only until the tip
            is `MOUTH` before the mouth, and may be as near as that; from there on alignment is what keeps them apart.
    """
    if task.plug is None:
        return []
    lines = plug_outline(task.plug, poses, OUTLINE_SPACING)
    if not inserting:
        return [_clearance("plug clearance", lines, task, range(len(task.scene.obstacles)), limit, ends)]
    assert task.port is not None
    around = port_obstacles(task)
    others = [i for i in range(len(task.scene.obstacles)) if i not in around]
    inside = alignment(task.plug, task.port, poses).depth > -MOUTH
    before = int(np.argmax(inside)) if inside.any() else len(poses)
    checks = [_clearance("plug clearance", lines, task, others, limit)]
    if before and around:
        checks.append(_clearance("plug clearance before the port", lines[:before], task, around, 0.0))
    return checks


def measure_insertion(poses: Float[np.ndarray, "t 3"], task: Task) -> Inserted:
    """How the plug of a task with a port went in.

    Args:
        poses: (t, 3) right ends [m, m, rad] during the insertion.
        task: The task.
    """
    assert task.plug is not None
    assert task.port is not None
    along = alignment(task.plug, task.port, poses)
    depth, lateral, angle = along.depth, np.abs(along.lateral), np.abs(along.angle)
    reached = np.flatnonzero(depth >= 0)
    aligned, mouth = False, (None, None)
    if len(reached):
        first = int(reached[0])
        share = 0.0 if first == 0 else float(depth[first - 1] / (depth[first - 1] - depth[first]))
        at = max(first - 1, 0) + (share if first else 0.0)
        rows = np.arange(len(poses))
        mouth = (float(abs(np.interp(at, rows, along.lateral))), float(abs(np.interp(at, rows, along.angle))))
        worst = max(mouth[0], lateral[first:].max()), max(mouth[1], angle[first:].max())
        aligned = bool(worst[0] <= PORT_LATERAL and worst[1] <= PORT_ANGLE)
    deep = bool(depth[-1] >= task.port.depth - PORT_DEPTH)
    return Inserted(aligned and deep, float(depth[-1]), *mouth, float(lateral[-1]), float(angle[-1]))


def insertion_checks(poses: Float[np.ndarray, "t 3"], task: Task) -> list[Check]:
    """Checks of depth and alignment; those of the whole way from the mouth on."""
    assert task.plug is not None
    assert task.port is not None
    found, along = measure_insertion(poses, task), alignment(task.plug, task.port, poses)
    inside = along.depth >= 0
    wanted = task.port.depth - PORT_DEPTH
    checks = [Check("inserted depth", found.depth, "m", wanted, found.depth >= wanted)]
    for name, values, at_mouth, unit, limit in (
        ("plug misalignment", along.lateral, found.lateral_at_mouth, "m", PORT_LATERAL),
        ("plug angle", along.angle, found.angle_at_mouth, "rad", PORT_ANGLE),
    ):
        worst = max(float(np.abs(values[inside]).max()), at_mouth) if at_mouth is not None else float("nan")
        checks.append(Check(name, worst, unit, limit, worst <= limit, "" if inside.any() else "never reached the port"))
    return checks


def port_obstacles(task: Task) -> list[int]:
    """Indices of the obstacles that the port is in: those that the plug reaches into when it is in."""
    if task.plug is None or task.port is None:
        return []
    depth, rear = max(task.port.depth, MOUTH), np.array([[*task.port.position, task.port.angle]])
    area = shapely.Polygon(plug_outline(replace(task.plug, length=depth), rear, depth)[0])
    return [index for index, solid in enumerate(task.scene.solids) if solid.intersects(area)]


def _clearance(
    name: str, lines: np.ndarray, task: Task, obstacles: Sequence[int], limit: float, ends: Ends | None = None
) -> Check:
    """Clearance from some of the obstacles and from the walls."""
    whole = task.scene
    part = replace(whole, obstacles=tuple(whole.obstacles[i] for i in obstacles))
    measure = to_scene(part)
    found = closest_approach(lines, measure, limit if ends is None else ends.clearance(limit, lines, measure))
    places = [*obstacles, *range(len(whole.obstacles), len(whole.obstacles) + 4)]
    where = f"the plug and {whole.name_of(places[found.obstacle])}"
    return Check(name, found.distance, "m", found.wanted, found.wanted - 1e-9 <= found.distance > 0, where, found.row)
