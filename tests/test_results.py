"""Pages of results show what their data files hold."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cableway.benchmark.summary import commits_text
from cableway.benchmark.tables import Table, markdown

RESULTS = Path(__file__).resolve().parents[1] / "docs" / "results"
PAGES = sorted(RESULTS.glob("*.md"))
WITHOUT_DATA = {"clutter", "controllers", "lab-methods", "lab-unconstrained", "narrow", "reproduction", "rivals"}
"""Pages whose episodes are gone: a page leaves this list when it is made again, and none is added."""


def rows(text: str) -> list[str]:
    """Lines of all tables."""
    return [line for line in text.splitlines() if line.startswith("|")]


def tables(about: dict[str, Any]) -> str:
    """Of the data of `cableway bench` or `cableway reproduce`."""
    if "suites" in about:
        return markdown(about)
    found = [table for section in about["sections"] for table in section["tables"]]
    return "".join(Table(table["title"], tuple(map(tuple, table["rows"]))).markdown() for table in found)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_shows_its_data_and_says_where_it_comes_from(page: Path):
    text, data = page.read_text(), page.with_suffix(".json")
    if page.stem in WITHOUT_DATA:
        assert not data.exists(), f"{page.stem} has data: take it from WITHOUT_DATA"
        assert "gone: there is no data" in text.replace("\n", " ")
        return
    about = json.loads(data.read_text())
    assert rows(text) == rows(tables(about))
    assert commits_text(about["commits"]) in text


def test_every_data_file_has_a_page():
    assert {path.stem for path in RESULTS.glob("*.json")} == {page.stem for page in PAGES} - WITHOUT_DATA
