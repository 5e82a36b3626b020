"""Whole runs on disk: a folder with one folder for each, which has the files that `cableway run` leaves.

`report.json` is written last, so that a run that has one is whole; others are made again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cableway.core.errors import FileFormatError, InputError
from cableway.core.files import write_json
from cableway.core.reading import read_json
from cableway.records import Rollout
from cableway.scene.files.loading import load_planar_task
from cableway.scene.files.saving import save_task
from cableway.scene.task import Task

FORMAT, VERSION = "cableway-runs", 1

MANIFEST = "runs.json"
"""What all runs have in common, and how they are drawn."""

TASK, ROLLOUT, REPORT = "task.yaml", "rollout.npz", "report.json"
"""Files of a run."""


@dataclass(frozen=True, eq=False)
class StoredRun:
    """A run that was read.

    Attributes:
        number: Which of the folder's.
        task: What was to be done.
        rollout: What happened; None where no plan was found.
        report: The plain data of its report, with `plant`.
    """

    number: int
    task: Task
    rollout: Rollout | None
    report: Mapping[str, Any]

    @property
    def success(self) -> bool:
        """Whether the task succeeded."""
        return self.report.get("success") is True


def run_folder(folder: Path, number: int) -> Path:
    """Where a run is."""
    return folder / f"run-{number:06d}"


def open_runs(folder: Path, config: Mapping[str, Any]) -> None:
    """Say in a folder what its runs are drawn by, or check that it says so.

    Raises:
        InputError: It holds runs that are drawn otherwise, or something else.
    """
    path = folder / MANIFEST
    if path.exists():
        found = _manifest(path)["config"]
        for name in sorted({*found, *config}):
            if found.get(name) != config.get(name):
                raise InputError(f"{folder}: holds runs with {name} {found.get(name)!r}, not {config.get(name)!r}")
        return
    if folder.is_dir() and any(not each.name.startswith(".") for each in folder.iterdir()):
        raise InputError(f"{folder}: there is something else in this folder")
    write_json(path, {"format": FORMAT, "version": VERSION, "config": dict(config)})


def is_runs(folder: Path) -> bool:
    """Whether a folder holds runs."""
    return (folder / MANIFEST).is_file()


def is_whole(folder: Path, number: int) -> bool:
    """Whether a run is there."""
    return (run_folder(folder, number) / REPORT).is_file()


def write_run(folder: Path, number: int, task: Task, rollout: Rollout | None, report: Mapping[str, Any]) -> None:
    """Write a run."""
    place = run_folder(folder, number)
    save_task(task, place / TASK)
    if rollout is not None:
        rollout.save(place / ROLLOUT)
    write_json(place / REPORT, dict(report))


def count_runs(folder: Path) -> tuple[int, int]:
    """How many runs of a folder are whole, and how many of them succeeded."""
    reports = [read_json(place / REPORT) for place in folder.glob("run-[0-9]*") if (place / REPORT).is_file()]
    return len(reports), sum(report.get("success") is True for report in reports)


def read_runs(folder: Path) -> Iterator[StoredRun]:
    """The runs of a folder that are whole, in the order of their numbers.

    Raises:
        FileFormatError: The folder holds no runs, or a file is damaged.
    """
    _manifest(folder / MANIFEST)
    for place in sorted(folder.glob("run-[0-9]*")):
        if not (place / REPORT).is_file():
            continue
        report = read_json(place / REPORT)
        if not isinstance(report, dict) or not place.name[4:].isdigit():
            raise FileFormatError(f"{place / REPORT}: not the report of a run")
        rollout = Rollout.load(place / ROLLOUT) if (place / ROLLOUT).exists() else None
        yield StoredRun(int(place.name[4:]), load_planar_task(place / TASK), rollout, report)


def _manifest(path: Path) -> dict[str, Any]:
    content = read_json(path)
    sound = isinstance(content, dict) and isinstance(content.get("config"), dict)
    if not sound or content.get("format") != FORMAT or content.get("version") != VERSION:
        raise FileFormatError(f"{path}: not the manifest of {FORMAT}, version {VERSION}")
    return content
