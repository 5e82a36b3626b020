"""Planning and running beside the page: a process that does what it is asked for last, and drops what it is at."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Any

from cableway.core.compiled import clock
from cableway.core.errors import CablewayError, said
from cableway.core.executors import begin_worker, deaf_to_interrupts
from cableway.core.logs import log_file
from cableway.scene.files.loading import AnyTask
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import Task
from cableway.studio.pace import Pace
from cableway.tracking import Row
from cableway.workflow.events import CANCEL, Event, Progress, Stepped
from cableway.workflow.run import Run, SolveOptions
from cableway.workflow.solve import solve
from cableway.workflow.solve_in_space import SpatialOptions, SpatialRun, solve_in_space


@dataclass(frozen=True)
class Answer:
    """What the process says of a request.

    Attributes:
        number: Of the request.
        run: What became of it; None where it could not be tried, or is under way.
        problem: Why it could not be tried; "" where it was.
        stage: What it is at; "" once it is over.
        row: Of the run; None at all other times.
    """

    number: int
    run: Run | SpatialRun | None = None
    problem: str = ""
    stage: str = ""
    row: Row | None = None


class Replanner:
    """A process that solves one task at a time, always the one it was asked for last.

    Args:
        on_answer: Called with each answer, from a thread of its own; one may still come to a request that another has
            replaced.
    """

    def __init__(self, on_answer: Callable[[Answer], Any]) -> None:
        self._on_answer = on_answer
        self._lock = threading.RLock()
        self._number = 0
        self._process: Any = None
        self._connection: Any = None  # a `Connection`, of another class on Windows

    def start(self) -> None:
        """Begin the process, unless it runs."""
        with self._lock:
            if self._process is not None and self._process.is_alive():
                return
            context = multiprocessing.get_context("spawn")
            self._connection, theirs = context.Pipe()
            with deaf_to_interrupts():
                self._process = context.Process(target=_work, args=(theirs, log_file()), daemon=True)
                self._process.start()
            theirs.close()
            listening = threading.Thread(target=self._listen, args=(self._connection,), daemon=True)
            listening.start()

    def request(self, task: AnyTask, options: SolveOptions | SpatialOptions, since: float = 0.0) -> int:
        """Have a task solved, in place of what is under way; returns the number of the request.

        Where it is run, rows come in the time that they take, from the time `since` [s] of the run on.
        """
        with self._lock:
            self.start()
            self._number += 1
            self._send((self._number, task, options, since))
            return self._number

    def cancel(self) -> None:
        """Drop what is under way; it is answered no more."""
        with self._lock:
            self._number += 1
            if self._process is not None:
                self._send((self._number, None, None, 0.0))

    def stop(self) -> None:
        """End what is under way; it is answered with what there is."""
        with self._lock:
            if self._process is not None:
                self._send((self._number, None, None, 0.0))

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._number += 1
            process, connection = self._process, self._connection
            self._process = self._connection = None
        if connection is not None:
            connection.close()
        if process is not None:
            process.kill()
            process.join()

    def _send(self, message: Any) -> None:
        with contextlib.suppress(OSError):  # of a process that died, which is told by `_listen`
            self._connection.send(message)

    def _listen(self, connection: Connection) -> None:
        while True:
            try:
                answer = connection.recv()
            except (EOFError, OSError):
                with self._lock:
                    if connection is not self._connection:
                        return
                    answer = Answer(self._number, problem="the planner's process ended; the next change begins another")
                    self._process, self._connection = None, None
                self._on_answer(answer)
                return
            self._on_answer(answer)


def _work(connection: Connection, log: str | None) -> None:
    """In the process: solve the newest request until the other side goes away."""
    begin_worker(log)
    with contextlib.suppress(EOFError, OSError):
        while True:
            number, task, options, since = connection.recv()
            while connection.poll():
                number, task, options, since = connection.recv()
            if task is not None:
                connection.send(_answer(connection, number, task, options, since))


def _answer(
    connection: Connection, number: int, task: AnyTask, options: SolveOptions | SpatialOptions, since: float = 0.0
) -> Answer:
    last, pace = "", Pace(since, connection.poll)

    def on_event(event: Event) -> str | None:
        nonlocal last
        if isinstance(event, Progress) and event.stage != last:
            last = event.stage
            connection.send(Answer(number, stage=last))
        elif isinstance(event, Stepped):
            pace.keep(event.row.time)
            connection.send(Answer(number, row=event.row))
        return CANCEL if connection.poll() else None

    def time() -> float:
        """Time is over once there is another request, also where no progress is reported."""
        return math.inf if connection.poll() else clock()

    try:
        if isinstance(options, SpatialOptions):
            assert isinstance(task, SpatialTask)
            return Answer(number, solve_in_space(task, replace(options, clock=time), on_event))
        assert isinstance(task, Task)
        return Answer(number, solve(task, replace(options, clock=time), on_event))
    except CablewayError as error:
        return Answer(number, problem=str(error))
    except Exception as error:
        return Answer(number, problem=f"an error of cableway's own: {said(error)}")
