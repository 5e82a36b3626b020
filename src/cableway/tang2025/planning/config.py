"""What can be chosen in the paper's planner: its path set, its deformation, and the values of its table."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from cableway.core.checks import Bounds, Checked, Choice, NotNegative, Share
from cableway.core.errors import InputError
from cableway.planning.config import InitialName, PivotConfig, PlannerConfig
from cableway.planning.projection import ProjectionConfig

PathSetKind = Literal["homotopic", "transfer"]
Interpolation = Literal["spline", "sigmoid"]


@dataclass(frozen=True, kw_only=True)
class PathSetConfig(Checked):
    """How the pivot path becomes one path per keypoint.

    Attributes:
        kind: "homotopic": along the start cable, the pivot path and the goal cable, then tightened in free space;
            "transfer": linear transfer with redistribution in the passages, the paper's.
        waypoints: M, points of each path.
        margin: Clearance [m] beyond the cable's radius that tightening leaves where there was that much before.
        spread: alpha: width over which the paths spread in a passage, over the cable's length, at most.
        shrink: gamma: scale of the end shapes that set the order in the passages ("transfer").
    """

    kind: Annotated[PathSetKind, Choice("path set")] = "homotopic"
    waypoints: Annotated[int, Bounds(8, 10000)] = 201
    margin: NotNegative[float] = 0.01
    spread: Share = 0.5
    shrink: Share = 0.1


@dataclass(frozen=True, kw_only=True)
class DeformationConfig(Checked):
    """The optimisation of progress along the path set.

    Attributes:
        steps: T; paper's table: 50.
        near_stiffness: k1, springs between neighbouring keypoints [N/m]. The paper's 2 does not hold the length.
        far_stiffness: k2, springs between every second keypoint [N/m]; paper's table: 1.
        step_stiffness: k3, springs between a keypoint and itself one step later [N/m]; 0 in the paper, whose
            sequences may therefore wait and jump.
        lower_bound: lb, least progress of a keypoint in a step. The paper's 0.01 with T = 50 leaves keypoints no
            room to be more than half a path apart.
        upper_bound: ub, most progress of a keypoint in a step; paper's table: 0.1.
        interpolation: "spline": a C2 cubic spline through each path; "sigmoid": the paper's weighted segments.
        sharpness: a of the paper's sigmoid, per segment.
        iterations: Iterations allowed to Ipopt; when they are used up, the last iterate is taken and the report says
            so.
    """

    steps: Annotated[int, Bounds(2, 10000)] = 50
    near_stiffness: Annotated[float, Bounds(0, 1e9)] = 100.0
    far_stiffness: Annotated[float, Bounds(0, 1e9)] = 1.0
    step_stiffness: Annotated[float, Bounds(0, 1e9)] = 0.1
    lower_bound: Share = 0.0
    upper_bound: Share = 0.1
    interpolation: Annotated[Interpolation, Choice("interpolation")] = "spline"
    sharpness: Annotated[float, Bounds(0.1, 1e4)] = 10.0
    iterations: Annotated[int, Bounds(1, 10**6)] = 100

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.lower_bound * self.steps <= 1 <= self.upper_bound * self.steps:
            raise InputError(
                f"progress cannot reach 1 in {self.steps} steps of {self.lower_bound:g} to {self.upper_bound:g}"
            )


@dataclass(frozen=True, kw_only=True)
class PaperPlannerConfig(PlannerConfig):
    """All stages of the paper's planner, with our values; `paper_planner` has the paper's.

    Attributes:
        path_set: One path per keypoint.
        deformation: Progress of the keypoints along their paths.
        initial_trajectories: As in `PlannerConfig`; here the first guesses of the deformation, one after the other.
    """

    path_set: PathSetConfig = field(default_factory=PathSetConfig)
    deformation: DeformationConfig = field(default_factory=DeformationConfig)
    initial_trajectories: tuple[InitialName, ...] = ("head", "tail", "uniform")


def paper_planner() -> PaperPlannerConfig:
    """The values and variants of the paper (table of key hyperparameters), and nothing else.

    What the paper leaves open was chosen by `studies/tang2025_settings.py`: alpha, first guess and iterations.
    """
    return PaperPlannerConfig(
        pivot=PivotConfig(method="rrt_star"),
        path_set=PathSetConfig(kind="transfer", spread=0.25),
        deformation=DeformationConfig(
            near_stiffness=2.0,
            far_stiffness=1.0,
            step_stiffness=0.0,
            lower_bound=0.01,
            upper_bound=0.1,
            interpolation="sigmoid",
            iterations=1000,
        ),
        initial_trajectories=("least-energy",),
        projection=ProjectionConfig(kind="none"),
    )


def paper_planner_refined() -> PaperPlannerConfig:
    """The paper's chain, followed by our projection to equilibria and trajectory optimisation."""
    return replace(paper_planner(), projection=ProjectionConfig(kind="optimize"))
