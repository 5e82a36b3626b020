"""The commands that the documentation shows are run, page by page, and print what the page says.

On a page, a block of YAML, Python or XML whose first line is a comment with a file's name is that file, and a block
marked `console` is a session: lines that begin with `$ ` are run in order, in one folder for each page, and what stands
below one is what it prints, `...` being anything. Each command must end with status 0.
"""

from __future__ import annotations

import doctest
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
BLOCK = re.compile(r"^```(yaml|python|xml|console)\n(.*?)^```", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"(?:# |<!-- )([\w-]+\.(?:yaml|py|svg))(?: -->)?\n")
PAGES = sorted(page for page in DOCS.rglob("*.md") if "```console\n" in page.read_text())
LIKE = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def commands(session: str) -> list[tuple[str, str]]:
    """Each command with what it is to print."""
    return re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", session, re.MULTILINE)


def matches(shown: str, printed: str) -> bool:
    """Whether a page shows what was printed; a line of three dots at its end stands for any lines, or none."""
    check = doctest.OutputChecker().check_output
    return check(shown, printed, LIKE) or check(shown.removesuffix("\n...\n") + "\n", printed, LIKE)


def run(command: str, folder: Path) -> str:
    """What a command prints, on both channels."""
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "COLUMNS")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{environment['PATH']}"
    line = ["bash", "-c", f"exec 2>&1; {command}"]
    done = subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{command} ended with {done.returncode}\n{done.stdout}"
    return done.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_of_a_page_do_what_it_says(page: Path, tmp_path: Path):
    ran = 0
    for kind, block in BLOCK.findall(page.read_text()):
        if kind == "console":
            for command, shown in commands(block):
                printed = run(command, tmp_path)
                assert not shown or matches(shown, printed), (
                    f"{page.name} shows of `{command}`\n{shown}\nbut it prints\n{printed}"
                )
                ran += 1
        elif named := FILE.match(block):
            (tmp_path / named[1]).write_text(block)
    assert ran


def test_the_tutorial_is_among_them():
    assert DOCS / "tutorial.md" in PAGES


def test_a_session_is_read():
    session = "$ one\n...\nshown\n$ two; echo $?\n"
    assert commands(session) == [("one", "...\nshown\n"), ("two; echo $?", "")]
