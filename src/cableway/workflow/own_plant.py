"""A plant of a user's own in place of the simulator: loaded, checked, and named in the record."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cableway.core.errors import CablewayError, InputError, raised, said
from cableway.core.plugins import load_plugin
from cableway.scene.task import CONTROL_STEP, Task
from cableway.tracking.answers import AnsweringPlant
from cableway.workflow.events import Listener, Note
from cableway.workflow.run import SolveOptions


def prepare_plant(task: Task, options: SolveOptions, listener: Listener) -> OwnPlant | None:
    """The plant that the options name; None for the simulated one, which is also that of a dry run.

    Raises:
        InputError: It cannot be loaded or made, or is no plant of the task.
    """
    make, name, file = options.plant, "the plant", None
    if make is None:
        return None
    if isinstance(make, str):
        name = make
        make, file = load_plugin(name)
        listener.emit(Note(f"The plant {name} runs {file}."))
    if not callable(make):
        raise InputError(f"{name}: must be a class or a function that makes a plant of a task, got {make!r}")
    return None if options.dry_run else _made(make, task, name, file)


def _made(make: Callable[[Task], Any], task: Task, name: str, file: Path | None) -> OwnPlant:
    try:
        plant = OwnPlant(make(task), name, file)
        own = plant.task
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    except CablewayError:
        raise
    except raised() as error:
        raise InputError(f"{name}: no plant can be made of the task {task.name!r}: {said(error)}") from None
    if own.start.shape != task.start.shape:
        raise InputError(f"{name}: its task must be the one that it is made of, got {own.name!r}")
    if not math.isclose(plant.control_step, CONTROL_STEP):
        raise InputError(f"{name}: its control_step must be {CONTROL_STEP} s, got {plant.control_step!r}")
    return plant


class OwnPlant(AnsweringPlant):
    """A plant of a user's own.

    Args:
        plant: The plant.
        name: For the reader.
        file: Of its code, for the record.

    Raises:
        InputError: It is no plant.
        SimulationError: It does not say what its task is.
    """

    def __init__(self, plant: Any, name: str, file: Path | None = None) -> None:
        super().__init__(plant)
        self._name, self._file = name, file

    @property
    def unmodelled(self) -> tuple[str, ...]:
        """Sentences for the reader of a report."""
        return (f"The plant is not simulated by cableway: {self._name}. All figures are of what it measured.",)

    def as_dict(self) -> dict[str, str]:
        """For the record of a run."""
        return {"own": self._name} | ({} if self._file is None else {"file": str(self._file)})
