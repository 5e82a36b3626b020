"""The named cables: their values, and the ranges within which a cable of that kind may lie."""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from cableway.core.errors import UnknownNameError
from cableway.scene.files.document import read_document


def preset_names() -> tuple[str, ...]:
    """Names of the cable presets."""
    return tuple(sorted(_presets()))


def preset_values(name: str) -> dict[str, float]:
    """Fields of `Cable` by name; the length is the first of the preset's.

    Raises:
        UnknownNameError: No such preset; the message lists them.
    """
    preset = dict(_preset(name))
    lengths = preset.pop("lengths")
    return {"length": lengths[0]} | {key: preset[key] for key in preset if key not in ("ranges", "source")}


def preset_ranges(name: str) -> dict[str, tuple[float, float]]:
    """Least and greatest value of fields of `Cable`, by name.

    Raises:
        UnknownNameError: No such preset; the message lists them.
    """
    return {field: (low, high) for field, (low, high) in _preset(name)["ranges"].items()}


def _preset(name: str) -> dict[str, Any]:
    if name not in _presets():
        raise UnknownNameError("preset", name, preset_names())
    return _presets()[name]


@cache
def _presets() -> dict[str, dict[str, Any]]:
    return read_document(Path(str(resources.files("cableway.scene.files"))) / "catalogue" / "cable_presets.yml").data
