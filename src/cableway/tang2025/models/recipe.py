"""A training as one file: what is collected, which model, how it is trained; and carrying that out."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cableway.core.checks import shown
from cableway.core.configuration import from_mapping
from cableway.core.errors import InputError, UnknownNameError
from cableway.core.provenance import describe, versions
from cableway.datasets.transitions import Transitions
from cableway.scene.files.document import read_document
from cableway.tang2025.models.checkpoint import save_model
from cableway.tang2025.models.dataset import fingerprint
from cableway.tang2025.models.evaluation import baselines, evaluate
from cableway.tang2025.models.learned import LearnedConfig, LearnedModel
from cableway.tang2025.models.networks import KINDS
from cableway.tang2025.models.training import Progress, TrainingConfig, train

LOGGER = logging.getLogger(__name__)

CONFIGS = Path(__file__).parent / "configs"
"""Folder of the configurations that the shipped weights were made from."""

VERSION = 1
"""Version of the file format, under the key `cableway`."""

SECTIONS = ("cableway", "collection", "model", "training")


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """What a model is made from.

    Attributes:
        collection: How transitions are collected; plain data for the simulation's configuration.
        model: The model; its class says the kind.
        training: How it is trained.
    """

    collection: dict[str, Any]
    model: LearnedConfig
    training: TrainingConfig


def shipped_config(name: str = "transformer") -> Path:
    """The configuration that the shipped weights of this name were made from.

    Raises:
        UnknownNameError: There is none.
    """
    known = sorted(path.stem for path in CONFIGS.glob("*.yaml"))
    if name not in known:
        raise UnknownNameError("model configuration", name, known)
    return CONFIGS / f"{name}.yaml"


def read_training_config(path: Path | str) -> Recipe:
    """A recipe from a YAML file with the sections `collection`, `model` (with its `kind`) and `training`.

    Raises:
        FileFormatError: The file is missing or not YAML.
        InputError: A section or key is missing or unknown, or a value is not allowed.
    """
    content = read_document(Path(path)).data
    for key in content:
        if key not in SECTIONS:
            raise InputError(f"{path}: unknown section {shown(key)}; known: {', '.join(SECTIONS)}")
    if content.get("cableway") != VERSION:
        raise InputError(
            f"{path}: cableway must be {VERSION}, the version of the format, got {shown(content.get('cableway'))}"
        )
    collection, model = content.get("collection", {}), content.get("model", {})
    for name, section in (("collection", collection), ("model", model)):
        if not isinstance(section, Mapping):
            raise InputError(f"{path}: {name} must be a mapping of keys to values, got {shown(section)}")
    kind = model.get("kind", "transformer")
    if str(kind) not in KINDS:
        raise InputError(f"{path}: model.kind must be one of {', '.join(sorted(KINDS))}, got {shown(kind)}")
    fields = {key: value for key, value in model.items() if key != "kind"}
    return Recipe(
        collection=dict(collection),
        model=from_mapping(KINDS[str(kind)], fields, f"{path}: model"),
        training=from_mapping(TrainingConfig, content.get("training", {}), f"{path}: training"),
    )


def make_model_file(
    path: Path,
    recipe: Recipe,
    data: Transitions,
    *,
    start: LearnedModel | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Make a model and save it; interrupted and called again, it goes on, and ends with the same file.

    Until the model is saved, the state of the training is in `state_file(path)`.

    Args:
        path: Where to.
        recipe: What to make.
        data: The transitions.
        start: A model of the recipe's configuration to go on from.
        progress: Called with the stage in words and the fraction done.

    Returns:
        The model's card.
    """
    state = state_file(path)
    model, card = make_model(recipe, data, start=start, state_file=state, progress=progress)
    save_model(path, model, card)
    state.unlink(missing_ok=True)
    return card


def state_file(path: Path) -> Path:
    """Where the state of a training is kept until its model is at `path`."""
    return path.with_name(f"{path.name}.state")


def make_model(
    recipe: Recipe,
    data: Transitions,
    *,
    start: LearnedModel | None = None,
    state_file: Path | None = None,
    progress: Progress | None = None,
) -> tuple[LearnedModel, dict[str, Any]]:
    """Train a model as a recipe says, evaluate it on the held-out episodes, and write up how it was made.

    Args:
        recipe: What to make.
        data: The transitions.
        start: A model of the recipe's configuration to go on from.
        state_file: See `cableway.tang2025.models.training.train`.
        progress: Called with the stage in words and the fraction done.

    Returns:
        The model and its card, plain data that `cableway.tang2025.models.checkpoint.save_model` stores with it.
    """
    settings = {"model": describe(recipe.model), "training": describe(recipe.training)}
    LOGGER.info("training: %s", json.dumps(settings))
    result = train(recipe.model, data, recipe.training, start=start, state_file=state_file, progress=progress)
    table = evaluate({"model": result.model, **baselines()}, result.validation_data)
    card = {
        "kind": recipe.model.kind,
        "parameters": result.model.parameters,
        "data": {
            "sha256": fingerprint(data),
            "transitions": len(data),
            "training_transitions": len(result.training_data),
            "held_out_transitions": len(result.validation_data),
            "metadata": describe(data.metadata),
        },
        **settings,
        "history": [asdict(row) for row in result.history],
        "errors": {name: [asdict(row) for row in rows] for name, rows in table.items()},
        "versions": versions(),
    }
    return result.model, card
