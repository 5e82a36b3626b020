"""Pictures of tasks in space, in perspective: shaded obstacles, grippers, cables; what is hidden of these is dashed."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import combinations, product

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cableway.core.errors import Point, TaskError, printable
from cableway.core.quantities import limit_text, size_text
from cableway.figures import palette, style
from cableway.figures.marks import LINE, Mark, draw_marks, sentence_lines, write_lines
from cableway.figures.perspective import pale
from cableway.figures.scene import TASKS_SHOWN, small_panels, smooth
from cableway.records import Attempt, Plan, Rollout
from cableway.rendering.camera import Camera
from cableway.rendering.mesh import Mesh, capsules
from cableway.rendering.picture import Light, Picture, render
from cableway.rendering.space import CABLE, DIRECTION, GRIPPER, OBSTACLE, TABLE, body_mesh, cable_mesh, scene_mesh
from cableway.robot.spatial_arms import SpatialArms, SpatialWay
from cableway.scene.cell import Cell
from cableway.scene.spatial.task import SpatialDraft, SpatialTask
from cableway.scene.task import ENDS, End

VIEW = 0.5
"""Angle of view across a picture [rad]."""

LAMP, AMBIENT = np.array([-0.4, -0.9, 2.6]), 0.55
"""Where the lamp is from the corner of the workspace, in its largest sizes, and the share of light from everywhere."""

PANEL, TALL = 3.3, 0.8
"""Width [inch] of a panel, and its height over that."""

WIDE, SHAPES = 5.0, 8
"""Width [inch] of the picture of a plan, and how many of its shapes it shows between start and goal."""

FINE = 250
"""Pixels of a panel to the inch."""

BEHIND = 0.004
"""Depth [m] by which a point is behind what is seen there before it counts as hidden; added to the radius."""

CURVES, GAP = 2.4, 0.35
"""Width [inch] of a panel with curves, and the height between two."""

TALL_ARM, WIDE_ARM = 0.7, 0.2
"""How high above its base, and how far about it, a picture shows an arm [m]."""

COLORS: dict[End, str] = dict(zip(ENDS, (palette.START, palette.GOAL), strict=True))


class SpaceView:
    """A scene in space seen by one camera, in panels whose units are pixels, y upwards.

    Args:
        task: The task.
        width: Of the panel [inch].
        pixels: Width and height of its picture; as the panel's where None.
        arms: Of the cell, drawn into every picture.
    """

    def __init__(
        self,
        task: SpatialDraft,
        width: float = PANEL,
        pixels: tuple[int, int] | None = None,
        arms: Sequence[Mesh] = (),
    ) -> None:
        self.task = task
        self.size = pixels or (round(FINE * width), round(FINE * width * TALL))
        scene = task.scene
        shown = _corners(task)
        if task.cell is not None and arms:
            shown = np.concatenate([shown, _about_arms(task.cell, task)])
        self._camera = Camera.framing(shown, np.array(DIRECTION), size=self.size, view=VIEW, margin=0.02)
        x, y, z = (LAMP * max(scene.size)).tolist()
        self._light = Light(position=(x, y, z), ambient=AMBIENT)
        solid = scene_mesh(scene, pale(palette.OBSTACLE, 0.3), pale(palette.OBSTACLE_EDGE, 0.75))
        self._solid = Mesh.joined([solid, *arms])

    def picture(
        self,
        cables: Sequence[tuple[Float[np.ndarray, "s 3"], str]],
        held: Sequence[tuple[Float[np.ndarray, "2 7"], str]],
    ) -> Picture:
        """The scene with cables and gripper poses, each with its colour, as the camera sees it."""
        radius = self.task.cable.radius
        meshes = [cable_mesh(stations, radius, to_rgb(color)) for stations, color in cables]
        meshes += [
            body_mesh(body, poses[body.side], pale(color, 0.55)) for poses, color in held for body in self.task.bodies
        ]
        return render(Mesh.joined([self._solid, *meshes]), self._camera, self._light, samples=3)

    def draw(
        self,
        ax: Axes,
        cables: Sequence[tuple[Float[np.ndarray, "s 3"], str]],
        held: Sequence[tuple[Float[np.ndarray, "2 7"], str]],
    ) -> None:
        """The same in a panel, what is hidden of cables dashed."""
        radius, picture = self.task.cable.radius, self.picture(cables, held)
        width, height = self.size
        ax.imshow(picture.color, extent=(-0.5, width - 0.5, -0.5, height - 0.5), aspect="auto")
        for stations, color in cables:
            self._dashed(ax, stations, color, self._hidden(stations, picture, radius + BEHIND))
        ax.set_xlim(-0.5, width - 0.5)
        ax.set_ylim(-0.5, height - 0.5)
        ax.set_axis_off()
        for a, b in self._edges():
            line = a + np.linspace(0, 1, 60)[:, None] * (b - a)
            shown = np.where(
                self._hidden(line, picture, BEHIND, OBSTACLE, CABLE, GRIPPER)[:, None], np.nan, self.at(line)
            )
            ax.plot(*shown.T, color=palette.MUTED, linewidth=0.5, alpha=0.7, zorder=3)

    def at(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 2"]:
        """Where points [m] are in the panel."""
        pixels = self._camera.project(points)[0]
        return np.stack([pixels[..., 0], self.size[1] - 1 - pixels[..., 1]], axis=-1)

    def _hidden(
        self, points: Float[np.ndarray, "k 3"], picture: Picture, off: float, *labels: int
    ) -> Bool[np.ndarray, "k"]:
        """Which points are more than `off` [m] behind what has one of the labels; by default, table or obstacles."""
        pixels, away = self._camera.project(points)
        u, v = (np.clip(np.nan_to_num(pixels).round().astype(int), 0, np.array(self.size) - 1)).T
        return (away > picture.depth[v, u] + off) & np.isin(picture.label[v, u], labels or (TABLE, OBSTACLE))

    def _dashed(self, ax: Axes, line: Float[np.ndarray, "s 3"], color: str, hidden: Bool[np.ndarray, "s"]) -> None:
        seen = np.where(hidden[:, None], self.at(line), np.nan)
        thin = min(1.0, self.size[0] / (0.7 * FINE * PANEL))
        for below, width in (("white", 2.2), (color, 1.2)):
            ax.plot(*seen.T, color=below, linewidth=thin * width, linestyle=(0, (2, 1.5)), zorder=4)

    def _edges(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The edges of the workspace."""
        corners = _corners(self.task)
        return [(a, b) for a, b in combinations(corners, 2) if np.count_nonzero(a != b) == 1]


