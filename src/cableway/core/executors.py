"""Where work is done: in this process, in others on this machine, or on a Ray cluster. Results do not depend on it."""

from __future__ import annotations

import faulthandler
import itertools
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Any, Protocol, TypeVar

from cableway.core.errors import InputError, SimulationError, UnknownNameError, said
from cableway.core.extras import require
from cableway.core.logs import log_file, log_to

PATIENCE = 4.0
"""Wall time that an isolated local call may take, in units of its limit of processor time."""

POLLED = 0.01
"""Time [s] after which it is looked again whether workers have ended."""

_LAST: deque[tuple[Any, ...]] = deque(maxlen=1)
"""Queues of the last local pool. Without them a thread that ends with the pool would take its locks away, and the end
of the process would stop it in the midst of that: the resource tracker then warns of a leak."""

Result = TypeVar("Result")
Call = TypeVar("Call", bound=tuple[Any, ...])


class Pending(Protocol):
    """A call that was begun."""

    def result(self) -> Any:
        """Wait for what it returns, or raise what it raised."""
        ...


@dataclass(frozen=True)
class Executor:
    """Something that works.

    Attributes:
        submit: `submit(function, arguments, time_limit)` begins `function(*arguments)`; where the executor is isolated,
            a call that takes longer than the limit is ended: of processor time [s] in a local process, where other work
            on the machine does not count, or `PATIENCE` times that of wall time; of wall time on a cluster.
        workers: How many calls run at a time.
    """

    submit: Callable[[Callable[..., Any], tuple[Any, ...], float | None], Any]
    workers: int

    def in_order(self, function: Callable[..., Result], calls: Iterable[tuple[Any, ...]]) -> Iterator[Result]:
        """`function(*arguments)` for each of `calls`, in their order.

        Twice as many calls are under way as there are workers, so at most that many results wait in memory.
        """
        remaining = iter(calls)
        ahead = itertools.islice(remaining, 2 * self.workers)
        waiting: deque[Pending] = deque(self.submit(function, arguments, None) for arguments in ahead)
        while waiting:
            result = waiting.popleft().result()
            waiting.extend(self.submit(function, arguments, None) for arguments in itertools.islice(remaining, 1))
            yield result

    def as_they_end(
        self, function: Callable[..., Any], calls: Iterable[Call], time_limit: float
    ) -> Iterator[tuple[Call, Pending]]:
        """Each of `calls` once it ended, at most twice as many as there are workers begun or waiting.

        For isolated executors. The `result` of a call that took too long raises `TimeoutError`, of one whose process
        died another error that names this.
        """
        remaining = iter(calls)
        ahead = itertools.islice(remaining, 2 * self.workers)
        running: dict[Future[Any], Call] = {self.submit(function, call, time_limit): call for call in ahead}
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                call = running.pop(future)
                for other in itertools.islice(remaining, 1):
                    running[self.submit(function, other, time_limit)] = other
                yield call, _Ended(future)


@dataclass(frozen=True)
class _Ended:
    """A call in an isolated process, which the system ends where it has used its processor time up."""

    future: Future[Any]

    def result(self) -> Any:
        try:
            return self.future.result()
        except Exception as error:
            if sys.platform != "win32" and getattr(error, "exitcode", None) == -signal.SIGPROF:
                raise TimeoutError from None
            raise


class _Later:
    """A call that is made when its result is asked for."""

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...], time_limit: float | None) -> None:
        self.result = lambda: function(*arguments)


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


@contextmanager
def open_executor(
    name: str, workers: int | None, *, isolated: bool = False, begin: Callable[[], None] | None = None
) -> Iterator[Executor]:
    """An executor to use in a `with` statement.

    Args:
        name: "local" or "ray".
        workers: Calls at a time; all cores of this machine, or of the Ray cluster, where None. More than one local
            worker needs an importable main module (`if __name__ == "__main__"`).
        isolated: Whether calls can be limited in time, and one whose process dies costs no other.
        begin: Called in every local process of an isolated executor before its first call.

    Raises:
        UnknownNameError: No such executor.
        InputError: `workers` is below 1.
        MissingExtraError: Ray is not installed.
    """
    if workers is not None and workers < 1:
        raise InputError(f"workers must be at least 1, got {workers!r}")
    if name not in _EXECUTORS:
        raise UnknownNameError("executor", name, _EXECUTORS)
    opened = _isolated(workers, begin) if isolated and name == "local" else _EXECUTORS[name](workers)
    with opened as executor:
        yield executor


@contextmanager
def _local(workers: int | None) -> Iterator[Executor]:
    count = workers or cores()
    if count == 1:
        yield Executor(_Later, 1)
        return
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), begin_worker, (log_file(),))
    _LAST.append(tuple(getattr(pool, name, None) for name in ("_call_queue", "_result_queue")))

    def submit(function: Callable[..., Any], arguments: tuple[Any, ...], _: float | None) -> Any:
        with deaf_to_interrupts():
            return pool.submit(function, *arguments)

    try:
        yield Executor(submit, count)
        _shut_down(pool, before)  # here, so that workers end, too, where this is interrupted
    except BrokenProcessPool:
        raise SimulationError(
            "a worker process died: out of memory, killed, or unable to import the main module "
            "(which needs `if __name__ == '__main__'`)"
        ) from None
    except BaseException:
        _end_workers(before)  # or they finish what they are at, for which nobody waits any more
        raise
    finally:
        _shut_down(pool, before)


