"""`cableway bench`: suites x methods, each episode kept as it comes, then tables, figures and a report."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cableway.cli.episodes import EpisodeOptions
from cableway.cli.options import Maybe
from cableway.cli.terminal import Terminal, columns
from cableway.core.errors import InputError

if TYPE_CHECKING:
    from cableway.benchmark.episode import Job, Result
    from cableway.benchmark.methods import Method
    from cableway.benchmark.suites import Suite
    from cableway.benchmark.summary import Results

CSV, SUMMARY, TABLES, PAGE, BASELINE = "results.csv", "summary.json", "tables.md", "report.html", "baseline.json"
SUCCESS_PICTURE, ERROR_PICTURE = "success.png", "errors.png"


@dataclass(frozen=True, kw_only=True)
class Bench(EpisodeOptions):
    """Run methods on suites of tasks: results.csv, summary.json, tables.md, figures, report.html, baseline.json.

    Each episode's result is saved at once; the same command continues an interrupted run.
    """

    suites: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="SUITES")]
    """Names, separated by commas, or all. Suites that judge planners, as open loop succeeds in them too: paper,
    clutter, dense, corridors, mazes, sensing, unconstrained, blocked. Suites that judge controllers: plants,
    plants-rough, table, limp, faults, cell, eyes, paper-cell, lengths, lab-constrained, lab-unconstrained,
    lab-drawn. In space, and not among all: space-clutter, space-dense, windows, yu, yu-cell, extruded, lift, with the
    methods cableway (rod-mpc), rod-jacobian and open-loop."""

    size: Annotated[str, tyro.conf.arg(metavar="{quick,standard,full}")] = "quick"
    """How many episodes of each suite."""

    methods: str = "cableway"
    """Names, separated by commas: cableway, true-keypoints, markers, unrehearsed, rod-jacobian, broyden, open-loop,
    tdm-mpc, cdm-mpc, bdm-mpc, tang2025, tang2025-tracking, tang2025-plan, tang2025-refined-plan, straight-plan,
    slide-plan, rrt-connect-plan; FILE.py:NAME or package.module:NAME for your own, whose code is run. In eyes,
    true-keypoints is always run, too."""

    episodes: Maybe[str] = None
    """Only these episodes, separated by commas; by default, all."""

    deadline: Maybe[float] = None
    """Wall time [s] after which a control step counts as missed, and the grippers coast to rest; by default, none."""

    against: Maybe[Path] = None
    """The baseline.json of an earlier run; the exit status is 1 if this run is significantly worse.
    By default, nothing is compared."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.benchmark.gate import read_baseline, regressions
        from cableway.benchmark.methods import load_method
        from cableway.benchmark.suites import SPACE_SUITES, SUITES, get_suite
        from cableway.benchmark.summary import each_of
        from cableway.core.files import only_writer

        terminal, folder = Terminal(self), self.folder("bench")
        before = None if self.against is None else read_baseline(self.against)
        planar = [name for name in SUITES if name not in SPACE_SUITES]
        suites = [get_suite(name) for name in (planar if self.suites == "all" else self.suites.split(","))]
        beside = [source for suite in suites for source in suite.beside]
        methods = {source: load_method(source) for source in dict.fromkeys([*beside, *self.methods.split(",")])}
        jobs = self._jobs(suites, methods)
        with only_writer(folder), terminal.progress() as progress:
            results = self.results(jobs, folder, progress)
            about = self._write(results, jobs, list(methods.values()), folder)
        terminal.note(f"In {folder}: {CSV}, {SUMMARY}, {TABLES}, {PAGE}, {BASELINE}")
        worse = [] if before is None else regressions(list(each_of(results)), before)
        terminal.result(about | {"regressions": worse}, _shown(results))
        for sentence in _missed(results):
            terminal.note(sentence)
        for sentence in worse:
            terminal.note(f"worse than {self.against}: {sentence}")
        return 1 if worse else 0

    def _jobs(self, suites: Sequence[Suite], methods: Mapping[str, Method]) -> list[Job]:
        """All jobs of the run, suite by suite, the methods of an episode one after the other: those beside which others
        are to be seen first."""
        from cableway.benchmark.episode import jobs_of
        from cableway.benchmark.methods import DEFAULT
        from cableway.benchmark.suites import episode_name

        if len({method.name for method in methods.values()}) < len(methods):
            raise InputError(f"--methods: two methods of {self.methods!r} have the same name")
        jobs: list[Job] = []
        asked = self.methods.split(",")
        for suite in suites:
            chosen = dict.fromkeys([*suite.beside, *asked])
            own = [(source, suite.episodes(self.size, own=source == DEFAULT)) for source in chosen]
            each = [jobs_of(source, episodes, self.deadline) for source, episodes in own]
            jobs += [job for row in zip_longest(*each) for job in row if job is not None]
        if self.episodes is None:
            return jobs
        wanted, known = [episode_name(name) for name in self.episodes.split(",")], {job.episode.name for job in jobs}
        names = ", ".join(suite.name for suite in suites)
        for name in wanted:
            if name not in known:
                raise InputError(f"--episodes: no {name!r} in {names} of size {self.size}, whose episodes are like "
                                 f"{jobs[0].episode.name!r} and {jobs[-1].episode.name!r}")  # fmt: skip
        return [job for job in jobs if job.episode.name in wanted]

    def _write(self, results: Results, jobs: Sequence[Job], methods: Sequence[Method], folder: Path) -> dict[str, Any]:
        """Leave all files of a finished run."""
        from cableway.benchmark.gate import baseline
        from cableway.benchmark.pages import report_page
        from cableway.benchmark.summary import csv_text, each_of, summary
        from cableway.benchmark.tables import markdown
        from cableway.core.files import write_json, write_text

        found = list(each_of(results))
        names = ("suites", "methods", "episodes", "deadline", "time_limit", "executor", "workers")
        chosen = {name: getattr(self, name) for name in names}
        about = summary(results, methods, self.size, chosen)
        page = report_page(
            results,
            {(job.episode.suite, job.method, job.episode.name): job for job in jobs},
            folder,
            about=about,
            command=f"cableway {shlex.join(sys.argv[1:])}",
            pictures=self._write_pictures(results, about, folder),
        )
        for name, text in ((CSV, csv_text(found)), (TABLES, markdown(about)), (PAGE, page)):
            write_text(folder / name, text)
        write_json(folder / SUMMARY, about)
        write_json(folder / BASELINE, baseline(found))
        return about

    def _write_pictures(self, results: Results, about: Mapping[str, Any], folder: Path) -> list[str]:
        """Draw shares of success and distributions of the error; names of the files."""
        from cableway.benchmark.summary import success_shares
        from cableway.figures.benchmark import error_figure, success_figure
        from cableway.outcome import SUCCESS_ERROR

        self.draw(success_figure(success_shares(about)), folder / SUCCESS_PICTURE)
        errors = {
            suite: {name: [_error(result) for result in each] for name, each in rows.items()}
            for suite, rows in results.items()
            if any(result.shape_error is not None for each in rows.values() for result in each)
        }
        if not errors:
            return [SUCCESS_PICTURE]
        self.draw(error_figure(errors, (0.01, SUCCESS_ERROR)), folder / ERROR_PICTURE)
        return [SUCCESS_PICTURE, ERROR_PICTURE]


