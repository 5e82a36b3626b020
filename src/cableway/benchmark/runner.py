"""Runs episodes side by side, each in a process that it can take down with it, and keeps every result at once."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any

import pebble

from cableway.benchmark.episode import Job, Result, Scored, died, run_job, warm_up
from cableway.core.errors import FileFormatError, InputError, UnknownNameError
from cableway.core.executors import EXECUTORS, begin_worker, cores, open_executor
from cableway.core.files import write_atomically, write_json
from cableway.records import Outcome

EPISODES, FAILURES = "episodes", "failures"
"""Folders of results and of pictures of what failed."""

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
        result = Result(**json.loads(path.read_text()))
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: not a result of this version ({error}); remove it to run it again") from None
    if result.digest != job.episode.digest:
        raise FileFormatError(f"{path}: of a task with the digest {result.digest}, not {job.episode.digest}")
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
        time_limit: Wall time [s] after which an episode is given up and its process ended.
        done: Told of each result.

    Raises:
        UnknownNameError: No such executor; the message lists them.
        InputError: A number is out of range, or Ray is not installed.
    """
    if not time_limit > 0:
        raise InputError(f"the time limit must be positive, got {time_limit!r}")
    if workers is not None and workers < 1:
        raise InputError(f"workers must be at least 1, got {workers!r}")
    if executor not in EXECUTORS:
        raise UnknownNameError("executor", executor, EXECUTORS)
    run = _on_ray if executor == "ray" else _locally
    for job, outcome in run(jobs, workers, time_limit):
        picture = picture_path(job, folder)
        picture.unlink(missing_ok=True)
        if outcome.picture is not None:
            content = outcome.picture
            write_atomically(picture, lambda file, content=content: file.write(content))
        write_json(result_path(job, folder), asdict(outcome.result))
        done(outcome.result)


def _locally(jobs: Sequence[Job], workers: int | None, time_limit: float) -> Iterator[tuple[Job, Scored]]:
    count = workers or cores()
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update({name: value for name, value in ONE_THREAD.items() if before[name] is None})
    pool = pebble.ProcessPool(count, context=multiprocessing.get_context("spawn"), initializer=_begin)
    try:
        yield from _as_they_end(
            jobs,
            2 * count,
            lambda job: pool.schedule(run_job, args=[job], timeout=time_limit),
            time_limit,
        )
        pool.close()
    finally:
        pool.stop()
        pool.join()
        for name, value in before.items():
            if value is None:
                del os.environ[name]


def _begin() -> None:
    """In a worker, before the clock of its first episode runs."""
    begin_worker()
    warm_up()


def _on_ray(jobs: Sequence[Job], workers: int | None, time_limit: float) -> Iterator[tuple[Job, Scored]]:
    """On a Ray cluster; what hangs ends itself there, as nobody outside can reach it."""
    with open_executor("ray", workers) as cluster, ThreadPoolExecutor(2 * cluster.workers) as waiting:
        yield from _as_they_end(
            jobs,
            2 * cluster.workers,
            lambda job: waiting.submit(cluster.submit(_limited, job, time_limit)),
            time_limit,
        )


def _limited(job: Job, time_limit: float) -> Scored:
    import faulthandler

    faulthandler.dump_traceback_later(time_limit, exit=True)
    try:
        return run_job(job)
    finally:
        faulthandler.cancel_dump_traceback_later()


def _as_they_end(
    jobs: Sequence[Job], ahead: int, submit: Callable[[Job], Future[Any]], time_limit: float
) -> Iterator[tuple[Job, Scored]]:
    """Jobs with what became of them, at most `ahead` of them begun or waiting at a time."""
    remaining = iter(jobs)
    running = {submit(job): job for job in islice(remaining, ahead)}
    while running:
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            job = running.pop(future)
            running.update({submit(other): other for other in islice(remaining, 1)})
            yield job, _outcome(job, future, time_limit)


def _outcome(job: Job, future: Future[Any], time_limit: float) -> Scored:
    """What an episode came to; one that died costs itself alone."""
    try:
        return future.result()
    except TimeoutError:
        outcome, detail = Outcome.TIMED_OUT, f"not done within {time_limit:g} s"
    except (Exception, pebble.ProcessExpired) as error:
        outcome, detail = Outcome.CRASHED, f"{type(error).__name__}: {' '.join(str(error).split())[:500]}"
    return died(job, outcome, detail)
