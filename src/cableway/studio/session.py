"""What one page edits and plans: a draft with its past, what is wrong with it, and the plan for it.

There is no state that files cannot hold: the draft is a task file, what became of it a plan and a report.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError, Point
from cableway.scene.files.loading import AnyDraft
from cableway.scene.files.saving import save_task
from cableway.scene.spatial.task import SpatialDraft
from cableway.scene.task import ENDS, End
from cableway.studio import ends
from cableway.studio.inspection import Inspection, inspect
from cableway.studio.obstacles import with_obstacle
from cableway.studio.opening import TASK, Opened, opened
from cableway.studio.planning import PLANNING, Planning, planning_from, planning_of
from cableway.studio.replanner import Answer, Replanner
from cableway.studio.running import Running, Wanted
from cableway.studio.saving import write_files
from cableway.tasks.space.generation import random_any_task
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve_in_space import SpatialOptions

REMEMBERED = 200
"""Edits that can be undone."""

WAYS = 4
"""Plans sought that go round the obstacles in different ways."""

Shapes = Mapping[End, Float[np.ndarray, "d"] | None]


class Moment(NamedTuple):
    """A draft, and rod coordinates of the cable at both ends."""

    draft: AnyDraft
    shapes: Shapes


class Session:
    """A task that is edited; every change is told to all who listen.

    Args:
        source: A task or a draft, or the name or the file of one.
        options: How it is planned.
        planner: Makes what plans, of what is to be told the answers; see `Replanner`.
        watched: Whether what is shown comes from elsewhere: it is not edited.

    Attributes:
        moment: The draft as it is now, also in the midst of a drag.
        inspection: What is known of it.
        planning: How far its plan is.
        running: How far its run is, until the next edit; None where there is none.
        options: How it is planned.

    Raises:
        InputError: There is no such task, or its values make none.
    """

    def __init__(
        self,
        source: Any,
        options: SolveOptions | None = None,
        planner: Callable[..., Any] = Replanner,
        *,
        watched: bool = False,
    ) -> None:
        self.watched = watched
        self.running: Running | None = None
        self.options = SolveOptions(track=False) if options is None else options
        self._lock = threading.RLock()
        self.planning = Planning("planning", PLANNING)
        self._listeners: list[Callable[[], Any]] = []
        self._past: list[Moment] = []
        self._future: list[Moment] = []
        found = opened(source)
        self._asked = 0
        self._replanner = planner(self._hear)
        self._replanner.start()
        self._take(found)

    # ------------------------------------------------------------------------------------------ what there is
    @property
    def draft(self) -> AnyDraft:
        """As it is now."""
        return self.moment.draft

    @property
    def can_undo(self) -> bool:
        """Whether something was edited."""
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        """Whether an edit was undone, and nothing edited since."""
        return bool(self._future)

    def listen(self, listener: Callable[[], Any]) -> Callable[[], None]:
        """Have `listener` called after every change, from whatever thread made it; returns what ends that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    # ------------------------------------------------------------------------------------------ opening
    def open(self, source: Any) -> None:
        """Edit another task, or look at a plan or a rollout of one, see `opened`.

        Raises:
            InputError: There is none, its values make none, or a record is not of the task beside it.
        """
        self.look_at(opened(source))

    def look_at(self, found: Opened) -> None:
        """Edit a task, which is planned for where nothing of it was opened besides."""
        with self._lock:
            self._require_own()
            before = self.moment
            self._take(found)
            self._remember(before)
        self._tell()

    def _take(self, found: Opened) -> None:
        self._show(_moment(found.draft))
        if found.plan is None and found.rollout is None:
            self._plan()
            return
        self._drop()
        self.planning = planning_from(found.plan, found.name)
        if found.rollout is not None:
            self.running = Running.of_rollout(found.draft.checked(), found.plan, found.rollout, found.name)

    def open_content(self, name: str, content: bytes) -> None:
        """Edit the task of a file with that name and content, or look at a plan or rollout (.npz) of the task here.

        Raises:
            InputError: It is none.
        """
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / (Path(name).name or "task.yaml")
            path.write_bytes(content)
            if path.suffix == ".npz":
                save_task(self.draft, path.with_name(TASK))
            try:
                self.open(path)
            except InputError as error:
                raise InputError(str(error).replace(str(path), path.name)) from None

    def draw(self, kind: str, seed: int) -> None:
        """Edit the random task of a kind and a seed.

        Raises:
            InputError: There is no such kind, or none was found.
        """
        self.open(random_any_task(seed, kind))

    def save(self, folder: Path) -> tuple[Path, ...]:
        """Write what there is to a folder, see `write_files`; once a run is over, that and the plan that it followed.

        Raises:
            InputError: The draft is no task.
        """
        with self._lock:
            draft, planning, running = self.draft, self.planning, self.running
        if running is not None and running.run is not None:
            plans = () if running.plan is None else (running.plan,)
            return write_files(folder, draft, plans, running.run, running.perturbation)
        return write_files(folder, draft, planning.plans, planning.run)

    # ------------------------------------------------------------------------------------------ editing
    def hold(self) -> Moment:
        """Begin an edit that is previewed as it goes, such as a drag; the plan under way is dropped."""
        with self._lock:
            self._require_own()
            self._drop()
            return self.moment

    def preview_obstacle(self, held: Moment, index: int, obstacle: Any) -> None:
        """Show an obstacle as it would be, the rest as it was held.

        Raises:
            InputError: It cannot be so.
        """
        self._show(Moment(with_obstacle(held.draft, index, obstacle), held.shapes))

    def preview_gripper(self, end: End, side: int, pose: Float[np.ndarray, "pose"]) -> bool:
        """Lead a gripper of an end to a pose; returns whether the cable snapped.

        Raises:
            InputError: No stable cable is held so; all stays as it is.
        """
        with self._lock:
            draft, shapes = self.moment
            q = shapes[end]
            if q is None:
                raise InputError(f"the {end} is unknown: draw or open another task")
            rod = draft.cable.rod
            poses = rod.end_poses(q[None])[0]
            poses[side] = pose
            led = ends.led(rod, q, ends.within_reach(rod, poses, side))
            self._show(Moment(ends.with_end(draft, end, led.q), {**shapes, end: led.q}))
            return led.snapped

    def release(self, held: Moment) -> None:
        """End an edit that began with `hold`, and plan what it came to."""
        with self._lock:
            if self.moment is not held:
                self._remember(held)
            self._plan()

    def bend(self, end: End) -> None:
        """Bend the cable at an end to the other side.

        Raises:
            InputError: No stable shape lies there.
        """
        with self._lock:
            draft, shapes = self.moment
            q = shapes[end]
            if q is None:
                raise InputError(f"the {end} is unknown: draw or open another task")
            if isinstance(draft, SpatialDraft):
                raise InputError("in space a cable has no two sides to bend to: turn a gripper")
            q = ends.bent(draft.cable.rod, q)
            self._commit(Moment(ends.with_end(draft, end, q), {**shapes, end: q}))

    def set_obstacle(self, index: int, obstacle: Any) -> None:
        """Put an obstacle in the place of one, remove that where None, or add one after the last.

        Raises:
            InputError: It cannot be so.
        """
        with self._lock:
            self._commit(Moment(with_obstacle(self.draft, index, obstacle), self.moment.shapes))

    def set_gripper(self, end: End, side: int, pose: Float[np.ndarray, "pose"]) -> bool:
        """As `preview_gripper`, and plan.

        Raises:
            InputError: No stable cable is held so.
        """
        with self._lock:
            held = self.hold()
            try:
                return self.preview_gripper(end, side, pose)
            finally:
                self.release(held)

    def undo(self) -> None:
        """Go back before the last edit, if there was one."""
        self._turn(self._past, self._future)

    def redo(self) -> None:
        """Do again what was undone last, if there is something."""
        self._turn(self._future, self._past)

    # ------------------------------------------------------------------------------------------ planning
    def seek_ways(self) -> None:
        """Look for plans that go round the obstacles in different ways."""
        with self._lock:
            self._require_own()
            if isinstance(self.draft, SpatialDraft):
                raise InputError("in space one plan is sought, and no others that go round the obstacles differently")
            self._plan(alternatives=WAYS)

    # ------------------------------------------------------------------------------------------ running
    def run(self, wanted: Wanted, place: int = 0) -> None:
        """Run the plan at a place, 0 for the best, in a plant.

        Raises:
            InputError: There is no plan yet, or no such controller or plant.
        """
        with self._lock:
            self._require_own()
            if self.planning.status != "found":
                raise InputError("there is no plan to run yet")
            task, plan = self.draft.checked(), self.planning.plans[place]
            seed = self.options.seed
            perturbation, eyes = wanted.perturbation(task, seed), wanted.eyes(task, seed)
            self.begin(
                Running(task=task, plan=plan, controller=wanted.controller, perturbation=perturbation, eyes=eyes)
            )

    def push(self, index: int, by: Point) -> None:
        """Push an obstacle by (dx, dy) [m] while it is run, see `Running.pushed`.

        Raises:
            InputError: It cannot stand there, something has been there, or none can be pushed now.
        """
        with self._lock:
            self._require_own()
            if self.running is not None:
                self.begin(self.running.pushed(index, by))

    def stop(self) -> None:
        """End the run, if there is one; what there is of it is kept."""
        self._replanner.stop()

    def begin(self, running: Running) -> None:
        """Begin a run, or watch one that begins."""
        with self._lock:
            self.running = running
            since = running.kept[-1].time if running.kept else 0.0
            self._asked = self._replanner.request(running.task, running.options(self.options), since)
        self._tell()

    def close(self) -> None:
        """End planning for good."""
        self._replanner.close()

    def _show(self, moment: Moment) -> None:
        with self._lock:
            self.moment = moment
            self.inspection: Inspection = inspect(moment.draft, moment.shapes)
            if self.inspection.faults:
                self.planning = Planning("invalid", "No plan is sought: no cable can do this.")
            else:
                self.planning = Planning("planning", "Let go to plan.")
        self._tell()

    def _require_own(self) -> None:
        if self.watched:
            raise InputError("this page watches a run from elsewhere; tasks are edited and run by: cableway studio")

    def _remember(self, moment: Moment) -> None:
        self._past = [*self._past, moment][-REMEMBERED:]
        self._future.clear()

    def _commit(self, moment: Moment) -> None:
        with self._lock:
            self._require_own()
            before = self.moment
            self._show(moment)
            self._remember(before)
            self._plan()

    def _turn(self, source: list[Moment], other: list[Moment]) -> None:
        with self._lock:
            if not source or self.watched:
                return
            other.append(self.moment)
            self._show(source.pop())
            self._plan()

    def _plan(self, **changes: Any) -> None:
        with self._lock:
            self.running = None
            if self.inspection.faults:
                self._drop()
            else:
                self.planning = replace(self.planning, status="planning", sentence=PLANNING, at=None)
                self._asked = self._replanner.request(self.draft.checked(), self._how(**changes))
        self._tell()

    def _how(self, **changes: Any) -> SolveOptions | SpatialOptions:
        """How the draft is planned."""
        options = self.options
        if isinstance(self.draft, SpatialDraft):
            return SpatialOptions(seed=options.seed, time_limit=options.time_limit)
        return replace(options, **changes)

    def _drop(self) -> None:
        """Wait for no answer any more."""
        self._asked, self.running = 0, None
        self._replanner.cancel()

    def _hear(self, answer: Answer) -> None:
        with self._lock:
            if answer.number != self._asked:
                return
            if self.running is not None:
                self.running = self.running.heard(answer)
            elif answer.stage:
                self.planning = replace(self.planning, sentence=f"Planning: {answer.stage} ...")
            elif answer.run is None:
                self.planning = Planning("none", f"No plan: {answer.problem}.")
            else:
                self.planning = planning_of(answer.run)
        self._tell()

    def _tell(self) -> None:
        for listener in tuple(self._listeners):
            listener()


def _moment(draft: AnyDraft) -> Moment:
    return Moment(draft, {end: ends.held_shape(draft, end) for end in ENDS})
