"""The built wheel, in an empty environment, outside the repository."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

ROOT = Path(__file__).resolve().parents[1]


def run(command: Sequence[str | Path], folder: Path, **variables: str) -> str:
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")} | variables
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{command} ended with {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder], ROOT)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def command(wheel: Path) -> Iterator[Path]:
    """The installed `cableway`, with its dependencies at the locked versions and without extras."""
    with TemporaryDirectory(prefix="cableway-") as name:
        folder = Path(name)
        run([sys.executable, "-m", "venv", folder / "venv"], folder)
        install(str(wheel), folder)
        yield folder / "venv" / "bin" / "cableway"


def install(requirement: str, folder: Path) -> None:
    environment, locked = folder / "venv", folder / "locked.txt"
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    locked.write_text("\n".join(line.rstrip("\\ ") for line in lines if not line.startswith((" ", "#"))) + "\n")
    uv = Path(sys.executable).parent / "uv"
    options = ["--quiet", "--only-binary", ":all:", "--constraint", locked, requirement]
    if uv.exists():
        run([uv, "pip", "install", *options], folder, VIRTUAL_ENV=str(environment))
    else:
        run([environment / "bin" / "python", "-m", "pip", "install", *options], folder)


def test_it_holds_tasks_weights_types_and_attribution(wheel: Path):
    names = zipfile.ZipFile(wheel).namelist()
    assert len([n for n in names if n.startswith("cableway/scene/files/catalogue/") and n.endswith(".yaml")]) == 11
    assert any(n.startswith("cableway/tang2025/models/weights/") and n.endswith(".safetensors") for n in names)
    for wanted in (
        "cableway/py.typed",
        "cableway/scene/files/catalogue/NOTICE",
        "cableway/scene/files/catalogue/cable_presets.yml",
    ):
        assert wanted in names
    assert any(n.endswith("licenses/LICENSE") for n in names)
    assert not [n for n in names if not n.startswith(("cableway/", "cableway-"))]


def test_it_asks_for_no_developer_tools_and_no_extra(command: Path):
    assert not (command.parent / "pytest").exists()
    installed = {path.name for path in command.parents[1].glob("lib/python*/site-packages/*")}
    assert "mujoco" in installed
    assert not installed & {"casadi", "equinox", "jax", "jaxlib", "ompl", "optax", "ray"}


def test_help_and_tasks(command: Path, tmp_path: Path):
    assert "plan" in run([command, "--help"], tmp_path)
    assert "maze-1" in run([command, "tasks"], tmp_path)
    assert "plan" in run([command.parent / "python", "-m", "cableway", "--help"], tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_plan_and_check_a_task(command: Path, tmp_path: Path):
    run([command, "plan", "single-obstacle-2", "--out", "out", "--quiet"], tmp_path)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["success"] is True
    for name in ("plan.npz", "plan.png"):
        assert (tmp_path / "out" / name).stat().st_size > 0
    run([command, "check", "single-obstacle-2", "out/plan.npz"], tmp_path)


def test_track_a_task(command: Path, tmp_path: Path):
    run([command, "run", "single-obstacle-2", "--out", "out", "--quiet"], tmp_path)
    assert json.loads((tmp_path / "out" / "report.json").read_text())["success"] is True


@pytest.mark.parametrize(
    "arguments",
    ["plan single-obstacle-1 --planner tang2025", "run single-obstacle-1 --controller neural-mpc", "models"],
)
def test_what_needs_the_extra_says_so_in_one_sentence(command: Path, tmp_path: Path, arguments: str):
    done = subprocess.run([command, *arguments.split()], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].endswith("which are not installed: pip install 'cableway[tang2025]'")
    assert "Traceback" not in done.stderr


def test_with_the_extra_it_knows_the_shipped_model(wheel: Path, command: Path, tmp_path: Path):
    install(f"{wheel}[tang2025]", command.parents[2])
    assert "transformer" in run([command, "models"], tmp_path)
