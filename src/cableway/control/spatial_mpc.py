"""Adaptive rod MPC in space: `cableway.control.rod_mpc` for the twelve numbers.

With theta the parameters and b the output offset as estimated (`cableway.estimation.spatial_filter`), q_0 the adapted
rod's shape once all that was sent is done, e(q) its end poses and s(q) its keypoints, the shapes q_1..q_H make ::

    sum_k  |s(q_k) + b - s_ref,k|^2 / v^2                         tracking
         + |e(q_k) - e(q_{k-1}) - (e_ref,k - e_ref,k-1)|_R^2 / u^2   motion, fed forward from the plan
         + |turn of the ends from the plan's|^2 / r^2             how the cable is rolled, which keypoints do not say
         + |l(q_k) - l_ref,k|^2 / h^2                             loads: away from folds, where shapes vanish
         + the shortfalls of `cableway.motion.spatial_terms`

least: of clearance of cable and bodies, of stability, and of the distances of the cable from itself and from hands.
R counts a turn of 1 rad as `turn_lever`. The grippers are led so that the rod's ends come to e(q_1). Where the rod as
it is estimated cannot be held as the grippers hold the cable, the action is that of `SpatialFeedback`.

Note:
    Not in the paper (Tang et al.), whose cables lie on a table. Unlike in the plane the plan's own motion is fed
    forward, not that of shapes fitted to it: a fit would need the roll, which the plan has for another cable.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from cableway.control.base import Status
from cableway.control.spatial_feedback import SpatialFeedback, SpatialFeedbackConfig
from cableway.control.spatial_following import SpatialFollower, SpatialState, begun
from cableway.core.checks import Checked, NotNegative, Positive, Share
from cableway.estimation.spatial_filter import SpatialEstimate, SpatialEstimator, SpatialEstimatorConfig
from cableway.geometry.groups import SE3
from cableway.motion.banded_least_squares import Normal, levenberg_marquardt
from cableway.motion.limits import SoftLimits
from cableway.motion.spatial import SpatialProblem
from cableway.motion.spatial_terms import SpatialTerms
from cableway.motion.terms import TENSION
from cableway.records import Estimate, Observation, Plan
from cableway.rod.inverse import meet_poses
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP

TRACKING_SCALE = 0.005
"""v [m]."""

MOTION_SCALE = 0.003
"""u [m]."""

TURN_SCALE = 0.2
"""r [rad]."""

LOAD_SCALE = 16.0
"""h, of loads in their units."""

ITERATIONS, TOLERANCE = 6, 1e-2
"""Most steps of one optimisation, which goes on from the plan, and the fall of the cost that is worth another."""

SETTLING = 0.25
"""Share of a correction that is made while the estimates settle."""

ALL_BUT_FIRST = slice(1, None)


@dataclass(frozen=True, kw_only=True)
class SpatialMPCConfig(Checked):
    """Settings of `SpatialMPC`.

    Attributes:
        horizon: H, number of actions looked ahead.
        turn_lever: Motion [m] that a turn of 1 rad counts as.
        clearance: Of cable and bodies, below which it costs [m].
        stability: Stability margin below which it costs.
        max_span: Distance between the grippers over the cable's length, never exceeded unless by the plan.
        hold: Time [s] at the plan's first row before it is followed, while the estimates settle.
        estimator: Settings of the estimation.

    Raises:
        InputError: A value is out of range.
    """

    horizon: Positive[int] = 3
    turn_lever: Positive[float] = 0.05
    clearance: NotNegative[float] = 0.006
    stability: NotNegative[float] = 15.0
    max_span: Share = 0.985
    hold: NotNegative[float] = 1.5
    estimator: SpatialEstimatorConfig = field(default_factory=SpatialEstimatorConfig)


@dataclass(frozen=True, kw_only=True)
class SpatialMPCState(SpatialState):
    """State of `SpatialMPC`.

    Attributes:
        estimator: Of the rod's parameters.
        estimate: The present one.
    """

    estimator: SpatialEstimator
    estimate: SpatialEstimate

    def estimates(self) -> Mapping[str, Estimate]:
        """See `SpatialState.estimates`."""
        return self.estimator.estimates(self.estimate)


class SpatialMPC(SpatialFollower[SpatialMPCState]):
    """Model predictive control with the rod in space as the model, adapted while it runs.

    Args:
        config: The settings, the defaults where None.
    """

    def __init__(self, config: SpatialMPCConfig | None = None) -> None:
        self.config = config or SpatialMPCConfig()
        super().__init__(self.config.hold, self.config.max_span)
        self._nominal = SpatialFeedback(SpatialFeedbackConfig(hold=self.config.hold, max_span=self.config.max_span))

    def init(self, task: SpatialTask, plan: Plan) -> SpatialMPCState:
        """See `SpatialFollower.init`."""
        common = begun(task, plan)
        assert plan.q is not None
        estimator = SpatialEstimator(task.rod, self.config.estimator, CONTROL_STEP)
        state = SpatialMPCState(**vars(common), estimator=estimator, estimate=estimator.start(plan.q[0]))
        self.step(state, Observation(0.0, plan.shapes[0], plan.poses[0]))  # compiles what a step needs
        return state

    def answer(
        self, state: SpatialMPCState, observation: Observation, forward: Float[np.ndarray, "2 6"]
    ) -> tuple[Float[np.ndarray, "2 6"], SpatialMPCState]:
        """See `SpatialFollower.answer`."""
        then, before = state.poses_at_frame(observation)
        speed = float(np.linalg.norm(then[:, :3] - before[:, :3], axis=1).max())
        estimate = state.estimator.update(state.estimate, observation.keypoints, then, speed, observation.confidence)
        learned = estimate is not state.estimate
        state = replace(state, estimate=estimate, status=Status.TRACKING)
        action = self._solved(state) if learned else None
        if action is None:
            action, _ = self._nominal.answer(state, observation, forward)
            return action, replace(state, status=Status.NOMINAL)
        return (SETTLING * action if state.steps < self._held_steps else action), state

    def _solved(self, state: SpatialMPCState) -> Float[np.ndarray, "2 6"] | None:
        """The next gripper motion; None where the estimated rod cannot be held as the grippers will be."""
        estimate, plan, config = state.estimate, state.plan, self.config
        rod, grasps = state.estimator.adapted(estimate.theta), estimate.grasps
        now = meet_poses(rod, SE3.compose(state.commanded, grasps), estimate.q[None])
        if not len(now):
            return None
        rows = np.array([self.row(state, ahead) for ahead in range(config.horizon + 1)])
        assert plan.q is not None
        reference = plan.q[rows]
        q = np.concatenate([now, rod.retract(now, rod.difference(reference[0], reference[1:]))])
        problem = replace(state.problem, rod=rod)
        cost = _Horizon(problem, config, plan.shapes[rows], plan.poses[rows], reference, estimate.offset)
        q = levenberg_marquardt(q, cost, ITERATIONS, TOLERANCE, free=ALL_BUT_FIRST)
        grippers = SE3.compose(rod.end_poses(q[1:2])[0], SE3.inverse(grasps))
        action = SE3.minus(grippers, state.commanded)
        return action if np.isfinite(action).all() else None


class _Horizon:
    """The cost of the shapes of a horizon, of which the first stays.

    Args:
        problem: With the adapted rod.
        config: The settings.
        shapes: (H+1, n, 3) keypoints of the plan [m].
        poses: (H+1, 2, 7) its gripper poses.
        q: (H+1, 12) its rod coordinates.
        offset: (n, 3) of the keypoints [m].
    """

    def __init__(
        self, problem: SpatialProblem, config: SpatialMPCConfig, shapes: Float[np.ndarray, "H n 3"],
        poses: Float[np.ndarray, "H 2 7"], q: Float[np.ndarray, "H 12"], offset: Float[np.ndarray, "n 3"],
    ) -> None:  # fmt: skip
        self.rod = rod = problem.rod
        self._wanted, self._poses, self._steps = shapes - offset, poses, SE3.minus(poses[1:], poses[:-1])
        self._loads, self._load_units = q[:, rod.loads], LOAD_SCALE * rod.units[rod.loads]
        units = SE3.step_units(config.turn_lever)
        self._motion_scale = MOTION_SCALE * units / config.turn_lever
        soft = SoftLimits(
            margin=config.clearance, room=config.clearance, stability_wanted=config.stability,
            span_wanted=config.max_span, separation_margin=0.0, bend_share=1.0,
        )  # fmt: skip
        self._terms = SpatialTerms(problem, soft, 1.0, max(TENSION, float(q[:, rod.loads.start].max())))
        self._offset = rod.at_stations(offset)

    def cost(self, q: Float[np.ndarray, "H 12"]) -> float:
        """The cost alone, for trial steps."""
        if not np.isfinite(q).all():
            return np.inf
        stations, poses = self.rod.shapes(q)
        residuals = self._terms.residuals(q, stations + self._offset, None, poses, None)
        values = [self._tracking(stations), self._motion(poses), self._roll(poses), self._pull(q)]
        return float(sum(0.5 * np.sum(value**2) for value in (*values, *(value for value, _ in residuals))))

    def linearise(self, q: Float[np.ndarray, "H 12"]) -> Normal:
        """Cost, gradient and Gauss-Newton blocks at q, by steps of q."""
        rows, dof = q.shape
        stations, dstations, poses, dposes = self.rod.jacobians(q)
        by_keypoints = self.rod.at_keypoints(dstations).reshape(rows, -1, dof) / TRACKING_SCALE
        by_turns = dposes[:, :, 3:].reshape(rows, -1, dof) / TURN_SCALE
        by_loads = np.zeros((rows, self._loads.shape[1], dof))
        by_loads[:, :, self.rod.loads] = np.diag(1 / self._load_units)
        residuals = [
            (self._tracking(stations), by_keypoints),
            (self._roll(poses), by_turns),
            (self._pull(q), by_loads),
            *self._terms.residuals(q, stations + self._offset, dstations, poses, dposes),
        ]
        cost, gradient, diagonal = 0.0, np.zeros((rows, dof)), np.zeros((rows, dof, dof))
        for value, slopes in residuals:
            cost += 0.5 * np.sum(value**2)
            gradient += np.einsum("tsi,ts->ti", slopes, value)
            diagonal += np.matmul(slopes.transpose(0, 2, 1), slopes)
        motion = self._motion(poses)
        by_ends = dposes.reshape(rows, -1, dof) / np.tile(self._motion_scale, 2)[:, None]
        later, earlier = by_ends[1:], by_ends[:-1]
        cost += 0.5 * np.sum(motion**2)
        gradient[1:] += np.einsum("tsi,ts->ti", later, motion)
        gradient[:-1] -= np.einsum("tsi,ts->ti", earlier, motion)
        diagonal[1:] += np.matmul(later.transpose(0, 2, 1), later)
        diagonal[:-1] += np.matmul(earlier.transpose(0, 2, 1), earlier)
        above = -np.matmul(earlier.transpose(0, 2, 1), later)
        return Normal(float(cost), gradient, (diagonal, above, np.zeros((max(0, rows - 2), dof, dof))))

    def _tracking(self, stations: Float[np.ndarray, "H s 3"]) -> Float[np.ndarray, "H k"]:
        off = self.rod.at_keypoints(stations) - self._wanted
        return off.reshape(len(off), -1) / TRACKING_SCALE

    def _motion(self, poses: Float[np.ndarray, "H 2 7"]) -> Float[np.ndarray, "h k"]:
        off = (SE3.minus(poses[1:], poses[:-1]) - self._steps) / self._motion_scale
        return off.reshape(len(off), -1)

    def _roll(self, poses: Float[np.ndarray, "H 2 7"]) -> Float[np.ndarray, "H k"]:
        off = SE3.minus(poses, self._poses)[..., 3:]
        return off.reshape(len(off), -1) / TURN_SCALE

    def _pull(self, q: Float[np.ndarray, "H 12"]) -> Float[np.ndarray, "H 6"]:
        return (q[:, self.rod.loads] - self._loads) / self._load_units
