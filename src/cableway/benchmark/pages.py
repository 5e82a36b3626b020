"""Reports as pages that open without a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cableway.benchmark.episode import Job, Result
from cableway.benchmark.runner import picture_path
from cableway.benchmark.summary import Results, commits_text, each_of
from cableway.benchmark.tables import sentence, suite_tables
from cableway.core.templates import render
from cableway.metrics import METRICS


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
    suites = [
        {"name": name, "description": sentence(name), "tables": suite_tables(name, figures)}
        for name, figures in about["suites"].items()
    ]
    return render(
        "report.html.jinja",
        "cableway.benchmark",
        suites=suites,
        failures=[
            _failure(result, jobs[result.suite, result.method, result.episode], folder, about["size"])
            for result in each_of(results)
            if not result.success
        ],
        metrics=[metric for metric in METRICS.values() if metric.title],
        command=command,
        pictures=pictures,
        commits=commits_text(about["commits"]),
        **{key: about[key] for key in ("versions", "machine", "size")},
    )


def repeat_command(job: Job, size: str) -> str:
    """The command that runs a job of a size of its suite again."""
    return f"cableway bench {job.episode.suite} --size {size} --methods {job.source} --episodes {job.episode.name}"


def _failure(result: Result, job: Job, folder: Path, size: str) -> dict[str, str]:
    picture = picture_path(job, folder)
    return {
        "suite": result.suite,
        "method": result.method,
        "episode": result.episode,
        "outcome": result.outcome,
        "detail": result.detail,
        "command": repeat_command(job, size),
        "picture": picture.relative_to(folder).as_posix() if picture.exists() else "",
    }
