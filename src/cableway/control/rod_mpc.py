"""Adaptive rod MPC: the cable as an elastic rod whose parameters are estimated while it is led.

At every control step, with theta the parameters and b the output offset as estimated (`rod_estimate`), e_0 the rod's
end poses once all that was sent is done, and s_ref,k the plan's shapes:

1. *Fit.* Find the shapes q*_k of the adapted rod nearest to s_ref,k, k = 0..H, with end poses e*_k and loads l*_k. So
   the plan's gripper motion becomes one for this cable.
2. *Correct.* Find the shapes q_1..q_H, with keypoints s(q), end poses e(q) and loads l(q), that make ::

        sum_k  w_s |s(q_k) + b - s_ref,k|^2                           tracking
             + w_m |e(q_k) - e(q_{k-1}) - (e*_k - e*_{k-1})|_R^2      motion, fed forward from the fit
             + w_l |l(q_k) - l*_k|^2                                  load: away from folds, where shapes vanish
             + w_c max(0, d_k - clearance)^2                          of stations and bodies
             + w_g max(0, gap - max_span)^2 + max(0, least - gap)^2    distance between the ends
             + w_b max(0, step - largest)^2                           limits of the grippers

   least, R counting a turn of 1 rad as `turn_lever`; then lead the grippers so that the rod's ends come to e(q_1).

Every q is an equilibrium, so the model has no state of its own: a late frame is compared with the gripper
poses of its own time (`tracker`), and the cable's lag is part of b. A long cable swings about its equilibria, and
feedback that takes the swing for an error drives it: below `QUASI_STATIC` a frame counts with the fourth power of the
frequency of the first bending mode.

Note:
    Not in the paper (Tang et al.), whose MPC predicts with a network; terms and weights follow `neural_mpc`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from cableway.control import rod_kernels
from cableway.control.base import Controller, Status
from cableway.control.estimating import EstimatingState
from cableway.control.following import LEAST_RATE
from cableway.control.limits import span_limit, within_limits
from cableway.core.checks import Checked, NotNegative, Positive
from cableway.core.deprecation import renamed_keywords
from cableway.estimation.parameter_filter import MET
from cableway.estimation.rod_filter import EstimatorConfig
from cableway.motion.interpolation import rows_at
from cableway.motion.limits import BodyMeetings, BodyPoints
from cableway.motion.time_parametrization import gripper_effort
from cableway.records import Observation, Plan
from cableway.rod import kernels
from cableway.rod.fitting import fit_along, meet_ends
from cableway.rod.inverse import fit_keypoints, fit_sequence
from cableway.rod.material import ROD
from cableway.rod.planar import PlanarRod
from cableway.scene.clearance import clearances
from cableway.scene.task import Task

MOTION_WEIGHT = 3.0
"""w_m [1/m^2]; only ratios of weights count."""

LOAD_WEIGHT = 1e-7
"""w_l, for loads in units of 10 EI/L^2 and 3 EI/L."""

SPAN_WEIGHT = 100.0
"""w_g [1/m^2]."""

LIMIT_WEIGHT = 100.0
"""w_b [1/m^2]."""

SAME = 1e-6
"""Distance [m] of a keypoint up to which rod coordinates give a plan's shapes."""

SURE = 2.0
"""Standard deviations by which the estimated length must suffice before the cable is pulled farther than planned."""

MOST_EFFORT = 0.85
"""Share of the grippers' limits that the fitted motion may take; plans take 70% at most."""

SETTLING = 0.25
"""Share of a correction that is made while the estimates settle."""


@dataclass(frozen=True, kw_only=True)
class RodMPCConfig(Checked):
    """Settings of `RodMPC`. Only ratios of weights count.

    Attributes:
        horizon: H, number of actions looked ahead.
        tracking_weight: w_s [1/m^2].
        turn_lever: Motion [m] that a turn of 1 rad counts as.
        clearance_weight: w_c [1/m^2].
        threshold: d_k, clearance [m] below which obstacles cost, where the plan keeps no more.
        far: The same where the plan keeps as much or more; in between it is the plan's clearance.
        soft_span: Distance between the ends over the cable's length from where it costs; where the plan stretches the
            cable farther, the plan's distance.
        max_span: The same, never exceeded; between the grippers never more than is sure, see `_span_limit`.
        hold: Time [s] at the plan's first row before it is followed, while the estimates settle.
        estimator: Settings of the estimation.

    Raises:
        InputError: A value is out of range.
    """

    horizon: Positive[int] = 3
    tracking_weight: Positive[float] = 1.0
    turn_lever: Positive[float] = 0.05
    clearance_weight: NotNegative[float] = 30.0
    threshold: NotNegative[float] = 0.006
    far: NotNegative[float] = 0.015
    soft_span: Positive[float] = 0.985
    max_span: Positive[float] = 0.995
    hold: NotNegative[float] = 1.5
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)

    @property
    def weights(self) -> rod_kernels.Weights:
        """Of all terms."""
        return rod_kernels.Weights(
            tracking=float(self.tracking_weight), motion=MOTION_WEIGHT, turn_lever=float(self.turn_lever),
            load=LOAD_WEIGHT, clearance=float(self.clearance_weight), span=SPAN_WEIGHT, limits=LIMIT_WEIGHT,
        )  # fmt: skip


