"""Inserting a plug into its port: hold before it until the plug is aligned, then go straight.

The plug is fixed to the cable's end, and both are held askew by an unknown grasp g (`cableway.rod.material`), which
cannot be observed at the plug. While the grippers hold, g is estimated from the shape of the whole cable, and the right
gripper is brought by small steps to the pose bearing(x_0, g) at which the plug is where the plan has it. Then
both grippers make the plan's motions and nothing else: what is in a port is not corrected.

One shape says little about g: a cable held askew looks much like one curved at rest. What the run to the port learned
of g from many shapes is therefore where its estimation begins.

Note:
    Not in the paper (Tang et al.).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from cableway.control.base import Controller
from cableway.control.estimating import EstimatingState
from cableway.core.checks import Checked, NotNegative, Share
from cableway.core.deprecation import renamed, renamed_keywords
from cableway.estimation.rod_filter import EstimatorConfig
from cableway.geometry.groups import SE2
from cableway.outcome import PORT_ANGLE, PORT_LATERAL
from cableway.records import Estimate, Observation, Plan
from cableway.scene.task import Task


@dataclass(frozen=True, kw_only=True)
class InsertionConfig(Checked):
    """Settings of `InsertionController`.

    Attributes:
        hold: Time [s] before the port in which the grasp is estimated and the plug aligned.
        gain: Share of the estimated misalignment that a step takes away; averages over about 1 / `gain` observations.
        max_span: Largest distance between the grippers, as a share of the cable's estimated length.
        frames: Frames with keypoints before which the plug is not inserted; nor is it before its estimated misalignment
            is within `outcome.PORT_LATERAL` and `PORT_ANGLE`.
        estimator: Of the grasp, among other things.

    Raises:
        InputError: A value is out of range.
    """

    hold: NotNegative[float] = 4.0
    gain: Share = 0.15
    max_span: NotNegative[float] = 0.995
    frames: NotNegative[int] = 10
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)


InsertionConfig.__init__ = renamed_keywords(longest="max_span")(InsertionConfig.__init__)


class InsertionController(Controller[EstimatingState]):
    """Aligns the plug with the first row of an insertion plan, then makes the motions of the rest.

    Args:
        config: The settings, the defaults where None.
        known: What the run to the port estimated of the cable, by name, as `Rollout.estimated` has it.
    """

    def __init__(self, config: InsertionConfig | None = None, known: Mapping[str, Estimate] | None = None) -> None:
        self.config, self._known = config or InsertionConfig(), known

    def init(self, task: Task, plan: Plan) -> EstimatingState:
        """See `Controller.init`."""
        state = EstimatingState(**EstimatingState.estimating(task, plan, self.config, known=self._known))
        self.step(state, Observation(0.0, plan.shapes[0], plan.poses[0]))  # compiles what a step needs
        return state

    def step(
        self, state: EstimatingState, observation: Observation | None
    ) -> tuple[Float[np.ndarray, "2 3"], EstimatingState]:
        """See `Controller.step`."""
        state, waits = state.observing(observation), False
        if state.must_stop:
            return state.stopping()
        if state.index < state.plan.held_steps:
            state = state.updated()
            held = state.index >= state.plan.held_steps - 1
            if held and state.estimate.updates < self.config.frames:
                return state.stopping()
            off = self._misaligned(state)
            waits = held and bool(np.linalg.norm(off[:-1]) > PORT_LATERAL or abs(off[-1]) > PORT_ANGLE)
            action = self.config.gain * np.stack([np.zeros_like(off), off])
        else:
            action = state.plan.actions(state.index, 1)[0]
        max_span = self.config.max_span * state.estimate.length
        return state.sending(action, state.tracking_status, max_span, waits)

    def _misaligned(self, state: EstimatingState) -> Float[np.ndarray, "3"]:
        """From where the right gripper is to where it has the plug aligned, with the estimated grasp."""
        wanted = SE2.compose(state.plan.plan.poses[0, 1], SE2.inverse(state.estimate.grasps[1]))
        return SE2.minus(wanted, state.tracker.commanded[1])


__getattr__ = renamed(__name__, {"PlugPush": "InsertionController", "PlugPushConfig": "InsertionConfig"})
