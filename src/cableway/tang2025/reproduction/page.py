"""The paper's tables and figures beside ours, as a page and as text."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from cableway.benchmark.pages import render
from cableway.tang2025.reproduction.sections import Section


def reproduction_page(sections: Sequence[Section], about: Mapping[str, Any]) -> str:
    """HTML with the paper's tables and figures beside ours.

    Args:
        sections: In order.
        about: "versions", "machine", "size" and "configuration".
    """
    return render("reproduction.html.jinja", "cableway.tang2025.reproduction", sections=sections, **about)


def reproduction_text(sections: Sequence[Section], about: Mapping[str, Any]) -> str:
    """The same as Markdown."""
    machine, (first, second) = about["machine"], about["configuration"]["data_seeds"]
    made = (
        f"Made by `cableway reproduce --size {about['size']}`. Versions: "
        f"{', '.join(f'{package} {version}' for package, version in about['versions'].items())}. Machine: "
        f"{machine['system']}, {machine['processor']}, {machine['cores']} cores, ten million additions in a plain "
        f"Python loop take {machine['ten_million_additions']} s. Seeds: of episodes, those in their suites' lists; of "
        f"data sets, {first} and {second}; of other trials, counted from 0."
    )
    parts = ["# The paper's tables and figures, and ours\n", "\n".join(textwrap.wrap(made, 120)) + "\n"]
    for section in sections:
        parts += [f"## {section.title}\n", "\n".join(textwrap.wrap(section.text, 120)) + "\n"]
        parts += [table.markdown() for table in section.tables]
        parts += [f"![{picture}]({picture})\n" for picture in section.pictures]
    return "\n".join(parts)
