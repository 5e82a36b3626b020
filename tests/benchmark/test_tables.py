"""Tables say what the results hold, failures and unreachable goals included."""

from __future__ import annotations

from dataclasses import replace

from cableway.benchmark.episode import Result
from cableway.benchmark.summary import commits, suite_figures
from cableway.benchmark.tables import Table, suite_tables
from cableway.simulation.perturbations.variants import VARIANTS


def result(number: int, plant: str, error: float, least: float | None) -> Result:
    return Result(
        suite="plants", episode=f"{number}-{plant}", method="m", task=f"clutter-{number}", plant=plant, seed=0,
        digest="", made_by="", outcome="success", success=error < 0.03, strict=error < 0.01,
        shape_error=error, least_achievable_error=least,
    )  # fmt: skip


def tables(results: list[Result]) -> list[Table]:
    return suite_tables("plants", suite_figures("plants", {"m": results}))


RESULTS = [result(1, "hard", 0.002, 0.001), result(2, "hard", 0.012, 0.009), result(3, "slip", 0.5, None)]


def cell(rows: tuple[tuple[str, ...], ...], row: int, title: str) -> str:
    return rows[row][[name.split(" [")[0] for name in rows[0]].index(title)]


def test_the_strict_rule_is_also_counted_where_it_can_be_met():
    methods = tables(RESULTS)[0].rows
    assert cell(methods, 1, "n") == "3"
    assert cell(methods, 1, "< 1 cm").startswith("33.3 ")
    assert cell(methods, 1, "< 1 cm where achievable").startswith("50.0 ")
    assert cell(methods, 1, "< 1 cm where achievable").endswith(" of 2")


def test_a_column_that_tells_nothing_new_is_left_out():
    titles = tables(RESULTS[:1])[0].rows[0]
    assert not any("where achievable" in title for title in titles)


def test_what_differs_in_a_plant_is_said():
    _, plants, groups = tables(RESULTS)
    assert plants.rows[1:] == (("hard", VARIANTS["hard"].description), ("slip", VARIANTS["slip"].description))
    assert [row[0] for row in groups.rows[1:]] == ["hard", "slip"]
    assert cell(groups.rows, 2, "error") == "500 / 500 / 500"


def test_episodes_are_counted_by_commit():
    new = [replace(each, commit="b" * 40) for each in RESULTS[1:]]
    assert commits({"plants": {"m": RESULTS[:1], "n": new}}) == {"": 1, "b" * 40: 2}
