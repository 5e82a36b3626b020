"""The planners of the registry that are settings of `cableway.planning.planner.plan`."""

from __future__ import annotations

from cableway.planning.config import PlannerConfig
from cableway.planning.planner import plan
from cableway.workflow.registry import Planner


def default() -> Planner:
    """Equilibria of the rod, searched and optimised."""
    return Planner(PlannerConfig(), plan)


def paper() -> Planner:
    """The paper's chain, with its values."""
    return Planner(PlannerConfig.paper(), plan)


def paper_refined() -> Planner:
    """The paper's chain with our trajectory optimisation."""
    return Planner(PlannerConfig.named("paper-refined"), plan)


def straight() -> Planner:
    """Each keypoint straight to its goal."""
    return Planner(PlannerConfig.named("straight"), plan)


def slide() -> Planner:
    """The cable slid along one curve."""
    return Planner(PlannerConfig.named("slide"), plan)


def rrt_connect() -> Planner:
    """RRT-Connect among equilibria all over the workspace, not optimised, as sampling-based planners before it."""
    return Planner(PlannerConfig.named("rrt-connect"), plan)
