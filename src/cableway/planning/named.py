"""The planners by name: the one list that `PlannerConfig.named`, command line, benchmark and studies read.

An entry names its configuration as "module:function", which is imported when it is first asked for, so that this list
loads nothing and a planner may need packages that are not installed.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PlannerEntry:
    """A planner's line in the list.

    Attributes:
        description: What it does, in a few words.
        config: "module:function"; the function takes nothing and returns a `PlannerConfig`.
        extra: Of cableway that it needs, see `cableway.core.extras`; "" for none.
    """

    description: str
    config: str
    extra: str = ""


PLANNERS = {
    "default": PlannerEntry(
        "equilibria of the rod, searched and optimised; ours", "cableway.planning.config:PlannerConfig"
    ),
    "tang2025": PlannerEntry(
        "the paper's chain (Tang et al.)", "cableway.tang2025.planning.config:paper_planner", extra="tang2025"
    ),
    "tang2025-refined": PlannerEntry(
        "the paper's chain with our trajectory optimisation",
        "cableway.tang2025.planning.config:paper_planner_refined",
        extra="tang2025",
    ),
    "straight": PlannerEntry("each keypoint straight to its goal", "cableway.planning.config:straight"),
    "slide": PlannerEntry("the cable slid along one curve", "cableway.planning.config:slide"),
    "rrt-connect": PlannerEntry("RRT-Connect among equilibria, not optimised", "cableway.planning.config:rrt_connect"),
}
"""Planners by name; the first is the default."""

RENAMED = {"paper": "tang2025", "paper-refined": "tang2025-refined"}
"""New name of each old one."""
