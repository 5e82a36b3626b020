"""Whether a run is worse than an earlier one of the same episodes, beyond noise.

Episodes are the same bit for bit on one machine; on another, rounding differs, so that one episode may come out
otherwise and errors by a little. Times are compared as multiples of a reference computation in the same episode.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cableway.benchmark.episode import Result
from cableway.core.errors import FileFormatError
from cableway.core.provenance import versions

LOST = 1
"""Successes that may be lost on balance, by either rule."""

ERROR_RATIO = 1.25
"""Largest ratio of errors (geometric mean over episodes that succeeded both times) that passes."""

LEAST_ERROR = 1e-4
"""Errors [m] below this are counted as this."""

TIME_RATIO = 2.0
"""Largest ratio of times (median over episodes), each over the reference time of its episode, that passes."""

TIMES = ("planning_time", "control_median")
"""What is compared of the times."""

KEPT = ("digest", "success", "strict", "shape_error", *TIMES, "reference_time")
"""Figures of each episode in a baseline."""


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
        content = json.loads(path.read_text())
        if not all(set(row) == set(KEPT) for row in content["episodes"].values()):
            raise KeyError
    except OSError as error:
        raise FileFormatError(f"{path}: {error.strerror}") from None
    except (AttributeError, KeyError, TypeError, ValueError):
        raise FileFormatError(f"{path}: not a baseline.json of this version of the benchmark") from None
    return content


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
        found.append(f"{changed} tasks are not those of the baseline")
    for rule in ("success", "strict"):
        lost = [new for new, old in pairs if old[rule] and not getattr(new, rule)]
        gained = sum(getattr(new, rule) and not old[rule] for new, old in pairs)
        if len(lost) - gained > LOST:
            names = ", ".join(f"{result.suite}/{result.method}/{result.episode}" for result in lost)
            found.append(f"{rule}: {len(lost)} lost, {gained} gained: {names}")
    errors = [
        max(new.shape_error, LEAST_ERROR) / max(old["shape_error"], LEAST_ERROR)
        for new, old in pairs
        if new.success and old["success"] and new.shape_error is not None and old["shape_error"] is not None
    ]
    if errors and (ratio := float(np.exp(np.mean(np.log(errors))))) > ERROR_RATIO:
        found.append(f"errors are {ratio:.2f} times those of the baseline, more than {ERROR_RATIO:g}")
    return found + _slower(pairs)


def _slower(pairs: Sequence[tuple[Result, dict[str, Any]]]) -> list[str]:
    """Times that have grown, as multiples of the reference time."""
    found = []
    for name in TIMES:
        ratios = [
            getattr(new, name) / new.reference_time * old["reference_time"] / old[name]
            for new, old in pairs
            if new.reference_time and getattr(new, name) and old["reference_time"] and old[name]
        ]
        if ratios and (ratio := float(np.median(ratios))) > TIME_RATIO:
            found.append(f"{name}: {ratio:.2f} times that of the baseline, more than {TIME_RATIO:g}")
    return found


def _key(result: Result) -> str:
    return f"{result.suite}/{result.method}/{result.episode}"


def _short(value: Any) -> Any:
    return float(f"{value:.4g}") if isinstance(value, float) else value
