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
from cableway.control.spatial_following import SpatialFollower, SpatialState, begun
from cableway.core.checks import Checked, NotNegative, Positive, Share
from cableway.geometry.groups import SE3
from cableway.records import Observation, Plan
from cableway.rod.inverse import motion_jacobian
from cableway.scene.spatial.task import SpatialTask


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


class SpatialFeedback(SpatialFollower[SpatialState]):
    """Proportional feedback of the keypoints on top of the plan's own gripper motion.

    Args:
        config: The settings, the defaults where None.
    """

    def __init__(self, config: SpatialFeedbackConfig | None = None) -> None:
        self.config = config or SpatialFeedbackConfig()
        super().__init__(self.config.hold, self.config.max_span)

    def init(self, task: SpatialTask, plan: Plan) -> SpatialState:
        """See `SpatialFollower.init`."""
        return begun(task, plan)

    def answer(
        self, state: SpatialState, observation: Observation, forward: Float[np.ndarray, "2 6"]
    ) -> tuple[Float[np.ndarray, "2 6"], SpatialState]:
        """See `SpatialFollower.answer`."""
        if not self.config.gain:
            return forward, replace(state, status=Status.UNSEEN)
        plan, rod, ahead = state.plan, state.task.rod, self.row(state, 1)
        assert plan.q is not None
        jacobian = motion_jacobian(rod, plan.q[ahead])
        under_way = SE3.minus(state.commanded, state.poses_at_frame(observation)[0])
        error = (plan.shapes[ahead] - observation.keypoints).ravel() - jacobian @ (forward + under_way).ravel()
        units = np.tile((self.config.turn_lever / SE3.step_units(self.config.turn_lever)) ** 2, 2)
        normal = jacobian.T @ jacobian + self.config.damping * np.diag(units)
        back = self.config.gain * np.linalg.solve(normal, jacobian.T @ error).reshape(2, 6)
        if not np.isfinite(back).all():
            return forward, replace(state, status=Status.FAILED)
        return forward + back, replace(state, status=Status.TRACKING)