RodMPCConfig.__init__ = renamed_keywords(stretch="soft_span", longest="max_span")(RodMPCConfig.__init__)


@dataclass(frozen=True, kw_only=True)
class RodMPCState(EstimatingState):
    """State of `RodMPC`.

    Attributes:
        shapes: (T + 1, d) shapes of the task's rod nearest to the plan's rows, from which fits start: loads that
            keypoints do not determine do not run away from step to step.
        fits: (H + 1, d) what the last ones found, from which they start, too.
        clearance: (T + 1,) least clearance of the plan's rows [m].
        limits: Of grippers and cable.
        bodies: What moves with the grippers.
        meetings: What of it could meet the other gripper's or the cable.
    """

    shapes: Float[np.ndarray, "t d"]
    fits: Float[np.ndarray, "h d"]
    clearance: Float[np.ndarray, "t"]
    limits: rod_kernels.Limits
    bodies: BodyPoints
    meetings: BodyMeetings


class RodMPC(Controller[RodMPCState]):
    """Model predictive control with the rod as the model, adapted while it runs.

    Args:
        config: The settings, the defaults where None.
    """

    def __init__(self, config: RodMPCConfig | None = None) -> None:
        self.config = config or RodMPCConfig()

    def init(self, task: Task, plan: Plan) -> RodMPCState:
        """See `Controller.init`."""
        grippers, shapes = task.grippers, plan_shapes(task.cable.rod, plan)
        beginning = EstimatingState.estimating(task, plan, self.config, shapes[0])
        limits = rod_kernels.Limits(
            float(grippers.max_step), float(grippers.max_turn), float(grippers.least_span), float(task.cable.radius)
        )
        state = RodMPCState(
            **beginning, shapes=shapes, fits=rows_at(shapes, beginning["plan"].rows(0, self.config.horizon + 1)),
            clearance=self._least_clearance(plan, task), limits=limits, bodies=BodyPoints.of(task),
            meetings=BodyMeetings.of(task),
        )  # fmt: skip
        self.step(state, Observation(0.0, plan.shapes[0], plan.poses[0]))  # compiles what a step needs
        return state

    def resume(self, state: RodMPCState, task: Task, plan: Plan) -> RodMPCState:
        """See `Controller.resume`."""
        return self.init(task, plan).knowing(state)

    def in_scene(self, state: RodMPCState, task: Task) -> RodMPCState:
        """See `Controller.in_scene`."""
        task = state.task.in_scene(task.scene)
        kept = self._least_clearance(state.plan.plan, task)
        return replace(state, task=task, clearance=kept, bodies=BodyPoints.of(task))

    def _least_clearance(self, plan: Plan, task: Task) -> Float[np.ndarray, "t"]:
        """Of cable and bodies in each row of a plan [m], of what leaves a gripper only where it could be `far`."""
        return clearances(plan.shapes, plan.poses, task, self.config.far).min(axis=1)

    def step(self, state: RodMPCState, observation: Observation | None) -> tuple[Float[np.ndarray, "2 3"], RodMPCState]:
        """See `Controller.step`."""
        state = state.observing(observation)
        if state.must_stop:
            return state.stopping()
        before, state = state.estimate, state.updated()
        if state.estimate is before and not state.tracker.steps_without_keypoints:
            return state.stopping(Status.UNEXPLAINED)
        state = self._paced(state)
        action, max_span = self._solve(state), self._span_limit(state)
        if not np.isfinite(action).all():
            # as it is estimated the cable is taut already
            status = Status.UNSEEN if state.tracker.steps_without_keypoints else Status.FAILED
            return state.sending(state.plan.actions(state.index, 1)[0], status, max_span=0.0)
        if state.index < state.plan.held_steps:
            action = SETTLING * action
        return state.sending(action, state.tracking_status, max_span)

    def _span_limit(self, state: RodMPCState) -> float:
        """Largest distance [m] between the grippers: the plan's, `max_span` of the nominal length, or what is sure.

        Sure is `max_span` of the estimated length, with the estimated grasps, less `SURE` standard deviations;
        nothing is while the estimates settle. A cable that lies almost straight is not pulled taut by what the first
        frames suggest.
        """
        share, commanded = self.config.max_span, state.tracker.commanded
        planned = float(span_limit(state.plan.poses(state.index, 1), state.task.cable.length, share)[0])
        if state.index < state.plan.held_steps:
            return planned
        slack, deviation = state.estimator.slack(state.estimate, commanded)
        left, right = state.task.cable.rod.group.position(commanded)
        span = float(np.linalg.norm(right - left))
        return max(planned, span + slack - (1 - share) * state.estimate.length - SURE * deviation)

    def _paced(self, state: RodMPCState) -> RodMPCState:
        """With the next fits, and slower than the plan where those ask the grippers for more than they can.

        The estimated cable may need other motions than the plan's, most where it is about to snap.
        """
        whole = self._fitted(replace(state, rate=1.0))
        effort = self._effort(whole)
        if state.index < state.plan.held_steps or effort <= MOST_EFFORT:
            return whole
        return self._fitted(replace(state, rate=max(LEAST_RATE, MOST_EFFORT / effort)))

    def _effort(self, state: RodMPCState) -> float:
        """Share of the grippers' limits that the motion from fit to fit takes."""
        limits = state.task.grippers
        ends = kernels.batch_shapes(state.fits, state.estimate.theta[ROD], state.estimator.modes, 0)[2]
        return float(gripper_effort(ends, limits.max_step, limits.max_turn).max())

    def _fitted(self, state: RodMPCState) -> RodMPCState:
        """With the estimated rod's shapes nearest to the plan's next ones."""
        estimator, rows = state.estimator, state.plan.rows(state.index, self.config.horizon + 1, state.rate)
        wanted, p = rows_at(state.plan.plan.shapes, rows), state.estimate.theta[ROD]
        near = rows_at(state.shapes, rows)
        fits = fit_along(near, state.fits[1], wanted, p, estimator.modes, estimator.rod.stride)
        return replace(state, fits=fits)

    def _solve(self, state: RodMPCState) -> Float[np.ndarray, "2 3"]:
        """The next gripper motion; NaN where the estimated rod cannot be held as the grippers will be."""
        config, estimator, estimate, fits = self.config, state.estimator, state.estimate, state.fits
        rod, modes, p = estimator.rod, estimator.modes, estimate.theta[ROD]
        rows = state.plan.rows(state.index, len(fits), state.rate)
        wanted, ends = rows_at(state.plan.plan.shapes, rows), kernels.batch_shapes(fits, p, modes, 0)[2]
        commanded = state.tracker.commanded
        before = rod.group.compose(commanded, estimate.grasps)
        clearance = np.clip(rows_at(state.clearance, rows[1:]), config.threshold, max(config.threshold, config.far))
        now = estimate.q.copy()
        if meet_ends(now, before, p, modes) > MET:
            return np.full(rod.step_shape, np.nan)
        q = rod.retract(now, rod.difference(fits[0], fits[1:]))
        horizon = rod_kernels.Wanted(
            shapes=wanted[1:].copy(),
            steps=rod.group.minus(ends[1:], ends[:-1]),
            loads=fits[1:, rod.loads].copy(),
            max_span=span_limit(ends[1:], estimate.length, config.soft_span),
            clearance=clearance,
        )
        rod_kernels.optimize(
            q, before, p, modes, rod.stride, rod.at_stations(estimate.offset), horizon, state.bodies,
            state.meetings, state.task.scene.world.arrays, state.limits, config.weights,
        )  # fmt: skip
        reached = kernels.batch_shapes(q[:1], p, modes, 0)[2]
        farthest = float(span_limit(ends[1:2], estimate.length, config.max_span)[0])
        moved = within_limits(rod.group.minus(reached[0], before), before, state.task.grippers, farthest)
        grippers = rod.group.compose(rod.group.plus(before, moved), rod.group.inverse(estimate.grasps))
        return rod.group.minus(grippers, commanded)


def plan_shapes(rod: PlanarRod, plan: Plan) -> Float[np.ndarray, "t 6"]:
    """Rod coordinates of a plan's rows, running on from row to row, turned on with its gripper poses.

    The plan's own where they are shapes of this rod, to `SAME`; otherwise each row is fitted. The last row need not be
    one: a plan may end at a goal that the rod only comes near to.
    """
    q = plan.q
    if q is None or np.abs((rod.at_keypoints(rod.shapes(q)[0]) - plan.shapes)[:-1]).max(initial=0.0) > SAME:
        first = fit_keypoints(rod, plan.shapes[0])[0]
        q = np.vstack([first, fit_sequence(rod, plan.shapes[1:], first)])
    return np.array([rod.continued(row, poses) for row, poses in zip(q, plan.poses, strict=True)])