def draw_ends(view: SpaceView, ax: Axes) -> None:
    """Scene, start and goal, as far as they are known."""
    task = view.task
    known: list[End] = [end for end in ENDS if getattr(task, end) is not None]
    cables = [(task.stations(end), COLORS[end]) for end in known]
    view.draw(ax, cables, [(task.gripper_poses(end), COLORS[end]) for end in known])


def spatial_task_figure(task: SpatialDraft, faults: Sequence[TaskError] = ()) -> Figure:
    """The picture of a task in space: its scene, start and goal, with its name and description; and what is wrong.

    Each of `faults` is a sentence above the panel, with its number in a red ring at its place.
    """
    view, cable = SpaceView(task), task.cable
    facts = f"cable {limit_text(cable.length)} long, {limit_text(2 * cable.radius)} thick, weight {cable.weight:.3g}"
    facts += f" B/L² · workspace {size_text(task.scene.size)}"
    text = [*textwrap.wrap(printable(task.description), 60), *textwrap.wrap(facts, 64)]
    lines = sentence_lines([fault.sentence for fault in faults], PANEL)
    below, height = 0.36 + 0.13 * len(text), PANEL * TALL
    tall = below + height + 0.3 + (0.1 + LINE * len(lines) if lines else 0.0)
    figure = style.new_figure(style.SINGLE, tall)
    left = (style.SINGLE - PANEL) / 2
    ax = style.add_axes(figure, left, below, PANEL, height)
    draw_ends(view, ax)
    style.title(ax, task.name)
    marks = [Mark(fault.sentence, None if fault.at is None else _pair(view.at(np.array(fault.at)))) for fault in faults]
    draw_marks(ax, marks)
    write_lines(figure, left, lines)
    _legend(figure, tall, 0.12 + 0.13 * len(text))
    place = (left / style.SINGLE, 0.08 / tall)
    figure.text(*place, "\n".join(text), fontsize=style.NOTE, color=palette.MUTED, va="bottom", parse_math=False)
    return figure


