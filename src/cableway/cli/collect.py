"""`cableway collect`: simulated transitions, to train deformation models on; or whole runs, to learn policies from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cableway.cli.interrupts import CONTINUES, INTERRUPTS
from cableway.cli.options import Maybe, WorkerOptions
from cableway.cli.terminal import Terminal, pairs
from cableway.core.errors import InputError

if TYPE_CHECKING:
    from cableway.simulation.episodes import CollectionConfig


@dataclass(frozen=True, kw_only=True)
class Collect(WorkerOptions):
    """Collect transitions of a simulated cable in random motion, or with --episodes whole runs of a controller;
    continues an interrupted collection."""

    config: Maybe[Path] = None
    """YAML file whose section `collection` says what to collect; by default, that of the shipped model."""

    transitions: Maybe[int] = None
    """Number of transitions; by default, as the configuration says."""

    episodes: Maybe[int] = None
    """Number of runs of a controller, each with a plan of its own; a folder that has some of them gets the others."""

    task: Maybe[str] = None
    """With --episodes: the task of all runs; by default, a random one for each."""

    kind: str = "clutter"
    """With --episodes: kind of the random tasks, as of `cableway tasks --random`."""

    plants: Annotated[str, tyro.conf.arg(metavar="NAME,...")] = "nominal"
    """With --episodes: plants, which runs have in turn."""

    controller: str = "rod-mpc"
    """With --episodes: who leads."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.episodes is None:
            for name in ("task", "kind", "plants", "controller"):
                if getattr(self, name) != getattr(type(self), name):
                    raise InputError(f"--{name}: only goes with --episodes")
        elif self.config is not None or self.transitions is not None:
            raise InputError("--episodes: goes with neither --config nor --transitions")

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        if self.episodes is not None:
            return self._runs(self.episodes)
        from cableway.simulation.collection import collect

        terminal, folder, config = Terminal(self), self.folder("collect"), self.configuration()
        INTERRUPTS.kept = partial(_kept, folder)
        with terminal.progress() as progress:
            manifest, made = collect(config, folder, progress=progress, workers=self.workers, executor=self.executor)
        episodes = sum(manifest.episodes_ended.values())
        report = {
            "folder": str(folder), "transitions": manifest.transitions, "episodes": episodes,
            "shards": len(manifest.shards), "made_now": made, "seed": config.seed,
        }  # fmt: skip
        terminal.result(report, pairs([(name.replace("_", " "), str(value)) for name, value in report.items()]))
        return 0

    def _runs(self, episodes: int) -> int:
        """Collect whole runs."""
        from cableway.datasets.runs import count_runs
        from cableway.workflow.collecting import RunsConfig, collect_runs

        plants, seed = tuple(self.plants.split(",")), self.seed or 0
        config = RunsConfig(
            episodes=episodes, task=self.task, kind=self.kind, plants=plants, controller=self.controller, seed=seed
        )
        terminal, folder = Terminal(self), self.folder("episodes")
        INTERRUPTS.kept = partial(_kept_runs, folder)
        with terminal.progress() as progress:
            made = collect_runs(config, folder, progress=progress, workers=self.workers, executor=self.executor)
        count, succeeded = count_runs(folder)
        report = {"folder": str(folder), "runs": count, "succeeded": succeeded, "made_now": made, "seed": seed}
        terminal.result(report, pairs([(name.replace("_", " "), str(value)) for name, value in report.items()]))
        return 0

    def configuration(self) -> CollectionConfig:
        """What the options ask for.

        Raises:
            FileFormatError: The configuration file is missing or not YAML.
            InputError: A section or key is unknown, or a value is not allowed.
        """
        from cableway.core.configuration import from_mapping
        from cableway.scene.files.presets import preset_values
        from cableway.simulation.episodes import CollectionConfig
        from cableway.tang2025.models.recipe import read_training_config, shipped_config

        path = self.config or shipped_config()
        section = read_training_config(path).collection
        cable = section.get("cable")
        if isinstance(cable, dict) and "preset" in cable:
            section["cable"] = {**preset_values(str(cable["preset"])), **cable}
        config = from_mapping(CollectionConfig, section, f"{path}: collection")
        given: dict[str, Any] = {"transitions": self.transitions, "seed": self.seed}
        return replace(config, **{name: value for name, value in given.items() if value is not None})


def _kept_runs(folder: Path) -> str:
    """How many runs there are so far, in words."""
    from cableway.datasets.runs import count_runs, is_runs

    count = count_runs(folder)[0] if is_runs(folder) else 0
    return f"{count} runs are in {folder}, {CONTINUES}" if count else ""


def _kept(folder: Path) -> str:
    """What a collection has kept so far, in words."""
    from cableway.datasets.manifest import MANIFEST, read_manifest

    if not (folder / MANIFEST).exists():
        return ""
    return f"{read_manifest(folder).transitions} transitions are in {folder}, {CONTINUES}"
