"""The panels of a page: the task on the left, the plan on the right. Everything that is done in them is posted."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import viser
from viser import uplot

from cableway.core.quantities import quantity
from cableway.figures import palette
from cableway.scene.files.loading import AnyDraft, task_names
from cableway.scene.obstacles import Box, Disc, Obstacle, Polygon
from cableway.scene.spatial.obstacles import SpatialObstacle
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import SpatialDraft
from cableway.scene.task import ENDS, End
from cableway.studio import obstacles as hands
from cableway.studio import spatial_obstacles as spatial_hands
from cableway.studio.curves import Curves
from cableway.studio.inspection import Inspection
from cableway.studio.planning import Planning
from cableway.studio.session import Moment, Session
from cableway.studio.view import look
from cableway.studio.view.events import in_order
from cableway.tasks.generation import KINDS
from cableway.tasks.space.generation import SPATIAL_KINDS

WIDTH = 292
"""Of a panel in pixels: both leave a table that is as wide as high on a page of 1280 x 800."""

TYPED = 0.7
"""Time [s] after the last key until a number counts."""

SAY = {
    "planning": palette.MUTED,
    "found": palette.GREEN,
    "none": palette.BAD,
    "invalid": palette.BAD,
}
"""Colours of what is said of planning."""

LOUD = look.rgb(palette.BLUE)
"""Colour of the buttons that are pressed most."""

QUIET = look.rgb(palette.MUTED)
"""Colour of buttons that are pressed now and then."""

NO_OBSTACLE = {
    False: "Click an obstacle to see its numbers and knobs, or drag it.",
    True: "Click an obstacle or a gripper, and pull its arrows or arcs; dragged by itself it keeps its height.",
}
"""Said on the table and in space."""

POSE = {
    False: "x [mm], y [mm] and direction [°] of this gripper",
    True: "Place of this gripper [mm]; its arcs turn it",
}
"""Said of a gripper's numbers on the table and in space."""

ROUNDED = 0.051
"""By which a number of the panel may differ from what it shows [mm]."""

NO_PLAN = "Once there is a plan, it is played here."

Do = Callable[..., Any]
"""`do(call, key=..., delay=...)` posts a call, see `Inbox.post`."""


