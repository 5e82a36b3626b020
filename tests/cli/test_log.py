"""Laws of `--log FILE`: it tells what was done, ends nothing, and spoils no file."""

from __future__ import annotations

import json
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from commands import Command

from cableway.cli import show
from cableway.core.provenance import versions

RECORD = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} (DEBUG|INFO|ERROR) cableway\.[\w.]+\[\d+\]: \S")


def records(path: Path) -> list[str]:
    """The records of a log; what is not the first line of one is indented."""
    found = re.split(r"\n(?!    )", path.read_text().rstrip("\n"))
    assert all(RECORD.match(each) for each in found)
    return found


def test_a_run_is_logged_from_its_options_to_its_end(cableway: Command, moved_file: Path):
    """Also where nothing is printed."""
    done = cableway("run", moved_file, "--controller", "open-loop", "--no-video", "--quiet", "--log", "log.txt")
    assert done == (0, "", "")
    text = "\n".join(records(Path("log.txt")))
    assert f"cableway {versions()['cableway']}, python" in text
    assert '"controller": "open-loop"' in text
    told = ("stage: projection", "a plan of", "planned: Plan(", "verification 0.", "from 0.0 s on: tracking",
            "ended after", "settled", "exit status 0")  # fmt: skip
    places = [text.index(each) for each in told]
    assert places == sorted(places)


def test_what_a_run_is_made_with_is_logged_as_its_report_has_it(cableway: Command, moved_file: Path):
    """Before it is used, so that it is there where the run does not come to a report."""
    options = ("--controller", "rod-jacobian", "--no-video", "--quiet")
    cableway("run", moved_file, *options, "--out", "o", "--log", "log.txt")
    made_by = json.loads(Path("o/report.json").read_text())["configuration"]
    text = Path("log.txt").read_text()
    logged = {name: json.loads(found) for name, found in re.findall(r": (planner|plant|tracking): (\{.*\})\n", text)}
    assert logged["planner"] == made_by["plan"]["planner"]
    assert logged["plant"] == made_by["rollout"]["plant"]
    assert logged["tracking"] == {name: made_by["rollout"][name] for name in logged["tracking"]}
    assert logged["tracking"].keys() > {"controller", "recovery", "track"}
    assert text.index(": tracking: {") < text.index("from 0.0 s on: tracking")


def test_why_nothing_came_of_it_is_logged(cableway: Command, sealed_file: Path):
    cableway("plan", sealed_file, "--quiet", "--log", "log.txt")
    text = Path("log.txt").read_text()
    assert "initial trajectory 'corridor', try 1: no plan: " in text
    assert "exit status 1" in text


def test_a_log_goes_on_with_the_next_command(cableway: Command):
    cableway("tasks", "--quiet", "--log", "log.txt")
    before = records(Path("log.txt"))
    assert cableway("show", "nothing", "--log", "log.txt").status == 2
    after = records(Path("log.txt"))
    assert after[: len(before)] == before
    assert re.search(r" ERROR cableway\.cli\.log\[\d+\]: unknown task 'nothing'", after[-1])


def test_a_defect_is_logged_with_its_traceback(cableway: Command, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(show.Show, "target", lambda *given: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        cableway("show", "maze-1", "--log", "log.txt")
    assert "ZeroDivisionError: division by zero" in records(Path("log.txt"))[-1]


def test_nothing_listens_after_the_command(cableway: Command):
    package = logging.getLogger("cableway")
    before = package.level, list(package.handlers)
    cableway("tasks", "--log", "log.txt")
    assert (package.level, package.handlers) == before


@pytest.mark.parametrize(("path", "why"), [
    ("no/folder.txt", "No such file or directory"), (".", "Is a directory"), ("task.yaml", "is no log of cableway"),
])  # fmt: skip
def test_a_file_that_is_no_log_is_refused(cableway: Command, path: str, why: str):
    Path("task.yaml").write_text("cableway: 1\n")
    done = cableway("tasks", "--log", path)
    assert (done.status, done.out) == (2, "")
    assert re.fullmatch(rf"cableway: --log {re.escape(path)}: .*{why}.*\n", done.err)
    assert Path("task.yaml").read_text() == "cableway: 1\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_costs_the_log_alone(cableway: Command):
    done = cableway("tasks", "--log", "/dev/full")
    assert done.status == 0
    assert done.out == cableway("tasks").out
    assert "the log is not whole: [Errno 28] No space left on device" in done.err


@pytest.mark.parametrize("logged", [False, True])
def test_what_a_library_warns_of_is_nothing_for_stderr(tmp_path: Path, logged: bool):
    """Matplotlib cannot make its folder, and says so in three lines."""
    (tmp_path / "file").touch()
    command = [
        sys.executable,
        "-m",
        "cableway",
        "show",
        "maze-1",
        "--quiet",
        "--out",
        "o",
        *["--log", "l"][: 2 * logged],
    ]
    variables = {**os.environ, "MPLCONFIGDIR": str(tmp_path / "file" / "folder")}
    done = subprocess.run(command, cwd=tmp_path, env=variables, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert not logged or "WARNING matplotlib" in (tmp_path / "l").read_text()
