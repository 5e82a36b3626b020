"""`cableway collect`: simulated transitions, to train deformation models on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cableway.cli.options import Options
from cableway.cli.terminal import Terminal, pairs

if TYPE_CHECKING:
    from cableway.simulation.collection import CollectionConfig


@dataclass(frozen=True, kw_only=True)
class Collect(Options):
    """Collect transitions of a simulated cable led at random; `--out` is a folder or a file ending in .npz."""

    config: Path | None = None
    """YAML file whose section `collection` says what to collect; the one of the shipped model unless given."""

    transitions: int | None = None
    """How many, in place of what the configuration says."""

    workers: int = 1
    """Processes that simulate; the data do not depend on it."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.simulation.collection import collect

        terminal, path, config = Terminal(self), self.target("collect", "data.npz"), self._config()
        with terminal.progress() as tell:
            data = collect(config, progress=tell, workers=self.workers)
        data.save(path)
        episodes = len(set(data.episode.tolist()))
        report = {"file": str(path), "transitions": len(data), "episodes": episodes, "seed": config.seed}
        terminal.result(report, pairs([(name, str(value)) for name, value in report.items()]))
        return 0

    def _config(self) -> CollectionConfig:
        from cableway.models.configuration import from_mapping
        from cableway.models.recipe import read_training_config, shipped_config
        from cableway.simulation.collection import CollectionConfig

        path = self.config or shipped_config()
        config = from_mapping(CollectionConfig, read_training_config(path).collection, f"{path}: collection")
        given: dict[str, Any] = {"transitions": self.transitions, "seed": self.seed}
        return replace(config, **{name: value for name, value in given.items() if value is not None})
