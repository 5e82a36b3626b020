"""Laws of isolated executors: a call is ended by the processor time it took, and at last by wall time."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import synchronize
from pathlib import Path

import pytest
from pebble.pool.process import WorkerManager

from cableway.core import executors
from cableway.core.logs import LogFile


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Path]:
    """The file that this process logs to."""
    handler = LogFile(tmp_path / "log.txt")
    logging.getLogger().addHandler(handler)
    yield tmp_path / "log.txt"
    logging.getLogger().removeHandler(handler)
    handler.close()


@pytest.mark.parametrize("isolated", [False, True])
def test_workers_log_to_the_file_of_the_process_that_began_them(log: Path, isolated: bool):
    """Each record with the number of its process; records below the level of the root count, too."""
    with executors.open_executor("local", 2, isolated=isolated) as pool:
        for text in ("one", "two"):
            pool.submit(logging.getLogger("cableway.worker").debug, (text,), None).result()
    found = sorted(re.findall(r"DEBUG cableway\.worker\[(\d+)\]: (\w+)\n", log.read_text()), key=lambda pair: pair[1])
    assert [text for _, text in found] == ["one", "two"]
    assert str(os.getpid()) not in {process for process, _ in found}


@pytest.mark.parametrize(
    ("function", "argument"), [(sum, range(10**12)), (time.sleep, 600)], ids=["computing", "hanging"]
)
def test_a_call_that_takes_too_long_is_ended(function, argument):
    with executors.open_executor("local", 1, isolated=True) as pool:
        for _, ended in pool.as_they_end(function, [(argument,)], time_limit=0.5):
            with pytest.raises(TimeoutError):
                ended.result()


def test_time_that_others_take_does_not_count():
    """A second of wall time in which nothing is computed, with a limit of half a second."""
    with executors.open_executor("local", 1, isolated=True) as pool:
        assert [ended.result() for _, ended in pool.as_they_end(time.sleep, [(1.0,)], time_limit=0.5)] == [None]


def test_workers_end_where_the_end_of_their_pool_is_interrupted(monkeypatch: pytest.MonkeyPatch):
    """Idle ones, which no one would tell any more that there is nothing to do."""
    before, shutdown = set(multiprocessing.active_children()), ProcessPoolExecutor.shutdown

    def interrupted(pool: ProcessPoolExecutor, **options: bool) -> None:
        monkeypatch.setattr(ProcessPoolExecutor, "shutdown", shutdown)
        raise KeyboardInterrupt

    monkeypatch.setattr(ProcessPoolExecutor, "shutdown", interrupted)
    with pytest.raises(KeyboardInterrupt), executors.open_executor("local", 2) as pool:  # noqa: PT012
        assert pool.submit(sum, ([1],), None).result() == 1
        workers = set(multiprocessing.active_children()) - before
    for worker in workers:
        worker.join(20)
        assert worker.exitcode is not None


def test_a_pool_that_is_interrupted_as_it_ends_says_nothing(monkeypatch: pytest.MonkeyPatch):
    """Its thread is slow and has calls left, and must not find closed what it still reads."""
    failed = list[threading.ExceptHookArgs]()
    monkeypatch.setattr(threading, "excepthook", failed.append)
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), executors.open_executor("local", 2) as pool:  # noqa: PT012
            first, *_ = [pool.submit(time.sleep, (seconds,), None) for seconds in (0, 20, 20, 20)]
            first.add_done_callback(lambda _: time.sleep(0.5))
            first.result()
            signal.setitimer(signal.ITIMER_REAL, 0.2)
    finally:
        signal.signal(signal.SIGALRM, before)
    time.sleep(0.5)
    assert not failed


class _InterruptingBegin:
    """Interrupts the process that begins workers while it hands them this; another thread of it receives the signal."""

    number, handed = signal.SIGINT, 0

    def __call__(self) -> None: ...

    def __reduce__(self) -> tuple[type, tuple[()]]:
        type(self).handed += 1
        os.kill(os.getpid(), self.number)
        time.sleep(0.05)
        return _InterruptingBegin, ()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGALRM])
def test_an_interrupt_comes_after_the_workers_have_begun(number: signal.Signals, monkeypatch: pytest.MonkeyPatch):
    """All of them, so that none finds the process gone that was telling it what to do."""
    over = threading.Event()
    threading.Thread(target=over.wait, daemon=True).start()
    monkeypatch.setattr(_InterruptingBegin, "number", number)
    monkeypatch.setattr(_InterruptingBegin, "handed", 0)
    before = signal.signal(number, signal.default_int_handler)
    try:
        with (
            pytest.raises(KeyboardInterrupt),
            executors.open_executor("local", 2, isolated=True, begin=_InterruptingBegin()) as pool,
        ):
            pool.submit(sum, ([1],), None)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        over.set()
        signal.signal(number, before)
    assert _InterruptingBegin.handed == 2


def test_workers_that_still_begin_as_their_pool_ends_say_nothing(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    """They are ended before the pool takes away what they wait for, however long it takes over its own end."""
    stop = WorkerManager.force_stop_workers

    def slowly(manager: WorkerManager) -> None:
        time.sleep(2.0)
        stop(manager)

    monkeypatch.setattr(WorkerManager, "force_stop_workers", slowly)
    with (
        contextlib.suppress(KeyboardInterrupt),
        executors.open_executor("local", 2, isolated=True) as pool,
    ):
        pool.submit(time.sleep, (60,), None)
        raise KeyboardInterrupt
    assert capfd.readouterr().err == ""


def test_a_worker_in_the_midst_of_a_kernel_ends_when_it_is_told_to():
    """`sum` stands for a kernel: a signal's handler in Python waits for its end."""
    before = set(multiprocessing.active_children())
    with executors.open_executor("local", 1, isolated=True) as pool:
        assert pool.submit(sum, ([1],), None).result() == 1
        (worker,) = set(multiprocessing.active_children()) - before
        pool.submit(sum, (range(10**12),), None)
        os.kill(worker.pid, signal.SIGTERM)
        worker.join(60)
        assert worker.exitcode == -signal.SIGTERM


def test_a_pools_locks_are_not_taken_away_as_its_threads_end(monkeypatch: pytest.MonkeyPatch):
    """Where the process ends soon after, they would be stopped in the midst of it."""
    taken_away, unlinked = vars(synchronize)["sem_unlink"], list[str]()

    def unlink(name: str) -> None:
        taken_away(name)
        unlinked.append(threading.current_thread().name)

    executors._LAST.clear()
    monkeypatch.setattr(synchronize, "sem_unlink", unlink)
    running = len(sys._current_frames())
    for others in (set[str](), {threading.main_thread().name}):
        with executors.open_executor("local", 2) as executor:
            assert executor.submit(abs, (-3,), None).result() == 3
            assert set(unlinked) == others
            unlinked.clear()
        until = time.monotonic() + 10
        while len(sys._current_frames()) > running and time.monotonic() < until:  # its threads are yet to end
            time.sleep(0.01)
        assert not unlinked
