"""One page in a browser: what it shows of a session, and what hands do on it."""

from __future__ import annotations

import operator
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import viser

from cableway.figures import palette
from cableway.records import Plan
from cableway.scene.files.loading import AnyDraft
from cableway.scene.files.saving import task_text
from cableway.scene.spatial.task import SpatialDraft
from cableway.scene.task import CONTROL_STEP, Draft, End
from cableway.studio.curves import Curves, curves_of
from cableway.studio.film import film_page, film_video
from cableway.studio.inbox import Inbox
from cableway.studio.inspection import Inspection
from cableway.studio.obstacles import with_obstacle
from cableway.studio.pictures import Pictures
from cableway.studio.running import Running
from cableway.studio.session import Moment, Session
from cableway.studio.view import look, space, table
from cableway.studio.view.arms import Arms, SpaceArms
from cableway.studio.view.canvas import Canvas
from cableway.studio.view.dragging import Drags
from cableway.studio.view.events import in_order
from cableway.studio.view.hands import SpaceHands, TableHands, gripper, parts
from cableway.studio.view.panel import WIDTH, PlanPanel, TaskPanel
from cableway.studio.view.run_panel import RunPanel
from cableway.tracking import Row

PICTURE = 0.5
"""Time [s] between two pictures of the cameras of a run that goes on."""

TELL = 0.25
"""Time [s] between two changes of the numbers in the panel while something is dragged."""

LONG = 0.4
"""Time [s] of planning after something was let go from which on the page says that it plans, and at what it is."""

LOOK = {False: "Look from above", True: "Look at all of it"}
"""On the table; and in space, or where there are arms."""

FOV = 0.35
"""Angle of view [rad]: far away and narrow, so that what is high hides little."""


