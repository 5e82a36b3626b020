"""Data and models of the reproduction: collected, identified and fine-tuned once, then kept in its folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from cableway.datasets.transitions import Transitions
from cableway.scene.files.loading import cable_from_preset
from cableway.tang2025.reproduction.page import OnProgress

if TYPE_CHECKING:
    from cableway.tang2025.models.learned import LearnedModel
    from cableway.tang2025.models.recipe import Recipe

EPOCHS, IDENTIFICATION_SEED = 40, 302
"""Epochs in which a model is identified from random weights, and seed of the data for it."""

TUNING_EPOCHS, TUNING_RATE, TUNING_SEED = 5, 3e-4, 303
"""Epochs and learning rate of fine-tuning, a tenth of that of the shipped training; seed of the data for it."""


def collected(cable: str, folder: Path, transitions: int, seed: int) -> Transitions:
    """Simulated transitions of the cable of a preset; those that are in the folder are not simulated again."""
    from cableway.datasets.reading import load_transitions
    from cableway.simulation.collection import collect
    from cableway.simulation.episodes import CollectionConfig

    collect(CollectionConfig(transitions=transitions, seed=seed, cable=cable_from_preset(cable)), folder)
    return load_transitions(folder)


def identified(kind: str, cable: str, folder: Path, transitions: int, progress: OnProgress) -> LearnedModel:
    """A model of that kind and the shipped size, trained on data of one cable alone."""
    recipe = _shipped(kind)
    recipe = replace(recipe, training=replace(recipe.training, epochs=EPOCHS))
    data = collected(cable, folder / "data" / f"{cable}-{transitions}", transitions, IDENTIFICATION_SEED)
    return _trained(recipe, data, None, folder / "models" / f"{kind}-{cable}-{transitions}.safetensors", progress)


def fine_tuned(kind: str, cable: str, folder: Path, transitions: int, progress: OnProgress) -> LearnedModel:
    """The shipped model of that kind, trained on with data of one cable."""
    recipe = _shipped(kind)
    rollouts = min(1, recipe.training.rollout_epochs)
    training = replace(recipe.training, epochs=TUNING_EPOCHS, rollout_epochs=rollouts, learning_rate=TUNING_RATE)
    data = collected(cable, folder / "data" / f"{cable}-tuning-{transitions}", transitions, TUNING_SEED)
    path = folder / "models" / f"{kind}-{cable}-tuned-{transitions}.safetensors"
    return _trained(replace(recipe, training=training), data, kind, path, progress)


def _shipped(kind: str) -> Recipe:
    from cableway.tang2025.models.recipe import read_training_config, shipped_config

    return read_training_config(shipped_config(kind))


def _trained(recipe: Recipe, data: Transitions, start: str | None, path: Path, progress: OnProgress) -> LearnedModel:
    """The model in the file, which is made where it is not there; `start` names the one that it goes on from."""
    from cableway.tang2025.models.checkpoint import load_model
    from cableway.tang2025.models.learned import LearnedModel
    from cableway.tang2025.models.recipe import make_model_file

    def loaded(name: str) -> LearnedModel:
        model = load_model(name)
        assert isinstance(model, LearnedModel)
        return model

    if not path.exists():
        first = None if start is None else loaded(start)
        make_model_file(
            path, recipe, data, start=first, progress=lambda words, share: progress(f"{path.stem}: {words}", share)
        )
    return loaded(str(path))