class TaskPanel:
    """Open, edit, save.

    Args:
        gui: The page's controls.
        session: What they change.
        do: Posts what is to be done.
        select: Selects an obstacle, or none.
        save: Saves the session's files.
        download: Hands the task's file to the browser.
    """

    def __init__(self, gui: viser.GuiApi, session: Session, do: Do, select: Do, save: Do, download: Do) -> None:
        self._session, self._do = session, do
        self._selected: int | None = None
        self._typed = 0.0
        self.heading = gui.add_html("")
        steps = gui.add_button_group("", ("Undo", "Redo"))
        steps.on_click(in_order(lambda _: do(session.undo if steps.value == "Undo" else session.redo)))
        self.wrong = gui.add_html("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Edit"):
            self._add_obstacles(gui, select)
            self._add_ends(gui)
        with tabs.add_tab("Open, save"):
            self._add_files(gui, save, download)

    def _add_obstacles(self, gui: viser.GuiApi, select: Do) -> None:
        session, do = self._session, self._do

        def add(kind: Any) -> None:
            scene = session.draft.scene
            made = spatial_hands if isinstance(scene, SpatialScene) else hands
            index = len(scene.obstacles)
            session.set_obstacle(index, made.new_obstacle(kind, scene))  # pyright: ignore[reportArgumentType]
            select(index)

        def remove() -> None:
            index = self._selected
            if index is not None:
                select(None)
                session.set_obstacle(index, None)

        self._kinds = {False: gui.add_button_group("Add", ("box", "disc", "polygon"))}
        self._kinds[True] = gui.add_button_group("Add", ("box", "cylinder", "ball"), visible=False)
        for kinds in self._kinds.values():
            kinds.on_click(in_order(lambda _, kinds=kinds: do(partial(add, kinds.value))))
        self._no_obstacle = gui.add_html(look.hint(NO_OBSTACLE[False]))
        self._middle = gui.add_vector2("Centre [mm]", (0.0, 0.0), step=0.1)
        self._middle3 = gui.add_vector3("Centre [mm]", (0.0, 0.0, 0.0), step=0.1, visible=False)
        self._size = gui.add_vector2("Size [mm]", (0.0, 0.0), step=0.1)
        hint = "Along its own axes; a height of 0 never ends"
        self._size3 = gui.add_vector3("Size [mm]", (0.0, 0.0, 0.0), step=0.1, hint=hint, visible=False)
        self._angle = gui.add_number("Angle [°]", 0.0, step=0.1, hint="Of a polygon: by how much to turn it")
        hint = "Above the table; 0 where nothing passes above"
        self._height = gui.add_number("Height [mm]", 0.0, step=0.1, hint=hint)
        for field in (self._middle, self._middle3, self._size, self._size3, self._angle, self._height):
            field.on_update(lambda event: event.client and self._take("number", partial(self._number, self._selected)))
        self._remove = gui.add_button("Remove this obstacle", color="red")
        self._remove.on_click(in_order(lambda _: do(remove)))
        self.remove = remove

    def _add_ends(self, gui: viser.GuiApi) -> None:
        session = self._session
        self._poses: dict[tuple[End, int], Any] = {}
        self._others: list[Any] = []
        for end in ENDS:
            for side in (0, 1):
                name = f"{end} {'LR'[side]}"
                field = gui.add_vector3(name, (0.0, 0.0, 0.0), step=0.1, hint=POSE[False])
                field.on_update(lambda event, end=end, side=side: self._pose(event, end, side))
                self._poses[end, side] = field
            other = gui.add_button(f"Bend the {end} to the other side", color=QUIET)
            other.on_click(in_order(lambda _, end=end: self._do(lambda: session.bend(end))))
            self._others.append(other)

    def _add_files(self, gui: viser.GuiApi, save: Do, download: Do) -> None:
        session, do = self._session, self._do
        names = gui.add_dropdown("Catalogue", ("choose one", *task_names()))

        def choose(event: Any) -> None:
            if event.client is not None and names.value in task_names():
                do(partial(session.open, names.value))

        names.on_update(choose)
        kinds = gui.add_dropdown("Random", (*KINDS, *SPATIAL_KINDS))
        seed = gui.add_number("Seed", 0, min=0, step=1)
        draw = gui.add_button("Draw a random task", color=LOUD)
        draw.on_click(in_order(lambda _: do(partial(session.draw, kinds.value, int(seed.value)))))
        upload = gui.add_upload_button(
            "Open a task, or a plan or rollout of it ...", color=QUIET, mime_type=".yaml,.yml,.npz"
        )
        upload.on_upload(lambda _: do(partial(session.open_content, upload.value.name, upload.value.content)))
        gui.add_button("Save task, plan and report", color=LOUD).on_click(in_order(lambda _: do(save)))
        gui.add_button("Download the task file", color=QUIET).on_click(in_order(lambda _: do(download)))
        self.saved = gui.add_html(look.hint("Edits are kept while the studio runs; save what is to stay."))

    def show(self, moment: Moment, inspection: Inspection, selected: int | None) -> None:
        """Show a draft and what is wrong with it."""
        self._selected = selected
        draft = moment.draft
        set_changed(self.heading, "content", look.heading(draft.name, draft.description))
        wrong = inspection.sentences
        text = look.sentences(wrong[:6], palette.BAD, numbered=True) if wrong else ""
        set_changed(self.wrong, "content", text)
        if time.monotonic() - self._typed < 2 * TYPED:
            return
        self._show_obstacle(draft, selected)
        in_space = isinstance(draft, SpatialDraft)
        for other in self._others:
            set_changed(other, "visible", not in_space)
        for (end, side), field in self._poses.items():
            q = moment.shapes[end]
            set_changed(field, "hint", POSE[in_space])
            if q is not None:
                x, y, last = draft.cable.rod.end_poses(q[None])[0, side, :3]
                last = 1000 * last if in_space else math.degrees(math.remainder(last, math.tau))
                set_changed(field, "value", _rounded(1000 * x, 1000 * y, last))

    def _show_obstacle(self, draft: AnyDraft, selected: int | None) -> None:
        there: dict[int, Any] = dict(enumerate(draft.scene.obstacles))
        obstacle, in_space = None if selected is None else there.get(selected), isinstance(draft, SpatialDraft)
        for kind, kinds in self._kinds.items():
            set_changed(kinds, "visible", kind == in_space)
        set_changed(self._no_obstacle, "content", look.hint(NO_OBSTACLE[in_space]))
        set_changed(self._no_obstacle, "visible", obstacle is None)
        set_changed(self._remove, "visible", obstacle is not None)
        size = spatial_hands.size_of(obstacle) if in_space and obstacle is not None else None
        set_changed(self._middle3, "visible", in_space and obstacle is not None)
        set_changed(self._size3, "visible", size is not None)
        if in_space and obstacle is not None:
            set_changed(self._middle3, "value", _rounded(*(1000 * spatial_hands.frame_of(obstacle)[:3])))
            set_changed(self._size3, "value", _rounded(*(1000 * each for each in size or (0.0, 0.0, 0.0))))
            obstacle = None
        for field in (self._middle, self._height):
            set_changed(field, "visible", obstacle is not None)
        set_changed(self._size, "visible", isinstance(obstacle, Box | Disc))
        set_changed(self._angle, "visible", isinstance(obstacle, Box | Polygon))
        if obstacle is None:
            return
        set_changed(self._middle, "value", _rounded(*(1000 * hands.middle_of(obstacle))))
        set_changed(self._height, "value", round(1000 * (obstacle.height or 0.0), 2))
        set_changed(self._angle, "value", round(math.degrees(hands.angle_of(obstacle)), 2))
        if isinstance(obstacle, Box):
            set_changed(self._size, "value", _rounded(*(1000 * np.array(obstacle.size))))
        elif isinstance(obstacle, Disc):
            set_changed(self._size, "value", _rounded(2000 * obstacle.radius, 2000 * obstacle.radius))

    def _number(self, index: int | None) -> None:
        """Make the obstacle that was selected when the numbers were typed as they say."""
        there = None if index is None else dict(enumerate(self._session.draft.scene.obstacles)).get(index)
        if index is None or there is None:
            return
        wanted: Any
        if isinstance(there, Obstacle):
            wanted = _numbered(there, self._middle.value, self._size.value, self._angle.value, self._height.value)
        else:
            wanted = _numbered_in_space(there, self._middle3.value, self._size3.value)
        if wanted != there:
            self._session.set_obstacle(index, wanted)

    def _pose(self, event: Any, end: End, side: int) -> None:
        if event.client is None:
            return
        x, y, last = self._poses[end, side].value

        def set_gripper() -> None:
            q = self._session.moment.shapes[end]
            if not isinstance(self._session.draft, SpatialDraft):
                pose = np.array([x / 1000, y / 1000, math.radians(last)])
            elif q is not None:
                turn = self._session.draft.rod.end_poses(q[None])[0, side, 3:]
                pose = np.array([x / 1000, y / 1000, last / 1000, *turn])
            else:
                return
            self._session.set_gripper(end, side, pose)

        self._take(f"pose {end} {side}", set_gripper)

    def _take(self, key: str, call: Do) -> None:
        """Do what typed numbers say once no more come, and leave the fields alone until then."""
        self._typed = time.monotonic()

        def take() -> None:
            self._typed = 0.0
            call()

        self._do(take, key=key, delay=TYPED)


