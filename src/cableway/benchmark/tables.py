"""Tables of a run, for Markdown and for the report: made of what `summary.json` holds, so that they say the same."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cableway.benchmark.suites import PLANNER_SUITES, SUITES
from cableway.metrics import METRICS, Metric

COLUMNS = ("planned", "success", "strict", "strict_reachable", "survived", "contact", "avoidable_contact",
           "shape_error", "above_least_achievable", "deviation", "clearance", "tracking_error", "tracking_p99",
           "hidden", "unknown", "lost", "planning_time", "control_time", "control_p99", "missed")  # fmt: skip
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


def markdown(about: Mapping[str, Any]) -> str:
    """All tables of a run.

    Args:
        about: `summary.summary` of the run.
    """
    parts = []
    for suite, figures in about["suites"].items():
        parts.append(f"## {suite}, {about['size']}\n\n{sentence(suite)}\n")
        parts += [f"### {suite}: {table.title}\n\n{table.markdown()}" for table in suite_tables(suite, figures)]
    return "\n".join(parts)


def sentence(suite: str) -> str:
    """What a suite is."""
    text = SUITES[suite].description
    judged = " It judges planners, not controllers." if suite in PLANNER_SUITES else ""
    return f"{text[0].upper()}{text[1:]}.{judged} Version {SUITES[suite].version}."


def suite_tables(suite: str, figures: Mapping[str, Any]) -> list[Table]:
    """Methods against metrics, their differences to the first, and the groups of each.

    Args:
        suite: Its name.
        figures: `summary.suite_figures` of it.
    """
    methods, by = figures["methods"], SUITES[suite].groups
    tables = [_figures("methods", "method", methods)]
    if by in ("plant", "condition"):
        tables.append(Table(f"{by}s", ((by, "what differs"), *figures[f"{by}s"].items())))
    if len(methods) > 1:
        tables.append(_differences(methods))
    return tables + [_figures(name, by, found["groups"]) for name, found in methods.items() if len(found["groups"]) > 1]


def _figures(title: str, first: str, rows: Mapping[str, Mapping[str, Any]]) -> Table:
    shown = [METRICS[name] for name in COLUMNS]
    shown = [metric for metric in shown if any(_adds(metric, found) for found in rows.values())]
    lines = [(first, "n", *(metric.head for metric in shown))]
    for name, found in rows.items():
        lines.append((name, str(found["episodes"]), *(_cell(metric, found) for metric in shown)))
    return Table(title, tuple(lines))


def _differences(methods: Mapping[str, Mapping[str, Any]]) -> Table:
    """How much more each method has than the first one, in the same episodes."""
    first, *others = methods
    shown = [METRICS[name] for name in COMPARED]
    lines = [("method", "n", *(metric.head for metric in shown))]
    for name in others:
        found = [methods[name]["differences"].get(metric.key) for metric in shown]
        count = str(max((each["n"] for each in found if each is not None), default=0))
        lines.append((name, count, *(_interval(metric, each) for metric, each in zip(shown, found, strict=True))))
    return Table(f"differences to {first} in the same episodes", tuple(lines))


def _adds(metric: Metric, row: Mapping[str, Any]) -> bool:
    """Whether a column shows something that the others do not."""
    found = row["metrics"].get(metric.key)
    return found is not None and (metric.key != "strict_reachable" or found["n"] < row["episodes"])


def _cell(metric: Metric, row: Mapping[str, Any]) -> str:
    """A share with its interval, and of how many where not of all; or median / 95th percentile / worst."""
    found = row["metrics"].get(metric.key)
    if found is None or metric.is_share:
        of = f" of {found['n']}" if found is not None and found["n"] < row["episodes"] else ""
        return _interval(metric, found) + of
    return " / ".join(number(metric.scale * found[key]) for key in ("median", "p95", "worst"))


def _interval(metric: Metric, found: Mapping[str, float] | None) -> str:
    if found is None:
        return "-"
    value, low, high = (number(metric.scale * found[key]) for key in ("value", "low", "high"))
    return f"{value} ({low} to {high})"


def number(value: float) -> str:
    """Three digits, and no more than a table needs.

    >>> [number(x) for x in (100.0, 99.61, 12.345, 0.1234, 0.00123)]
    ['100', '99.6', '12.3', '0.12', '0.00']
    """
    return f"{value:.0f}" if abs(value) >= 99.95 else f"{value:.1f}" if abs(value) >= 9.995 else f"{value:.2f}"
