"""Projection of a sequence of keypoint shapes to equilibria of the rod, and its time parametrisation.

Each shape is replaced by the nearest equilibrium, the trajectory is optimised, and then stepped so that no row
asks more of the grippers than one control step allows.

Note:
    Not in the paper (Tang et al.), whose planned shapes are tracked as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, Checked, Choice
from cableway.core.deprecation import renamed, renamed_keywords
from cableway.core.errors import PlanningError
from cableway.core.quantities import limit_text, told_apart
from cableway.geometry import polyline
from cableway.geometry.groups import SE2
from cableway.motion.interpolation import evenly_moved, rows_at, subdivided
from cableway.motion.time_parametrization import at_equal_effort, gripper_effort, require_rows, with_ramps
from cableway.motion.validity import gripper_spans
from cableway.planning.trajectory_optimization import TrajectoryOptimizationConfig, optimize_trajectory
from cableway.robot.branches import SINGULAR
from cableway.robot.cell_kinematics import CellKinematics
from cableway.rod import inverse
from cableway.rod.lag import lag
from cableway.rod.planar import PlanarRod
from cableway.scene.checks import quantities
from cableway.scene.grippers import Grippers
from cableway.scene.task import CONTROL_STEP, Task

Kind = Literal["replan", "optimize", "fit", "none"]

EFFORT_PIECES = 8
"""Parts of a row between which effort is measured."""

MOST_LAG = 0.05
"""What counts of the lag of one row, at a step as long as tau [m]: shapes about to snap would ask for any time."""

LIMIT_SHARE = 0.7
"""Share of the gripper limits, and of `ProjectionConfig.lag`, that a plan uses; the rest is left to the controller."""

USUAL_RAMPS = {"max_acceleration": 0.5, "max_turn_acceleration": 5.0, "max_jerk": 5.0, "max_turn_jerk": 50.0}
"""Limits [m/s², rad/s², m/s³, rad/s³] that a collaborative robot takes easily, for plans of tasks that have none."""

LEAST_PACE = 0.25
"""Share of the grippers' largest step that a cable without slack leaves them."""

KEYPOINT_STEP = 1.5
"""Largest move of any keypoint in a control step, in units of the grippers' largest step."""


@dataclass(frozen=True, kw_only=True)
class ProjectionConfig(Checked):
    """How a sequence of shapes becomes one that the cable takes.

    Attributes:
        kind: "replan": nearest equilibria, optimised, and where that does not verify, replanned locally and
            optimised again; "optimize": optimised; "fit": nearest equilibria; "none": the shapes as they are, the
            grippers along the tangents at their ends, as in the paper.
        optimization: Weights of the trajectory optimisation.
        row_step: Largest move of a keypoint between rows during the optimisation [m].
        lag: Largest distance [m] by which a cable of `damping_time` may trail behind its equilibria.
        damping_time: tau [s] of that cable.
        fit_tolerance: Stacked distance [m] from start or goal to the nearest equilibrium above which there is no plan.
    """

    kind: Annotated[Kind, Choice("projection")] = "replan"
    optimization: TrajectoryOptimizationConfig = field(default_factory=TrajectoryOptimizationConfig)
    row_step: Annotated[float, Bounds(1e-4, 1)] = 0.012
    lag: Annotated[float, Bounds(1e-5, 1)] = 0.005
    damping_time: Annotated[float, Bounds(0, 10)] = 0.2
    fit_tolerance: Annotated[float, Bounds(0, 1)] = 0.01


ProjectionConfig.__init__ = renamed_keywords(refinement="optimization")(ProjectionConfig.__init__)


@dataclass(frozen=True)
class ProjectedTrajectory:
    """Shapes and the gripper poses that go with them, one row per control step.

    Attributes:
        shapes: (T+1, n, 2) keypoints [m].
        poses: (T+1, 2, 3) gripper poses [m, m, rad].
        places: (T+1,) fractional rows 0.. of the initial trajectory from which they come.
        q: (T+1, dof) rod coordinates; None where the shapes are no equilibria.
        nodes: (R+1, dof) rod coordinates before the time parametrisation, or None.
        node_places: (R+1,) their places in the initial trajectory.
    """

    shapes: Float[np.ndarray, "t n 2"]
    poses: Float[np.ndarray, "t 2 3"]
    places: Float[np.ndarray, "t"]
    q: Float[np.ndarray, "t dof"] | None = None
    nodes: Float[np.ndarray, "r dof"] | None = None
    node_places: Float[np.ndarray, "r"] | None = None


