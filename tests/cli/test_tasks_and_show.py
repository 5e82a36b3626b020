"""Laws of `tasks` and `show`."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib.image
import pytest
from conftest import Command

from cableway.scene.loading import catalogue_file, load_task, task_names


def test_tasks_lists_the_catalogue(cableway: Command):
    done = cableway("tasks")
    assert done.status == 0
    assert all(name in done.out for name in task_names())


def test_tasks_as_json_says_what_the_tasks_say(cableway: Command):
    done = cableway("tasks", "--json", "--out", "list")
    rows = json.loads(done.out)["tasks"]
    assert [row["name"] for row in rows] == list(task_names())
    first = load_task(rows[0]["name"])
    assert rows[0]["cable_length"] == first.cable.length
    assert rows[0]["obstacles"] == len(first.scene.obstacles)
    assert json.loads(Path("list/report.json").read_text()) == json.loads(done.out)


def test_show_draws_the_task_and_says_where(cableway: Command):
    done = cableway("show", "maze-1")
    assert (done.status, done.err) == (0, "")
    assert done.out.strip() == "runs/maze-1/task.png"
    assert matplotlib.image.imread("runs/maze-1/task.png").std() > 0.05


@pytest.mark.parametrize(("out", "path"), [("here", "here/task.png"), ("a/b.png", "a/b.png")])
def test_show_writes_to_a_folder_or_a_file(cableway: Command, out: str, path: str):
    assert cableway("show", "maze-1", "--quiet", "--out", out) == (0, "", "")
    assert Path(path).is_file()
    assert [p for p in Path().rglob("*") if p.is_file()] == [Path(path)]


def test_show_takes_a_file(cableway: Command):
    Path("mine.yaml").write_text(catalogue_file("maze-1").read_text().replace("name: maze-1", "name: mine"))
    done = cableway("show", "mine.yaml", "--json")
    assert json.loads(done.out) == {"task": "mine", "picture": "runs/mine/task.png"}