def _shut_down(pool: ProcessPoolExecutor, others: set[Any]) -> None:
    """Call off what has not begun, and wait for all processes of this one but `others`.

    Not for the pool's thread, as the pool would: before Python 3.13 one that is waited for counts as ended once the
    wait is interrupted, and the pool closes what it still reads.
    """
    pool.shutdown(wait=False, cancel_futures=True)
    while set(multiprocessing.active_children()) - others:
        time.sleep(POLLED)


def _end_workers(others: set[Any]) -> None:
    """Have all processes of this one end, but for `others`."""
    for worker in set(multiprocessing.active_children()) - others:
        worker.terminate()


@contextmanager
def _isolated(workers: int | None, begin: Callable[[], None] | None) -> Iterator[Executor]:
    """Processes of which each can be ended, and is made again where it died."""
    import pebble

    count = workers or cores()
    before = set(multiprocessing.active_children())
    context: Any = multiprocessing.get_context("spawn")
    pool = pebble.ProcessPool(count, context=context, initializer=begin_worker, initargs=[log_file(), begin])

    def submit(function: Callable[..., Any], arguments: tuple[Any, ...], limit: float | None) -> Any:
        most = None if limit is None else PATIENCE * limit
        with deaf_to_interrupts():
            return pool.schedule(_within, args=[function, arguments, limit], timeout=most)

    try:
        yield Executor(submit, count)
        pool.close()
        pool.join()
    except BaseException:
        pool.stop()
        _end_workers(before)  # before the pool takes its locks away, or a worker that still begins fails aloud
        raise
    finally:  # again, where that was interrupted
        pool.stop()
        pool.join()


def _within(function: Callable[..., Any], arguments: tuple[Any, ...], limit: float | None) -> Any:
    """A call in a process that ends by SIGPROF after so much processor time [s]; Windows has no such clock."""
    if sys.platform == "win32":
        return _failing(function, arguments)
    signal.setitimer(signal.ITIMER_PROF, limit or 0.0)
    try:
        return _failing(function, arguments)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _failing(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """A call whose `sys.exit` or `KeyboardInterrupt` is an error, which does not end the main process as well."""
    try:
        return function(*arguments)
    except Exception:
        raise
    except BaseException as error:
        raise RuntimeError(f"the process was to be ended by {said(error)}") from None


@contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Threads and processes that begin meanwhile never hear an interrupt, not even before `begin_worker`; this thread
    hears one afterwards, or a process that is only half begun would fail with a traceback.
    """
    with _heard_later():
        if sys.platform == "win32":  # where workers alone turn deaf
            yield
            return
        resource_tracker.ensure_running()  # where it is begun meanwhile, it lets interrupts through again
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _heard_later() -> Iterator[None]:
    """What handles a signal in Python does so once this is over. Blocking does not do: other threads receive it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    with ExitStack() as stack:
        stack.callback(lambda: [signal.raise_signal(number) for number in came])
        for number in signal.valid_signals():
            if callable(handler := signal.getsignal(number)):
                stack.callback(signal.signal, number, handler)
                signal.signal(number, lambda number, _: came.append(number))
        yield


def begin_worker(log: str | None, begin: Callable[[], None] | None = None) -> None:
    """In a worker: an interrupt is for the main process, and a main process that was killed takes its workers along.

    A worker that is to end does so in the midst of a kernel, too, which a handler written in Python would wait for.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    log_to(log)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if begin is not None:
        begin()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _ray(workers: int | None) -> Iterator[Executor]:
    """The cluster that RAY_ADDRESS names, or a Ray of this machine's own for as long as it is needed."""
    require("ray", "the executor 'ray'")
    import ray  # pyright: ignore[reportMissingImports]

    ours = not ray.is_initialized()
    if ours:
        address = os.environ.get("RAY_ADDRESS")
        place = {"address": address} if address else {"address": "local", "num_cpus": workers or cores()}
        ray.init(**place, include_dashboard=None if address else False, log_to_driver=False, logging_level="error")
    try:
        call = ray.remote(_call)
        count = workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        with ThreadPoolExecutor(2 * count) as waiting:
            yield Executor(
                lambda function, arguments, limit: waiting.submit(_get, ray, call.remote(function, arguments, limit)),
                count,
            )
    except ray.exceptions.RayError as error:
        raise SimulationError(f"Ray failed: {' '.join(str(error).split())[:300]}") from None
    finally:
        if ours:
            ray.shutdown()


def _call(function: Callable[..., Any], arguments: tuple[Any, ...], time_limit: float | None) -> Any:
    """What hangs ends itself on a cluster, as nobody outside can reach it."""
    if time_limit is None:
        return _failing(function, arguments)
    faulthandler.dump_traceback_later(time_limit, exit=True)
    try:
        return _failing(function, arguments)
    finally:
        faulthandler.cancel_dump_traceback_later()


def _get(ray: Any, reference: Any) -> Any:
    try:
        return ray.get(reference)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from None  # what the function raised, without Ray around it


_EXECUTORS = {"local": _local, "ray": _ray}
"""By name."""
