"""Laws of the map of the paper: it has every numbered item, in order. `test_documents.py` sees that its names exist."""

from __future__ import annotations

import re
from pathlib import Path

MAP = (Path(__file__).resolve().parents[2] / "docs" / "paper.md").read_text()

EQUATIONS, FIGURES, TABLES = 25, 11, ("I", "II", "III", "IV", "V")
"""Of arXiv 2512.24974."""


def first_cells(title: str) -> list[str]:
    """First cells of the rows of the table in a section."""
    section = MAP.partition(f"## {title}\n")[2].partition("\n## ")[0]
    return re.findall(r"^\| ([^|]+?) \|", section, re.MULTILINE)


def test_no_equation_table_or_figure_of_the_paper_is_missing():
    assert first_cells("Equations") == [f"({number})" for number in range(1, EQUATIONS + 1)]
    assert first_cells("Tables") == [f"Table {number}" for number in TABLES]
    assert first_cells("Figures") == [f"Fig. {number}" for number in range(1, FIGURES + 1)]


def test_every_item_says_what_became_of_it():
    words = ("implemented", "reproduced", "departed", "missing", "drawn", "numbers only")
    for title in ("Equations", "Tables", "Figures"):
        section = MAP.partition(f"## {title}\n")[2].partition("\n## ")[0]
        for row in re.findall(r"^\| (?:\(|Table|Fig).*", section, re.MULTILINE):
            assert any(word in row.split(" | ")[2] for word in words), row
