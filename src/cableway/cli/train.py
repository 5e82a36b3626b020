"""`cableway train`: a deformation model from collected transitions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from cableway.cli.models import HORIZONS, error_at
from cableway.cli.options import Options
from cableway.cli.terminal import Terminal, pairs

if TYPE_CHECKING:
    from cableway.models.recipe import Recipe


@dataclass(frozen=True, kw_only=True)
class Train(Options):
    """Train a deformation model, going on where an interrupted training stopped; `--out` is a folder or a file."""

    data: Path = Path("runs/collect")
    """A data set from `cableway collect`."""

    config: Path | None = None
    """YAML file whose sections `model` and `training` say what to train; the shipped model's unless given."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.datasets.reading import load_transitions
        from cableway.models.card import write_card
        from cableway.models.checkpoint import save_model
        from cableway.models.compilation import enable_compilation_cache
        from cableway.models.recipe import make_model

        terminal, path, recipe = Terminal(self), self.target("train", "model.safetensors"), self._recipe()
        data = load_transitions(self.data)
        state = path.with_name(f"{path.name}.state")
        if not enable_compilation_cache():
            terminal.note("The training step is compiled before it starts; the next run finds it in your cache folder.")
        path.parent.mkdir(parents=True, exist_ok=True)
        with terminal.progress() as tell:
            model, card = make_model(
                recipe, data, state_file=state, progress=lambda words, share: tell(f"train: {words}", share)
            )
        save_model(path, model, card)
        page = write_card(path)
        errors = {f"{steps}": error_at(card, steps) for steps in HORIZONS}
        report = {
            "file": str(path), "card": str(page), "kind": card["kind"], "parameters": card["parameters"],
            "mean_error_mm": errors,
        }  # fmt: skip
        rows = [(name, str(report[name])) for name in ("file", "card", "kind", "parameters")]
        rows += [(f"held-out error, {steps} steps", f"{value:.2f} mm") for steps, value in errors.items() if value]
        terminal.result(report, pairs(rows))
        return 0

    def _recipe(self) -> Recipe:
        from cableway.models.recipe import read_training_config, shipped_config

        recipe = read_training_config(self.config or shipped_config())
        return recipe if self.seed is None else replace(recipe, training=replace(recipe.training, seed=self.seed))
