"""Commands run as a user runs them, but in this process and in an empty folder."""

from __future__ import annotations

from pathlib import Path

import problems
import pytest
from commands import Command, Done

from cableway.cli import main
from cableway.scene.files.saving import save_task


@pytest.fixture
def cableway(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs a command in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> Done:
        capsys.readouterr()
        status = main([str(argument) for argument in arguments])
        printed = capsys.readouterr()
        return Done(status, printed.out, printed.err)

    return run


@pytest.fixture(scope="session")
def moved_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A task file that is quickly planned."""
    path = tmp_path_factory.mktemp("tasks") / "moved.yaml"
    save_task(problems.moved(), path)
    return path


@pytest.fixture(scope="session")
def sealed_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A task file without a solution."""
    path = tmp_path_factory.mktemp("tasks") / "sealed.yaml"
    save_task(problems.sealed(), path)
    return path


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory, moved_file: Path) -> Path:
    """What `cableway run` leaves, with the open-loop controller, which needs no model."""
    folder = tmp_path_factory.mktemp("run") / "moved"
    command = ["run", str(moved_file), "--controller", "open-loop", "--seed", "3", "--quiet", "--out", str(folder)]
    assert main(command) == 0
    return folder
