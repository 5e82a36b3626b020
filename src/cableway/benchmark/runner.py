"""Runs episodes side by side, where collection runs too, and keeps every result at once."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from cableway.benchmark.episode import Job, Result, Scored, died, run_job, warm_up
from cableway.benchmark.spatial_episode import warm_up_in_space
from cableway.core.configuration import from_mapping
from cableway.core.errors import FileFormatError, InputError
from cableway.core.executors import Pending, open_executor
from cableway.core.files import write_bytes, write_json
from cableway.core.reading import read_json
from cableway.outcome import Outcome

EPISODES, FAILURES = "episodes", "failures"
"""Folders of results and of pictures of what failed."""

LOGGER = logging.getLogger(__name__)

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}
"""What keeps a worker to one core, so that times mean the same however many there are."""


def result_path(job: Job, folder: Path) -> Path:
    """Where a job's result is kept."""
    return folder / EPISODES / job.episode.suite / job.method / f"{job.episode.name}.json"


def picture_path(job: Job, folder: Path) -> Path:
    """Where a job's picture is kept where it failed."""
    return folder / FAILURES / job.episode.suite / job.method / f"{job.episode.name}.png"


def read_result(job: Job, folder: Path) -> Result | None:
    """The result of a job, None where it is yet to be run, or was made by another version of the method.

    Raises:
        FileFormatError: The file is damaged, or its task is another one than the job's.
    """
    path = result_path(job, folder)
    if not path.exists():
        return None
    try:
        result = from_mapping(Result, read_json(path), str(path))
    except InputError as error:
        raise FileFormatError(f"{error}; remove the file to run the episode again") from None
    if result.digest != job.episode.digest:
        raise FileFormatError(f"{path}: result of a task with digest {result.digest}, not {job.episode.digest}")
    return result if result.made_by == job.made_by else None


def run_jobs(
    jobs: Sequence[Job],
    folder: Path,
    *,
    executor: str = "local",
    workers: int | None = None,
    time_limit: float = 300.0,
    done: Callable[[Result], None] = lambda result: None,
) -> None:
    """Run jobs and keep each result in the folder as it comes.

    Args:
        jobs: What to run, in this order.
        folder: Where results go.
        executor: "local" or "ray".
        workers: Episodes at a time; as many as there are cores where None.
        time_limit: Processor time [s] after which an episode is given up and its process ended; see
            `core.executors.Executor`.
        done: Called with each result.

    Raises:
        UnknownNameError: No such executor; the message lists them.
        InputError: A number is out of range, or Ray is not installed.
    """
    if not time_limit > 0:
        raise InputError(f"the time limit must be positive, got {time_limit!r}")
    begin = warm_up_in_space if all(job.episode.in_space for job in jobs) else warm_up
    begin = begin if executor == "local" else None
    with _one_thread(), open_executor(executor, workers, isolated=True, begin=begin) as pool:
        for (job,), ended in pool.as_they_end(run_job, ((job,) for job in jobs), time_limit):
            scored = _scored(job, ended, time_limit)
            _keep(job, scored, folder)
            LOGGER.info("%s, %s: %s", scored.result.method, scored.result.episode, scored.result.outcome)
            done(scored.result)


def _keep(job: Job, scored: Scored, folder: Path) -> None:
    picture = picture_path(job, folder)
    picture.unlink(missing_ok=True)
    if scored.picture is not None:
        write_bytes(picture, scored.picture)
    write_json(result_path(job, folder), asdict(scored.result))


@contextmanager
def _one_thread() -> Iterator[None]:
    """Workers begun meanwhile keep to one core each, unless the user says otherwise."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update({name: value for name, value in ONE_THREAD.items() if before[name] is None})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]


def _scored(job: Job, ended: Pending, time_limit: float) -> Scored:
    """What an episode came to; one that died costs itself alone."""
    try:
        return ended.result()
    except TimeoutError:
        outcome, detail = Outcome.TIMED_OUT, f"not finished within {time_limit:g} s of processor time"
    except Exception as error:
        outcome, detail = Outcome.CRASHED, f"{type(error).__name__}: {' '.join(str(error).split())[:500]}"
    return died(job, outcome, detail)
