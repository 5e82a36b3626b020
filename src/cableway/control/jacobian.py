"""Feedback by the derivative of the keypoints by the gripper poses: from the rod, or learned while running.

With J that derivative, s the measured keypoints, s_ref the plan's next shape and a_ref its gripper motion,

    a = a_ref + K (s_ref - s - J a_ref),      K = g (J^T J + d R)^-1 J^T,

R counting a turn of 1 rad as `turn_lever`. "rod" takes J from the equilibrium of the uniform rod nearest to the plan's
shape. "broyden" knows nothing of rods: J starts as the interpolation of the ends' rigid motions and follows what
happens,

    J <- J + r (ds - J dy) dy^T R / (dy^T R dy + e),

the rank-one update of Broyden (1965, "A class of methods for solving nonlinear simultaneous equations"), as in the
"Jacob-IK" baseline of Tang et al.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float

from cableway.control.base import Controller, Status
from cableway.control.following import FollowerState
from cableway.control.limits import span_limit
from cableway.core.checks import Checked, Choice, NotNegative, Positive
from cableway.core.deprecation import renamed_keywords
from cableway.geometry.groups import SE2
from cableway.records import Observation, Plan
from cableway.rod.inverse import fit_keypoints, motion_jacobian
from cableway.scene.task import Task

Source = Literal["rod", "broyden"]


@dataclass(frozen=True, kw_only=True)
class JacobianConfig(Checked):
    """Settings of `JacobianFeedback`; the defaults are those for the rod's derivative, `broyden()` has the other ones.

    Attributes:
        source: Where J comes from, "rod" or "broyden".
        gain: g, share of the error that one step is to remove.
        damping: d [1], against motions that move no keypoint.
        turn_lever: Motion [m] that a turn of 1 rad counts as.
        learning_rate: r, share of what was not expected that J takes on.
        least_motion: Root of e [m]: gripper motions much smaller than that teach nothing.
        max_span: Distance between the grippers over the cable's length, never exceeded unless by the plan.
        hold: Time [s] at the plan's first row before it is followed.

    Raises:
        InputError: A value is out of range.
    """

    source: Annotated[Source, Choice("source")] = "rod"
    gain: NotNegative[float] = 0.3
    damping: Positive[float] = 0.3
    turn_lever: Positive[float] = 0.05
    learning_rate: NotNegative[float] = 0.3
    least_motion: Positive[float] = 0.001
    max_span: NotNegative[float] = 0.995
    hold: NotNegative[float] = 1.5

    @classmethod
    def broyden(cls) -> JacobianConfig:
        """Settings for a learned derivative: the defaults, made for the rod's, unlearn it (`studies/tuning.py`)."""
        return cls(source="broyden", gain=0.1, damping=1.0, least_motion=0.005)


JacobianConfig.__init__ = renamed_keywords(longest="max_span")(JacobianConfig.__init__)


@dataclass(frozen=True, kw_only=True)
class JacobianState(FollowerState):
    """State of `JacobianFeedback`.

    Attributes:
        jacobian: (m, a) derivative of the keypoints by the gripper poses.
        previous: Keypoints (n, 2) and gripper poses (2, 3) of the last complete observation, None before it.
        q: (d,) rod coordinates of the plan's shape.
    """

    jacobian: Float[np.ndarray, "m a"]
    previous: tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "2 3"]] | None
    q: Float[np.ndarray, "d"]


class JacobianFeedback(Controller[JacobianState]):
    """Proportional feedback of the keypoints on top of the plan's own gripper motion.

    Args:
        config: The settings, the defaults where None.
    """

    def __init__(self, config: JacobianConfig | None = None) -> None:
        self.config = config or JacobianConfig()

    def init(self, task: Task, plan: Plan) -> JacobianState:
        """See `Controller.init`."""
        state = JacobianState(
            **FollowerState.beginning(task, plan, self.config.hold),
            jacobian=blend_jacobian(plan.shapes[0], plan.poses[0]),
            previous=None,
            q=fit_keypoints(task.cable.rod, plan.shapes[0])[0],
        )
        self.step(state, Observation(0.0, plan.shapes[0], plan.poses[0]))  # compiles what a step needs
        return state

    def step(
        self, state: JacobianState, observation: Observation | None
    ) -> tuple[Float[np.ndarray, "2 3"], JacobianState]:
        """See `Controller.step`."""
        config, state = self.config, state.looking(observation)
        if state.must_stop:
            return state.stopping()
        max_span = float(span_limit(state.plan.poses(state.index, 1), state.task.cable.length, config.max_span)[0])
        forward = state.plan.actions(state.index, 1)[0]
        if not np.isfinite(state.tracker.keypoints).all():
            return state.sending(forward, Status.UNSEEN, max_span)
        state = self._learned(state)
        back = self._feedback(state, forward)
        if not np.isfinite(back).all():
            return state.sending(forward, Status.FAILED, max_span)
        return state.sending(forward + back, Status.TRACKING, max_span)

    def _learned(self, state: JacobianState) -> JacobianState:
        """With the derivative at the plan's next shape, or updated by the last observation."""
        config, tracker = self.config, state.tracker
        now = (tracker.keypoints, tracker.at_frame)
        if config.source == "rod":
            rod = state.task.cable.rod
            q = fit_keypoints(rod, state.plan.shapes(state.index, 1)[0], state.q)[0]
            return replace(state, q=q, jacobian=motion_jacobian(rod, q), previous=now)
        jacobian = state.jacobian
        if state.previous is not None:
            change, motion = (now[0] - state.previous[0]).ravel(), SE2.minus(now[1], state.previous[1]).ravel()
            weighted = self._units * motion
            surprise = change - jacobian @ motion
            rate = config.learning_rate / (motion @ weighted + config.least_motion**2)
            jacobian = jacobian + rate * np.outer(surprise, weighted)
        return replace(state, jacobian=jacobian, previous=now)

    def _feedback(self, state: JacobianState, forward: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 3"]:
        """K (s_ref - s - J a_ref), with the motions under way counted as done."""
        tracker, jacobian = state.tracker, state.jacobian
        under_way = SE2.minus(tracker.commanded, tracker.at_frame).ravel()
        wanted = state.plan.shapes(state.index, 1)[0]
        error = (wanted - tracker.keypoints).ravel() - jacobian @ (forward.ravel() + under_way)
        normal = np.einsum("ka,kb->ab", jacobian, jacobian) + self.config.damping * np.diag(self._units)
        return self.config.gain * np.linalg.solve(normal, error @ jacobian).reshape(forward.shape)

    @property
    def _units(self) -> Float[np.ndarray, "a"]:
        """R, for both grippers."""
        lever = self.config.turn_lever
        return np.tile((lever / SE2.step_units(lever)) ** 2, 2)


def blend_jacobian(keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2*n 6"]:
    """The derivative of keypoints [m] that follow both ends' rigid motions in proportion to where they are."""
    share = np.linspace(0.0, 1.0, len(keypoints))
    shares = np.stack([1.0 - share, share], axis=1)[:, None, :, None]
    axes = np.eye(SE2.space)[:, None]
    found = shares * SE2.pulled_back(axes, keypoints[:, None, None], poses)
    return found.reshape(keypoints.size, -1)


def broyden() -> JacobianFeedback:
    """Feedback by a learned derivative, the paper's Jacob-IK."""
    return JacobianFeedback(JacobianConfig.broyden())
