"""The files that planning and running leave in a folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from cableway.cli.options import REPORT, VECTOR

if TYPE_CHECKING:
    from cableway.cli.terminal import Terminal
    from cableway.report import Report

TASK = "task.yaml"
PLAN, PLAN_PICTURE = "plan.npz", "plan.png"
ALTERNATIVES_PICTURE, CELL_PICTURE = "alternatives.png", "cell.png"
ROLLOUT, ROLLOUT_PICTURE, VIDEO = "rollout.npz", "rollout.png", "rollout.mp4"
REPLANNING_PICTURE, ESTIMATES_PICTURE = "replanning.png", "estimates.png"
INSERTION_PLAN, INSERTION, INSERTION_PICTURE = "insertion-plan.npz", "insertion.npz", "insertion.png"

PUSH_0_1 = "push.npz"
"""What version 0.1 called the plan of the insertion."""

ALL = (
    REPORT, TASK, PLAN, PLAN_PICTURE, ALTERNATIVES_PICTURE, CELL_PICTURE, INSERTION_PLAN, ROLLOUT, ROLLOUT_PICTURE,
    VIDEO, REPLANNING_PICTURE, ESTIMATES_PICTURE, INSERTION, INSERTION_PICTURE,
)  # fmt: skip
"""In the order in which they are told; beside a picture there may be the same as vector graphics."""


def alternative(place: int) -> str:
    """Name of the file of the alternative at a place, 1 for the best.

    >>> alternative(1), alternative(2)
    ('plan.npz', 'plan-2.npz')
    """
    return PLAN if place == 1 else f"plan-{place}.npz"


def clear(folder: Path) -> None:
    """Remove what an earlier run left, so that a folder never mixes two runs."""
    for path in (*(folder / name for name in (*_names(), PUSH_0_1)), *folder.glob("plan-*.npz")):
        path.unlink(missing_ok=True)


def listed(folder: Path) -> str:
    """Which files there are, in words."""
    others = sorted(path.name for path in folder.glob("plan-*.npz"))
    return f"in {folder}: {', '.join([*(name for name in _names() if (folder / name).exists()), *others])}"


def _names() -> Iterator[str]:
    """All names, those of vector graphics included."""
    for name in ALL:
        yield name
        if name.endswith(".png"):
            yield from (name.removesuffix("png") + ending for ending in VECTOR)


def announce(terminal: Terminal, folder: Path, report: Report) -> None:
    """Say on the side how it ended and which files there are."""
    terminal.note(f"{report.task}: {'success' if report.success else 'failed'}; {listed(folder)}")


def write_report(folder: Path, report: Report) -> None:
    """Write a report's plain data."""
    from cableway.core.files import write_json

    write_json(folder / REPORT, report.as_dict())
