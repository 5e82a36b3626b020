"""The planner in space: short searches in a fixed order, each made smooth and judged, until one verifies.

The first in the order whose plan verifies is the plan, so that the answer does not depend on timing.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from cableway.core.checks import Bounds, Checked
from cableway.core.errors import Cancelled, PlanningError, PlanningInterrupted
from cableway.core.provenance import describe, versions
from cableway.core.time_limit import OutOfTime, time_limit
from cableway.motion.interpolation import evenly_moved, subdivided
from cableway.motion.limits import Margins
from cableway.motion.spatial import SpatialFreeSpace, SpatialProblem, continuous_poses, rows_between
from cableway.motion.time_parametrization import gripper_effort, require_rows, with_ramps
from cableway.outcome import Outcome
from cableway.planning.projection import EFFORT_PIECES, KEYPOINT_STEP, LIMIT_SHARE, USUAL_RAMPS
from cableway.planning.routes.spatial import blocked, grid_path, slid_shapes
from cableway.planning.spatial_optimization import optimize_in_space
from cableway.planning.spatial_rrt import Sampler, Trees, about_path, about_shapes, anywhere, bursts
from cableway.planning.trajectory_optimization import CLEARANCE_WEIGHTS, TrajectoryOptimizationConfig
from cableway.records import Attempt, Plan, Verdict
from cableway.robot.free_spatial_arms import FreeSpatialArms
from cableway.robot.spatial_arms import SpatialArms, SpatialWay
from cableway.rod.spatial_lag import spatial_lag
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP
from cableway.verification.spatial_plan import SpatialVerificationLimits, verify_spatial_plan

LOGGER = logging.getLogger(__name__)

Source = Literal["anywhere", "tube", "corridor", "tube-tail"]
"""Where a search gets its samples."""

Progress = Callable[[str, float], None]

SOURCES: tuple[Source, ...] = ("anywhere", "tube", "corridor", "tube-tail")

SLOWEST = 3.0
"""How many times as long as the grippers' limits ask for a plan may take where the cable trails behind: a heavy one
would crawl past a fold."""

WAYS = 6
"""In which arms may hold the cable that are searched, in turns."""

ARMS_CLEARANCES, ARMS_KEPT = (0.010, 0.008), 0.007
"""Clearance [m] of links and hands in the search, the lesser one where start or goal leave no more; and in the rows of
a plan, which are not quite those looked at."""

ARMS_STEP = 2.0
"""Times as far apart as without arms are shapes that a search looks at, each of which takes it several times as long:
what it misses between them the rows of the plan show."""

SPARE = 0.002
"""Clearance [m] beyond the margin that the way of a sliding cable keeps."""


@dataclass(frozen=True, kw_only=True)
class SpatialPlannerConfig(Checked):
    """How a plan in space is searched.

    Attributes:
        first: Samples of the first searches.
        most: Of the last ones.
        step: Largest move of a point of the cable between two shapes that are checked [m].
        row_step: Largest move of a keypoint between rows during the optimisation [m].
        lag: Largest distance [m] by which the cable may trail behind its equilibria, where a plan `SLOWEST` times as
            slow keeps it.
        margins: What shapes keep in the search.
        optimization: Weights of the trajectory optimisation.
        limits: What a plan must keep.
    """

    first: Annotated[int, Bounds(2, 10**6)] = 240
    most: Annotated[int, Bounds(2, 10**7)] = 32_000
    step: Annotated[float, Bounds(1e-4, 0.1)] = 0.006
    row_step: Annotated[float, Bounds(1e-4, 1)] = 0.015
    lag: Annotated[float, Bounds(1e-5, 1)] = 0.002
    margins: Margins = field(default_factory=lambda: Margins(clearance=0.006, stability=15.0))
    optimization: TrajectoryOptimizationConfig = field(
        default_factory=lambda: TrajectoryOptimizationConfig(
            margin=0.008, room=0.02, stability_wanted=25.0, iterations=20, tolerance=1e-3
        )
    )
    limits: SpatialVerificationLimits = field(default_factory=SpatialVerificationLimits)


# Threads of the linear algebra library wait for each other in small matrices.
@threadpool_limits.wrap(limits=1, user_api="blas")
def plan_in_space(
    task: SpatialTask,
    *,
    seed: int = 0,
    config: SpatialPlannerConfig | None = None,
    progress: Progress | None = None,
    expired: Callable[[], bool] | None = None,
) -> Plan:
    """Find a verified sequence of shapes and gripper poses from start to goal.

    Args:
        task: The task; where it has a cell, the plan has the joints of its arms.
        seed: Same seed, same plan.
        config: How.
        progress: Called with the name of a stage and the share of it that is done.
        expired: Asked several times a second; the search ends once it says yes.

    Raises:
        PlanningError: No plan was found; `attempt` holds the one that came closest. The message says so where grippers
            or cable cannot pass, where arms cannot hold both ends in one way, and where the time ran out.
        MissingExtraError: Coal, which the judge needs, is not installed.
    """
    search = _Search(task, config or SpatialPlannerConfig(), seed, progress or (lambda stage, share: None))
    try:
        with time_limit(expired):
            return search.run()
    except OutOfTime:
        raise search.error("the time limit ran out before a plan was found", Outcome.TIMED_OUT) from None
    except (Cancelled, KeyboardInterrupt):
        if search.best is None:
            raise
        reason = f"interrupted before a plan was found; the closest attempt: {search.best.reason}"
        raise PlanningInterrupted(reason, search.best, Outcome.INTERRUPTED) from None


class _Search:
    """One search; `best` is the failure with the fewest failed checks."""

    def __init__(self, task: SpatialTask, config: SpatialPlannerConfig, seed: int, progress: Progress) -> None:
        self.task, self.config, self.seed, self.report = task, config, seed, progress
        self.problem = SpatialProblem.of(task)
        self.best: Attempt | None = None
        self._arms = None if task.cell is None else SpatialArms(task, ARMS_KEPT)
        self._trees: dict[SpatialWay | None, Trees] = {}
        self._samplers: dict[Source, Sampler | None] = {}

    def _ways(self) -> list[SpatialWay | None]:
        """How the arms may hold the cable, None for grippers alone; each has trees from then on.

        Raises:
            PlanningError: They cannot.
        """
        if self.task.cell is None:
            self._add_trees(None)
            return [None]
        found: list[SpatialWay] | str = ""
        for clearance in ARMS_CLEARANCES:
            arms = SpatialArms(self.task, clearance)
            if not isinstance(found := arms.ways(), str):
                for way in found[:WAYS]:
                    self._add_trees(way, arms.held(way))
                return [*found[:WAYS]]
        raise PlanningError(f"there is no plan: {found}", Attempt(found), Outcome.INFEASIBLE)

    def _add_trees(self, way: SpatialWay | None, arms: FreeSpatialArms | None = None) -> None:
        space = SpatialFreeSpace.of(self.problem, self.config.margins, arms)
        step = self.config.step * (1.0 if arms is None else ARMS_STEP)
        self._trees[way] = Trees(self.problem, space, step)

    def run(self) -> Plan:
        """The first plan that verifies."""
        config, tried = self.config, 0
        most = config.first * 2 ** int(np.log2(config.most / config.first))
        names = tuple(product(self._ways(), SOURCES))
        searches: Iterator[tuple[tuple[SpatialWay | None, Source], int, int]] = bursts(names, config.first, most)
        for (way, source), samples, burst in searches:
            if burst == 1 and (way, source) == names[0] and (fault := blocked(self.problem, config.limits.clearance)):
                attempt = replace(self.best or Attempt(""), reason=fault)
                raise PlanningError(f"there is no plan: {fault}", attempt, Outcome.INFEASIBLE)
            self.report("search", tried / (len(names) * 2 * most))
            tried += samples
            sampler = self._sampler(source)
            if sampler is None:
                continue
            path, used = self._trees[way].search(sampler, samples, (self.seed, SOURCES.index(source), burst))
            LOGGER.info("%s, %d of %d samples: %s", source, used, samples, "no path" if path is None else "a path")
            if path is not None and (found := self._made_of(path, source, way)) is not None:
                return found
        raise self.error(f"no plan was found with {tried} samples", Outcome.NO_PLAN)

    def error(self, message: str, outcome: Outcome) -> PlanningError:
        """The error that says why the closest attempt is no plan."""
        reason = f"; the closest attempt: {self.best.reason}" if self.best else ""
        return PlanningError(message + reason, self.best, outcome)

    def _sampler(self, source: Source) -> Sampler | None:
        """What draws samples; None where there is no way for it to lie about."""
        if source not in self._samplers:
            try:
                self._samplers[source] = self._new_sampler(source)
            except PlanningError as error:
                self._samplers[source] = None
                self._note(Attempt(str(error)))
        return self._samplers[source]

    def _new_sampler(self, source: Source) -> Sampler:
        problem = self.problem
        if source == "anywhere":
            return anywhere(problem)
        away = self.config.margins.clearance + SPARE
        if source == "corridor":
            stations = problem.rod.shapes(np.array([problem.start, problem.goal]))[0]
            middle = stations[:, stations.shape[1] // 2]
            return about_path(problem, grid_path(problem, middle[0], middle[1], problem.radius + away))
        reach = float(problem.bodies.radius.max()) + away
        slid = slid_shapes(problem, reach, reverse=source == "tube-tail")
        eased = replace(self.config.optimization, iterations=12)
        return about_shapes(problem, optimize_in_space(slid, problem, eased, weights=CLEARANCE_WEIGHTS[1:2]))

    def _made_of(self, path: Float[np.ndarray, "r 12"], source: Source, way: SpatialWay | None) -> Plan | None:
        """The plan of a free path, made smooth; or as it is, where that does not verify."""
        rod, config = self.problem.rod, self.config
        if self._arms is not None and way is not None:
            joints = self._arms.unwound(self._arms.joints(rod.shapes(path)[1], way), way)
            if isinstance(joints, str):
                LOGGER.info("%s: no plan: %s", source, joints)
                self._note(Attempt(joints))
                return None
        self.report("optimisation", 0.0)
        q = rows_between(rod, path, evenly_moved(rod, path, config.row_step))
        report = lambda share: self.report("optimisation", share)  # noqa: E731
        smooth = optimize_in_space(
            q, self.problem, config.optimization, report, CLEARANCE_WEIGHTS[-1:], self._trees[way].space.arms
        )
        for rows in (smooth, path):
            try:
                plan = self._timed(rows, way)
            except PlanningError as error:
                LOGGER.info("%s: no plan: %s", source, error)
                self._note(Attempt(str(error)))
                continue
            self.report("verification", 0.0)
            verdict = verify_spatial_plan(plan, self.task, config.limits)
            self.report("verification", 1.0)
            if verdict.passed:
                LOGGER.info("%s: a plan of %d steps", source, plan.steps)
                made_by = {"initial_trajectory": source, "seed": self.seed, "versions": versions()}
                return plan.judged(verdict).noted(**made_by, planner=describe(config))
            LOGGER.info("%s: no plan: %s", source, verdict)
            self._note(Attempt(str(verdict), plan.shapes, plan.poses, verdict))
        return None

    def _timed(self, q: Float[np.ndarray, "r 12"], way: SpatialWay | None) -> Plan:
        """Rows one control step apart, from rest to rest, within `LIMIT_SHARE` of the limits.

        Raises:
            PlanningError: There would be too many, or the arms cannot follow.
        """
        rod, limits = self.problem.rod, self.problem.grippers
        fine = subdivided(len(q), EFFORT_PIECES)
        stations, poses = rod.shapes(rows_between(rod, q, fine))
        shift = np.linalg.norm(np.diff(rod.at_keypoints(stations), axis=0), axis=2).max(1)
        effort = np.maximum(
            gripper_effort(poses, limits.max_step, limits.max_turn), shift / (KEYPOINT_STEP * limits.max_step)
        )
        if self._arms is not None and way is not None:
            effort = np.maximum(effort, self._arms.effort(self._arms.joints(poses, way), way))
        trailing = spatial_lag(rod, q) * self.task.cable.damping_time / CONTROL_STEP / self.config.lag
        effort = np.clip(np.repeat(trailing / EFFORT_PIECES, EFFORT_PIECES), effort, SLOWEST * effort)
        require_rows(effort.sum() / LIMIT_SHARE, rod.keypoints)
        ramped = replace(limits, **USUAL_RAMPS)
        poses_at = lambda places: rod.shapes(rows_between(rod, q, places))[1]  # noqa: E731
        rows = rows_between(rod, q, with_ramps(fine, effort, LIMIT_SHARE, poses_at, ramped, rod.keypoints))
        stations, poses = rod.shapes(rows)
        shapes = np.ascontiguousarray(rod.at_keypoints(stations))
        plan = Plan(shapes, continuous_poses(poses), rows)
        if self._arms is None or way is None:
            return plan
        joints = self._arms.along(plan.poses, stations, way)
        if isinstance(joints, str):
            raise PlanningError(joints)
        return replace(plan, joints=joints, metadata={"arms": way.described()})

    def _note(self, attempt: Attempt) -> None:
        if self.best is None or _faults(attempt.verdict) < _faults(self.best.verdict):
            self.best = attempt


def _faults(verdict: Verdict | None) -> int:
    return len(verdict.failures()) if verdict else 99
