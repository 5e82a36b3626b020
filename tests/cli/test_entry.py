"""Laws of the command as a whole: help, versions, exit statuses, one sentence for every mistake."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import problems
import pytest
from commands import Command

import cableway as package
from cableway.core.errors import ControlError
from cableway.core.provenance import versions
from cableway.planning.named import PLANNERS
from cableway.scene.files.loading import task_names
from cableway.scene.files.saving import save_task

COMMANDS = ("tasks", "show", "plan", "run", "check", "collect", "train", "evaluate", "models")


def one_sentence(text: str) -> bool:
    return text.startswith("cableway: ") and text.count("\n") == 1 and "Traceback" not in text


def test_help_lists_every_command(cableway: Command):
    done = cableway("--help")
    assert done.status == 0
    assert all(f"• {name} " in done.out for name in COMMANDS)
    assert done.err == ""


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_and_the_common_options(cableway: Command, command: str):
    done = cableway(command, "--help")
    assert done.status == 0
    assert all(option in done.out for option in ("--out", "--seed", "--quiet", "--json", "--log"))


def test_version_is_the_packages(cableway: Command):
    assert cableway("--version") == (0, f"cableway {versions()['cableway']}\n", "")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "tasks"),
        (["plam"], "plam"),
        (["plan", "maze-1", "--sed", "3"], "--seed"),
        (["plan"], "TASK"),
        (["plan", "maze-1", "--seed", "three"], "--seed"),
        (["check", "maze-1"], "FILE"),
    ],
)
def test_a_command_line_that_cannot_be_read_is_status_2_and_says_what_is_known(
    cableway: Command, arguments: list[str], said: str
):
    done = cableway(*arguments)
    assert done.status == 2
    assert done.out == ""
    assert said in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["plan", "maze-9"], f"unknown task 'maze-9'; known: {', '.join(task_names())}"),
        (["show", "no/such.yaml"], "no/such.yaml: no such file"),
        (["plan", "maze-1", "--seed", "-1"], "--seed must be from 0 to 2147483647, got -1"),
        (["plan", "maze-1", "--seed", "2147483648"], "--seed must be from 0 to 2147483647, got 2147483648"),
        (["plan", "maze-1", "--planner", "best"], f"unknown planner 'best'; known: {', '.join(sorted(PLANNERS))}"),
        (["plan", "maze-1", "--pivot", "prm"], "unknown pivot method 'prm'; known: grid, rrt_star"),
        (
            ["run", "maze-1", "--controller", "pid"],
            "unknown controller 'pid'; known: broyden, neural-mpc, open-loop, rod-jacobian, rod-mpc, tang2025",
        ),
        (
            ["run", "maze-1", "--controller", "broyden", "--model", "transformer"],
            "--model applies to neural-mpc and tang2025 only; broyden has no deformation model",
        ),
        (
            ["run", "maze-1", "--adapt"],
            "--adapt applies to neural-mpc and tang2025 only; rod-mpc has no learned model",
        ),
        (["run", "maze-1", "--model", "no/such.safetensors"], "no/such.safetensors: no such file"),
        (["check", "maze-1", "plan.npz"], "plan.npz: no such file"),
        (["collect", "--config", "none.yaml"], "none.yaml: no such file"),
        (["collect", "--transitions", "0"], "collection.transitions must be whole and positive, got 0"),
        (["collect", "--transitions", "9", "--workers", "0"], "workers must be at least 1, got 0"),
        (["collect", "--executor", "cloud"], "unknown executor 'cloud'; known: local, ray"),
        (["reproduce", "--size", "huge"], "unknown size 'huge'; known: full, quick"),
        (
            ["train"],
            "runs/collect: not a data set; one is a folder with manifest.json, "
            "or a recording ending in .csv, .npz or .yaml",
        ),
        (["models", "none.safetensors"], "none.safetensors: no such file"),
        (["models", "no\nne.safetensors"], r"no\nne.safetensors: no such file"),
    ],
)
def test_a_mistake_is_status_2_and_one_sentence(cableway: Command, arguments: list[str], sentence: str):
    done = cableway(*arguments)
    assert done == (2, "", f"cableway: {sentence}\n")
    assert not Path("runs").exists(), "a mistake leaves nothing behind"


def test_a_mistake_of_any_length_is_one_short_sentence(cableway: Command):
    done = cableway("plan", "x" * 100_000)
    assert done.status == 2
    assert done.err.startswith("cableway: unknown task 'xxx")
    assert done.err.endswith(f"known: {', '.join(task_names())}\n")
    assert len(done.err) < 1000


def test_an_unknown_model_lists_those_there_are(cableway: Command):
    done = cableway("run", "maze-1", "--model", "convolution")
    assert done.status == 2
    assert done.err.startswith("cableway: unknown model 'convolution'; known: ")


@pytest.mark.parametrize("command", [["plan", "maze-1"], ["show", "maze-1"], ["tasks"], ["collect"]])
def test_a_file_in_the_way_of_the_folder_is_named(cableway: Command, command: list[str]):
    Path("taken").write_text("mine")
    done = cableway(*command, "--out", "taken")
    assert done == (2, "", "cableway: --out taken: a file with this name exists; give a folder\n")
    assert Path("taken").read_text() == "mine"


def test_a_folder_that_cannot_be_made_is_named(cableway: Command):
    Path("file").write_text("")
    done = cableway("show", "maze-1", "--out", "file/below")
    assert done.status == 2
    assert one_sentence(done.err)
    assert "file/below" in done.err


def test_a_failure_that_is_nobodys_mistake_is_status_1(cableway: Command, monkeypatch: pytest.MonkeyPatch):
    def fail(source: str) -> None:
        raise ControlError("the controller gave up")

    monkeypatch.setattr("cableway.scene.files.loading.load_task", fail)
    assert cableway("show", "maze-1") == (1, "", "cableway: the controller gave up\n")


def test_a_reader_that_leaves_early_makes_no_noise():
    """`cableway tasks | head -1`: the status stays that of the command."""
    with subprocess.Popen(
        [sys.executable, "-m", "cableway", "tasks"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        said = process.stderr.read()
    assert (process.returncode, said) == (0, "")


def test_the_package_is_a_program_too():
    done = subprocess.run([sys.executable, "-m", package.__name__, "--version"], capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stdout.startswith("cableway ")


def test_an_old_name_is_told_once_to_who_runs_a_command(cableway: Command, tmp_path: Path):
    """Python hides such warnings from all but tests; the command goes on with the new name."""
    save_task(problems.free(), tmp_path / "free.yaml")
    done = cableway("plan", tmp_path / "free.yaml", "--planner", "paper", "--pivot", "grid")
    assert done.status == 1
    assert done.err.count("the planner 'paper' is now 'tang2025'; the old name goes with the next release") == 1
