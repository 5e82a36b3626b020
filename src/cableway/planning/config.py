"""What can be chosen in planning: one frozen record per stage, each checked when it is made."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from cableway.core.checks import require_choice, require_not_negative, require_range
from cableway.core.errors import InputError, UnknownNameError
from cableway.planning.projection import RealizationConfig
from cableway.planning.rrt_connect import ExploreConfig
from cableway.verification import VerificationLimits

PivotMethod = Literal["grid", "rrt_star"]
PathSetKind = Literal["homotopic", "transfer"]
Interpolation = Literal["spline", "sigmoid"]
Guide = Literal[
    "corridor", "tube", "slide-head", "slide-tail", "head", "tail", "uniform", "anywhere", "straight", "previous"
]

PLANNERS = ("default", "paper", "paper-refined", "straight", "slide", "rrt-connect")
"""Names of planners, see `PlannerConfig.named`."""


@dataclass(frozen=True, kw_only=True)
class PivotConfig:
    """How the path of the cable's centre is found.

    Attributes:
        method: "grid": shortest path on a grid, then made smooth; "rrt_star": OMPL's RRT*, the paper's.
        length_weight: k_l of the cost; paper's table: 1.
        clearance_weight: k_c of the cost [m]; paper's table: 1.
        resolution: Spacing of the grid and of the path's vertices [m].
        iterations: Iterations of RRT*.
        reach: Longest edge of RRT* [m].
    """

    method: PivotMethod = "grid"
    length_weight: float = 1.0
    clearance_weight: float = 1.0
    resolution: float = 0.005
    iterations: int = 2000
    reach: float = 0.1

    def __post_init__(self) -> None:
        require_choice("pivot method", self.method, PivotMethod)
        require_range(self, 1e-6, 1e6, "length_weight")
        require_range(self, 0, 1e6, "clearance_weight")
        require_range(self, 1e-4, 0.1, "resolution")
        require_range(self, 1, 10**7, "iterations")
        require_range(self, 1e-3, 100, "reach")


@dataclass(frozen=True, kw_only=True)
class PathSetConfig:
    """How the pivot path becomes one path per keypoint.

    Attributes:
        kind: "homotopic": along the start cable, the pivot path and the goal cable, then tightened in free space;
            "transfer": linear transfer with redistribution in the passages, the paper's.
        waypoints: M, points of each path.
        margin: Clearance [m] beyond the cable's radius that tightening leaves where there was that much before.
        spread: alpha: width over which the paths spread in a passage, over the cable's length, at most.
        shrink: gamma: scale of the end shapes that set the order in the passages ("transfer").
    """

    kind: PathSetKind = "homotopic"
    waypoints: int = 201
    margin: float = 0.01
    spread: float = 0.5
    shrink: float = 0.1

    def __post_init__(self) -> None:
        require_choice("path set", self.kind, PathSetKind)
        require_range(self, 8, 10000, "waypoints")
        require_not_negative(self, "margin")
        require_range(self, 0, 1, "spread", "shrink")


@dataclass(frozen=True, kw_only=True)
class DeformationConfig:
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
        iterations: Iterations allowed to Ipopt; when they are used up, the last iterate is taken.
    """

    steps: int = 50
    near_stiffness: float = 100.0
    far_stiffness: float = 1.0
    step_stiffness: float = 0.1
    lower_bound: float = 0.0
    upper_bound: float = 0.1
    interpolation: Interpolation = "spline"
    sharpness: float = 10.0
    iterations: int = 100

    def __post_init__(self) -> None:
        require_choice("interpolation", self.interpolation, Interpolation)
        require_range(self, 2, 10000, "steps")
        require_range(self, 0, 1e9, "near_stiffness", "far_stiffness", "step_stiffness")
        require_range(self, 0, 1, "lower_bound", "upper_bound")
        require_range(self, 0.1, 1e4, "sharpness")
        require_range(self, 1, 10**6, "iterations")
        if not self.lower_bound * self.steps <= 1 <= self.upper_bound * self.steps:
            raise InputError(
                f"progress cannot reach 1 in {self.steps} steps of {self.lower_bound:g} to {self.upper_bound:g}"
            )


@dataclass(frozen=True, kw_only=True)
class PlannerConfig:
    """All stages of the planner.

    Attributes:
        pivot: Path of the cable's centre.
        path_set: One path per keypoint.
        deformation: Progress of the keypoints along their paths.
        explore: The guides that search among equilibria.
        guides: What is realised, in this order, until a plan verifies: a search among equilibria about the pivot
            path ("corridor"), about the shapes of "slide-head" ("tube") or all over ("anywhere"); the cable sliding
            along one curve, its right or left end leading; the deformation optimised along the path set from a
            first guess in which the right end ("head"), the left end ("tail") or neither leads ("uniform"); each
            keypoint going straight to its goal ("straight").
        realization: How a guide is made true.
        limits: What a plan must keep.
    """

    pivot: PivotConfig = field(default_factory=PivotConfig)
    path_set: PathSetConfig = field(default_factory=PathSetConfig)
    deformation: DeformationConfig = field(default_factory=DeformationConfig)
    explore: ExploreConfig = field(default_factory=ExploreConfig)
    guides: tuple[Guide, ...] = ("corridor", "tube", "slide-head", "slide-tail", "head", "anywhere", "tail")
    realization: RealizationConfig = field(default_factory=RealizationConfig)
    limits: VerificationLimits = field(default_factory=VerificationLimits)

    def __post_init__(self) -> None:
        for guide in self.guides:
            require_choice("guide", guide, Guide)
        if not self.guides:
            raise InputError(f"PlannerConfig.guides needs at least one of {', '.join(get_args(Guide))}")

    @classmethod
    def paper(cls) -> PlannerConfig:
        """The values and variants of the paper (Tang et al., table of key hyperparameters), and nothing else."""
        return cls(
            pivot=PivotConfig(method="rrt_star"),
            path_set=PathSetConfig(kind="transfer"),
            deformation=DeformationConfig(
                near_stiffness=2.0,
                far_stiffness=1.0,
                step_stiffness=0.0,
                lower_bound=0.01,
                upper_bound=0.1,
                interpolation="sigmoid",
            ),
            guides=("uniform",),
            realization=RealizationConfig(kind="none"),
        )

    @classmethod
    def named(cls, name: str) -> PlannerConfig:
        """A planner by its name: the default, the paper's, and simpler ones to compare with.

        "paper-refined" is the paper's chain with our refinement; "straight" moves each keypoint straight to its
        goal; "slide" only slides the cable along one curve; "rrt-connect" only searches among equilibria, all over
        the workspace, and refines nothing, as sampling-based planners before it.

        Raises:
            UnknownNameError: There is none of that name; the message lists them.
        """
        match name:
            case "default":
                return cls()
            case "paper":
                return cls.paper()
            case "paper-refined":
                return replace(cls.paper(), realization=RealizationConfig(kind="refine"))
            case "straight":
                return cls(guides=("straight",), realization=RealizationConfig(kind="none"))
            case "slide":
                return cls(guides=("slide-head", "slide-tail"), realization=RealizationConfig(kind="fit"))
            case "rrt-connect":
                return cls(guides=("anywhere",), realization=RealizationConfig(kind="fit"))
            case _:
                raise UnknownNameError("planner", name, PLANNERS)
