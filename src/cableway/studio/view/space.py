"""What there is in space: obstacles, the cable at start and goal with its grippers, what is wrong, and the plan.

Everything has a shadow straight below it on the table, by which it is seen how high it is.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations, product
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.quantities import quantity
from cableway.figures import palette
from cableway.geometry import polyline, rotations
from cableway.geometry.spatial_convex import Solid
from cableway.records import Plan
from cableway.rendering.space import DIRECTION, surface_of
from cableway.scene.bodies import LEFT, RIGHT
from cableway.scene.spatial.grippers import SpatialGrippers
from cableway.scene.spatial.obstacles import Prism, SpatialObstacle, Sphere
from cableway.scene.spatial.task import SpatialDraft
from cableway.scene.task import SPLINE_PIECES, End
from cableway.studio import spatial_obstacles as hands
from cableway.studio.inspection import Inspection
from cableway.studio.session import Moment
from cableway.studio.view.arms import SIDES, SpaceArms
from cableway.studio.view.canvas import Canvas
from cableway.studio.view.look import framing, mixed
from cableway.studio.view.meshes import Mesh, cord, creases, faceted, together, welded
from cableway.studio.view.table import COLORS, GRID_STEP, MARKED, SHAPES, draw_grid
from cableway.tracking import Row

BESIDE = 0.025
"""Distance of an axis' numbers from it [m]."""

GIZMO = 0.16
"""Size of arrows and arcs, as a share of the longest side of the workspace."""

OPACITY = 0.55
"""Of obstacles: what is behind them shows."""

PIECES, SHADOW = 2, 20
"""Of a line that stands for a cable, between two keypoints, and of its shadow: without graphics hardware, segments take
a page most of its time."""

HAND = 1.6
"""Length of the line that shows how a gripper is rolled, in its radii."""

BALL = Sphere(center=(0.0, 0.0, 0.0), radius=1.0)
"""Of a fault's mark, before it is made so large."""

FAULT = 0.012
"""Radius of that [m]."""

HERE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""The frame of the world."""

WAY_STEP = 3
"""Rows of a plan from one point of a gripper's way to the next."""

SEEN = 0.004
"""Half the width of the cross of a keypoint that was seen [m]."""


