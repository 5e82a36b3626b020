"""Running the episodes of a benchmark at the edge, shared by `bench` and `reproduce`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from cableway.cli.interrupts import CONTINUES, INTERRUPTS
from cableway.cli.options import PictureOptions, WorkerOptions
from cableway.cli.terminal import OnProgress

if TYPE_CHECKING:
    from cableway.benchmark.episode import Job, Result
    from cableway.benchmark.summary import Results


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions(PictureOptions, WorkerOptions):
    """Options of the commands that run episodes."""

    seed: tyro.conf.Suppress[None] = None
    """Each episode of a suite has its own."""

    time_limit: float = 300.0
    """Seconds of processor time after which an episode is stopped and counts as a failure."""

    def results(self, jobs: Sequence[Job], folder: Path, progress: OnProgress) -> Results:
        """The results of jobs by suite and method; those that the folder does not have yet are run."""
        from cableway.benchmark.runner import read_result, run_jobs
        from cableway.workflow.compilation import compile_all

        INTERRUPTS.kept = partial(_kept, jobs, folder)
        missing = [job for job in jobs if read_result(job, folder) is None]
        ended, failed = len(jobs) - len(missing), 0
        if any(not job.episode.in_space for job in missing):
            compile_all(progress)  # here, so that no episode's time limit has it in it

        def done(result: Result) -> None:
            nonlocal ended, failed
            ended, failed = ended + 1, failed + (not result.success)
            progress(f"episodes: {ended} of {len(jobs)}, {failed} failed now", ended / len(jobs))

        if missing:
            progress(f"episodes: {ended} of {len(jobs)}", ended / len(jobs))
            run_jobs(
                missing, folder, executor=self.executor, workers=self.workers, time_limit=self.time_limit, done=done
            )
        results: dict[str, dict[str, list[Result]]] = {}
        for job in jobs:
            if (result := read_result(job, folder)) is not None:
                results.setdefault(job.episode.suite, {}).setdefault(job.method, []).append(result)
        return results


def _kept(jobs: Sequence[Job], folder: Path) -> str:
    """How many episodes have a result, in words."""
    from cableway.benchmark.runner import read_result

    ended = sum(read_result(job, folder) is not None for job in jobs)
    return f"{ended} of {len(jobs)} episodes are in {folder}, {CONTINUES}" if ended else ""
