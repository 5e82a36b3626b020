"""A run's figures as plain data: what `summary.json` holds, of which tables are made, and one line for each episode."""

from __future__ import annotations

import csv
import io
import os
import platform
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

from cableway.benchmark.conditions import condition_of
from cableway.benchmark.episode import Result, reference_time
from cableway.benchmark.methods import Method
from cableway.benchmark.statistics import difference, estimate, quantiles
from cableway.benchmark.suites import SUITES, cable_of, kind_of
from cableway.core.provenance import versions
from cableway.metrics import METRICS
from cableway.simulation.perturbations.variants import variant

Results = Mapping[str, Mapping[str, Sequence[Result]]]
"""Results by suite and by method."""


def each_of(results: Results) -> Iterator[Result]:
    """All results, suite by suite and method by method."""
    return (result for rows in results.values() for found in rows.values() for result in found)


def group_of(result: Result) -> str:
    """What a result is grouped by in its suite's tables."""
    by = SUITES[result.suite].groups
    if by == "condition":
        return result.condition
    return result.plant if by == "plant" else cable_of(result.task) if by == "cable" else kind_of(result.task)


def by_group(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Results by what they are grouped by, in the order in which groups first come."""
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(group_of(result), []).append(result)
    return groups


def machine() -> dict[str, Any]:
    """The class of this machine."""
    return {
        "system": platform.system(),
        "processor": platform.machine(),
        "cores": os.cpu_count(),
        "ten_million_additions": round(10 * reference_time(), 3),
    }


def summary(results: Results, methods: Sequence[Method], size: str, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """All figures with their intervals, by suite, method and group."""
    return {
        "versions": versions(),
        "commits": commits(results),
        "machine": machine(),
        "size": size,
        "configuration": dict(configuration),
        "metrics": {
            metric.key: {"unit": metric.unit, "better": metric.better, "definition": metric.definition}
            for metric in METRICS.values()
        },
        "methods": {method.name: method.description for method in methods},
        "suites": {suite: suite_figures(suite, rows) for suite, rows in results.items()},
    }


def suite_figures(suite: str, rows: Mapping[str, Sequence[Result]]) -> dict[str, Any]:
    """Figures of one suite by method, and what is different in each plant and condition."""
    first = next(iter(rows.values()))
    conditions = [name for name in dict.fromkeys(result.condition for result in first) if name]
    return {
        "version": SUITES[suite].version,
        "plants": {name: variant(name).description for name in dict.fromkeys(result.plant for result in first)},
        **({"conditions": {name: condition_of(name).description for name in conditions}} if conditions else {}),
        "methods": {name: _figures(found) | _against(found, first) for name, found in rows.items()},
    }


def success_shares(about: Mapping[str, Any]) -> dict[str, dict[str, tuple[float, float, float]]]:
    """Shares of success with the ends of their intervals, of what `summary` says: by suite and method, or by method and
    group where there is one suite.
    """
    rows = {suite: found["methods"] for suite, found in about["suites"].items()}
    if len(rows) == 1:
        (methods,) = rows.values()
        rows = {name: figures["groups"] for name, figures in methods.items()}
    return {
        panel: {
            name: (share["value"], share["low"], share["high"])
            for name, figures in found.items()
            if (share := figures["metrics"].get("success"))
        }
        for panel, found in rows.items()
    }


def commits(results: Results) -> dict[str, int]:
    """Number of episodes by the commit that they were run at, "" where none was recorded, as outside a checkout."""
    return dict(Counter(result.commit or "" for result in each_of(results)))


def commits_text(about: Mapping[str, int]) -> str:
    """Commits in words.

    >>> commits_text({"889c4151b2c3d4e5f6": 12}), commits_text({"889c4151b2c3d4e5f6 with changes": 2, "": 1})
    ('commit 889c4151b2', 'commit 889c4151b2 with changes (2 episodes), no commit recorded (1 episode)')
    """
    names = {name: re.sub(r"^(\w{10})\w*", r"commit \1", name) or "no commit recorded" for name in about}
    if len(names) == 1:
        return next(iter(names.values()))
    return ", ".join(f"{names[name]} ({count} episode{'s' * (count != 1)})" for name, count in about.items())


def _figures(results: Sequence[Result]) -> dict[str, Any]:
    groups = by_group(results)
    return {
        "episodes": len(results),
        "outcomes": dict(Counter(result.outcome for result in results).most_common()),
        "metrics": _metrics(results),
        **missed_steps(results),
        "groups": {name: {"episodes": len(rows), "metrics": _metrics(rows)} for name, rows in groups.items()},
    }


def missed_steps(results: Sequence[Result]) -> dict[str, Any]:
    """With a deadline, control steps of all episodes and how many missed it; else nothing."""
    counted = [(result.steps or 0, result.missed) for result in results if result.missed is not None]
    if not counted:
        return {}
    return {"deadline": {"steps": sum(steps for steps, _ in counted), "missed": sum(missed for _, missed in counted)}}


def _metrics(results: Sequence[Result]) -> dict[str, Any]:
    found = {}
    for metric in METRICS.values():
        if (average := estimate(metric, results)) is not None:
            found[metric.key] = asdict(average) | (quantiles(metric, results) or {})
    return found


def _against(results: Sequence[Result], first: Sequence[Result]) -> dict[str, Any]:
    """Differences to the first method in the same episodes."""
    if results is first:
        return {}
    found = {metric.key: difference(metric, results, first) for metric in METRICS.values()}
    against = {key: asdict(average) for key, average in found.items() if average is not None}
    return {"difference_to": first[0].method, "differences": against} if first else {}


def csv_text(results: Sequence[Result]) -> str:
    """All results, one a line; an empty cell where there is no figure, full precision elsewhere."""
    file = io.StringIO()
    writer = csv.DictWriter(file, [entry.name for entry in fields(Result)], lineterminator="\n")
    writer.writeheader()
    for result in results:
        writer.writerow({name: "" if value is None else value for name, value in asdict(result).items()})
    return file.getvalue()
