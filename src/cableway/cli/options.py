"""The options that every command has."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import tyro

from cableway.core.errors import InputError, TaskError, UnknownNameError

if TYPE_CHECKING:
    from cableway.figures.style import Figure
    from cableway.scene.files.loading import AnyTask
    from cableway.scene.task import Task

REPORT = "report.json"
"""Name of the file of a command's figures."""

VECTOR = ("svg", "pdf")
"""Formats of vector graphics."""

LARGEST_SEED = 2**31 - 1
"""What the narrowest random generator in use takes: OMPL's and JAX's keys are 32 bits."""


def option(**given: Any) -> object:
    """`tyro.conf.arg` for an option whose help says in words what happens without it."""
    return tyro.conf.arg(help_behavior_hint="", **given)


T = TypeVar("T")
Maybe = Annotated[T | None, option()]
Flag = Annotated[bool, option()]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options that every command has."""

    out: Maybe[Path] = None
    """Folder for the results; by default, runs/<task or command>."""

    seed: Maybe[int] = None
    """Seed of all random numbers; by default, that of the configuration, or 0."""

    quiet: Flag = False
    """Print nothing but errors."""

    json: Flag = False
    """Print the report alone, as JSON, on stdout."""

    log: Maybe[Path] = None
    """File to which all that the command does is added, with times; by default, nothing is logged."""

    def __post_init__(self) -> None:
        if self.seed is not None and not 0 <= self.seed <= LARGEST_SEED:
            raise InputError(f"--seed must be from 0 to {LARGEST_SEED}, got {self.seed}")

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        raise NotImplementedError

    def folder(self, name: str) -> Path:
        """The folder for results, which need not exist yet.

        Raises:
            InputError: It is a file.
        """
        folder = self.out if self.out is not None else Path("runs") / name
        if folder.exists() and not folder.is_dir():
            raise InputError(f"--out {folder}: a file with this name exists; give a folder")
        return folder

    def keep(self, name: str, report: Any) -> None:
        """Write a report, only where `--out` says where to."""
        from cableway.core.files import only_writer, write_json

        if self.out is not None:
            with only_writer(folder := self.folder(name)):
                write_json(folder / REPORT, report)

    def target(self, name: str, default: str, *others: str) -> Path:
        """The one file of a command: `--out` itself where it ends as `default` or `others` do, else `default` in the
        folder."""
        if self.out is not None and self.out.suffix.lower() in (Path(default).suffix, *others):
            return self.out
        return self.folder(name) / default


@dataclass(frozen=True, kw_only=True)
class PictureOptions(Options):
    """Options of the commands that draw."""

    vector: Annotated[str | None, option(metavar="{svg,pdf}")] = None
    """Write pictures as vector graphics, too, beside the PNG files; by default, as PNG alone."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.vector not in (None, *VECTOR):
            raise UnknownNameError("vector format", self.vector, VECTOR)

    def draw(self, figure: Figure, path: Path) -> None:
        """Write a picture to a file, and to another one beside it where `--vector` asks for it."""
        from cableway.figures.style import save_figure

        save_figure(figure, path)
        if self.vector is not None:
            save_figure(figure, path.with_suffix(f".{self.vector}"))


@dataclass(frozen=True, kw_only=True)
class WorkerOptions(Options):
    """Options of the commands that simulate much."""

    workers: Maybe[int] = None
    """Simulations that run in parallel; by default, one per core. The results do not depend on it."""

    executor: Annotated[str, tyro.conf.arg(metavar="{local,ray}")] = "local"
    """Where they run: local, or ray (`pip install 'cableway[ray]'`) on the cluster at RAY_ADDRESS."""


@dataclass(frozen=True, kw_only=True)
class TaskOptions(Options):
    """Options of the commands on one task."""

    task: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="TASK")]
    """Name in the catalogue, or a YAML file."""

    def load(self) -> Task:
        """The task, on the table.

        Raises:
            InputError: There is none of that name, its file cannot be read, or it is in space; where `show` can draw
                what no cable can do, the message says so.
        """
        from cableway.scene.files.loading import as_task

        return as_task(self.load_any())

    def load_any(self) -> AnyTask:
        """As `load`, or one in space."""
        from cableway.scene.files.loading import load_task

        try:
            return load_task(self.task)
        except TaskError as error:
            if error.draft is None:
                raise
            raise InputError(f"{error}; cableway show {shlex.quote(self.task)} draws it") from None
