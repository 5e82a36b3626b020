"""`cableway models`: shipped and local deformation models with their figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.text import Text

from cableway.cli.options import Maybe, Options, option
from cableway.cli.terminal import Terminal, columns
from cableway.core.errors import FileFormatError

HORIZONS = (1, 10, 30)
"""Steps ahead at which errors are listed."""


@dataclass(frozen=True, kw_only=True)
class Models(Options):
    """List the shipped models, those below runs/, and those named, with their held-out errors."""

    out: Maybe[Path] = None
    """Folder for report.json; by default, none is written."""

    files: Annotated[tyro.conf.Positional[tuple[Path, ...]], option(metavar="[FILE ...]")] = ()
    """Other model files."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.datasets.manifest import MANIFEST
        from cableway.tang2025.models.checkpoint import model_names, read_card

        terminal, sources = Terminal(self), [*model_names(), *self.files]
        rows = [_row(str(source), read_card(source)) for source in sources]
        for path in sorted(Path("runs").rglob("*.safetensors")):
            if path in sources or (path.parent / MANIFEST).exists():  # named already, or a shard of a data set
                continue
            try:
                rows.append(_row(str(path), read_card(path)))
            except FileFormatError as error:
                terminal.note(f"Left out: {error}.")
        names = [f"{steps} steps" for steps in HORIZONS]
        caption = "Mean stacked error of open-loop prediction on held-out episodes."
        table = columns("model", "kind", "parameters", "transitions", *names, caption=caption)
        for row in rows:
            errors = [_text(row["mean_error_mm"][f"{steps}"]) for steps in HORIZONS]
            facts = (row["kind"], str(row["parameters"]), str(row["transitions"]))
            table.add_row(*map(Text, (row["model"], *facts)), *errors)
        report = {"models": rows}
        self.keep("models", report)
        terminal.result(report, table)
        return 0


def error_at(card: Mapping[str, Any], steps: int) -> float | None:
    """The mean stacked held-out error [mm] after `steps` steps that a model's card states."""
    rows = card.get("errors", {}).get("model", [])
    return next((float(row["mean"]) for row in rows if row.get("horizon") == steps), None)


def _row(name: str, card: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "model": name,
        "kind": str(card.get("kind", "")),
        "parameters": card.get("parameters"),
        "transitions": card.get("data", {}).get("training_transitions"),
        "mean_error_mm": {f"{steps}": error_at(card, steps) for steps in HORIZONS},
    }


def _text(millimetres: float | None) -> str:
    return "" if millimetres is None else f"{millimetres:.2f} mm"
