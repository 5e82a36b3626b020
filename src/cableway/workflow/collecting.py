"""Collect whole runs of a controller over tasks and plants.

Task, plant and seed of a run follow from the configuration and the number of the run alone, so that workers, machines
and interruptions do not matter; times of controllers are the only figures that differ.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from cableway.core.checks import Bounds, Checked
from cableway.core.errors import InputError, UnknownNameError
from cableway.core.executors import open_executor
from cableway.core.provenance import describe
from cableway.datasets.runs import is_whole, open_runs, write_run
from cableway.scene.files.loading import load_planar_task
from cableway.scene.files.saving import task_text
from cableway.scene.task import Task
from cableway.simulation.perturbations.variants import named_perturbation, variant
from cableway.tasks.generation import FIRST_SEED, KINDS, random_task
from cableway.workflow.registry import make_controller
from cableway.workflow.run import Run, SolveOptions
from cableway.workflow.solve import solve

MOST_SEED = 2**31 - 1
"""Seeds of random tasks are below."""

TRIES = 20
"""Seeds that are tried for a random task."""


@dataclass(frozen=True, kw_only=True)
class RunsConfig(Checked):
    """What is run.

    Attributes:
        episodes: How many runs.
        task: Name or file of the task of all; None for a random one of `kind` in each.
        kind: Of random tasks.
        plants: Names of plants, which runs have in turn.
        controller: Name of the controller, or the "package.module:NAME" of one of your own.
        seed: Of everything random.

    Raises:
        InputError: There is no plant, or a number is out of range.
        UnknownNameError: A name of a kind, a plant or a controller is not known.
    """

    episodes: Annotated[int, Bounds(1, 10_000_000)]
    task: str | None = None
    kind: str = "clutter"
    plants: tuple[str, ...] = ("nominal",)
    controller: str = "rod-mpc"
    seed: Annotated[int, Bounds(0)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kind not in KINDS:
            raise UnknownNameError("kind of random task", self.kind, KINDS)
        if not self.plants:
            raise InputError("plants must name one at least, got none")
        for name in self.plants:
            variant(name)
        make_controller(self.controller)

    def drawn(self, number: int, task: Task | None) -> tuple[Task, str, int]:
        """Task, plant and seed of a run.

        Args:
            number: Of the run.
            task: That of all runs, if there is one.

        Raises:
            InputError: No random task was found.
        """
        rng = np.random.default_rng([self.seed, number])
        plant, reasons = self.plants[number % len(self.plants)], ""
        for seed in rng.integers(FIRST_SEED, MOST_SEED, TRIES).tolist():
            if task is not None:
                return task, plant, seed
            try:
                return random_task(seed, self.kind), plant, seed
            except InputError as error:
                reasons = str(error)
        raise InputError(reasons)


def collect_runs(
    config: RunsConfig,
    folder: Path,
    *,
    progress: Callable[[str, float], None] | None = None,
    workers: int | None = 1,
    executor: str = "local",
) -> int:
    """Run what is not there yet, and keep each run as it comes.

    Args:
        config: What is run.
        folder: Where runs go; see `cableway.datasets.runs`.
        progress: Called with the stage's name and the share that is done.
        workers: Runs at a time, None for as many as there are cores; more than one local worker needs an importable
            main module.
        executor: "local" or "ray".

    Returns:
        How many were made now.

    Raises:
        InputError: The folder holds other runs, or `workers` or `executor` cannot be used.
        StorageError: There is no room for the next run.
    """
    task, tell = None if config.task is None else load_planar_task(config.task), progress or (lambda stage, share: None)
    common = {name: value for name, value in describe(config).items() if name != "episodes"}
    open_runs(folder, {**common, "task": None if task is None else task_text(task)})
    missing = [number for number in range(config.episodes) if not is_whole(folder, number)]
    done = config.episodes - len(missing)
    with open_executor(executor, workers) as pool:
        for number, (actual, rollout, report) in zip(
            missing, pool.in_order(_run, _calls(config, task, missing)), strict=True
        ):
            write_run(folder, number, actual, rollout, report)
            done += 1
            tell("collect", done / config.episodes)
    return len(missing)


def _calls(config: RunsConfig, task: Task | None, numbers: list[int]) -> Iterator[tuple[Any, ...]]:
    for number in numbers:
        yield config, task, number


def _run(config: RunsConfig, task: Task | None, number: int) -> tuple[Task, Any, dict[str, Any]]:
    """Task, rollout and report of a run; in a worker."""
    drawn, plant, seed = config.drawn(number, task)
    options = SolveOptions(
        controller=config.controller,
        perturbation=named_perturbation(plant, drawn, seed),
        seed=seed,
        clock=time.process_time,  # as others may work on this machine
    )
    run: Run = solve(drawn, options)
    return run.task, run.rollout, {**run.report.as_dict(), "plant": plant}