class PlanPanel:
    """The plan, its ways, its curves, and playing it.

    Args:
        gui: The page's controls.
        session: What they are of.
        do: Posts what is to be done.
        scrub: Shows a row of the plan.
        play: Begins or ends playing.
        choose: Shows another one of the plans.
        export: Hands a page that plays the plan to the browser.
    """

    def __init__(
        self, gui: viser.GuiApi, session: Session, do: Do, scrub: Do, play: Do, choose: Do, export: Do
    ) -> None:
        self.said = gui.add_html("")
        self._hint = gui.add_html(look.hint(NO_PLAN))
        self.step = gui.add_slider("Step", 0, 1, 1, 0)
        self.step.on_update(lambda event: event.client and do(lambda: scrub(self.step.value), key="scrub"))
        self.play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, color=LOUD)
        self.play.on_click(in_order(lambda _: do(play)))
        self.now = gui.add_html("")
        self.way: Any = gui.add_dropdown("Way", ("1",))
        self.way.on_update(
            lambda event: event.client and do(lambda: choose(int(self.way.value.split()[0]) - 1), key="way")
        )
        self._ways = gui.add_button("Look for other ways", color=QUIET)
        self._ways.on_click(in_order(lambda _: do(session.seek_ways)))
        self._export = gui.add_button("Download a page that plays it", color=QUIET)
        self._export.on_click(in_order(lambda _: do(export)))
        cable, sides = (
            (("cable", palette.INK), ("grippers", palette.RIGHT)),
            (("left", palette.LEFT), ("right", palette.RIGHT)),
        )
        self._clear, self._speed = plot(gui, "Clearance [mm]", cable), plot(gui, "Of the grippers' limits [%]", sides)
        self._curves: Curves | None = None

    def show(
        self, planning: Planning, curves: Curves | None, chosen: int, stale: bool, *, in_space: bool = False
    ) -> None:
        """Show how far planning is, and the curves of the plan that is chosen."""
        set_changed(self.said, "content", look.sentences([planning.sentence], SAY[planning.status]))
        there = curves is not None
        set_changed(self._hint, "visible", not there)
        for field in (self.step, self.play, self.now, *self._clear, *self._speed):
            set_changed(field, "visible", there)
        set_changed(self._export, "visible", there)
        set_changed(self._ways, "visible", there and not in_space and not stale and len(planning.plans) == 1)
        count = len(planning.plans)
        set_changed(self.way, "visible", count > 1)
        if count > 1:
            options = tuple(f"{k + 1} of {count}: {plan.steps / 10:.1f} s" for k, plan in enumerate(planning.plans))
            if tuple(self.way.options) != options:
                self.way.options = options
            set_changed(self.way, "value", options[min(chosen, count - 1)])
        if curves is not None and curves is not self._curves:
            self._curves = curves
            set_changed(self.step, "max", len(curves.times) - 1)
            self._clear[1].data = (curves.times, 1000 * curves.cable, 1000 * curves.grippers)
            self._speed[1].data = (curves.times, *(100 * curves.speed.T))

    def show_row(self, row: int, playing: bool) -> None:
        """Show where in the plan the page is."""
        if self._curves is None:
            return
        row = min(row, len(self._curves.times) - 1)
        set_changed(self.step, "value", row)
        set_changed(self.play, "label", "Pause" if playing else "Play")
        cable, grippers = self._curves.cable[row], self._curves.grippers[row]
        text = f"{self._curves.times[row]:.1f} s: cable {quantity(cable)} clear, grippers {quantity(grippers)}"
        set_changed(self.now, "content", look.hint(text))


