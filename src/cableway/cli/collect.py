"""`cableway collect`: simulated transitions, to train deformation models on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cableway.cli.interrupts import CONTINUES, INTERRUPTS
from cableway.cli.options import Maybe, WorkerOptions
from cableway.cli.terminal import Terminal, pairs

if TYPE_CHECKING:
    from cableway.simulation.episodes import CollectionConfig


@dataclass(frozen=True, kw_only=True)
class Collect(WorkerOptions):
    """Collect transitions of a simulated cable in random motion; continues an interrupted collection."""

    config: Maybe[Path] = None
    """YAML file whose section `collection` says what to collect; by default, that of the shipped model."""

    transitions: Maybe[int] = None
    """Number of transitions; by default, as the configuration says."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
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


def _kept(folder: Path) -> str:
    """What a collection has kept so far, in words."""
    from cableway.datasets.manifest import MANIFEST, read_manifest

    if not (folder / MANIFEST).exists():
        return ""
    return f"{read_manifest(folder).transitions} transitions are in {folder}, {CONTINUES}"
