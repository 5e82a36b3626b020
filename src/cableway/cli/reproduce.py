"""`cableway reproduce`: the paper's tables and figures, its numbers and ours side by side."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cableway.cli.episodes import EpisodeOptions
from cableway.cli.terminal import OnProgress, Terminal, pairs
from cableway.core.errors import UnknownNameError

if TYPE_CHECKING:
    from pathlib import Path

    from cableway.benchmark.episode import Job
    from cableway.benchmark.summary import Results
    from cableway.tang2025.reproduction.page import Section

PAGE, TEXT, DATA = "reproduction.html", "reproduction.md", "reproduction.json"

SIZES = {"quick": ("quick", 2000, 2000, 1, 3), "full": ("standard", 10000, 25000, 7, 16)}
"""For each size: that of the suites, transitions for each cable, and for fine-tuning, repetitions of what is timed, and
trials of the case studies."""


@dataclass(frozen=True, kw_only=True)
class Reproduce(EpisodeOptions):
    """Make the paper's tables and figures: reproduction.html, reproduction.md, reproduction.json, pictures.

    Each episode's result is saved at once; the same command continues an interrupted run.
    """

    size: Annotated[str, tyro.conf.arg(metavar="{quick,full}")] = "quick"
    """quick: a quarter of an hour on two cores; full: as many trials as the paper, and more."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.benchmark.summary import commits, machine
        from cableway.core.files import only_writer, write_json, write_text
        from cableway.core.provenance import commit, versions
        from cableway.tang2025.reproduction.page import reproduction_page, reproduction_text

        if self.size not in SIZES:
            raise UnknownNameError("size", self.size, SIZES)
        terminal, folder = Terminal(self), self.folder("reproduce")
        jobs = self._jobs()
        with only_writer(folder), terminal.progress() as progress:
            results = self.results(jobs, folder, progress)
            sections = self._sections(results, folder, progress)
            about = {
                "versions": versions(),
                "commit": commit(),
                "commits": commits(results),
                "machine": machine(),
                "size": self.size,
                "configuration": self._configuration(),
            }
            write_text(folder / PAGE, reproduction_page(sections, about))
            write_text(folder / TEXT, reproduction_text(sections, about))
            content = about | {"sections": [asdict(section) for section in sections]}
            write_json(folder / DATA, content)
        terminal.note(f"In {folder}: {PAGE}, {TEXT}, {DATA}")
        rows = [
            (section.title, f"{len(section.tables)} tables, {len(section.pictures)} pictures") for section in sections
        ]
        terminal.result(content, pairs(rows))
        return 0

    def _configuration(self) -> dict[str, Any]:
        """What was run, with the seeds that no list of a suite has."""
        from cableway.tang2025.reproduction import identification, reproduction

        suites, transitions, tuning, repeats, trials = SIZES[self.size]
        return {
            "methods": {suite: list(methods) for suite, methods in reproduction.RUNS.items()},
            "suites": suites,
            "transitions": transitions,
            "fine_tuning_transitions": tuning,
            "repetitions": repeats,
            "trials": trials,
            "data_seeds": [reproduction.DATA_SEED, identification.IDENTIFICATION_SEED, identification.TUNING_SEED],
        }

    def _jobs(self) -> list[Job]:
        from cableway.benchmark.episode import jobs_of
        from cableway.benchmark.methods import DEFAULT
        from cableway.benchmark.suites import get_suite
        from cableway.tang2025.reproduction.reproduction import RUNS

        size = SIZES[self.size][0]
        return [
            job
            for suite, methods in RUNS.items()
            for method in methods
            for job in jobs_of(method, get_suite(suite).episodes(size, own=method == DEFAULT))
        ]

    def _sections(self, results: Results, folder: Path, progress: OnProgress) -> list[Section]:
        from cableway.tang2025.reproduction import between_arms, case_studies, reproduction

        _, transitions, tuning, repeats, trials = SIZES[self.size]
        progress("figures", 0.0)
        return [
            reproduction.hyperparameters(),
            reproduction.planning(folder, self.draw),
            reproduction.simulated(results),
            between_arms.between_arms(results),
            case_studies.over_time(folder, self.draw, progress),
            reproduction.prediction(folder, transitions, tuning, progress, self.draw),
            reproduction.unconstrained(results),
            case_studies.without_obstacles(folder, self.draw, progress),
            reproduction.summary(results),
            case_studies.mazes(folder, trials, progress, self.draw),
            case_studies.one_plan(folder, self.draw),
            case_studies.tracking(folder, self.draw),
            case_studies.silicone(folder, transitions, trials, progress),
            case_studies.insertion(folder, trials, progress, self.draw),
            reproduction.cost(repeats, progress),
        ]
