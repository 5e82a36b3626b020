"""Models in safetensors files, with their configuration and card; and other trees of arrays. Never pickle."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from safetensors.numpy import save

from cableway.core.configuration import from_mapping
from cableway.core.errors import FileFormatError, InputError, UnknownNameError
from cableway.core.files import write_bytes
from cableway.core.provenance import describe
from cableway.core.reading import parse_json, parse_safetensors, read_bytes
from cableway.tang2025.models.base import DeformationModel
from cableway.tang2025.models.evaluation import HorizonError
from cableway.tang2025.models.learned import LearnedModel
from cableway.tang2025.models.networks import KINDS, config_of

FORMAT = "cableway-model"
"""Marks our files among other safetensors files."""

VERSION = 2
"""Version of the file's layout."""

FIRST_MODES = (1.0, 2.0 / 3.0)
"""Files of version 1 give the second modes of a rod for x^2 - 1/3, which is 2/3 P_2 of `cableway.rod.material`."""

WEIGHTS = Path(__file__).parent / "weights"
"""Folder of the shipped weights."""

SUFFIX = ".safetensors"

METADATA_KEY = "cableway"
"""The one key of a file's metadata; with several, their order and so the file's bytes would be random."""

DIGEST_KEY = "sha256"
"""The checksum of everything else, among the metadata."""

Tree = TypeVar("Tree")


@dataclass(frozen=True)
class CardData:
    """What the card of a model says of its data."""

    sha256: str = ""
    transitions: int = 0
    training_transitions: int = 0
    held_out_transitions: int = 0
    metadata: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Card:
    """What the card of a model holds, of which another tool may leave things out."""

    kind: str = ""
    parameters: int = 0
    data: CardData = CardData()
    model: dict[str, Any] = field(default_factory=dict)
    training: dict[str, Any] = field(default_factory=dict)
    history: list[dict[str, float]] = field(default_factory=list)
    errors: dict[str, list[HorizonError]] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)


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


def save_model(path: Path | str, model: LearnedModel, card: dict[str, Any], *, half: bool = False) -> None:
    """Write a model and its card, atomically.

    Args:
        path: The file, by custom ending in `.safetensors`.
        model: The model, normalisation included.
        card: Plain data on how it was made, see `cableway.tang2025.models.recipe.make_model`.
        half: Whether matrices of weights are rounded to half precision, for a file half as large.
    """
    metadata = {
        "format": FORMAT,
        "version": VERSION,
        "kind": model.config.kind,
        "config": describe(model.config),
        "card": card,
    }
    rounded = jax.tree.map(lambda leaf: leaf.astype(jnp.float16) if half and _is_matrix(leaf) else leaf, model)
    write_tree(Path(path), rounded, metadata)


def load_model(name_or_path: str | Path) -> DeformationModel:
    """A model from a file, or a shipped one by its name.

    Raises:
        UnknownNameError: No shipped model has this name.
        FileFormatError: The file is missing, damaged, no model, or of another version.
    """
    path = model_file(name_or_path)
    metadata = _read_model_metadata(path)
    kind = str(metadata.get("kind"))
    try:
        config = from_mapping(config_of(kind), _with_keypoints(metadata), "its configuration")
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from None
    like = eqx.filter_eval_shape(lambda: LearnedModel(config, key=jax.random.key(0)))
    model = read_tree(path, like)
    if metadata["version"] == 1 and model.rod is not None:
        old, modes = model.rod, jnp.array(FIRST_MODES, jnp.float32)
        model = eqx.tree_at(lambda m: (m.rod.stiffness, m.rod.rest), model, (modes * old.stiffness, modes * old.rest))
    return model


def _with_keypoints(metadata: dict[str, Any]) -> Any:
    """The configuration; files of earlier releases say only with their data how many keypoints a network saw."""
    config, kind = metadata.get("config"), config_of(str(metadata.get("kind")))
    try:
        count = metadata["card"]["data"]["metadata"]["config"]["cable"]["keypoints"]
    except (KeyError, TypeError):
        return config
    if not isinstance(config, dict) or "keypoints" not in {field.name for field in fields(kind)}:
        return config
    return {"keypoints": count, **config}


