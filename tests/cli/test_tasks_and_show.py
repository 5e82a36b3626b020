"""Laws of `tasks` and `show`."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib.image
import pytest
import yaml
from commands import Command

from cableway.core.errors import InputError
from cableway.scene.files.loading import catalogue_file, load_planar_task, load_task, task_names
from cableway.tasks.generation import random_task


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


@pytest.mark.parametrize(
    ("out", "path"), [("here", "here/task.png"), ("a/b.png", "a/b.png"), ("b.svg", "b.svg"), ("b.PDF", "b.PDF")]
)
def test_show_writes_to_a_folder_or_a_file(cableway: Command, out: str, path: str):
    assert cableway("show", "maze-1", "--quiet", "--out", out) == (0, "", "")
    assert Path(path).is_file()
    assert [p for p in Path().rglob("*") if p.is_file()] == [Path(path)]


def test_vector_graphics_stand_beside_the_picture(cableway: Command):
    assert cableway("show", "maze-1", "--vector", "pdf", "--out", "here") == (0, "here/task.png\n", "")
    assert sorted(path.name for path in Path("here").iterdir()) == ["task.pdf", "task.png"]
    assert Path("here/task.pdf").read_bytes().startswith(b"%PDF")
    done = cableway("show", "maze-1", "--vector", "eps")
    assert (done.status, done.err) == (2, "cableway: unknown vector format 'eps'; known: pdf, svg\n")


def test_show_takes_a_file(cableway: Command):
    Path("mine.yaml").write_text(catalogue_file("maze-1").read_text().replace("name: maze-1", "name: mine"))
    done = cableway("show", "mine.yaml", "--json")
    assert json.loads(done.out) == {"task": "mine", "picture": "runs/mine/task.png"}


def test_random_tasks_are_written_listed_and_drawn(cableway: Command):
    done = cableway("tasks", "--random", "clutter", "--seed", 2, "--count", 2, "--picture", "--json", "--out", "here")
    assert done.status == 0
    rows = json.loads(done.out)["tasks"]
    assert [row["name"] for row in rows] == ["clutter-2", "clutter-3"]
    assert [load_task(row["file"]).name for row in rows] == ["clutter-2", "clutter-3"]
    assert sorted(path.name for path in Path("here").iterdir()) == ["clutter-2.yaml", "clutter-3.yaml", "tasks.png"]
    assert matplotlib.image.imread("here/tasks.png").std() > 0.05


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--random", "fog"], "unknown kind of random task 'fog'"),
        (["--count", "2"], "--count, --width, --body, --cell and --picture need --random"),
        (["--random", "clutter", "--body", "2f-85"], "body is not for clutter; kinds in space: space-clutter,"),
        (["--random", "lift", "--body", "claw"], "grippers.body must be one of disc, 2f-85,"),
        (["--random", "clutter", "--count", "0"], "--count must be from 1 to 1000000, got 0"),
        (["--random", "slot", "--width", "1"], "width of slot must be from 0.025 to 0.2 m, got 1.0"),
    ],
)
def test_wrong_options_of_random_tasks_leave_nothing(cableway: Command, arguments: list[str], message: str):
    done = cableway("tasks", *arguments)
    assert (done.status, message in done.err) == (2, True)
    assert not list(Path().iterdir())


@pytest.mark.parametrize(
    "text", ["$x_{", r"\frac{1}{0}", "100$ or 200$", "red \x1b[31m bell \x07 \x9b5m", "ångström, 線, 🪢"]
)
def test_a_description_is_drawn_as_it_stands(cableway: Command, text: str):
    """No formula, no control character, no font keeps a task from being shown, nor says anything at the terminal."""
    content = yaml.safe_load(catalogue_file("maze-1").read_text())
    Path("mine.yaml").write_text(json.dumps(content | {"description": text}))
    assert cableway("show", "mine.yaml") == (0, "runs/maze-1/task.png\n", "")


def test_what_is_said_has_no_control_characters(cableway: Command):
    """A file's name and keys may have some; they are written out."""
    Path("\x1b[31m.yaml").write_text('{cableway: 1, "bell \\x07": 2}')
    done = cableway("show", "./\x1b[31m.yaml")
    assert done.status == 2
    assert r"\x1b[31m.yaml" in done.err
    assert not [character for character in done.err[:-1] if not character.isprintable()]


def test_arguments_that_cannot_be_read_are_quoted_without_what_steers_a_terminal(cableway: Command):
    done = cableway("tasks", "maze-1", "\u202eevil")
    assert done.status == 2
    assert r"\u202eevil" in done.err
    assert "\u202e" not in done.err


def test_plan_and_show_draw_the_arms_of_a_cell(cableway: Command):
    """`show` makes of a plan's file the same picture as `plan`."""
    random_task(5000, "cell").save("mine.yaml")
    assert cableway("plan", "mine.yaml", "--quiet", "--out", "o").status == 0
    assert {path.name for path in Path("o").iterdir()} == {
        "plan.npz",
        "plan.png",
        "cell.png",
        "report.json",
        "task.yaml",
    }
    assert matplotlib.image.imread("o/cell.png").std() > 0.05
    assert cableway("show", "o/task.yaml", "o/plan.npz", "--out", "here") == (0, "here/cell.png\n", "")
    assert Path("here/cell.png").read_bytes() == Path("o/cell.png").read_bytes()
    assert [path.name for path in Path("here").iterdir()] == ["cell.png"]


def test_show_draws_no_arms_where_there_are_none(cableway: Command, moved_file: Path, run_folder: Path):
    plan = run_folder / "plan.npz"
    done = cableway("show", moved_file, plan)
    assert (done.status, done.out) == (2, "")
    assert (
        done.err
        == f"cableway: {plan}: the task moved is in no cell, and show draws the arms of plans and rollouts alone\n"
    )
    random_task(5000, "cell").save("mine.yaml")
    done = cableway("show", "mine.yaml", plan)
    assert done.status == 2
    assert f"{plan}: it has no joints of arms" in done.err
    assert [path.name for path in Path().iterdir()] == ["mine.yaml"]


def test_tasks_in_space_are_drawn_checked_and_refused_by_what_is_planar(cableway: Command):
    assert cableway("tasks", "--random", "lift", "--seed", "11", "--picture", "--quiet") == (0, "", "")
    file = "runs/lift/lift-11.yaml"
    assert cableway("show", file, "--quiet", "--out", "here") == (0, "", "")
    for picture in ("runs/lift/tasks.png", "here/task.png"):
        assert matplotlib.image.imread(picture).std() > 0.05
    done = cableway("check", file, "--json")
    assert done.status == 0
    assert json.loads(done.out)["goal"]["stability"] > 25
    with pytest.raises(InputError, match=r"^the task 'lift-11' is in space, .* studio\); give a task on the table"):
        load_planar_task(file)
    spoilt = yaml.safe_load(Path(file).read_text())
    spoilt["goal"]["equilibrium"][2] = 0.0
    Path("bad.yaml").write_text(yaml.safe_dump(spoilt))
    for command in ("check", "show"):
        done = cableway(command, "bad.yaml")
        assert done.status == 2
        assert "goes through the table" in done.err
        assert "cableway show bad.yaml draws it" in done.err or "drawn in runs/lift-11/task.png" in done.err