class Page:
    """A page.

    Args:
        client: Its connection.
        session: What it is of.
        out: Folder in which tasks are saved, each in one of its own.
    """

    def __init__(self, client: viser.ClientHandle, session: Session, out: Path) -> None:
        self._client, self._session, self._out = client, session, out
        self._inbox = Inbox(self._complain)
        self._do = self._inbox.post
        self._drags = drags = Drags(session, self._do, self)
        self._canvas = Canvas(client, drags.dragged, lambda name: self._do(lambda: self.clicked(name)), drags.posed)
        self.hands: TableHands | SpaceHands = TableHands(session, lambda: self._selected)
        self._view: Any = table
        self._grasped: tuple[End, int] | None = None
        self._selected: int | None = None
        self._told = 0.0
        self._moment: Moment | None = None
        self._run_row: int | None = None
        self._plan: Plan | None = None
        self._drawn: tuple[Any, ...] = ()
        self._curves: Curves | None = None
        self._chosen, self._row, self._playing = 0, 0, False
        self._where: tuple[Any, ...] = ()
        self._arms: Arms | SpaceArms | None = None
        self._ran: tuple[Any, Arms | None] = (None, None)
        self._pictured: tuple[tuple[Any, ...], Pictures | None] = ((None,), None)
        self._pictured_at = 0.0
        self._aspect = 0.0
        self._build()
        client.camera.on_update(lambda _: self._do(self._fit, key="fit"))
        self._end = session.listen(self._changed)
        self._do(self.show, key="show")

    def close(self) -> None:
        """The connection is over."""
        self._end()
        self._inbox.close()
        self._drags.close()

    # ------------------------------------------------------------------------------------------ what is shown
    def _build(self) -> None:
        gui = self._client.gui
        self._task_panel = TaskPanel(gui, self._session, self._do, self._select, self._save, self._download)
        self._look_button = above = gui.add_button(LOOK[False], icon=viser.Icon.CAMERA, color=look.rgb(palette.MUTED))
        above.on_click(in_order(lambda _: self._do(self._look)))
        self._with_arms = gui.add_checkbox("Show the arms", True, visible=False)
        self._with_arms.on_update(lambda event: event.client and self._do(self.show, key="show"))
        gui.main_panel.dock_left()
        gui.main_panel.set_width(WIDTH)
        right = gui.add_panel()
        tabs = [("Plan", self._build_plan), ("Run", self._build_run)]
        for name, build in reversed(tabs) if self._session.watched else tabs:  # the first is open
            with right.add_tab(name):
                build(gui)
        right.dock_right()
        right.set_width(WIDTH)
        for label, key, modifier, what in (
            ("Play or pause", "space", None, self._play),
            ("Step ahead", "arrowright", None, lambda: self._scrub(self._row + 1)),
            ("Step back", "arrowleft", None, lambda: self._scrub(self._row - 1)),
            ("Undo", "Z", "cmd/ctrl", self._session.undo),
            ("Redo", "Y", "cmd/ctrl", self._session.redo),
            ("Remove the obstacle", "delete", None, self._task_panel.remove),
        ):
            command: Any = gui.add_command(label, hotkey=key, modifier=modifier)  # pyright: ignore[reportArgumentType]
            command.on_trigger(in_order(lambda _, what=what: self._do(what)))

    def _build_plan(self, gui: viser.GuiApi) -> None:
        self._plan_panel = PlanPanel(gui, self._session, self._do, self._scrub, self._play, self._choose, self._export)

    def _build_run(self, gui: viser.GuiApi) -> None:
        self._run_panel = RunPanel(gui, self._do, self._run, self._scrub_run, self._export_run, self._film)

    def _look(self) -> None:
        """Look at the whole table, or at the whole workspace."""
        camera = self._client.camera
        self._aspect = camera.aspect
        position, at = self._view.camera_of(self._session.draft, FOV, max(self._aspect, 0.1))
        with self._client.atomic():
            camera.fov = FOV
            camera.up_direction = (0.0, 0.0, 1.0)
            camera.position = position
            camera.look_at = at

    def _fit(self) -> None:
        """Look at the whole table again where the page has another shape, as once its panels are there."""
        if self._drags.held is None and abs(self._client.camera.aspect - self._aspect) > 0.01:
            self._look()

    def _changed(self) -> None:
        """Show what the session came to; that it plans for what is shown already only where that takes long, since a
        page without graphics hardware would draw all the while, on the processor that plans."""
        session = self._session
        same = session.moment is self._moment and session.planning.status == "planning"
        waits = self._drags.released + LONG - time.monotonic() if same and session.running is None else 0.0
        self._do(self.show, key="show", delay=max(waits, 0.0))

    def show(self) -> None:
        """See `Shown.show`."""
        session = self._session
        moment, inspection, planning = session.moment, session.inspection, session.planning
        self._moment, draft = moment, moment.draft
        if self._selected is not None and self._selected >= len(draft.scene.obstacles):
            self._selected = None
        chosen = min(self._chosen, max(len(planning.plans) - 1, 0))
        plan = planning.plans[chosen] if planning.plans else None
        if plan is not self._plan:
            self._plan, self._curves = plan, None if plan is None else curves_of(draft, plan)
            self._row = 0 if plan is None else min(self._row, plan.steps)
            self._arms = Arms.of(draft, plan) if isinstance(draft, Draft) else SpaceArms.of(draft, plan)
        with self._client.atomic():
            if self._where != (where := _where(draft)):
                self._where = where
                self._enter(draft)
            view, canvas = self._view, self._canvas
            self._draw_draft()
            wrong = [fault.at for fault in inspection.faults if fault.at is not None]
            view.draw_faults(canvas, wrong if planning.at is None else [*wrong, planning.at])
            if (plan, draft.cable.radius) != self._drawn:
                self._drawn = (plan, draft.cable.radius)
                view.draw_plan(canvas, draft, plan)
            self._draw_moment()
            self._show_run()
            self._show_task(moment, inspection)
            stale = planning.status != "found"
            self._plan_panel.show(planning, self._curves, chosen, stale, in_space=self._in_space)
            self._plan_panel.show_row(self._row, self._playing)
        self._client.flush()

    def _draw_moment(self) -> None:
        """One row of the plan, unless a run is shown."""
        session = self._session
        arms = {"arms": self._arms} if self._arms is not None and self._with_arms.value else {}
        self._view.draw_moment(self._canvas, session.draft, None if session.running else self._plan, self._row, **arms)

    def _draw_draft(self) -> None:
        """Obstacles, start and goal."""
        session, canvas = self._session, self._canvas
        held: dict[str, Any] = {"held": self._drags.held is not None} if self._in_space else {}
        grasped: dict[str, Any] = {"grasped": self._grasped} if self._in_space else {}
        self._view.draw_obstacles(canvas, self._as_it_stands(), self._selected, **held)
        self._view.draw_ends(canvas, session.moment, session.inspection, **held, **grasped)

    @property
    def _in_space(self) -> bool:
        """Whether the task is."""
        return isinstance(self._session.draft, SpatialDraft)

    def _enter(self, draft: AnyDraft) -> None:
        """Show another workspace."""
        if self._view is not (space if self._in_space else table):
            self._canvas.clear()
            self._drawn, self._selected, self._grasped = (), None, None
            self._view = space if self._in_space else table
            self.hands = (
                SpaceHands(self._session) if self._in_space else TableHands(self._session, lambda: self._selected)
            )
        in_cell = draft.cell is not None
        self._look_button.label = LOOK[self._in_space or in_cell]
        self._with_arms.visible = in_cell
        self._view.draw_table(self._canvas, draft)
        self._look()

    def _show_task(self, moment: Moment, inspection: Inspection) -> None:
        """The panel of the task; in a drag only now and then, since letters take a page longer than shapes."""
        now = time.monotonic()
        if self._drags.held is None or now - self._told >= TELL:
            self._told = now
            self._task_panel.show(moment, inspection, self._selected)

    def _show_run(self) -> None:
        """The newest row of the run, or that which was chosen."""
        running, draft = self._session.running, self._session.draft
        if running is None:
            self._run_row = None
        rows = () if running is None else running.seen
        last = len(rows) - 1
        row = last if self._run_row is None else min(self._run_row, last)
        record = None if running is None else running.plan or running.rollout
        if record is not self._ran[0]:
            self._ran = record, Arms.of(draft, record) if isinstance(draft, Draft) else None
        arms = {"arms": self._ran[1]} if self._ran[1] is not None and self._with_arms.value else {}
        self._view.draw_run(self._canvas, draft, rows[row] if rows else None, **arms)
        self._show_pictures(running, rows, row)
        session = self._session
        can_run = session.planning.status == "found"
        self._run_panel.show(running, row, can_run, in_space=self._in_space, watched=session.watched)

    def _show_pictures(self, running: Running | None, rows: Sequence[Row], row: int) -> None:
        """What the cameras of a run see, if it has any; while it goes on now and then."""
        if running is None or running.eyes is None or not rows:
            self._run_panel.show_picture(None)
            return
        what = running.task, running.plan, running.perturbation, running.eyes
        if not all(map(operator.is_, what, self._pictured[0])):
            self._pictured, self._pictured_at = (what, Pictures(running)), 0.0
        now, pictures = time.monotonic(), self._pictured[1]
        assert pictures is not None
        if not running.live or now - self._pictured_at >= PICTURE:
            self._pictured_at = now
            self._run_panel.show_picture(pictures.of(rows[row]))

    def _as_it_stands(self) -> AnyDraft:
        """The draft with what was pushed, or is being pushed, in its place."""
        draft, running = self._session.draft, self._session.running
        if running is not None:
            draft = replace(draft, scene=running.scene)
        return draft if self._drags.pushed is None else with_obstacle(draft, *self._drags.pushed)

    def _complain(self, sentence: str) -> None:
        self._client.add_notification("Not possible", sentence, color="red", auto_close_seconds=8.0)

    # ------------------------------------------------------------------------------------------ playing
    def _scrub(self, row: int) -> None:
        if self._plan is None:
            return
        self._row = min(max(int(row), 0), self._plan.steps)
        with self._client.atomic():
            self._draw_moment()
            self._plan_panel.show_row(self._row, self._playing)
        self._client.flush()

    def _play(self) -> None:
        if self._plan is None:
            return
        self._playing = not self._playing
        if self._playing and self._row >= self._plan.steps:
            self._row = 0
        self._scrub(self._row)
        if self._playing:
            self._began = time.monotonic() - CONTROL_STEP * self._row
            self._do(self._frame, key="frame")

    def _frame(self) -> None:
        """The next row of what is played, in the time that it takes."""
        if not self._playing or self._plan is None:
            self._playing = False
            return
        row = int((time.monotonic() - self._began) / CONTROL_STEP)
        self._playing = row < self._plan.steps
        self._scrub(row)
        if self._playing:
            self._do(self._frame, key="frame", delay=CONTROL_STEP / 2)

    def _choose(self, place: int) -> None:
        self._chosen = place
        self.show()

    # ------------------------------------------------------------------------------------------ running
    def _run(self) -> None:
        """Begin a run of the plan that is chosen, or end the one under way."""
        running = self._session.running
        if running is not None and running.live:
            self._session.stop()
            return
        self._run_row, self._playing = None, False
        self._session.run(self._run_panel.wanted, self._chosen)

    def _scrub_run(self, row: int) -> None:
        running = self._session.running
        last = 0 if running is None else len(running.seen) - 1
        self._run_row = None if row >= last else int(row)
        with self._client.atomic():
            self._show_run()
        self._client.flush()

    def _export_run(self) -> None:
        """A page that plays the run, by itself."""
        running = self._session.running
        if running is not None and running.rollout is not None:
            task: Any = running.task
            page = film_page(replace(task, scene=running.scene), running.rollout, running.sentence)
            self._client.send_file_download(f"{running.task.name}-run.html", page.encode(), save_immediately=True)

    def _film(self) -> None:
        """A video of the run, made beside the page, which it would keep for seconds."""
        running = self._session.running
        if running is None or running.rollout is None:
            return
        film, waits = Inbox(self._complain), self._client.add_notification("A video is made", "", loading=True)
        name = f"{running.task.name}.mp4"
        film.post(lambda: self._client.send_file_download(name, film_video(running), save_immediately=True))
        film.post(waits.remove)
        film.post(film.close)

    # ------------------------------------------------------------------------------------------ hands
    def _select(self, index: int | None) -> None:
        self._selected, self._grasped = index, None
        self.show()

    def clicked(self, name: str) -> None:
        """See `Shown.clicked`."""
        what, which, more = parts(name)
        if what == "obstacles":
            self._select(int(which))
        elif what == "ends":
            self._selected, self._grasped = None, gripper(which, more)
            self.show()

    def snapped(self, name: str) -> None:
        """See `Shown.snapped`."""
        end = "start" if "start" in name else "goal"
        self._client.add_notification("The cable snapped", f"The {end} was unstable, and took the nearest shape.",
                                      color="orange", auto_close_seconds=4.0)  # fmt: skip

    def let_go(self) -> None:
        """See `Shown.let_go`: a gizmo returns to what it moved."""
        if self._in_space:
            self._draw_draft()
            self._client.flush()

    # ------------------------------------------------------------------------------------------ files
    def _save(self) -> None:
        paths = self._session.save(self._out / self._session.draft.name)
        said = f"Saved in {paths[0].parent}: {', '.join(path.name for path in paths)}."
        self._task_panel.saved.content = look.hint(said)

    def _export(self) -> None:
        """A page that plays the plan that is chosen, by itself."""
        draft, planning = self._session.draft, self._session.planning
        if self._plan is not None and planning.status == "found":
            page = film_page(draft.checked(), self._plan, planning.sentence)
            self._client.send_file_download(f"{draft.name}.html", page.encode(), save_immediately=True)

    def _download(self) -> None:
        draft = self._session.draft
        self._client.send_file_download(f"{draft.name}.yaml", task_text(draft).encode(), save_immediately=True)


def _where(draft: AnyDraft) -> tuple[Any, ...]:
    """What is drawn once for all of a task."""
    return draft.scene.size, "" if draft.cell is None else draft.cell.name
