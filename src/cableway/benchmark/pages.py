"""The report of a run as a page that opens without a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2

from cableway.benchmark.episode import Result
from cableway.benchmark.metrics import METRICS
from cableway.benchmark.runner import Job
from cableway.benchmark.summary import Results
from cableway.benchmark.tables import sentence, suite_tables


def report_page(
    results: Results,
    jobs: Mapping[tuple[str, str, str], Job],
    folder: Path,
    *,
    about: Mapping[str, Any],
    command: str,
    pictures: Sequence[str],
) -> str:
    """HTML with all tables, and each failure with its picture and the command that repeats it.

    Args:
        results: Of the run.
        jobs: By suite, method and episode.
        folder: Where the page and the pictures are.
        about: `summary.summary` of the run.
        command: That made it.
        pictures: Names of figures in the folder.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("cableway.benchmark", ""), autoescape=True, undefined=jinja2.StrictUndefined
    )
    suites = [
        {"name": name, "description": sentence(name), "tables": suite_tables(name, rows)}
        for name, rows in results.items()
    ]
    return environment.get_template("report.html.jinja").render(
        suites=suites,
        failures=[
            _failure(result, jobs[result.suite, result.method, result.episode], folder)
            for rows in results.values()
            for found in rows.values()
            for result in found
            if not result.success
        ],
        metrics=list(METRICS.values()),
        command=command,
        pictures=pictures,
        **{key: about[key] for key in ("versions", "machine", "size")},
    )


def repeat_command(job: Job) -> str:
    """The command that runs a job again."""
    return f"cableway bench {job.episode.suite} --methods {job.source} --episodes {job.episode.name} --size full"


def _failure(result: Result, job: Job, folder: Path) -> dict[str, str]:
    picture = job.picture(folder)
    return {
        "suite": result.suite,
        "method": result.method,
        "episode": result.episode,
        "outcome": result.outcome,
        "detail": result.detail,
        "command": repeat_command(job),
        "picture": picture.relative_to(folder).as_posix() if picture.exists() else "",
    }
