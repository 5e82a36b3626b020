"""The studies behind the page of planning run, each on one task, and print the tables that the page keeps."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import foreign_tasks
import gripper_bodies
import plan_quality
import planning
import printed_page
import pytest
import ramps

from cableway.scene.files.loading import load_task


def printed(study: ModuleType, arguments: str, out: Path, monkeypatch, capsys) -> printed_page.Rows:
    """The one table that a study prints."""
    monkeypatch.setattr(sys, "argv", [f"{study.__name__}.py", *arguments.format(out=out).split()])
    study.main()
    (table,) = printed_page.tables(capsys.readouterr().out)
    return table


@pytest.mark.parametrize(
    ("study", "arguments", "row"),
    [
        (planning, "open-near --seeds 7000:7001 --out {out}", ["open-near", "default", "1 of 1"]),
        (gripper_bodies, "posts:100:101 --out {out}", ["posts", "1", "1", "1", "1"]),
        (foreign_tasks, "--seeds 0:1 --out {out}/tasks.csv", ["1", "1"]),
        (plan_quality, "open-loop --kinds open-near --seeds 0:1", ["deviation [mm], tau 0.1 s", "1"]),
    ],
    ids=lambda value: value.__name__ if isinstance(value, ModuleType) else "",
)
def test_a_study_prints_its_table(
    study: ModuleType, arguments: str, row: list[str], tmp_path: Path, monkeypatch, capsys
):
    head, first, *_ = printed(study, arguments, tmp_path, monkeypatch, capsys)
    assert first[: len(row)] == row
    assert len(head) == len(first)


def test_what_limits_of_acceleration_cost_is_told_beside_limits_of_speed_alone():
    rows = [ramps.row(load_task("single-obstacle-2"), limits, limits == "speed") for limits in ramps.LIMITS]
    steps = [row["steps"] for row in rows]
    assert steps[0] < steps[1] <= steps[3]
    (_, *lines), (_, tracked) = ramps.durations(rows).rows, ramps.tracking(rows).rows
    assert [line[0] for line in lines] == list(ramps.LIMITS)
    assert float(lines[3][3]) > 0
    assert tracked[:3] == ("speed", "1", "1")
