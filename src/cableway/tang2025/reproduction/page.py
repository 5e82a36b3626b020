"""The page of the reproduction: its sections, and how cells are written; errors in centimetres, as in the paper."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cableway.benchmark.episode import Result
from cableway.benchmark.summary import commits_text
from cableway.benchmark.tables import Table, number
from cableway.core.templates import render
from cableway.figures.style import Figure
from cableway.tang2025.reproduction.paper import Spread

LABORATORY = "2 mm of noise on the keypoints, 0.1 s of latency, one frame in ten lost"
"""What sensing "lab" of `plants` is."""

Row = tuple[str, ...]
OnProgress = Callable[[str, float], None]
Draw = Callable[[Figure, Path], None]
"""Writes a picture to a file."""


@dataclass(frozen=True)
class Picture:
    """A picture beside the page.

    Attributes:
        file: Its name.
        caption: What its panels show.
    """

    file: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A part of the reproduction.

    Attributes:
        title: What of the paper it is about.
        text: What is ours, in sentences.
        tables: Numbers side by side.
        pictures: Beside the page, with what they show.
    """

    title: str
    text: str
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()


def median_worst(values: Sequence[float]) -> str:
    """Of figures that are there; "-" of none."""
    return f"{number(float(np.median(values)))} / {number(max(values))}" if values else "-"


def successes(results: Sequence[Result]) -> str:
    """Number of successes, and of results."""
    return f"{sum(result.success for result in results)}/{len(results)}"


def spread(values: Spread) -> str:
    """Mean and standard deviation."""
    return f"{number(values[0])} ± {number(values[1])}"


def reproduction_page(sections: Sequence[Section], about: Mapping[str, Any]) -> str:
    """HTML with the paper's tables and figures beside ours.

    Args:
        sections: In order.
        about: "versions", "commit", "commits", "machine", "size" and "configuration".
    """
    packages = ("cableway.benchmark", "cableway.tang2025.reproduction")
    return render("reproduction.html.jinja", *packages, sections=sections, made=_made_at(about), **about)


def _made_at(about: Mapping[str, Any]) -> str:
    """Commits of the page and of the episodes in it."""
    return f"{commits_text({about['commit'] or '': 1})} (episodes: {commits_text(about['commits'])})"


def reproduction_text(sections: Sequence[Section], about: Mapping[str, Any]) -> str:
    """The same as Markdown."""
    machine, seeds = about["machine"], ", ".join(map(str, about["configuration"]["data_seeds"]))
    made = (
        f"Made by `cableway reproduce --size {about['size']}`, {_made_at(about)}. Versions: "
        f"{', '.join(f'{package} {version}' for package, version in about['versions'].items())}. Machine: "
        f"{machine['system']}, {machine['processor']}, {machine['cores']} cores, ten million additions in a plain "
        f"Python loop take {machine['ten_million_additions']} s. Seeds: of episodes, those in their suites' lists; of "
        f"data sets, {seeds}; of other trials, counted from 0."
    )
    parts = ["# The paper's tables and figures, and ours\n", "\n".join(textwrap.wrap(made, 120)) + "\n"]
    for section in sections:
        parts += [f"## {section.title}\n", "\n".join(textwrap.wrap(section.text, 120)) + "\n"]
        parts += [table.markdown() for table in section.tables]
        for picture in section.pictures:
            caption = "\n".join(textwrap.wrap(f"*{picture.caption}*", 120))
            parts.append(f"![{section.title}: {Path(picture.file).stem}]({picture.file})\n\n{caption}\n")
    return "\n".join(parts)
