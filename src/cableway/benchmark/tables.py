"""Tables of a run, for Markdown and for the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cableway.benchmark.episode import Result
from cableway.benchmark.statistics import Estimate, difference, estimate, quantiles
from cableway.benchmark.suites import SUITES
from cableway.benchmark.summary import Results, by_group
from cableway.metrics import METRICS, Metric
from cableway.simulation.perturbations.variants import variant

COLUMNS = ("success", "strict", "strict_reachable", "survived", "contact", "avoidable_contact", "shape_error",
           "above_least_achievable", "deviation", "clearance", "planning_time", "control_time", "control_p99",
           "missed")  # fmt: skip
"""Metrics of the tables."""

COMPARED = ("success", "strict", "contact", "shape_error", "deviation", "clearance", "planning_time", "control_time")
"""Metrics in which methods are compared."""


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        title: What it shows.
        rows: Of text, the first of them titles.
    """

    title: str
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """As Markdown."""
        first, *others = self.rows
        lines = [first, ("---",) * len(first), *others]
        return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def markdown(results: Results, size: str) -> str:
    """All tables of a run."""
    parts = []
    for suite, rows in results.items():
        parts.append(f"## {suite}, {size}\n\n{sentence(suite)}\n")
        parts += [f"### {suite}: {table.title}\n\n{table.markdown()}" for table in suite_tables(suite, rows)]
    return "\n".join(parts)


def sentence(suite: str) -> str:
    """What a suite is."""
    text = SUITES[suite].description
    return f"{text[0].upper()}{text[1:]}. Version {SUITES[suite].version}."


def suite_tables(suite: str, rows: Mapping[str, Sequence[Result]]) -> list[Table]:
    """Methods against metrics, their differences to the first, and the groups of each."""
    tables = [_figures("methods", "method", rows)]
    if SUITES[suite].groups == "plant":
        tables.append(_plants(next(iter(rows.values()))))
    if len(rows) > 1:
        tables.append(_differences(rows))
    groups = {name: by_group(results) for name, results in rows.items()}
    tables += [_figures(name, SUITES[suite].groups, found) for name, found in groups.items() if len(found) > 1]
    return tables


def _plants(results: Sequence[Result]) -> Table:
    """What is different in each plant."""
    return Table(
        "plants", (("plant", "what differs"), *((name, variant(name).description) for name in by_group(results)))
    )


def _figures(title: str, first: str, rows: Mapping[str, Sequence[Result]]) -> Table:
    shown = [METRICS[name] for name in COLUMNS]
    shown = [metric for metric in shown if any(_adds(metric, results) for results in rows.values())]
    lines = [(first, "n", *(metric.head for metric in shown))]
    for name, results in rows.items():
        lines.append((name, str(len(results)), *(_cell(metric, results) for metric in shown)))
    return Table(title, tuple(lines))


def _differences(rows: Mapping[str, Sequence[Result]]) -> Table:
    """How much more each method has than the first one, in the same episodes."""
    first, *others = rows
    shown = [METRICS[name] for name in COMPARED]
    lines = [("method", "n", *(metric.head for metric in shown))]
    for name in others:
        found = [difference(metric, rows[name], rows[first]) for metric in shown]
        count = str(max((each.n for each in found if each is not None), default=0))
        lines.append((name, count, *(_interval(metric, each) for metric, each in zip(shown, found, strict=True))))
    return Table(f"differences to {first} in the same episodes", tuple(lines))


def _adds(metric: Metric, results: Sequence[Result]) -> bool:
    """Whether a column shows something that the others do not."""
    found = estimate(metric, results)
    return found is not None and (metric.key != "strict_reachable" or found.n < len(results))


def _cell(metric: Metric, results: Sequence[Result]) -> str:
    """A share with its interval, and of how many where not of all; or median / 95th percentile / worst."""
    spread = quantiles(metric, results)
    if spread is None:
        found = estimate(metric, results)
        of = f" of {found.n}" if metric.is_share and found is not None and found.n < len(results) else ""
        return _interval(metric, found) + of
    return " / ".join(number(metric.scale * value) for value in spread.values())


def _interval(metric: Metric, found: Estimate | None) -> str:
    if found is None:
        return "-"
    value, low, high = (number(metric.scale * each) for each in (found.value, found.low, found.high))
    return f"{value} ({low} to {high})"


def number(value: float) -> str:
    """Three digits, and no more than a table needs.

    >>> [number(x) for x in (100.0, 99.61, 12.345, 0.1234, 0.00123)]
    ['100', '99.6', '12.3', '0.12', '0.00']
    """
    return f"{value:.0f}" if abs(value) >= 99.95 else f"{value:.1f}" if abs(value) >= 9.995 else f"{value:.2f}"