def camera_of(draft: SpatialDraft, fov: float, aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """From where and at what [m] the whole workspace is seen, on a page of this shape and angle [rad]."""
    corners = np.array(list(product(*((-0.03, side) for side in draft.scene.size))))
    return framing(corners, np.array(DIRECTION), fov, aspect)


def draw_table(canvas: Canvas, draft: SpatialDraft) -> None:
    """The workspace with a grid on its table, and the axes in millimetres."""
    x, y, z = size = draft.scene.size
    corners = np.array(list(product(*((0.0, side) for side in size))))
    edges = np.array([pair for pair in combinations(corners, 2) if np.count_nonzero(pair[0] != pair[1]) == 1])
    low = edges[:, :, 2].max(axis=1) == 0
    canvas.lines("/table/walls", edges[low], palette.INK, 2.0)
    canvas.lines("/table/edges", edges[~low], palette.OBSTACLE, 1.0)
    draw_grid(canvas, x, y, BESIDE)
    for at in np.arange(2 * GRID_STEP, z + 1e-6, 2 * GRID_STEP):
        canvas.words(f"/table/z{at:.2f}", f"{1000 * at:.0f}", (-BESIDE, 0.0, float(at)), "center-right")
    canvas.sweep("/table")


def draw_obstacles(canvas: Canvas, draft: SpatialDraft, selected: int | None, *, held: bool = False) -> None:
    """Obstacles, and what the selected one is moved and turned by."""
    ceiling = draft.scene.size[2]
    sides: list[Float[np.ndarray, "k 2 3"]] = []
    colors: list[str] = []
    for index, obstacle in enumerate(draft.scene.obstacles):
        chosen = index == selected
        frame, (mesh, edges) = hands.frame_of(obstacle), _shape(hands.placed(obstacle, HERE), ceiling)
        color = mixed(palette.BLUE, 0.72) if chosen else palette.OBSTACLE
        canvas.solid(
            f"/obstacles/{index}", mesh, color, at=tuple(frame[:3]), turn=tuple(frame[3:]),
            opacity=OPACITY, draggable=True, clickable=True,
        )  # fmt: skip
        sides.append(frame[:3] + rotations.rotate(frame[3:], edges))
        colors += len(edges) * [palette.BLUE if chosen else palette.OBSTACLE_EDGE]
        if chosen:
            stands = isinstance(obstacle, Prism)
            canvas.gizmo(
                f"/gizmo/obstacles/{index}", frame, GIZMO * max(draft.scene.size), axes=(True, True, not stands),
                turns=hands.turns(obstacle), held=held,
            )  # fmt: skip
    if colors:
        canvas.lines("/edges", np.concatenate(sides), colors, 1.4)
    for prefix in ("/obstacles", "/edges", "/gizmo/obstacles"):
        canvas.sweep(prefix)


def draw_ends(
    canvas: Canvas,
    moment: Moment,
    inspection: Inspection,
    *,
    grasped: tuple[End, int] | None = None,
    held: bool = False,
) -> None:
    """The cable at start and goal with its grippers, how clear and stable it is, and what moves the one grasped."""
    draft: Any = moment.draft
    lines: list[Float[np.ndarray, "k 2 3"]] = []
    colors: list[str] = []
    for end, color in COLORS.items():
        q = moment.shapes[end]
        if q is None:
            continue
        stations, poses = (each[0] for each in draft.rod.shapes(q[None]))
        canvas.solid(f"/ends/{end}-cable", cord(stations, draft.cable.radius), color)
        for side, pose in enumerate(poses):
            body = _body(draft.grippers, side)
            chosen = (end, side) == grasped
            canvas.solid(
                f"/ends/{end}-{side}", body, mixed(color, 0.25 if chosen else 0.55), at=tuple(pose[:3]),
                turn=tuple(pose[3:]), draggable=True, clickable=True,
            )  # fmt: skip
            up = pose[:3] + HAND * draft.grippers.radius * rotations.rotate(pose[3:], np.array([0.0, 0.0, 1.0]))
            lines.append(np.array([[pose[:3], up]]))
            colors.append(color)
            canvas.words(f"/ends/{end}-{side}-letter", "LR"[side], _above(up, 0.012))
            if chosen:
                canvas.gizmo(f"/gizmo/ends/{end}-{side}", pose, GIZMO * max(draft.scene.size), held=held)
        lines.append(_shadow(stations))
        colors += len(lines[-1]) * [mixed(color, 0.6)]
        if end in inspection.ends:
            found = inspection.ends[end]
            text = f"{end}: {quantity(found.clearance)} clear, stability {found.stability:.0f}"
            canvas.words(f"/ends/{end}-figures", text, _above(stations[len(stations) // 2], 0.03), "bottom-center")
    if colors:
        canvas.lines("/ends/lines", np.concatenate(lines), colors, 2.0)
    for prefix in ("/ends", "/gizmo/ends"):
        canvas.sweep(prefix)


def draw_faults(canvas: Canvas, faults: list[tuple[float, ...]]) -> None:
    """Numbered balls where something is wrong [m]."""
    mesh, _ = _shape(BALL, 0.0)
    for number, at in enumerate(faults[:MARKED], start=1):
        x, y, z = (*at, 0.0)[:3]
        canvas.solid(f"/faults/{number}", Mesh(FAULT * mesh.vertices, mesh.faces), palette.BAD, at=(x, y, z))
        canvas.words(f"/faults/{number}-number", str(number), (x, y, z - 2 * FAULT))
    canvas.sweep("/faults")


def draw_plan(canvas: Canvas, draft: SpatialDraft, plan: Plan | None) -> None:
    """Shapes of a plan over time, from the colour of the start to that of the goal, and the ways of the grippers."""
    del draft
    if plan is not None:
        rows = np.unique(np.linspace(0, plan.steps, SHAPES).round().astype(int))
        shapes = polyline.spline(plan.shapes[rows], PIECES)
        pieces = np.stack([shapes[:, :-1], shapes[:, 1:]], axis=2)
        colors = [mixed(palette.color_of_time(row / plan.steps), 0.35) for row in rows]
        canvas.lines("/plan/shapes", pieces.reshape(-1, 2, 3), np.repeat(colors, pieces.shape[1]).tolist(), 2.0)
        for side, color in enumerate(SIDES):
            way = plan.poses[np.unique(np.r_[: plan.steps : WAY_STEP, plan.steps]), side, :3]
            canvas.lines(f"/plan/way{side}", np.stack([way[:-1], way[1:]], axis=1), color, 2.0)
    canvas.sweep("/plan")


def draw_moment(
    canvas: Canvas, draft: SpatialDraft, plan: Plan | None, row: int, *, arms: SpaceArms | None = None
) -> None:
    """The cable, its grippers and the arms in one row of a plan."""
    if plan is not None:
        row = min(row, plan.steps)
        line = polyline.spline(plan.shapes[row], SPLINE_PIECES)
        _draw_held(canvas, "/moment", draft, line, plan.poses[row])
        if arms is not None and plan.joints is not None:
            arms.draw(canvas, "/moment", plan.joints[row])
    canvas.sweep("/moment")


def draw_run(canvas: Canvas, draft: SpatialDraft, row: Row | None) -> None:
    """A row of a run: the true cable and its grippers, where it should be, and crosses where it was seen."""
    if row is not None:
        _draw_held(canvas, "/run", draft, row.measured.centreline, row.measured.poses)
        wanted = polyline.spline(row.reference, PIECES)
        canvas.lines("/run/reference", np.stack([wanted[:-1], wanted[1:]], axis=1), palette.REFERENCE, 2.5)
        seen = row.observed[np.isfinite(row.observed[:, 0])]
        if len(seen):
            arms = SEEN * np.array([[-1.0, 1.0]]) * np.eye(3)[:, :, None]
            crosses = seen[:, None, None] + arms.swapaxes(1, 2)
            canvas.lines("/run/seen", crosses.reshape(-1, 2, 3), palette.GREEN, 1.6)
    canvas.sweep("/run")


def _draw_held(
    canvas: Canvas, name: str, draft: SpatialDraft, line: Float[np.ndarray, "m 3"], poses: Float[np.ndarray, "2 7"]
) -> None:
    """A cable, what holds it, and their shadow."""
    canvas.solid(f"{name}/cable", cord(line, 1.1 * draft.cable.radius), palette.INK)
    for side, color in enumerate(SIDES):
        at, turn = tuple(poses[side, :3]), tuple(poses[side, 3:])
        canvas.solid(f"{name}/{side}", _body(draft.grippers, side), color, at=at, turn=turn)
    canvas.lines(f"{name}/shadow", _shadow(line), palette.MUTED, 2.0)


def _shadow(line: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "k 2 3"]:
    """A line on the table below another."""
    below = line[:: max(len(line) // SHADOW, 1)] * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.001]
    return np.stack([below[:-1], below[1:]], axis=1)


def _above(point: Float[np.ndarray, "3"], by: float) -> tuple[float, float, float]:
    x, y, z = point.tolist()
    return x, y, z + by


@lru_cache(maxsize=2000)
def _shape(obstacle: SpatialObstacle, ceiling: float) -> tuple[Mesh, Float[np.ndarray, "e 2 3"]]:
    """The triangles of an obstacle and its edges."""
    surface = surface_of(obstacle.solid, ceiling)
    return (welded if isinstance(obstacle, Sphere) else faceted)(surface), creases(surface)


@lru_cache(maxsize=100)
def _body(grippers: SpatialGrippers, side: int) -> Mesh:
    """A gripper in its frame."""
    assert side in (LEFT, RIGHT)
    solids: list[Solid] = [body.solid(HERE) for body in grippers.bodies if body.side == side]
    return together([(faceted if len(solid.triangles) else welded)(surface_of(solid, 0.0)) for solid in solids])
