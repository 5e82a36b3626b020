"""The page says what its data say, and what was chosen is what the paper's planner has."""

from __future__ import annotations

from pathlib import Path

import tang2025_settings as study
from printed_page import tables

from cableway.tang2025.planning.config import paper_planner

DOCS = Path(__file__).parents[2] / "docs"
DATA = DOCS / "results" / "tang2025-settings"


def test_the_page_has_the_table_of_its_data():
    assert tables(DATA.with_suffix(".md").read_text()) == tables("\n".join(study.table(DATA)))


def test_the_suites_were_run_with_the_configuration_as_it_is():
    setting = study.setting_of(paper_planner())
    assert study.setting_of(study.configuration(setting)) == setting
    for file in DATA.glob("suite-*.jsonl"):
        for row in study.lines(file):
            assert {name: row[name] for name in setting} == setting, row


def test_least_energy_is_added_where_all_first_guesses_were_tried():
    """It takes the one that converged with the least energy, and leaves what is incomplete alone."""
    setting = study.BASE | {"task": "a", "seed": 0, "converged": True}
    rows = [
        setting | {"guess": guess, "energy": energy} for guess, energy in zip(study.GUESSES, (3, 2, 1), strict=True)
    ]
    rows[2]["converged"] = False
    added = study.with_least_energy(rows)[3:]
    assert [(row["guess"], row["energy"]) for row in added] == [("least-energy", 2)]
    assert study.with_least_energy(rows[:2]) == rows[:2]
