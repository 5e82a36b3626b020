"""Parts of the reproduction, and how their cells are written; errors in centimetres, as in the paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cableway.benchmark.episode import Result
from cableway.benchmark.tables import Table, number
from cableway.tang2025.reproduction.paper import Spread

LABORATORY = "2 mm of noise on the keypoints, 0.1 s of latency, one frame in ten lost"
"""What sensing "lab" of `plants` is."""

Row = tuple[str, ...]
Tell = Callable[[str, float], None]


@dataclass(frozen=True)
class Section:
    """A part of the reproduction.

    Attributes:
        title: What of the paper it is about.
        text: What is ours, in sentences.
        tables: Numbers side by side.
        pictures: Names of files beside the page.
    """

    title: str
    text: str
    tables: tuple[Table, ...] = ()
    pictures: tuple[str, ...] = ()


def median_worst(values: Sequence[float]) -> str:
    """Of figures that are there; "-" of none."""
    return f"{number(float(np.median(values)))} / {number(max(values))}" if values else "-"


def successes(results: Sequence[Result]) -> str:
    """How many of how many."""
    return f"{sum(result.success for result in results)}/{len(results)}"


def spread(values: Spread) -> str:
    """Mean and standard deviation."""
    return f"{number(values[0])} ± {number(values[1])}"
