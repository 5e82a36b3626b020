"""One search for plans of a task: initial trajectories are tried in turn, and the closest failure is remembered."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import PlanningError
from cableway.core.provenance import describe, versions
from cableway.core.time_limit import checkpoint
from cableway.motion.validity import is_pulled_straight
from cableway.outcome import Outcome
from cableway.planning.config import InitialName, PlannerConfig
from cableway.planning.initial_trajectories import (
    RESTARTS,
    InitialTrajectories,
    InitialTrajectory,
    Progress,
)
from cableway.planning.local_replanning import replanned
from cableway.planning.projection import ProjectedTrajectory, project, stepped
from cableway.planning.routes.infeasibility import find_blockage
from cableway.records import Attempt, Plan, Verdict
from cableway.robot.branches import NoMotion, arm_motion, common_ways, end_fault
from cableway.robot.free_arms import LEAST, free_arms, rooms
from cableway.robot.grasping import with_hands
from cableway.scene.cell import Way
from cableway.scene.task import Task
from cableway.verification import verify_plan

LOGGER = logging.getLogger(__name__)

Accept = Callable[[Plan], str]
"""What is wrong with a verified plan, "" if nothing."""

Tried = tuple[InitialName, int, InitialTrajectory]
"""An initial trajectory with its name and which of that name it is."""

STRAIGHT = 0.995
"""Distance between the grippers over L from which a plan is taken only where there is no other: an error of half a
percent of the length would tear the cable, a smaller one may bend it to the other side."""

WAYS = 8
"""Ways of holding the cable in which arms are seen, at most."""

NEARLY = 0.8
"""Share of its rows that arms follow from which an initial trajectory is projected anew with arms."""

SEEING: tuple[InitialName, ...] = ("corridor", "anywhere", "tube")
"""Searches that see arms, each in all ways before the next."""

OPTIMIZING = ("replan", "optimize")
"""Kinds of projection with an optimisation."""


class Search:
    """Tries initial trajectories and remembers what came closest.

    Args:
        task: The task.
        config: What to use in each stage.
        seed: For the initial trajectories that draw random numbers.
        progress: Called with the name of a stage and the share of it that is done.

    Attributes:
        best: The failure with the fewest failed checks.
        straight: The first verified plan that pulls the cable straight (`STRAIGHT`).

    Note:
        Plans are made for grippers first, and arms chosen that can follow. Where none can, arms are held to one choice
        of branches after the other, and search and optimisation see them (`robot.free_arms`): at once where start and
        goal leave one choice. Room beyond the margin may lead grippers to where arms cannot; so less of it is tried
        before a new search.
    """

    def __init__(
        self,
        task: Task,
        config: PlannerConfig,
        seed: int,
        progress: Progress | None,
    ) -> None:
        self.task, self.config, self.seed = _in_its_way(task), config, seed
        self.best: Attempt | None = None
        self.straight: Plan | None = None
        self._unfollowed: Float[np.ndarray, "t 2 3"] | None = None
        self._seen = False
        self._tried: list[Tried] = []
        self._progress = progress

    def trajectories(
        self, route: Float[np.ndarray, "P 2"] | None = None, previous: Plan | None = None
    ) -> InitialTrajectories:
        """The initial trajectories of the task, along a given pivot path or an earlier plan if there are any."""
        return InitialTrajectories(self.task, self.config, self.seed, self.report, route=route, previous=previous)

    def report(self, stage: str, share: float) -> None:
        """Report progress.

        Raises:
            OutOfTime: The time is up.
        """
        checkpoint()
        if self._progress is not None:
            self._progress(stage, share)

    def follow(self, trajectories: InitialTrajectories, name: InitialName, accept: Accept | None = None) -> Plan | None:
        """The verified plan that an initial trajectory leads to; None where it leads to none that is accepted."""
        restarts = range(len(RESTARTS) if name == "restarts" else 1)
        found = (self._follow(trajectories, name, accept, restart) for restart in restarts)
        return next((plan for plan in found if plan is not None), None)

    def follow_closely(self, accept: Accept | None = None) -> Plan | None:
        """The verified plan that one of the initial trajectories tried so far leads to where no more clearance than the
        margin is asked for; None where none does, or no more was.
        """
        found = (self._closely(tried, accept) for tried in self._tried)
        return next((plan for plan in found if plan is not None), None)

    def _closely(self, tried: Tried, accept: Accept | None) -> Plan | None:
        """The same for one of them."""
        name, restart, initial = tried
        projection, optimization = self.config.projection, self.config.projection.optimization
        if projection.kind not in OPTIMIZING or optimization.room <= optimization.margin:
            return None
        close = replace(projection, optimization=replace(optimization, room=optimization.margin))
        closely = copy(self)
        closely.config = replace(self.config, projection=close)
        plan = closely._noted(name, restart, closely._made_of(initial, accept))
        self.best, self.straight = closely.best, closely.straight
        return plan

    def _follow(
        self, trajectories: InitialTrajectories, name: InitialName, accept: Accept | None, restart: int
    ) -> Plan | None:
        try:
            initial = trajectories.make(name, restart)
        except PlanningError as error:
            return self._noted(name, restart, Attempt(str(error)))
        self._unfollowed = None
        plan = self._noted(name, restart, self._made_of(initial, accept))
        if plan is not None or self._unfollowed is None:
            self._tried.append((name, restart, initial))
            return plan
        led = self._led_by_arms(trajectories, (name, restart, initial), self._unfollowed, accept)
        return next((plan for plan in led if plan is not None), None)

    def _led_by_arms(
        self,
        trajectories: InitialTrajectories,
        tried: Tried,
        unfollowed: Float[np.ndarray, "t 2 3"],
        accept: Accept | None,
    ) -> Iterator[Plan | None]:
        """Plans that arms may follow, which cannot follow an initial trajectory as it was projected, `unfollowed`."""
        name, restart, initial = tried
        ranked, seeing = self._held(unfollowed), not self._seen
        self._seen = True
        for share, held in ranked:
            if share >= NEARLY:
                yield held._noted(name, restart, held._made_of(initial, accept))
        yield self._closely(tried, accept)
        made = [(held.trajectories(trajectories.route), held) for _, held in ranked if seeing]
        for other in SEEING:
            for there, held in made:
                yield held.follow(there, other, accept)

    def _held(self, poses: Float[np.ndarray, "t 2 3"]) -> list[tuple[float, Search]]:
        """Searches that see the arms in one way of holding the cable each, those in which arms can be at most of some
        gripper poses [m, m, rad] first, and at which share; none where this one does."""
        assert self.task.cell is not None
        found: list[tuple[float, Search]] = []
        for way in _distinct_ways(self.task) if self.task.cell.way is None else ():
            held = copy(self)
            held.task, held._tried = self.task.held(way), []
            arms = free_arms(held.task, poses[:0])
            assert arms is not None
            found.append((float((rooms(poses, arms) >= LEAST).all(axis=1).mean()), held))
        return sorted(found, key=lambda each: -each[0])[:WAYS]

    def _made_of(self, initial: InitialTrajectory, accept: Accept | None) -> Plan | Attempt:
        found = self._project(initial)
        if isinstance(found, Plan) and accept is not None and (fault := accept(found)):
            return _attempt(fault, found)
        return found

    def _noted(self, name: InitialName, restart: int, found: Plan | Attempt) -> Plan | None:
        if isinstance(found, Attempt):
            LOGGER.info("initial trajectory %r, try %d: no plan: %s", name, restart + 1, found.reason)
            return self._fail(found)
        made_by = {"initial_trajectory": name, "seed": self.seed, "versions": versions()}
        plan = found.noted(**made_by, planner=describe(self.config))
        if is_pulled_straight(plan.poses, self.task.cable.length, STRAIGHT):
            LOGGER.info("initial trajectory %r, try %d: a plan that pulls the cable straight", name, restart + 1)
            self.straight = self.straight or plan
            return None
        LOGGER.info("initial trajectory %r, try %d: a plan of %d steps", name, restart + 1, plan.steps)
        return plan

    def out_of_reach(self) -> PlanningError | None:
        """The error that says why the cell's arms cannot hold the cable at start and goal; None where they can."""
        fault = None if self.task.cell is None else end_fault(self.task, self.task.cell)
        if fault is None:
            return None
        return PlanningError(
            f"there is no plan: {fault.reason}", Attempt(fault.reason, at=fault.at), Outcome.INFEASIBLE
        )

    def blocked(self) -> PlanningError | None:
        """The error that says what certainly cannot pass, and where; None where all may."""
        blockage = find_blockage(self.task, self.config.limits.clearance)
        if blockage is None:
            return None
        x, y = blockage.place
        attempt = replace(self.best or Attempt(""), reason=str(blockage), at=(float(x), float(y)))
        return PlanningError(f"there is no plan: {blockage}", attempt, Outcome.INFEASIBLE)

    def nothing(self, tried: str) -> PlanningError:
        """The error that says what was tried, and why the closest attempt is no plan."""
        reason = f": {self.best.reason}" if self.best else ""
        return PlanningError(f"no plan was found {tried}{reason}", self.best)

    def _project(self, initial: InitialTrajectory) -> Plan | Attempt:
        task, config = self.task, self.config
        self.report("projection", 0.0)
        try:
            projected = project(initial.shapes, task, config.projection, lambda share: self.report("projection", share))
        except PlanningError as error:
            return Attempt(str(error), initial.shapes, stages=initial.stages)
        self.report("projection", 1.0)
        found = self._judge(projected, initial)
        if isinstance(found, Plan) or config.projection.kind != "replan":
            return found
        self._fail(found)  # now, because the time may run out within the local replanning
        try:
            projected = replanned(
                projected, task, config.projection, config.rrt_connect,
                seed=self.seed, progress=lambda share: self.report("local replanning", share),
            )  # fmt: skip
        except PlanningError:
            return found
        self.report("local replanning", 1.0)
        again = self._judge(projected, initial)
        return again if isinstance(again, Plan) or _faults(again) < _faults(found) else found

    def _judge(self, projected: ProjectedTrajectory, initial: InitialTrajectory) -> Plan | Attempt:
        stages = initial.stages_at(projected.places)
        made_by = {} if stages is None else stages.metadata
        plan = Plan(projected.shapes, projected.poses, projected.q, stages, made_by)
        if self.task.cell is not None:
            motion = arm_motion(plan.poses, self.task, self.task.cell)
            if isinstance(motion, NoMotion):
                self._unfollowed = plan.poses
                return replace(_attempt(motion.reason, plan), at=motion.at)
            if self.task.cell.way is None and projected.nodes is not None and projected.node_places is not None:
                # now that it is known which joints move, they get the time that they need
                held = copy(self)
                held.task = self.task.held(motion.way)
                eased = stepped(projected.nodes, projected.node_places, held.task, self.config.projection)
                return held._judge(eased, initial)
            plan = with_hands(plan, motion, self.task)
        self.report("verification", 0.0)
        verdict = verify_plan(plan, self.task, self.config.limits)
        self.report("verification", 1.0)
        return plan.judged(verdict) if verdict.passed else _attempt(str(verdict), plan, verdict)

    def _fail(self, attempt: Attempt) -> None:
        if self.best is None or _faults(attempt) < _faults(self.best):
            self.best = attempt


def _distinct_ways(task: Task) -> list[Way]:
    """The ways in which the arms of a cell can hold the cable at start and goal; of those that differ in the turns of
    tools, which hardly change where links are, one."""
    assert task.cell is not None
    ways = common_ways(task, task.cell)
    found: dict[Any, Way] = {}
    for way in () if isinstance(ways, NoMotion) else ways:
        found.setdefault((way.holders, way.branches), way)
    return list(found.values())


def _in_its_way(task: Task) -> Task:
    """The task with its arms held to the only way in which they can hold the cable, where there is one only."""
    if task.cell is None or task.cell.way is not None:
        return task
    ways = _distinct_ways(task)
    return task.held(ways[0]) if len(ways) == 1 else task


def _attempt(reason: str, plan: Plan, verdict: Verdict | None = None) -> Attempt:
    return Attempt(reason, plan.shapes, plan.poses, verdict, plan.stages)


def _faults(attempt: Attempt) -> int:
    return len(attempt.verdict.failures()) if attempt.verdict else 99
