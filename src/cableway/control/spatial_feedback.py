"""Feedback in space by the derivative of the keypoints by the gripper poses, as `control.jacobian` has it in the plane.

With J that derivative at the plan's next shape, s the keypoints seen, s_ref that shape and a_ref the plan's motion,

    a = a_ref + g (J^T J + d R)^-1 J^T (s_ref - s - J (a_ref + u)),

where u is what the grippers have moved, or been sent, since the frame was taken, and R counts a turn of 1 rad as
`turn_lever`. J is that of the nominal rod, weight included; nothing is estimated of the cable.

Note:
    Not in the paper (Tang et al.), whose cables lie on a table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cableway.control.base import Status
from cableway.core.checks import Checked, NotNegative, Positive, Share
from cableway.core.errors import InputError
from cableway.geometry.groups import SE3
from cableway.records import Observation, Plan
from cableway.rod.inverse import motion_jacobian
from cableway.scene.spatial.grippers import SpatialGrippers
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP

ROUNDING = 1.0 - 1e-9
"""Factor on the limits, so that rounding in the sums of poses does not exceed them."""

REMEMBERED = 100
"""Poses of the grippers that are kept: frames later than so many control steps are not used."""

BLIND_STEPS = 10
"""Control steps in a row without keypoints after which the grippers stop."""


@dataclass(frozen=True, kw_only=True)
class SpatialFeedbackConfig(Checked):
    """Settings of `SpatialFeedback`.

    Attributes:
        gain: g, share of the error that one step is to remove; 0 leads the plan's motion open loop.
        damping: d, against motions that move no keypoint.
        turn_lever: Motion [m] that a turn of 1 rad counts as.
        max_span: Distance between the grippers over the cable's length, never exceeded unless by the plan.
        hold: Time [s] at the plan's first row before it is followed.

    Raises:
        InputError: A value is out of range.
    """

    gain: NotNegative[float] = 0.2
    damping: Positive[float] = 0.3
    turn_lever: Positive[float] = 0.05
    max_span: Share = 0.985
    hold: NotNegative[float] = 1.5


@dataclass(frozen=True, kw_only=True)
class SpatialState:
    """State of `SpatialFeedback`.

    Attributes:
        task: The task.
        plan: The plan.
        steps: Control steps made.
        commanded: Gripper poses asked for so far.
        seen: Times [s] and gripper poses reported then, newest last.
        blind: Control steps since keypoints were last seen.
        status: How the last action came about.
    """

    task: SpatialTask
    plan: Plan
    steps: int
    commanded: Float[np.ndarray, "2 7"]
    seen: tuple[tuple[float, Float[np.ndarray, "2 7"]], ...] = ()
    blind: int = 0
    status: str = Status.STARTED


class SpatialFeedback:
    """Proportional feedback of the keypoints on top of the plan's own gripper motion.

    Args:
        config: The settings, the defaults where None.
    """

    def __init__(self, config: SpatialFeedbackConfig | None = None) -> None:
        self.config = config or SpatialFeedbackConfig()

    def init(self, task: SpatialTask, plan: Plan) -> SpatialState:
        """The state before the first step.

        Raises:
            InputError: The plan has no rod coordinates, or another number of keypoints than the task.
        """
        if plan.q is None or plan.q.shape[1] != task.rod.dof:
            raise InputError("a plan in space must have the rod coordinates of its shapes")
        if plan.shapes.shape[1] != task.cable.keypoints:
            raise InputError(f"the plan has {plan.shapes.shape[1]} keypoints, the task {task.cable.keypoints}")
        return SpatialState(task=task, plan=plan, steps=0, commanded=plan.poses[0])

    def row(self, state: SpatialState, ahead: int = 0) -> int:
        """Row of the plan that is the reference after so many steps more."""
        begun = state.steps + ahead - round(self.config.hold / CONTROL_STEP)
        return min(max(begun, 0), state.plan.steps)

    def step(self, state: SpatialState, observation: Observation) -> tuple[Float[np.ndarray, "2 6"], SpatialState]:
        """The next action [m, rad], within the grippers' limits, and the state after it."""
        state, plan = self._looking(state, observation), state.plan
        here, ahead = self.row(state), self.row(state, 1)
        action, status = SE3.minus(plan.poses[ahead], plan.poses[here]), Status.UNSEEN
        if state.blind > BLIND_STEPS or not np.isfinite(observation.poses).all():
            action, status = np.zeros_like(action), Status.STOPPED
        elif not state.blind and self.config.gain:
            back = self._feedback(state, observation, action, ahead)
            action, status = (action + back, Status.TRACKING) if np.isfinite(back).all() else (action, Status.FAILED)
        span = np.linalg.norm(plan.poses[ahead, 1, :3] - plan.poses[ahead, 0, :3])
        most = max(float(span), self.config.max_span * state.task.cable.length)
        action = within_limits(action, state.commanded, state.task.grippers, most)
        commanded = SE3.plus(state.commanded, action)
        return action, replace(state, steps=state.steps + 1, commanded=commanded, status=status)

    def _looking(self, state: SpatialState, observation: Observation) -> SpatialState:
        there = np.isfinite(observation.keypoints).all()
        seen = (*state.seen[1 - REMEMBERED :], (observation.time, observation.poses))
        return replace(state, seen=seen, blind=0 if there else state.blind + 1)

    def _feedback(
        self, state: SpatialState, observation: Observation, forward: Float[np.ndarray, "2 6"], row: int
    ) -> Float[np.ndarray, "2 6"]:
        """g (J^T J + d R)^-1 J^T (s_ref - s - J (a_ref + u))."""
        plan, rod = state.plan, state.task.rod
        assert plan.q is not None
        jacobian = motion_jacobian(rod, plan.q[row])
        taken = observation.time if observation.taken is None else observation.taken
        _, then = min(state.seen, key=lambda each: abs(each[0] - taken))
        under_way = SE3.minus(state.commanded, then)
        error = (plan.shapes[row] - observation.keypoints).ravel() - jacobian @ (forward + under_way).ravel()
        units = np.tile((self.config.turn_lever / SE3.step_units(self.config.turn_lever)) ** 2, 2)
        normal = jacobian.T @ jacobian + self.config.damping * np.diag(units)
        return self.config.gain * np.linalg.solve(normal, jacobian.T @ error).reshape(2, 6)


def within_limits(
    action: Float[np.ndarray, "2 6"], poses: Float[np.ndarray, "2 7"], grippers: SpatialGrippers, max_span: float
) -> Float[np.ndarray, "2 6"]:
    """The action made safe: no step or turn beyond the grippers' limits, no pulling apart beyond `max_span` [m].

    Where the grippers would come farther apart, what they do relative to each other is left out; an action that is not
    finite becomes standing still.
    """
    if not np.isfinite(action).all():
        return np.zeros_like(action)
    moves, turns = (
        part * np.minimum(1.0, ROUNDING * most / np.maximum(np.linalg.norm(part, axis=1, keepdims=True), 1e-30))
        for part, most in ((action[:, :3], grippers.max_step), (action[:, 3:], grippers.max_turn))
    )
    apart, change = poses[1, :3] - poses[0, :3], moves[1] - moves[0]
    if np.linalg.norm(apart + change) > max(max_span, float(np.linalg.norm(apart))):
        moves = np.tile(moves.mean(axis=0), (2, 1))
    return np.concatenate([moves, turns], axis=1)
