"""What lies on the table: obstacles with their knobs, the cable at start and goal, what is wrong, and the plan."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.quantities import quantity
from cableway.figures import palette
from cableway.geometry import polyline, se2
from cableway.records import Plan
from cableway.rendering.cell import feet, view_direction
from cableway.scene.obstacles import Box, Disc, Obstacle, to_shapely
from cableway.scene.task import ENDS, SPLINE_PIECES, Draft
from cableway.studio import obstacles as hands
from cableway.studio.inspection import Inspection
from cableway.studio.session import Moment
from cableway.studio.view.arms import SIDES, Arms, draw_feet, draw_hands, outlines
from cableway.studio.view.canvas import Canvas, along, outline, path
from cableway.studio.view.look import framing, mixed
from cableway.studio.view.meshes import circle, prism, ribbon, ring, tube
from cableway.tracking import Row

FLAT = 0.010
"""Height [m] at which an obstacle is drawn that nothing passes above."""

GRASP, KNOB = 0.011, 0.007
"""Radii [m] of what a gripper is dragged by and of a knob, larger than what they stand for, to be hit."""

ARM = 0.045
"""Distance [m] from a gripper to the knob that turns it."""

SHAPES = 14
"""Most shapes of a plan drawn over time."""

PORT_WALL = 0.002
"""Thickness [m] of what stands for the walls of a port."""

WAY = 0.002
"""Width [m] of the way of a gripper."""

GRID_STEP = 0.1
"""Between the lines of the grid [m]."""

SEEN = 0.003
"""Half the width of the cross of a keypoint that was seen [m]."""

MARKED = 6
"""Most faults marked."""

ARM_HEIGHT = 0.6
"""Height [m] above its base up to which an arm is in view at the least."""

TILT = 0.2
"""By which a page looks at the table from aside [rad]."""

COLORS = dict(zip(ENDS, (palette.START, palette.GOAL), strict=True))


def camera_of(draft: Draft, fov: float, aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """From where and at what [m] the whole table is seen, on a page of this shape and angle [rad]; with arms, from
    beside it."""
    width, height = draft.scene.size
    if draft.cell is not None:
        reach = np.array([0.0, 0.0, ARM_HEIGHT])
        standing = [at + up for at, _ in feet(draft) for up in (reach, 0.0)]
        corners = np.array([[x, y, 0.0] for x in (-0.03, width) for y in (-0.03, height)])
        points = np.concatenate([corners, standing])
        return framing(points, view_direction(draft, draft.cell), fov, aspect)
    middle = np.array([width / 2, height / 2, 0.0])
    away = max(1.2 * height, 1.24 * width / aspect) / 2 / np.tan(fov / 2)
    return middle + away * np.array([0.0, -np.sin(TILT), np.cos(TILT)]), middle


def draw_table(canvas: Canvas, draft: Draft) -> None:
    """The workspace with its grid, and the axes in millimetres; and what arms stand on."""
    width, height = draft.scene.size
    draw_feet(canvas, draft)
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    canvas.lines("/table/walls", outline(corners, 0.0), palette.INK, 2.0)
    draw_grid(canvas, width, height, 0.012)
    canvas.sweep("/table")


def draw_grid(canvas: Canvas, width: float, height: float, beside: float) -> None:
    """A grid on the table [m], and its axes in millimetres, so far beside it."""
    rows = [[[x, 0, 0], [x, height, 0]] for x in np.arange(GRID_STEP, width - 1e-6, GRID_STEP)]
    rows += [[[0, y, 0], [width, y, 0]] for y in np.arange(GRID_STEP, height - 1e-6, GRID_STEP)]
    if rows:
        canvas.lines("/table/grid", np.array(rows, dtype=float) + [0, 0, -0.0005], palette.GRID, 1.0)
    for x in np.arange(0.0, width + 1e-6, 2 * GRID_STEP):
        canvas.words(f"/table/x{x:.2f}", f"{1000 * x:.0f}", (float(x), -beside, 0.0), "top-center")
    for y in np.arange(0.0, height + 1e-6, 2 * GRID_STEP):
        canvas.words(f"/table/y{y:.2f}", f"{1000 * y:.0f}", (-beside, float(y), 0.0), "center-right")


def draw_obstacles(canvas: Canvas, draft: Draft, selected: int | None) -> None:
    """Obstacles, the knobs of the selected one, and the port."""
    sides: list[Float[np.ndarray, "k 2 3"]] = []
    colors: list[str] = []
    for index, obstacle in enumerate(draft.scene.obstacles):
        x, y = hands.middle_of(obstacle)
        at, angle, top = (float(x), float(y)), hands.angle_of(obstacle), obstacle.height or FLAT
        local, chosen = _local(obstacle), index == selected
        color = mixed(palette.BLUE, 0.72) if chosen else palette.OBSTACLE
        name = f"/obstacles/{index}"
        canvas.solid(name, prism(local, 0.0, top), color, at=at, angle=angle, draggable=True, clickable=True)
        sides.append(outline(se2.transform(local, np.array(at), angle), top + 0.0003))
        colors += len(local) * [palette.BLUE if chosen else palette.OBSTACLE_EDGE]
        if chosen:
            _draw_knobs(canvas, obstacle, top)
    if draft.port_walls is not None:
        _draw_port(canvas, draft, draft.port_walls)
    if sides:
        canvas.lines("/edges", np.concatenate(sides), colors, 1.6)
    for prefix in ("/obstacles", "/edges", "/knobs", "/port"):
        canvas.sweep(prefix)


def _draw_port(canvas: Canvas, draft: Draft, walls: Float[np.ndarray, "4 2"]) -> None:
    """Its walls, white between them, on top of the obstacle that it is in."""
    area = shapely.Polygon(walls)
    within = (each.height or FLAT for each in draft.scene.obstacles if to_shapely(each).intersects(area))
    top = max(within, default=FLAT)
    canvas.solid("/port/inside", prism(walls[::-1], 0.0, top + PORT_WALL / 2), "#ffffff")
    for number, (start, end) in enumerate(pairwise(walls)):
        ahead = PORT_WALL / 2 * (end - start) / np.linalg.norm(end - start)
        aside = np.array([-ahead[1], ahead[0]])
        corners = np.array([start - ahead - aside, end + ahead - aside, end + ahead + aside, start - ahead + aside])
        canvas.solid(f"/port/{number}", prism(corners, 0.0, top + PORT_WALL), palette.INK)


def _draw_knobs(canvas: Canvas, obstacle: Obstacle, top: float) -> None:
    solid = prism(circle(KNOB, 16), top, top + 0.002)
    for number, (x, y) in enumerate(hands.knobs(obstacle)):
        canvas.solid(f"/knobs/{number}", solid, palette.BLUE, at=(float(x), float(y)), draggable=True)
    if isinstance(obstacle, Disc):
        return
    middle, knob = hands.middle_of(obstacle), turn_knob(obstacle)
    canvas.lines("/knobs/arm", path(np.array([middle, knob]), top + 0.001), palette.BLUE, 1.4)
    at = (float(knob[0]), float(knob[1]))
    canvas.solid("/knobs/turn", prism(circle(KNOB, 16), top, top + 0.002), palette.ORANGE, at=at, draggable=True)


def turn_knob(obstacle: Obstacle) -> Float[np.ndarray, "2"]:
    """Where an obstacle is taken to turn it [m]: beyond its upper side."""
    middle = hands.middle_of(obstacle)
    reach = float(np.linalg.norm(obstacle.vertices - middle, axis=1).max()) + 0.025
    if isinstance(obstacle, Box):
        reach = obstacle.size[1] / 2 + 0.03
    turn = hands.angle_of(obstacle) + np.pi / 2
    return middle + reach * np.array([np.cos(turn), np.sin(turn)])


def draw_ends(canvas: Canvas, moment: Moment, inspection: Inspection) -> None:
    """The cable at start and goal with its grippers, what they are turned by, and how clear and stable it is."""
    draft: Any = moment.draft
    radius = draft.cable.radius
    arms: list[Float[np.ndarray, "k 2 3"]] = []
    colors: list[str] = []
    for end, color in COLORS.items():
        q = moment.shapes[end]
        if q is None:
            continue
        stations, poses = draft.cable.rod.shapes(q[None])
        canvas.solid(f"/ends/{end}-cable", tube(stations[0], radius, radius), color)
        for side, pose in enumerate(poses[0]):
            name, at = f"/ends/{end}-{side}", (float(pose[0]), float(pose[1]))
            knob = along(pose, ARM if side else -ARM)
            grasp = prism(circle(GRASP, 24), 0.0, 2 * radius + 0.002)
            canvas.solid(name, grasp, mixed(color, 0.25), at=at, draggable=True)
            arms.append(path(np.array([at, knob]), 0.002))
            colors.append(mixed(color, 0.35))
            canvas.solid(f"{name}-turn", prism(circle(KNOB, 16), 0.0, 0.004), color, at=knob, draggable=True)
            canvas.words(f"{name}-letter", "LR"[side], (*at, 2 * radius + 0.003))
        held = outlines(draft, poses[0])
        arms.append(held)
        colors += len(held) * [mixed(color, 0.35)]
        if end in inspection.ends:
            found = inspection.ends[end]
            text = f"{end}: {quantity(found.clearance)} clear, stability {found.stability:.0f}"
            x, y = stations[0][len(stations[0]) // 2]
            inward = "left" if x < draft.scene.size[0] / 2 else "right"
            canvas.words(f"/ends/{end}-figures-{inward}", text, (float(x), float(y) + 0.015, 0.01), f"bottom-{inward}")
    if arms:
        canvas.lines("/ends/arms", np.concatenate(arms), colors, 1.6)
    canvas.sweep("/ends")


def draw_faults(canvas: Canvas, faults: list[tuple[float, ...]]) -> None:
    """Numbered rings where something is wrong [m]."""
    for number, (x, y, *_) in enumerate(faults[:MARKED], start=1):
        canvas.solid(f"/faults/{number}", ring(0.013, 0.017, 0.022), palette.BAD, at=(x, y))
        canvas.words(f"/faults/{number}-number", str(number), (x + 0.02, y + 0.02, 0.025))
    canvas.sweep("/faults")


def draw_plan(canvas: Canvas, draft: Draft, plan: Plan | None) -> None:
    """Shapes of a plan over time, from the colour of the start to that of the goal, and the ways of the grippers."""
    if plan is not None:
        rows = np.unique(np.linspace(0, plan.steps, SHAPES).round().astype(int))
        for place, line in enumerate(polyline.spline(plan.shapes[rows], SPLINE_PIECES)):
            color = mixed(palette.color_of_time(rows[place] / plan.steps), 0.55)
            canvas.solid(f"/plan/{place}", ribbon(line, 1.2 * draft.cable.radius, 0.001), color)
        for side, color in enumerate(SIDES):
            canvas.solid(f"/plan/way{side}", ribbon(plan.poses[:, side, :2], WAY, 0.0035), color)
    canvas.sweep("/plan")


def draw_moment(canvas: Canvas, draft: Draft, plan: Plan | None, row: int, arms: Arms | None = None) -> None:
    """The cable and what holds it in one row of a plan."""
    if plan is not None:
        radius = draft.cable.radius
        row = min(row, plan.steps)
        line = polyline.spline(plan.shapes[row], SPLINE_PIECES)
        canvas.solid("/moment/cable", tube(line, 0.7 * radius, 1.6 * radius), palette.INK)
        draw_hands(canvas, "/moment", draft, plan.poses[row], 3.2 * radius)
        if arms is not None and plan.joints is not None:
            arms.draw(canvas, "/moment", plan.joints[row])
    canvas.sweep("/moment")


def draw_run(canvas: Canvas, draft: Draft, row: Row | None, arms: Arms | None = None) -> None:
    """A row of a run: the true cable and what holds it, where it should be, and crosses where it was seen."""
    if row is not None:
        radius = draft.cable.radius
        canvas.solid("/run/cable", tube(row.measured.centreline, radius, 1.6 * radius), palette.INK)
        wanted = polyline.spline(row.reference, SPLINE_PIECES)
        canvas.lines("/run/reference", path(wanted, 3.0 * radius), palette.REFERENCE, 2.0)
        draw_hands(canvas, "/run", draft, row.measured.poses, 3.2 * radius)
        if arms is not None and row.measured.joints is not None:
            arms.draw(canvas, "/run", row.measured.joints)
        seen = row.observed[np.isfinite(row.observed[:, 0])]
        if len(seen):
            strokes = SEEN * np.array([[[-1.0, -1.0], [1.0, 1.0]], [[-1.0, 1.0], [1.0, -1.0]]])
            crosses = (seen[:, None, None] + strokes).reshape(-1, 2, 2)
            raised = np.concatenate([crosses, np.full((len(crosses), 2, 1), 3.3 * radius)], axis=2)
            canvas.lines("/run/seen", raised, palette.GREEN, 1.6)
    canvas.sweep("/run")


def _local(obstacle: Obstacle) -> Float[np.ndarray, "k 2"]:
    """Outline of an obstacle about its centre, before turning [m]."""
    if isinstance(obstacle, Disc):
        return circle(obstacle.radius)
    if isinstance(obstacle, Box):
        return np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * np.array(obstacle.size) / 2
    return obstacle.vertices - hands.middle_of(obstacle)