def _missed(results: Results) -> list[str]:
    """How many control steps missed the deadline, a sentence for each suite and method."""
    from cableway.benchmark.summary import missed_steps

    return [
        f"{suite}, {name}: {count['missed']} of {count['steps']} control steps missed the deadline"
        for suite, rows in results.items()
        for name, found in rows.items()
        for count in missed_steps(found).values()
    ]


def _error(result: Result) -> float:
    """Infinite where the episode failed though its error may be small."""
    return math.inf if result.contact or result.shape_error is None else result.shape_error


def _shown(results: Results) -> Any:
    from cableway.benchmark.statistics import estimate, quantiles
    from cableway.benchmark.tables import number
    from cableway.metrics import METRICS

    table = columns("suite", "method", "n", "< 3 cm [%]", "< 1 cm [%]", "error, median / worst [mm]", "failures")
    for suite, rows in results.items():
        for name, found in rows.items():
            errors = quantiles(METRICS["shape_error"], found)
            shares = [estimate(METRICS[rule], found) for rule in ("success", "strict")]
            outcomes = [result.outcome for result in found if not result.success]
            table.add_row(
                suite, name, str(len(found)),
                *(number(100 * share.value) if share else "-" for share in shares),
                " / ".join(number(1000 * errors[key]) for key in ("median", "worst")) if errors else "-",
                ", ".join(f"{outcomes.count(each)} {each}" for each in dict.fromkeys(outcomes)),
            )  # fmt: skip
    return table
