"""What can be chosen in planning: one frozen record per stage, each checked when it is made."""

from __future__ import annotations

from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import Annotated, Literal, get_args

from cableway.core.checks import Bounds, Checked, Choice, require_choice
from cableway.core.deprecation import renamed, renamed_keywords, renamed_value
from cableway.core.errors import InputError, UnknownNameError
from cableway.planning.named import PLANNERS, RENAMED
from cableway.planning.projection import ProjectionConfig
from cableway.planning.rrt_connect import RRTConnectConfig
from cableway.verification import VerificationLimits

PivotMethod = Literal["grid", "rrt_star"]
InitialName = Literal[
    "corridor", "tube", "slide-head", "slide-tail", "anywhere", "restarts",
    "head", "tail", "uniform", "least-energy", "straight", "previous",
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class PivotConfig(Checked):
    """How the path of the cable's centre is found.

    Attributes:
        method: "grid": shortest path on a grid, then made smooth; "rrt_star": OMPL's RRT*, the paper's.
        length_weight: k_l of the cost; paper's table: 1.
        clearance_weight: k_c of the cost [m]; paper's table: 1.
        resolution: Spacing of the grid and of the path's vertices [m].
        iterations: Iterations of RRT*.
    """

    method: Annotated[PivotMethod, Choice("pivot method")] = "grid"
    length_weight: Annotated[float, Bounds(1e-6, 1e6)] = 1.0
    clearance_weight: Annotated[float, Bounds(0, 1e6)] = 1.0
    resolution: Annotated[float, Bounds(1e-4, 0.1)] = 0.005
    iterations: Annotated[int, Bounds(1, 10**7)] = 2000


@dataclass(frozen=True, kw_only=True)
class PlannerConfig:
    """All stages of the planner.

    The stages that only the planner of Tang et al. has are in `cableway.tang2025.planning.config.PaperPlannerConfig`,
    which adds them to these.

    Attributes:
        pivot: Path of the cable's centre.
        rrt_connect: Search among equilibria.
        initial_trajectories: What is projected to equilibria, in this order, until a plan verifies: a search among
            equilibria about the pivot path ("corridor"), about the shapes of "slide-head" ("tube") or all over
            ("anywhere"); the cable sliding along one curve, its right ("slide-head") or left end leading
            ("slide-tail"); "tube" and "corridor" begun anew with more and more samples ("restarts"); each keypoint
            going straight to its goal ("straight"). Four more are the paper's, and need the extra `tang2025`: the
            deformation optimised along the path set from a first guess in which the right end ("head"), the left end
            ("tail") or neither leads ("uniform"), and of these three the one of least energy ("least-energy").
        projection: How an initial trajectory becomes a sequence of equilibria.
        limits: What a plan must keep.
    """

    pivot: PivotConfig = field(default_factory=PivotConfig)
    rrt_connect: RRTConnectConfig = field(default_factory=RRTConnectConfig)
    initial_trajectories: tuple[InitialName, ...] = (
        "corridor", "tube", "slide-head", "slide-tail", "anywhere", "restarts",
    )  # fmt: skip
    projection: ProjectionConfig = field(default_factory=ProjectionConfig)
    limits: VerificationLimits = field(default_factory=VerificationLimits)

    def __post_init__(self) -> None:
        for name in self.initial_trajectories:
            require_choice("initial trajectory", name, InitialName)
        if not self.initial_trajectories:
            raise InputError(
                f"PlannerConfig.initial_trajectories needs at least one of {', '.join(get_args(InitialName))}"
            )

    @staticmethod
    def paper() -> PlannerConfig:
        """The values and variants of the paper (Tang et al., table of key hyperparameters), and nothing else.

        Raises:
            MissingExtraError: The extra `tang2025` is not installed.
        """
        return PlannerConfig.named("tang2025")

    @staticmethod
    def named(name: str) -> PlannerConfig:
        """A planner by its name, see `cableway.planning.named.PLANNERS`.

        Raises:
            UnknownNameError: There is none of that name; the message lists them.
            MissingExtraError: It is one of the paper's, and the extra `tang2025` is not installed.
        """
        name = renamed_value("planner", name, RENAMED)
        if name not in PLANNERS:
            raise UnknownNameError("planner", name, PLANNERS)
        return resolve_name(PLANNERS[name].config)()


def straight() -> PlannerConfig:
    """Each keypoint straight to its goal."""
    return PlannerConfig(initial_trajectories=("straight",), projection=ProjectionConfig(kind="none"))


def slide() -> PlannerConfig:
    """The cable only slid along one curve."""
    return PlannerConfig(initial_trajectories=("slide-head", "slide-tail"), projection=ProjectionConfig(kind="fit"))


def rrt_connect() -> PlannerConfig:
    """RRT-Connect among equilibria all over the workspace, not optimised, as sampling-based planners before it."""
    return PlannerConfig(initial_trajectories=("anywhere",), projection=ProjectionConfig(kind="fit"))


PlannerConfig.__init__ = renamed_keywords(
    explore="rrt_connect", guides="initial_trajectories", realization="projection"
)(PlannerConfig.__init__)

__getattr__ = renamed(
    __name__,
    {
        "DeformationConfig": "tang2025.planning.config.DeformationConfig",
        "PathSetConfig": "tang2025.planning.config.PathSetConfig",
    },
)
