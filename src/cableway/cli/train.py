"""`cableway train`: a deformation model from collected transitions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cableway.cli.interrupts import CONTINUES, INTERRUPTS
from cableway.cli.models import HORIZONS, error_at
from cableway.cli.options import Maybe, PictureOptions, option
from cableway.cli.terminal import Terminal, pairs
from cableway.core.errors import InputError

if TYPE_CHECKING:
    from cableway.figures.style import Figure
    from cableway.tang2025.models.learned import LearnedModel
    from cableway.tang2025.models.recipe import Recipe


@dataclass(frozen=True, kw_only=True)
class Train(PictureOptions):
    """Train a deformation model; continues an interrupted training. `--out` is a folder or a file."""

    data: tuple[Path, ...] = (Path("runs/collect"),)
    """Data sets from `cableway collect`, or recordings (CSV, NPZ, YAML); several are mixed."""

    config: Maybe[Path] = None
    """YAML file whose sections `model` and `training` say what to train; by default, those of --model."""

    model: str = "transformer"
    """Shipped model to train anew where there is no `--config`: bilstm, conv, hybrid, linear, mlp, rod, transformer,
    tang2025-bdm, tang2025-cdm, tang2025-tdm."""

    start: Annotated[str | None, option(name="from")] = None
    """A shipped model or a model file to start from; the kind stays the same. By default, weights are random."""

    devices: Maybe[int] = None
    """Number of JAX devices that share each batch; by default, as the configuration says."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.core.files import only_writer
        from cableway.datasets.reading import load_transitions
        from cableway.tang2025.models.card import write_card
        from cableway.tang2025.models.compilation import enable_compilation_cache
        from cableway.tang2025.models.dataset import joined
        from cableway.tang2025.models.recipe import make_model_file, state_file

        terminal, path = Terminal(self), self.target("train", "model.safetensors")
        start = self._start()
        recipe = self._recipe(start)
        data = joined([load_transitions(folder) for folder in self.data])
        if not enable_compilation_cache():
            terminal.note("The training step is compiled before it starts; the next run finds it in your cache folder.")
        state = state_file(path)
        INTERRUPTS.kept = lambda: f"the training so far is in {state}, {CONTINUES}" if state.exists() else ""
        with only_writer(path.parent), terminal.progress() as progress:
            card = make_model_file(
                path, recipe, data, start=start, progress=lambda words, share: progress(f"train: {words}", share)
            )
            page, picture = write_card(path), path.with_suffix(".png")
            self.draw(_figure(card["history"]), picture)
        errors = {f"{steps}": error_at(card, steps) for steps in HORIZONS}
        report = {
            "file": str(path), "card": str(page), "picture": str(picture), "kind": card["kind"],
            "parameters": card["parameters"], "epochs": len(card["history"]), "mean_error_mm": errors,
        }  # fmt: skip
        rows = [(name, str(value)) for name, value in report.items() if name != "mean_error_mm"]
        rows += [(f"held-out error, {steps} steps", f"{value:.2f} mm") for steps, value in errors.items() if value]
        terminal.result(report, pairs(rows))
        return 0

    def _start(self) -> LearnedModel | None:
        from cableway.tang2025.models.checkpoint import load_model
        from cableway.tang2025.models.learned import LearnedModel

        if self.start is None:
            return None
        model = load_model(self.start)
        if not isinstance(model, LearnedModel):
            raise InputError(f"--from {self.start}: models of this kind cannot be trained")
        return model

    def _recipe(self, start: LearnedModel | None) -> Recipe:
        from cableway.tang2025.models.recipe import read_training_config, shipped_config

        recipe = read_training_config(self.config or shipped_config(self.model))
        given = {"seed": self.seed, "devices": self.devices}
        changed = {name: value for name, value in given.items() if value is not None}
        recipe = replace(recipe, training=replace(recipe.training, **changed))
        return recipe if start is None else replace(recipe, model=start.config)


def _figure(history: list[dict[str, Any]]) -> Figure:
    """The learning curve."""
    from cableway.figures.learning import learning_figure

    return learning_figure([row["loss"] for row in history], [row["validation_error"] for row in history])
