"""Every example and the Python of README and planning page run as they stand, in a folder of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
SAYS = {
    "04_replay_a_recording": r"RodMPC +would have .* 0\.00 mm \(median\), 0\.00 mm \(most\)",
    "05_a_robot_over_a_socket": r"steps, settled\n.*\n39 steps, plant failed: the robot at .* hung up",
}
"""What those examples are there to show; the others say something."""
PAGES = ("README.md", "docs/planning.md")
CODE = [
    (page, code)
    for page in PAGES
    for code in re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.MULTILINE | re.DOTALL)
]


def run(code: str | Path, folder: Path) -> str:
    command = [sys.executable, str(code)] if isinstance(code, Path) else [sys.executable, "-c", code]
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_there_are_examples():
    assert len(EXAMPLES) >= 3
    assert {page for page, _ in CODE} == set(PAGES)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_and_says_something(path: Path, tmp_path: Path):
    assert re.search(SAYS.get(path.stem, r"\S"), run(path, tmp_path))


@pytest.mark.parametrize(("page", "code"), CODE)
def test_code_of_a_page_runs(page: str, code: str, tmp_path: Path):
    assert run(code, tmp_path).strip()