def read_card(name_or_path: str | Path) -> dict[str, Any]:
    """How a model was made and how well it predicts, as `save_model` stored it.

    Raises:
        UnknownNameError: No shipped model has this name.
        FileFormatError: The file is missing, damaged, no model, or of another version.
    """
    path = model_file(name_or_path)
    card = _read_model_metadata(path).get("card")
    if not isinstance(card, dict):
        raise FileFormatError(f"{path}: it holds no model card")
    known = {entry.name for entry in fields(Card)}
    try:
        from_mapping(Card, {name: part for name, part in card.items() if name in known}, "its card")
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from None
    return card


def cable_of(name_or_path: str | Path) -> dict[str, float]:
    """Numbers of the cable that a model was trained on, by the fields of `Cable`; without those that varied.

    Raises:
        UnknownNameError: No shipped model has this name.
        FileFormatError: The file is missing, damaged, no model, or of another version.
    """
    config = read_card(name_or_path).get("data", {}).get("metadata", {}).get("config", {})
    varied = config.get("ranges") or {}
    cable = config.get("cable") or {}
    return {name: value for name, value in cable.items() if isinstance(value, float) and name not in varied}


def _read_model_metadata(path: Path) -> dict[str, Any]:
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


def write_tree(path: Path, tree: Any, metadata: dict[str, Any]) -> None:
    """Write all arrays of a tree, and `metadata` as JSON, atomically."""
    arrays = {name: np.asarray(leaf) for name, leaf in _named_arrays(tree)}
    text = json.dumps({**metadata, DIGEST_KEY: _digest(arrays, metadata)}, allow_nan=False)
    write_bytes(Path(path), save(arrays, metadata={METADATA_KEY: text}))


def read_metadata(path: Path) -> dict[str, Any]:
    """The metadata of a file that `write_tree` wrote.

    Raises:
        FileFormatError: The file is missing or damaged.
    """
    return _read(path)[1]


def read_tree(path: Path, like: Tree) -> Tree:
    """A tree like `like` (arrays or their shapes) with the arrays of a file.

    Raises:
        FileFormatError: The file is missing, damaged, or its arrays are not those of `like`.
    """
    arrays = _read(path)[0]
    wanted = dict(_named_arrays(like))
    if arrays.keys() != wanted.keys():
        name = sorted(arrays.keys() ^ wanted.keys())[0]
        raise FileFormatError(f"{path}: array {name!r} is {'missing' if name in wanted else 'not of this model'}")
    for name, leaf in wanted.items():
        found = arrays[name]
        if found.dtype == np.float16 and leaf.dtype == np.float32:
            found = arrays[name] = found.astype(np.float32)
        if found.shape != leaf.shape or found.dtype != leaf.dtype:
            raise FileFormatError(
                f"{path}: array {name!r} is {found.dtype}{list(found.shape)}, not {leaf.dtype}{list(leaf.shape)}"
            )
        if np.issubdtype(found.dtype, np.inexact) and not np.isfinite(found).all():
            raise FileFormatError(f"{path}: array {name!r} holds a number that is not finite")
    return jax.tree_util.tree_map_with_path(
        lambda place, leaf: jax.device_put(arrays[_name(place)]) if _is_array(leaf) else leaf, like
    )


def _read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    arrays, header = parse_safetensors(read_bytes(path), str(path))
    metadata = parse_json(header.get(METADATA_KEY, "{}"), f"{path}: its metadata")
    if not isinstance(metadata, dict):
        return arrays, {}
    digest = metadata.pop(DIGEST_KEY, None)  # files of earlier releases have none
    if digest is not None and digest != _digest(arrays, metadata):
        raise FileFormatError(f"{path}: it is damaged: its contents do not have the checksum it was written with")
    return arrays, metadata


def _digest(arrays: dict[str, np.ndarray], metadata: dict[str, Any]) -> str:
    """SHA-256 of metadata and of names, types, shapes and bytes of arrays."""
    digest = hashlib.sha256(json.dumps(metadata, sort_keys=True).encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype} {array.shape} ".encode() + array.tobytes())
    return digest.hexdigest()


def _is_array(leaf: Any) -> bool:
    return eqx.is_array(leaf) or isinstance(leaf, jax.ShapeDtypeStruct)


def _is_matrix(leaf: Any) -> bool:
    return eqx.is_inexact_array(leaf) and leaf.ndim > 1


def _named_arrays(tree: Any) -> list[tuple[str, Any]]:
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return [(_name(place), leaf) for place, leaf in leaves if _is_array(leaf)]


def _name(place: tuple[Any, ...]) -> str:
    """Path of an array; a model's network is no level of its own, so that files of earlier releases stay readable."""
    return jax.tree_util.keystr(place, simple=True, separator=".").replace("network.", "")
