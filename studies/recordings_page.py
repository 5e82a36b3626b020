"""What a `cableway evaluate` left, as a page of the documentation with its data beside it.

    .venv/bin/python studies/recordings_page.py runs/evaluate/report.json yu2d "Cables of Yu et al." COMMAND [NOTE]

Writes `docs/results/NAME.md` and `docs/results/NAME.json`: the figures at 1, 5, 10 and 20 steps with their intervals, a
table for each data set. With `-` for the report the page is made anew from the data that is there.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from cableway.benchmark.summary import commits_text
from cableway.benchmark.tables import Table
from cableway.core.bootstrap import LEVEL
from cableway.core.files import write_json, write_text

RESULTS = Path(__file__).resolve().parents[1] / "docs" / "results"
STEPS = (1, 5, 10, 20)
FIGURES = ("median", "mean", "p95", "above_blend")
TITLES = ("model", "steps", "windows", "episodes", *(f"{name.replace('_', ' ')} [mm]" for name in FIGURES))


def rows(errors: dict[str, Any]) -> list[tuple[str, ...]]:
    """The table of one data set."""
    found = [TITLES]
    for name, curve in errors.items():
        for place, steps in enumerate(curve["horizons"]):
            if steps not in STEPS:
                continue
            cells = []
            for figure in FIGURES:
                low, high = (end[place] for end in curve["intervals"][figure])
                cells.append(f"{curve[figure][place]:.2f} ({low:.2f} to {high:.2f})")
            found.append((name, f"{steps}", f"{curve['windows'][place]}", f"{curve['episodes'][place]}", *cells))
    return found


def data_of(report: dict[str, Any], title: str, command: str, note: str) -> dict[str, Any]:
    """What the page shows, and where it is from."""
    sets = {Path(name).stem: each for name, each in report["data"].items()}
    sections = [
        {"title": name, "sha256": each["sha256"], "tables": [{"title": name, "rows": rows(each["errors_mm"])}]}
        for name, each in sets.items()
    ]
    return {
        "title": title,
        "command": command,
        "note": note,
        "commits": {report["commit"] or "": len(sets)},
        "versions": report["versions"],
        "sections": sections,
    }


def page(about: dict[str, Any], name: str) -> str:
    """The page of some data."""
    versions = ", ".join(f"{package} {version}" for package, version in about["versions"].items())
    tables = "\n".join(
        f"## {table['title']}\n\n{Table(table['title'], tuple(map(tuple, table['rows']))).markdown()}"
        for section in about["sections"]
        for table in section["tables"]
    )
    return (
        f"# {about['title']}\n\nMade by `{about['command']}`, {commits_text(about['commits'])}; the same figures: "
        f"[{name}.json]({name}.json). {about['note']} Versions: {versions}.\n\n"
        f"Stacked error after so many steps of open-loop prediction, with {LEVEL:.0%} intervals by resampling "
        f"episodes. *Above blend* is the mean difference to the "
        f"rigid blend in the same windows: below 0 the model predicts better.\n\n{tables}"
    )


def main() -> None:
    """Write page and data."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("report", type=Path)
    parser.add_argument("name")
    parser.add_argument("title", nargs="?", default="")
    parser.add_argument("command", nargs="?", default="")
    parser.add_argument("note", nargs="?", default="")
    given = parser.parse_args()
    data = RESULTS / f"{given.name}.json"
    if given.report == Path("-"):
        about = json.loads(data.read_text())
    else:
        about = data_of(json.loads(given.report.read_text()), given.title, given.command, given.note)
        write_json(data, about)
    write_text(RESULTS / f"{given.name}.md", page(about, given.name))


if __name__ == "__main__":
    main()
