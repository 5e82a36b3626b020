"""Whether a run is worse than an earlier one of the same episodes, beyond noise.

Episodes are the same bit for bit on one machine; on another, rounding differs, so that one episode may come out
otherwise and errors by a little. Times are compared as multiples of a reference computation in the same episode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import make_dataclass
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

from cableway.benchmark.episode import Result
from cableway.benchmark.suites import episode_name
from cableway.core.configuration import from_mapping
from cableway.core.errors import FileFormatError, InputError
from cableway.core.provenance import versions
from cableway.core.reading import read_json
from cableway.metrics import METRICS

LEAST_ERROR = 1e-4
"""Errors [m] below this are counted as this."""

COMPARED = {metric.field or metric.key: metric for metric in METRICS.values() if metric.tolerance is not None}
"""Metrics of the gate by their names in a result and in a baseline."""

KEPT = ("digest", *COMPARED, "reference_time")
"""Figures of each episode in a baseline."""

_TYPES = get_type_hints(Result)
_ROW = make_dataclass("Row", [(name, _TYPES[name]) for name in KEPT])
_BASELINE = make_dataclass("Baseline", [("versions", dict[str, str]), ("episodes", dict[str, _ROW])])
"""What a baseline's file holds."""

Pair = tuple[Result, dict[str, Any]]
"""A result and what the baseline has of the same episode."""


def baseline(results: Sequence[Result]) -> dict[str, Any]:
    """What a later run is compared with."""
    rows = {_key(result): {name: _short(getattr(result, name)) for name in KEPT} for result in results}
    return {"versions": versions(), "episodes": rows}


def read_baseline(path: Path) -> dict[str, Any]:
    """A baseline from its file.

    Raises:
        FileFormatError: The file is missing or is no baseline.
    """
    try:
        content = read_json(path)
        from_mapping(_BASELINE, content, str(path))
    except InputError as error:
        raise FileFormatError(f"{error}; not a baseline.json of this version of the benchmark") from None
    return {**content, "episodes": {episode_name(key): row for key, row in content["episodes"].items()}}


def regressions(results: Sequence[Result], before: dict[str, Any]) -> list[str]:
    """A sentence for each way in which a run is worse than its baseline; none where it is not.

    Args:
        results: Of this run.
        before: The baseline.
    """
    known = before["episodes"]
    pairs = [(result, known[_key(result)]) for result in results if _key(result) in known]
    missing = len(known) - len(pairs)
    found = [f"{missing} of {len(known)} episodes of the baseline were not run"] if missing else []
    changed = sum(old["digest"] != new.digest for new, old in pairs)
    if changed:
        found.append(f"{changed} tasks differ from the baseline's")
    for name, metric in COMPARED.items():
        compare = _lost if metric.is_share else _slower if metric.unit == "s" else _farther
        found += compare(name, metric.tolerance or 0.0, pairs)
    return found


def _lost(rule: str, most: float, pairs: Sequence[Pair]) -> list[str]:
    """Successes lost on balance."""
    lost = [new for new, old in pairs if old[rule] and not getattr(new, rule)]
    gained = sum(getattr(new, rule) and not old[rule] for new, old in pairs)
    names = ", ".join(_key(result) for result in lost)
    return [f"{rule}: {len(lost)} lost, {gained} gained: {names}"] if len(lost) - gained > most else []


def _farther(name: str, most: float, pairs: Sequence[Pair]) -> list[str]:
    """Geometric mean of the ratios of errors, over episodes that succeeded both times."""
    ratios = [
        max(getattr(new, name), LEAST_ERROR) / max(old[name], LEAST_ERROR)
        for new, old in pairs
        if new.success and old["success"] and getattr(new, name) is not None and old[name] is not None
    ]
    if ratios and (ratio := float(np.exp(np.mean(np.log(ratios))))) > most:
        return [f"errors are {ratio:.2f} times those of the baseline, more than {most:g}"]
    return []


def _slower(name: str, most: float, pairs: Sequence[Pair]) -> list[str]:
    """Median of the ratios of times, each a multiple of the reference time in its episode."""
    ratios = [
        getattr(new, name) / new.reference_time * old["reference_time"] / old[name]
        for new, old in pairs
        if new.reference_time and getattr(new, name) and old["reference_time"] and old[name]
    ]
    if ratios and (ratio := float(np.median(ratios))) > most:
        return [f"{name}: {ratio:.2f} times that of the baseline, more than {most:g}"]
    return []


def _key(result: Result) -> str:
    return f"{result.suite}/{result.method}/{result.episode}"


def _short(value: Any) -> Any:
    return float(f"{value:.4g}") if isinstance(value, float) else value