def project(
    shapes: Float[np.ndarray, "r n 2"],
    task: Task,
    config: ProjectionConfig,
    progress: Callable[[float], None] = lambda _: None,
) -> ProjectedTrajectory:
    """Project a sequence to equilibria: fit, optimise, step.

    Args:
        shapes: From start to goal [m], in general not equilibria.
        task: The task.
        config: Configuration.
        progress: Called with the share of the optimisation that is done; it may raise to stop.

    Raises:
        PlanningError: Start or goal is too far from any shape of the cable.
    """
    if config.kind == "none":
        return _as_it_is(shapes, task, config)
    q, places = fit_sequence(task.cable.rod, shapes, *end_equilibria(task, config), config.row_step)
    if config.kind != "fit":
        q = optimize_trajectory(q, task, config.optimization, progress)
    return stepped(q, places, task, config)


def stepped(
    nodes: Float[np.ndarray, "r dof"],
    node_places: Float[np.ndarray, "r"],
    task: Task,
    config: ProjectionConfig,
) -> ProjectedTrajectory:
    """Equilibria with a time parametrisation; `node_places` are their places in the initial trajectory."""
    rod = task.cable.rod
    q, at = step_evenly(nodes, task, config)
    stations, poses = rod.shapes(q)
    places = np.interp(at, np.arange(len(node_places)), node_places)
    shapes = np.ascontiguousarray(rod.at_keypoints(stations))
    return ProjectedTrajectory(shapes, poses, places, q, nodes, node_places)


def _as_it_is(shapes: Float[np.ndarray, "r n 2"], task: Task, config: ProjectionConfig) -> ProjectedTrajectory:
    """Shapes straight between those given, with the poses that the tangents at their ends give.

    Rows are at equal effort, or with ramps where the task limits acceleration or jerk.
    """
    at = subdivided(len(shapes), EFFORT_PIECES)
    fine = rows_at(shapes, at)
    effort = _effort(fine, _tangent_poses(fine), task, config)
    require_rows(effort.sum() / LIMIT_SHARE, task.cable.keypoints)
    if task.grippers.has_ramps:
        at = with_ramps(at, effort, LIMIT_SHARE, lambda where: _tangent_poses(rows_at(shapes, where)), task.grippers)
    else:
        at = at_equal_effort(at, effort, LIMIT_SHARE)
    fine = rows_at(shapes, at)
    return ProjectedTrajectory(fine, _tangent_poses(fine), at)


def _tangent_poses(shapes: Float[np.ndarray, "t n 2"]) -> Float[np.ndarray, "t 2 3"]:
    """Poses of grippers that hold the ends of keypoint shapes, angles without jumps."""
    fine = polyline.spline(shapes, 16)
    first, last = fine[:, 1] - fine[:, 0], fine[:, -1] - fine[:, -2]
    angles = np.unwrap(np.stack([np.arctan2(step[:, 1], step[:, 0]) for step in (first, last)], axis=1), axis=0)
    return np.concatenate([shapes[:, [0, -1]], angles[..., None]], axis=2)


def end_equilibria(task: Task, config: ProjectionConfig) -> tuple[Float[np.ndarray, "dof"], Float[np.ndarray, "dof"]]:
    """The equilibria nearest to start and goal.

    Raises:
        PlanningError: One of them is farther than `config.fit_tolerance` from its shape.
    """
    for name, distance in zip(("start", "goal"), task.equilibrium_distances, strict=True):
        if distance > config.fit_tolerance:
            raise PlanningError(
                f"the {name} is not an equilibrium of the cable: the nearest equilibrium is "
                f"{told_apart(distance, config.fit_tolerance)} away (stacked), more than "
                f"{limit_text(config.fit_tolerance)}"
            )
    return task.start_equilibrium, task.goal_equilibrium


def fit_sequence(
    rod: PlanarRod,
    shapes: Float[np.ndarray, "T+1 n 2"],
    start: Float[np.ndarray, "dof"],
    goal: Float[np.ndarray, "dof"],
    row_step: float,
) -> tuple[Float[np.ndarray, "R+1 dof"], Float[np.ndarray, "R+1"]]:
    """The nearest equilibrium of each shape, resampled so that keypoints move at most about `row_step` [m] a row.

    Returns:
        q (R+1, dof), from `start` to `goal` with angles that run on, and for each row its place 0..T in `shapes`.
    """
    q = np.vstack([start, inverse.fit_sequence(rod, shapes[1:-1], start), goal])
    angle, loads = rod.group.space, rod.loads
    q[:, angle] = np.unwrap(q[:, angle])
    q[:, loads] = np.clip(q[:, loads], -60.0, 60.0)
    q[0, loads], q[-1, loads] = start[loads], goal[loads]
    rows = evenly_moved(rod, q, row_step)
    return rows_at(q, rows), rows


