"""Where work is done: in this process, in others on this machine, or on a Ray cluster. Results do not depend on it."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from cableway.core.errors import InputError, SimulationError, UnknownNameError

Result = TypeVar("Result")
Submit = Callable[..., Callable[[], Any]]
"""Begins `function(*arguments)`; what it returns waits for the result."""


@dataclass(frozen=True)
class Executor:
    """Something that works.

    Attributes:
        submit: Begins a call.
        workers: How many calls run at a time.
    """

    submit: Submit
    workers: int

    def in_order(self, function: Callable[..., Result], calls: Iterable[tuple[Any, ...]]) -> Iterator[Result]:
        """`function(*arguments)` for each of `calls`, in their order.

        Twice as many calls are under way as there are workers, so at most that many results wait in memory.
        """
        remaining = iter(calls)
        ahead = itertools.islice(remaining, 2 * self.workers)
        waiting = deque(self.submit(function, *arguments) for arguments in ahead)
        while waiting:
            result = waiting.popleft()()
            waiting.extend(self.submit(function, *arguments) for arguments in itertools.islice(remaining, 1))
            yield result


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def open_executor(name: str, workers: int | None) -> Iterator[Executor]:
    """An executor to use in a `with` statement.

    Args:
        name: "local" or "ray".
        workers: Calls at a time; all cores of this machine, or of the Ray cluster, where None. More than one local
            worker needs an importable main module (`if __name__ == "__main__"`).

    Raises:
        UnknownNameError: No such executor.
        InputError: `workers` is below 1, or Ray is not installed.
    """
    if workers is not None and workers < 1:
        raise InputError(f"workers must be at least 1, got {workers!r}")
    if name not in _EXECUTORS:
        raise UnknownNameError("executor", name, _EXECUTORS)
    with _EXECUTORS[name](workers) as executor:
        yield executor


@contextmanager
def _local(workers: int | None) -> Iterator[Executor]:
    count = workers or cores()
    if count == 1:
        yield Executor(lambda function, *arguments: lambda: function(*arguments), 1)
        return
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), begin_worker)
    try:
        yield Executor(lambda function, *arguments: pool.submit(function, *arguments).result, count)
    except BrokenProcessPool:
        raise SimulationError(
            "a collecting process died: out of memory, stopped from outside, or unable to import the main module "
            "(which needs `if __name__ == '__main__'`)"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def begin_worker() -> None:
    """In a worker: an interrupt is for the main process, and a main process that was killed takes its workers along."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _ray(workers: int | None) -> Iterator[Executor]:
    """The cluster that RAY_ADDRESS names, or a Ray of this machine's own for as long as it is needed."""
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise InputError("the executor 'ray' needs Ray, which is not installed: pip install 'cableway[ray]'") from None
    ours = not ray.is_initialized()
    if ours:
        address = os.environ.get("RAY_ADDRESS")
        place = {"address": address} if address else {"address": "local", "num_cpus": workers or cores()}
        ray.init(**place, include_dashboard=None if address else False, log_to_driver=False, logging_level="error")
    try:
        call = ray.remote(_call)
        count = workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        yield Executor(lambda function, *arguments: _result_of(ray, call.remote(function, *arguments)), count)
    except ray.exceptions.RayError as error:
        raise SimulationError(f"Ray could not carry on: {' '.join(str(error).split())[:300]}") from None
    finally:
        if ours:
            ray.shutdown()


def _call(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


def _result_of(ray: Any, reference: Any) -> Callable[[], Any]:
    def result() -> Any:
        try:
            return ray.get(reference)
        except ray.exceptions.RayTaskError as error:
            raise error.cause from None  # what the function raised, without Ray around it

    return result


_EXECUTORS = {"local": _local, "ray": _ray}

EXECUTORS = tuple(_EXECUTORS)
"""Names of the executors."""