def _numbered(there: Obstacle, middle: Any, size: Any, angle: float, height: float) -> Obstacle:
    """An obstacle with the numbers of the panel [mm, degrees]."""
    wanted = hands.placed(there, (middle[0] / 1000, middle[1] / 1000))
    wanted = replace(wanted, height=height / 1000 if height > 0 else None)
    if isinstance(wanted, Box):
        return replace(wanted, size=(size[0] / 1000, size[1] / 1000), angle=math.radians(angle))
    if isinstance(wanted, Disc):
        return replace(wanted, radius=size[0] / 2000)
    return hands.turned(wanted, math.radians(angle)) if angle else wanted


def _numbered_in_space(there: SpatialObstacle, middle: Any, size: Any) -> SpatialObstacle:
    """The same in space: its middle and its sizes along its own axes [mm]."""
    frame = spatial_hands.frame_of(there)
    if np.abs(1000 * frame[:3] - middle).max() > ROUNDED:
        frame[:3] = np.array(middle) / 1000
    now = spatial_hands.size_of(there)
    if now is None or np.abs(1000 * np.array(now) - size).max() <= ROUNDED:
        return spatial_hands.placed(there, frame)
    x, y, z = (old if abs(1000 * old - new) <= ROUNDED else new / 1000 for old, new in zip(now, size, strict=True))
    return spatial_hands.placed(spatial_hands.resized(there, (x, y, z)), frame)


def plot(gui: viser.GuiApi, title: str, curves: tuple[tuple[str, str], ...]) -> tuple[Any, Any]:
    """Title and plot of curves over time, given by name and colour."""
    look_of: Any = {
        "stroke": palette.MUTED, "font": "11px cableway, sans-serif", "grid": {"stroke": palette.GRID, "width": 1},
        "ticks": {"show": False},
    }  # fmt: skip
    series = (
        uplot.Series(label="time [s]"),
        *(uplot.Series(label=name, stroke=color, width=1.6, points={"show": False}) for name, color in curves),
    )
    heading = gui.add_html(look.legend(title, curves))
    plot = gui.add_uplot(
        (np.zeros(2),) * len(series), series, height=150, legend={"show": False}, scales={"x": {"time": False}},
        axes=(uplot.Axis(**look_of, size=26), uplot.Axis(**look_of, size=38)),
    )  # fmt: skip
    return heading, plot


def _rounded(*values: float) -> tuple[float, ...]:
    return tuple(round(float(value), 1) + 0.0 for value in values)


def set_changed(handle: Any, name: str, value: Any) -> None:
    """Change what is shown, if it changes."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)
