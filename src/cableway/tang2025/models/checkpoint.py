"""Models in files: safetensors with the configuration and the model's card inside, never pickle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from cableway.core.configuration import from_mapping
from cableway.core.errors import FileFormatError, InputError, UnknownNameError
from cableway.core.provenance import describe
from cableway.tang2025.models.base import DeformationModel
from cableway.tang2025.models.kinds import KINDS, build, config_of, kind_of
from cableway.tang2025.models.learned import LearnedModel
from cableway.tang2025.models.tensors import read_metadata, read_tree, write_tree

FORMAT = "cableway-model"
"""Marks our files among other safetensors files."""

VERSION = 2
"""Version of the file's layout."""

FIRST_MODES = (1.0, 2.0 / 3.0)
"""Files of version 1 give the second modes of a rod for x^2 - 1/3, which is 2/3 P_2 of `cableway.rod.material`."""

WEIGHTS = Path(__file__).parent / "weights"
"""Folder of the shipped weights."""

SUFFIX = ".safetensors"


def model_names() -> tuple[str, ...]:
    """Names of the shipped models, sorted."""
    return tuple(sorted(path.stem for path in WEIGHTS.glob(f"*{SUFFIX}")))


def model_file(name_or_path: str | Path) -> Path:
    """The file of a shipped model's name, or the path itself if it has a separator or ends in `.safetensors`.

    Raises:
        UnknownNameError: No shipped model has this name.
    """
    text = str(name_or_path)
    if isinstance(name_or_path, Path) or "/" in text or "\\" in text or text.endswith(SUFFIX):
        return Path(name_or_path)
    if text not in model_names():
        raise UnknownNameError("model", text, model_names())
    return WEIGHTS / f"{text}{SUFFIX}"


def save_model(path: Path | str, model: LearnedModel, card: dict[str, Any]) -> None:
    """Write a model and its card, atomically.

    Args:
        path: The file, by custom ending in `.safetensors`.
        model: The model, normalisation included.
        card: Plain data on how it was made, see `cableway.tang2025.models.recipe.make_model`.
    """
    metadata = {
        "format": FORMAT,
        "version": VERSION,
        "kind": kind_of(model.config),
        "config": describe(model.config),
        "card": card,
    }
    write_tree(Path(path), model, metadata)


def load_model(name_or_path: str | Path) -> DeformationModel:
    """A model from a file, or a shipped one by its name.

    Raises:
        UnknownNameError: No shipped model has this name.
        FileFormatError: The file is missing, damaged, no model, or of another version.
    """
    path = model_file(name_or_path)
    metadata = _read(path)
    kind = str(metadata.get("kind"))
    try:
        config = from_mapping(config_of(kind), metadata.get("config"), "its configuration")
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from None
    like = eqx.filter_eval_shape(lambda: build(config, key=jax.random.key(0)))
    model = read_tree(path, like)
    if metadata["version"] == 1 and model.rod is not None:
        old, modes = model.rod, jnp.array(FIRST_MODES, jnp.float32)
        model = eqx.tree_at(lambda m: (m.rod.stiffness, m.rod.rest), model, (modes * old.stiffness, modes * old.rest))
    return model


def read_card(name_or_path: str | Path) -> dict[str, Any]:
    """How a model was made and how well it predicts, as `save_model` stored it.

    Raises:
        UnknownNameError: No shipped model has this name.
        FileFormatError: The file is missing, damaged, no model, or of another version.
    """
    path = model_file(name_or_path)
    card = _read(path).get("card")
    if not isinstance(card, dict):
        raise FileFormatError(f"{path}: it holds no model card")
    return card


def _read(path: Path) -> dict[str, Any]:
    metadata = read_metadata(path)
    if metadata.get("format") != FORMAT:
        raise FileFormatError(
            f"{path}: a safetensors file, but not a cableway model of kind {', '.join(sorted(KINDS))}"
        )
    if metadata.get("version") not in (1, VERSION):
        raise FileFormatError(
            f"{path}: a model file of version {metadata.get('version')!r}; this cableway reads version 1 and {VERSION}"
        )
    return metadata
