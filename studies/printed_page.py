"""Run a study and keep the tables that it prints: on a page of results, and in the page's data.

    .venv/bin/python studies/printed_page.py planning Ramps studies/ramps.py --seeds 9000:9012

The tables go below the heading of `docs/results/PAGE.md`, in place of those that the same command made before, and to
`docs/results/PAGE.json` with command, commit, versions and machine. What else the study prints is shown and not kept.
"""

from __future__ import annotations

import itertools
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

from cableway.benchmark.summary import commits_text, machine
from cableway.benchmark.tables import Table
from cableway.core.files import write_json, write_text
from cableway.core.provenance import commit, versions

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "docs" / "results"

Rows = list[list[str]]


def printed(command: list[str]) -> str:
    """What a study prints, shown as it comes."""
    lines = []
    with subprocess.Popen([sys.executable, *command], cwd=ROOT, stdout=subprocess.PIPE, text=True) as study:
        assert study.stdout is not None
        for line in study.stdout:
            print(line, end="", flush=True)
            lines.append(line)
    if study.returncode:
        raise SystemExit(study.returncode)
    return "".join(lines)


def tables(text: str) -> list[Rows]:
    """Cells of the Markdown tables in a text, lines between heads and rows left out."""
    found: list[Rows] = []
    for is_table, lines in itertools.groupby(text.splitlines(), lambda line: line.startswith("|")):
        if is_table:
            shown = [line for line in lines if set(line) - set("|- ")]
            found.append([[cell.strip() for cell in line.strip().strip("|").split("|")] for line in shown])
    return found


def made_by(entry: dict[str, Any]) -> str:
    """How some tables came about."""
    return f"Made by `{entry['command']}`, {commits_text({entry['commit']: 1})}:"


def block(entry: dict[str, Any]) -> str:
    """A study's part of the page."""
    shown = "\n".join(Table("", tuple(map(tuple, table["rows"]))).markdown() for table in entry["tables"])
    return f"{made_by(entry)}\n\n{shown}"


def placed(page: str, entry: dict[str, Any]) -> str:
    """A page with a study's part in place of what the same command made before, or at the end of its section."""
    before = re.compile(rf"Made by `{re.escape(entry['command'])}`,[^\n]*\n\n(\|[^\n]*\n|\n(?=\|))+")
    if before.search(page):
        return before.sub(lambda _: block(entry), page)
    head = re.search(rf"^#+ {re.escape(entry['title'])}\n", page, re.MULTILINE)
    if head is None:
        raise SystemExit(f"the page has no heading {entry['title']!r}")
    end = re.compile(r"^#", re.MULTILINE).search(page, head.end())
    above, below = (page, "") if end is None else (page[: end.start()], "\n" + page[end.start() :])
    return f"{above.rstrip()}\n\n{block(entry)}{below}"


def kept(entries: list[dict[str, Any]], page: str) -> list[dict[str, Any]]:
    """Those of the page, in its order."""
    places = [(page.find(f"Made by `{entry['command']}`,"), entry) for entry in entries]
    return [entry for place, entry in sorted(places, key=lambda each: each[0]) if place >= 0]


def main() -> None:
    """Run, then write page and data."""
    if len(sys.argv) < 4:
        raise SystemExit(__doc__)
    name, title, *command = sys.argv[1:]
    entry: dict[str, Any] = {
        "title": title,
        "command": f".venv/bin/python {shlex.join(command)}",
        "commit": commit() or "",
        "tables": [{"title": title, "rows": rows} for rows in tables(printed(command))],
        "versions": versions(),
        "machine": machine(),
    }
    if not entry["tables"]:
        raise SystemExit("the study printed no table")
    path, data = RESULTS / f"{name}.md", RESULTS / f"{name}.json"
    page = placed(path.read_text(), entry)
    known = json.loads(data.read_text())["sections"] if data.exists() else []
    others = [each for each in known if each["command"] != entry["command"]]
    write_json(data, {"sections": kept([*others, entry], page)})
    write_text(path, page)


if __name__ == "__main__":
    main()