def spatial_plan_figure(task: SpatialTask, made: Plan | Attempt | None, failure: str | None = None) -> Figure:
    """The picture of a plan in space: `SHAPES` of its shapes, the way of the keypoints, and the arms that hold it half
    way; or why there is none.

    Args:
        task: The task.
        made: The plan, or the closest attempt, or None.
        failure: Why there is no plan.
    """
    shapes = None if made is None else made.shapes
    view = SpaceView(task, WIDE, arms=_arms(task, made) if isinstance(made, Plan) else [])
    lines = sentence_lines([failure] if failure else [], WIDE, "No plan: ")
    height = WIDE * TALL
    tall = 0.4 + height + 0.3 + (0.1 + LINE * len(lines) if lines else 0.0)
    figure = style.new_figure(WIDE + 0.2, tall)
    ax = style.add_axes(figure, 0.1, 0.4, WIDE, height)
    cables = [(task.stations(end), COLORS[end]) for end in ENDS]
    if shapes is not None:
        rows = np.linspace(0, len(shapes) - 1, SHAPES + 2).round().astype(int)[1:-1]
        colors = [to_hex(style.TIME(row / (len(shapes) - 1))) for row in rows]
        cables += list(zip(smooth(shapes[rows]), colors, strict=True))
    view.draw(ax, cables, [(task.gripper_poses(end), COLORS[end]) for end in ENDS])
    if shapes is not None:
        for keypoint in range(0, shapes.shape[1], (shapes.shape[1] - 1) // 2):
            ax.plot(*view.at(shapes[:, keypoint]).T, color=palette.INK, linewidth=0.6, alpha=0.6, zorder=5)
    style.title(ax, task.name)
    write_lines(figure, 0.1, lines)
    _legend(figure, tall, 0.12)
    return figure


def spatial_rollout_figure(task: SpatialTask, rollout: Rollout, failure: str | None = None) -> Figure:
    """The picture of a run in space: (a) shapes of the cable on its way; over time (b) its stacked error to the goal,
    (c) the largest deviation of a keypoint from the plan, (d) the clearance of cable and grippers.

    Args:
        task: The task.
        rollout: What happened.
        failure: Why it did not succeed.
    """
    task, width = task.as_recorded(rollout.metadata), WIDE + CURVES + 0.95
    view, lines = SpaceView(task, WIDE), sentence_lines([failure] if failure else [], width, "Failed: ")
    below = 0.1 + LINE * len(lines) if lines else 0.0
    height, bottom = WIDE * TALL, 0.45 + below
    figure = style.new_figure(width, bottom + height + 0.3)
    ax = style.add_axes(figure, 0.1, bottom, WIDE, height)
    rows = np.linspace(0, rollout.steps, SHAPES + 2).round().astype(int)
    colors = [to_hex(style.TIME(row / max(rollout.steps, 1))) for row in rows]
    view.draw(
        ax,
        [(task.stations("goal"), palette.MUTED), *zip(rollout.centreline[rows], colors, strict=True)],
        [(rollout.poses[rows[0]], colors[0]), (rollout.poses[rows[-1]], colors[-1])],
    )
    style.title(ax, "(a) " + task.name)
    curves = {
        "(b) error [mm]": np.linalg.norm(rollout.keypoints - task.keypoints("goal"), axis=(1, 2)),
        "(c) deviation [mm]": rollout.deviations_from_reference,
        "(d) clearance [mm]": np.minimum(rollout.clearance, rollout.gripper_clearance),
    }
    tall = (height - 2 * GAP) / 3
    for place, (name, values) in enumerate(reversed(curves.items())):
        panel = style.add_axes(figure, WIDE + 0.75, bottom + place * (tall + GAP), CURVES, tall)
        panel.plot(rollout.times, 1000 * values, color=palette.INK, linewidth=1.2)
        panel.set_ylim(bottom=min(0.0, 1000 * float(values.min())))
        style.title(panel, name)
        if place == 0:
            panel.set_xlabel("time [s]")
        else:
            panel.tick_params(labelbottom=False)
    write_lines(figure, 0.1, lines)
    return figure


def _corners(task: SpatialDraft) -> Float[np.ndarray, "8 3"]:
    """Those of the workspace."""
    return np.array(list(product(*((0.0, side) for side in task.scene.size))))


def _about_arms(cell: Cell, task: SpatialDraft) -> Float[np.ndarray, "k 3"]:
    """Points between which arms are seen."""
    bases = np.array([arm.base(task.scene)[:3, 3] for arm in cell.arms])
    about = np.array(list(product((-WIDE_ARM, WIDE_ARM), (-WIDE_ARM, WIDE_ARM), (0.0, TALL_ARM))))
    return (bases[:, None] + about).reshape(-1, 3)


def _arms(task: SpatialTask, plan: Plan) -> list[Mesh]:
    """The arms of a plan half way; none where it has no joints."""
    way = SpatialWay.of_record(plan.metadata)
    if task.cell is None or plan.joints is None or way is None:
        return []
    links = SpatialArms(task).links(plan.joints[plan.steps // 2], way.holders)
    return [
        capsules(ends, radius).painted(pale(color, 0.5), GRIPPER)
        for (ends, radius), color in zip(links, (palette.LEFT, palette.RIGHT), strict=True)
    ]


def _pair(point: Float[np.ndarray, "2"]) -> Point:
    return float(point[0]), float(point[1])


def _legend(figure: Figure, tall: float, bottom: float) -> None:
    entries = [
        Patch(facecolor=palette.START, label="start"),
        Patch(facecolor=palette.GOAL, label="goal"),
        Patch(facecolor=palette.OBSTACLE_EDGE, label="obstacle"),
        Line2D([], [], color=palette.INK, linewidth=1.2, linestyle=(0, (2, 1.5)), label="hidden"),
    ]
    figure.legend(
        handles=entries, loc="lower center", bbox_to_anchor=(0.5, bottom / tall), ncols=4, frameon=False,
        fontsize=style.TICK, handlelength=1.4, columnspacing=1.2,
    )  # fmt: skip


def spatial_tasks_figure(tasks: Sequence[SpatialDraft]) -> Figure:
    """Many tasks in space in one picture, up to `TASKS_SHOWN` of them, in rows."""
    shown = tasks[:TASKS_SHOWN]
    figure, panels = small_panels([task.name for task in shown], 4, 1.6)
    for ax, task in zip(panels, shown, strict=True):
        view = SpaceView(task, 1.6)
        draw_ends(view, ax)
        ax.set_aspect("equal")
    return figure
