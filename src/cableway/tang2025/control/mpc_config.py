"""Settings of the model predictive controllers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from cableway.core.checks import Checked, Choice, NotNegative, Positive, Share
from cableway.core.deprecation import renamed_keywords
from cableway.estimation.rod_filter import EstimatorConfig
from cableway.tang2025.control.terms import Profile

ADAPT_EVERY = 20
"""Control steps between two adaptations of a model, where it is adapted."""


@dataclass(frozen=True, kw_only=True)
class MPCConfig(Checked):
    """Settings of `NeuralMPC`; `paper()` gives those of Tang et al., the defaults are ours.

    Attributes:
        horizon: H, number of actions looked ahead (paper, hyperparameter table: 5).
        iterations: Most Gauss-Newton iterations in one step (paper: 15). From the last solution, moved on by a step, a
            second one changes nothing measurable (`studies/neural.py`) and costs as much as the first.
        tolerance: Relative fall of the cost that is not worth another iteration.
        tracking_weight: lambda_1 [1/m^2] (paper: 150).
        obstacle_weight: lambda_2, [1/m^2] for the hinge, [m^2] for the barrier (paper: 0.01).
        control_weight: lambda_3 [1/m^2] (paper: 1).
        pose_weight: Pull of the gripper poses to the plan's [1/m^2]; 0 for none (paper).
        turn_lever: Motion [m] that a turn of 1 rad counts as in the control and pose terms (paper: 1, as R is unit).
        profile: "hinge" or the paper's "barrier", see `terms.clearance`.
        threshold: d, clearance [m] below which obstacles cost (paper: 0.005).
        pieces: Points costed per segment between keypoints; 1 for keypoints alone, as in the paper.
        feedforward: Regularise towards the plan's gripper steps instead of, as in the paper, towards no motion.
        offset_gain: Share of the newest prediction error that enters the output offset; 0 for no offset (paper).
        soft_span: Distance between the grippers over the cable's length from where it costs; where the plan stretches
            the cable farther, the plan's distance.
        span_weight: w_s [1/m^2]; 0 for no such cost (paper).
        max_span: Distance between the grippers over the cable's length that is never exceeded, unless by the plan.
        adapt_every: Control steps between two adaptations of the model; 0 for none.
        hold: Time [s] at the plan's first row before it is followed, while start and offset settle.
        waits_above: Stacked error over the number of keypoints [m] above which the reference waits, as in the authors'
            public code, which has 0.004; 0 for a reference by time alone. The paper does not say.
        patience: Control steps for which it waits at most (public code: 150, or 15 in which the error rose).
        estimator: Of the rod's parameters, for the latency, contacts and new plans, not for the model; as `nominal`
            there is none of it (paper).
    """

    horizon: Positive[int] = 5
    iterations: Positive[int] = 1
    tolerance: NotNegative[float] = 1e-3
    tracking_weight: Positive[float] = 150.0
    obstacle_weight: NotNegative[float] = 1e5
    control_weight: Positive[float] = 1e4
    pose_weight: NotNegative[float] = 300.0
    turn_lever: Positive[float] = 0.1
    profile: Annotated[Profile, Choice("profile")] = "hinge"
    threshold: Positive[float] = 0.005
    pieces: Positive[int] = 3
    feedforward: bool = True
    offset_gain: Share = 0.2
    soft_span: Positive[float] = 0.985
    span_weight: NotNegative[float] = 1e5
    max_span: Positive[float] = 0.995
    adapt_every: NotNegative[int] = 0
    hold: NotNegative[float] = 1.5
    waits_above: NotNegative[float] = 0.0
    patience: Positive[int] = 15
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)

    @classmethod
    def paper(cls) -> MPCConfig:
        """The controller as in Tang et al.: its table's weights, keypoints only, no feedforward, offset or hold."""
        return cls(
            iterations=15,
            obstacle_weight=0.01,
            control_weight=1.0,
            pose_weight=0.0,
            turn_lever=1.0,
            profile="barrier",
            pieces=1,
            feedforward=False,
            offset_gain=0.0,
            span_weight=0.0,
            hold=0.0,
            estimator=EstimatorConfig.nominal(),
        )


MPCConfig.__init__ = renamed_keywords(stretch="soft_span", stretch_weight="span_weight", longest="max_span")(
    MPCConfig.__init__
)