def step_evenly(
    q: Float[np.ndarray, "T+1 dof"], task: Task, config: ProjectionConfig
) -> tuple[Float[np.ndarray, "K+1 dof"], Float[np.ndarray, "K+1"]]:
    """The same polyline in q with rows none of which asks more than `LIMIT_SHARE` of the limits.

    The motion begins and ends at rest, see `_with_ramps`. Of arms that hold the cable, so do the joints.

    Returns:
        q (K+1, dof) and the fractional index of each row in the q given.
    """
    rod = task.cable.rod
    fine = subdivided(len(q), EFFORT_PIECES)
    stations, poses = rod.shapes(rows_at(q, fine))
    trailing = np.minimum(lag(rod, q), MOST_LAG) * config.damping_time / CONTROL_STEP / config.lag
    effort = _effort(rod.at_keypoints(stations), poses, task, config)
    effort = np.max([effort, np.repeat(trailing / EFFORT_PIECES, EFFORT_PIECES), _slack_effort(poses, task)], axis=0)
    grippers = _with_ramps(task)
    poses_at = lambda places: rod.shapes(rows_at(q, places))[1]  # noqa: E731
    at = with_ramps(fine, effort, LIMIT_SHARE, poses_at, grippers, task.cable.keypoints, _arms(poses, task))
    return rows_at(q, at), at


def _arms(poses: Float[np.ndarray, "f 2 3"], task: Task) -> CellKinematics | None:
    """The arms that hold the cable, where it is known how, and they can do so all along; else other checks say why."""
    if task.cell is None or task.cell.way is None:
        return None
    arms = CellKinematics(task, task.cell.way)
    return arms if arms.held(poses, np.zeros((2, 6)))[1].min() >= SINGULAR else None


def _with_ramps(task: Task) -> Grippers:
    """The grippers, with `USUAL_RAMPS` where the task limits neither acceleration nor jerk.

    A cable that swings is brought to full speed in one period of its first mode: what a constant acceleration begins
    to swing it ends after a whole period (Singer and Seering 1990, "Preshaping command inputs to reduce system
    vibration", with a ramp for the impulses).
    """
    grippers = task.grippers if task.grippers.has_ramps else replace(task.grippers, **USUAL_RAMPS)
    if not (period := task.cable.swing_period):
        return grippers
    slower = {}
    for name, most in (("max_acceleration", grippers.max_step), ("max_turn_acceleration", grippers.max_turn)):
        least = quantities(Grippers)[name].least
        slower[name] = min(getattr(grippers, name) or np.inf, max(most / CONTROL_STEP / period, least))
    return replace(grippers, **slower)


def _effort(
    shapes: Float[np.ndarray, "f n 2"], poses: Float[np.ndarray, "f 2 3"], task: Task, config: ProjectionConfig
) -> Float[np.ndarray, "f-1"]:
    """Largest of gripper move, gripper turn and keypoint move between shapes, each over its limit."""
    limits = task.grippers
    shift = np.linalg.norm(np.diff(shapes, axis=0), axis=2).max(1)
    moved = gripper_effort(poses, limits.max_step, limits.max_turn)
    return np.maximum(moved, shift / (KEYPOINT_STEP * limits.max_step))


def _slack_effort(poses: Float[np.ndarray, "f 2 3"], task: Task) -> Float[np.ndarray, "f-1"]:
    """How far a gripper goes away from the other over the cable's slack, which that uses up if the other one stalls."""
    at, span = SE2.position(poses), gripper_spans(poses)
    along = np.sum(np.diff(at, axis=0) * ((at[:, 1] - at[:, 0]) / span[:, None])[:-1, None], axis=2)
    slack = task.cable.length - np.maximum(span[1:], span[:-1])
    return np.maximum(-along[:, 0], along[:, 1]) / np.maximum(slack, LEAST_PACE * task.grippers.max_step)


__getattr__ = renamed(
    __name__, {"RealizationConfig": "ProjectionConfig", "RealizedSequence": "ProjectedTrajectory", "realize": "project"}
)
