"""Every example, and the Python of README and pages, runs as it stands, in a folder of its own; of a notebook, what its
cells show is asked for.

Where a page reads the data set `set`, there is a small one. Files that a page names are in `test_pages.py`.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from cableway.simulation.collection import collect
from cableway.simulation.episodes import CollectionConfig

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
NOTEBOOKS = sorted((ROOT / "examples").glob("[0-9]*.ipynb"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SAYS = {
    "04_replay_a_recording": r"RodMPC +would have .* 0\.00 mm \(median\), 0\.00 mm \(most\)",
    "05_a_robot_over_a_socket": r"steps, settled\n.*\n\d+ steps, plant failed, .*hung up",
    "07_a_robot_in_real_time": r"^settled, 0\.\d mm\n",
    "08_the_table_in_the_base_of_an_arm": r"the edges are 90\.01 degrees apart",
    "10_a_policy_by_imitation": r"the network succeeds in \d+ of 12 episodes, the controller in 1[12]",
}
"""What those examples are there to show; the others say something."""
CODE = [
    (page.name, code)
    for page in PAGES
    for code in re.findall(r"^```python\n((?!# [\w-]+\.py\n|>>>).*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
]


def run(code: str | Path, folder: Path) -> str:
    command = [sys.executable, str(code)] if isinstance(code, Path) else [sys.executable, "-c", code]
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_there_are_examples():
    assert len(EXAMPLES) >= 3
    assert {page for page, _ in CODE} >= {"README.md", "models.md", "datasets.md"}


def test_a_method_of_ones_own_takes_less_than_forty_lines():
    (path,) = (path for path in EXAMPLES if "method" in path.stem)
    assert len(path.read_text().splitlines()) < 40


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_and_says_something(path: Path, tmp_path: Path):
    assert re.search(SAYS.get(path.stem, r"\S"), run(path, tmp_path))


SHOW = """
import ast, json, sys

def last(code, names):
    body = ast.parse(code).body
    shown = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    return None if shown is None else eval(compile(ast.Expression(shown.value), "cell", "eval"), names)

names = {}
for cell in json.load(open(sys.argv[1]))["cells"]:
    if cell["cell_type"] == "code":
        value = last("".join(cell["source"]), names)
        print(type(value).__name__, "" if value is None else value._repr_html_()[:100000])
"""
"""Runs a notebook as Jupyter does, and prints what the last value of each cell shows."""


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_and_shows(path: Path, tmp_path: Path):
    (tmp_path / "show.py").write_text(SHOW)
    done = subprocess.run([sys.executable, "show.py", path], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    shown = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert list(shown) == ["Task", "Plan", "Report", "Animation"]
    assert all("data:image/png;base64," in shown[name] for name in ("Task", "Plan"))
    assert "<video" in shown["Animation"]
    assert "success" in shown["Report"]
    assert not any(cell.get("outputs") for cell in json.loads(path.read_text())["cells"])


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "set"
    collect(CollectionConfig(transitions=600), folder)
    return folder


@pytest.mark.parametrize(("page", "code"), CODE)
def test_code_of_a_page_runs(page: str, code: str, tmp_path: Path, data: Path):
    (tmp_path / "set").symlink_to(data)
    assert run(code, tmp_path).strip()
