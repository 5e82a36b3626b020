"""Watching a run from elsewhere, as of the command line or a robot, on a table or in space: its events on a page."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Self

from cableway.scene.files.loading import AnyTask
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.studio.pace import Pace
from cableway.studio.replanner import Answer
from cableway.studio.running import Running
from cableway.studio.session import Session
from cableway.studio.studio import Studio
from cableway.workflow.events import Event, Finished, Planned, Progress, Stepped
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve_in_space import SpatialOptions

PATIENCE = 15.0
"""Time [s] for which a run waits, before anything moves, until somebody has opened the page."""

LOOK = 0.1
"""Time [s] between two looks whether a page is open."""


class Watch:
    """A page on which a run is watched; an `on_event` of `cableway.workflow.solve.solve`, and of `solve_in_space`.

        with Watch(task, options) as watch:
            run = solve(task, options, watch)
            watch.linger()

    Args:
        task: What is run.
        options: How; what stands there of controller and plant is shown.
        host: Address to listen on.
        port: Port, 0 for any free one.
        patience: Time [s] for which the run waits, once it is planned, until the page is open.

    Attributes:
        address: Where the page is.

    Raises:
        InputError: The port cannot be had.
        MissingExtraError: viser is not installed.
    """

    def __init__(
        self,
        task: AnyTask,
        options: SolveOptions | SpatialOptions,
        host: str = "127.0.0.1",
        port: int = 0,
        patience: float = PATIENCE,
    ) -> None:
        self._options, self._patience, self._pace = options, patience, Pace()
        self._answer: Any = None
        shown = options if isinstance(options, SolveOptions) else None
        self.session = Session(task, shown, self._begun, watched=True)
        self._studio = Studio(task, host, port, Path("runs/studio"), session=self.session)
        self.address = self._studio.address

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(self, event: Event) -> None:
        """Show an event; a step of a simulated plant takes the time that it says."""
        match event:
            case Progress(stage):
                self._answer(Answer(0, stage=stage))
            case Planned(run):
                self._answer(Answer(0, run))
                options = self._options
                follows = options.track if isinstance(options, SolveOptions) else options.controller is not None
                if run.plan is not None and follows:
                    self._wait()
                    plant = options.perturbation or SpatialPerturbation()
                    eyes = options.eyes if isinstance(options, SolveOptions) else None
                    self.session.begin(
                        Running(
                            task=run.task, plan=run.plan, controller=options.controller, perturbation=plant, eyes=eyes
                        )
                    )
            case Stepped(row):
                self._pace.keep(row.time)
                self._answer(Answer(0, row=row))
            case Finished(run) if self.session.running is not None:
                self._answer(Answer(0, run))

    def linger(self) -> None:
        """Serve until nobody looks any more."""
        while self._studio.pages_of(self.session):
            time.sleep(LOOK)

    def close(self) -> None:
        """Close the page."""
        self._studio.stop()

    def _wait(self) -> None:
        end = time.monotonic() + self._patience
        while not self._studio.pages_of(self.session) and time.monotonic() < end:
            time.sleep(LOOK)

    def _begun(self, on_answer: Any) -> _Elsewhere:
        self._answer = on_answer
        return _Elsewhere()


class _Elsewhere:
    """In place of a `Replanner`: what is asked for is done elsewhere, all of it under the number 0."""

    def start(self) -> None:
        """See `Replanner.start`."""

    def request(self, *_: Any) -> int:
        """See `Replanner.request`."""
        return 0

    def cancel(self) -> None:
        """See `Replanner.cancel`."""

    stop = close = cancel
