"""Pages of results show what their data files hold, and what the documentation claims stands on those pages."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from printed_page import made_by

from cableway.benchmark.suites import PLANNER_SUITES
from cableway.benchmark.summary import commits_text
from cableway.benchmark.tables import Table, markdown

ROOT = Path(__file__).resolve().parents[1]
CLAIMS = ROOT / "docs" / "claims.md"
RESULTS = ROOT / "docs" / "results"
PAGES = sorted(RESULTS.glob("*.md"))

OURS = {name: name for name in ("cell", "faults", "lab-unconstrained", "lengths", "limp", "plants", "table")}
"""Page of our own method's results by suite, `standard` for all others."""


def rows(text: str) -> list[str]:
    """Lines of all tables, without those that part heads from rows."""
    return [line for line in text.splitlines() if line.startswith("|") and set(line) - set("|- ")]


def tables(about: dict[str, Any]) -> str:
    """Of the data of `cableway bench`, `cableway reproduce` or a study."""
    if "suites" in about:
        return markdown(about)
    found = [table for section in about["sections"] for table in section["tables"]]
    return "".join(Table(table["title"], tuple(map(tuple, table["rows"]))).markdown() for table in found)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_shows_its_data_and_says_where_it_comes_from(page: Path):
    text, about = page.read_text(), json.loads(page.with_suffix(".json").read_text())
    assert [cells_of(line) for line in rows(text)] == [cells_of(line) for line in rows(tables(about))]
    told = [commits_text(about["commits"])] if "commits" in about else list(map(made_by, about["sections"]))
    assert told
    assert all(each in " ".join(text.split()) for each in told)


def test_every_data_file_has_a_page():
    assert {path.stem for path in RESULTS.glob("*.json")} == {page.stem for page in PAGES}


def cells_of(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


@cache
def known(page: str) -> dict[tuple[str, str], dict[str, str]]:
    """Rows of a page's tables, cells by their head, by title of the table and first cell."""
    title, head, found = "", [], {}
    for line in (RESULTS / f"{page}.md").read_text().splitlines():
        if line.startswith("### "):
            title, head = line.removeprefix("### "), []
        elif not line.startswith("|"):
            head = []
        elif not head:
            head = cells_of(line)
        else:
            found[title, cells_of(line)[0]] = dict(zip(head, cells_of(line), strict=True))
    return found


CLAIMED = rows(CLAIMS.read_text().partition("\n## ")[0])[1:]
CELL = re.compile(r"\[([\w-]+)\]\(results/\1\.md\), `([^`]+)`, `([^`]+)`, `([^`]+)`")


def test_there_are_claims():
    assert len(CLAIMED) > 30


@pytest.mark.parametrize("line", CLAIMED, ids=lambda line: cells_of(line)[0])
def test_a_claim_is_a_cell_of_a_page_with_its_number_of_episodes_commit_and_data(line: str):
    _, n, figure, cell, _, commits, _, data, _ = cells_of(line)
    page, title, row, column = CELL.fullmatch(cell).groups()  # pyright: ignore[reportOptionalMemberAccess]
    found, text = known(page)[title, row], (RESULTS / f"{page}.md").read_text()
    assert (n, figure) == (found["n"], found[column])
    assert all(commit in text for commit in commits.split(", "))
    assert data == f"[{page}.json](results/{page}.json)"


@pytest.mark.parametrize("document", [ROOT / "README.md", ROOT / "docs" / "benchmark.md"], ids=lambda path: path.name)
def test_the_figures_of_suites_are_those_of_the_pages(document: Path):
    (head,) = (line for line in rows(document.read_text()) if line.startswith("| suite |") and "error [mm]" in line)
    lines = document.read_text().partition(head)[2].partition("\n\n")[0].splitlines()[2:]
    assert len(lines) >= 6
    for line in lines:
        shown = dict(zip(cells_of(head), cells_of(line), strict=True))
        suite = shown.pop("suite").strip("`")
        found = known(OURS.get(suite, "standard"))[f"{suite}: methods", "cableway"]
        shown.pop("plant", None)
        assert shown == {name: found.get(name, "-") for name in shown}, suite


def test_open_loop_succeeds_in_planner_suites_and_only_there():
    """What makes a suite one of planners is measured, wherever open loop was run."""
    shares = {
        title.partition(":")[0]: row["< 3 cm [%]"].startswith("100 ")
        for page in PAGES
        for (title, name), row in known(page.stem).items()
        if name == "open-loop" and title.endswith(": methods")
    }
    assert len(shares) > 6
    assert {suite for suite, all_succeed in shares.items() if all_succeed} == PLANNER_SUITES & set(shares)


def test_feedback_with_the_rods_derivative_is_as_good_on_fifteen_of_seventeen_plants():
    """To two points in a hundred, and not on the two that the documentation names."""
    found = json.loads((RESULTS / "plants.json").read_text())["suites"]["plants"]["methods"]
    share = {
        name: {plant: row["metrics"]["success"]["value"] for plant, row in found[name]["groups"].items()}
        for name in ("cableway", "rod-jacobian")
    }
    behind = {plant for plant, value in share["rod-jacobian"].items() if value < share["cableway"][plant] - 0.02}
    assert len(share["cableway"]) == 17
    assert behind == {"long-3", "obstacles-moved"}
