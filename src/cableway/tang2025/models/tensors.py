"""Trees of arrays in safetensors files: arrays by their path in the tree, and text as metadata. Never pickle."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from cableway.core.errors import FileFormatError
from cableway.core.files import write_atomically

Tree = TypeVar("Tree")

METADATA_KEY = "cableway"
"""The one key of a file's metadata; with several, their order and so the file's bytes would be random."""


def write_tree(path: Path, tree: Any, metadata: dict[str, Any]) -> None:
    """Write all arrays of a tree, and `metadata` as JSON, atomically."""
    arrays = {name: np.asarray(leaf) for name, leaf in _named_arrays(tree)}
    content = save(arrays, metadata={METADATA_KEY: json.dumps(metadata, allow_nan=False)})
    write_atomically(Path(path), lambda file: file.write(content))


def read_metadata(path: Path) -> dict[str, Any]:
    """The metadata of a file that `write_tree` wrote.

    Raises:
        FileFormatError: The file is missing or damaged.
    """
    return _read(path, with_arrays=False)[0]


def read_tree(path: Path, like: Tree) -> Tree:
    """A tree like `like` (arrays or their shapes) with the arrays of a file.

    Raises:
        FileFormatError: The file is missing, damaged, or its arrays are not those of `like`.
    """
    arrays = _read(path, with_arrays=True)[1]
    wanted = dict(_named_arrays(like))
    if arrays.keys() != wanted.keys():
        name = sorted(arrays.keys() ^ wanted.keys())[0]
        raise FileFormatError(f"{path}: array {name!r} is {'missing' if name in wanted else 'not of this model'}")
    for name, leaf in wanted.items():
        found = arrays[name]
        if found.shape != leaf.shape or found.dtype != leaf.dtype:
            raise FileFormatError(
                f"{path}: array {name!r} is {found.dtype}{list(found.shape)}, not {leaf.dtype}{list(leaf.shape)}"
            )
        if np.issubdtype(found.dtype, np.inexact) and not np.isfinite(found).all():
            raise FileFormatError(f"{path}: array {name!r} holds a number that is not finite")
    return jax.tree_util.tree_map_with_path(
        lambda place, leaf: jax.device_put(arrays[_name(place)]) if _is_array(leaf) else leaf, like
    )


def _read(path: Path, *, with_arrays: bool) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    if not Path(path).is_file():
        raise FileFormatError(f"{path}: no such file")
    try:
        with safe_open(path, framework="np") as file:
            metadata = json.loads((file.metadata() or {}).get(METADATA_KEY, "{}"))
            names = file.keys() if with_arrays else []
            arrays = {name: file.get_tensor(name) for name in names}
    except (SafetensorError, OSError, ValueError, TypeError) as error:
        raise FileFormatError(f"{path}: not a readable safetensors file ({error})") from None
    return metadata if isinstance(metadata, dict) else {}, arrays


def _is_array(leaf: Any) -> bool:
    return eqx.is_array(leaf) or isinstance(leaf, jax.ShapeDtypeStruct)


def _named_arrays(tree: Any) -> list[tuple[str, Any]]:
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return [(_name(place), leaf) for place, leaf in leaves if _is_array(leaf)]


def _name(place: tuple[Any, ...]) -> str:
    return jax.tree_util.keystr(place, simple=True, separator=".")
