"""What a plant answers, before anything relies on it: usable records, or one sentence on what it did instead."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np
from jaxtyping import Float

from cableway.core.checks import require_interface
from cableway.core.errors import CablewayError, Cancelled, InputError, SimulationError, raised, said
from cableway.core.files import LARGEST
from cableway.geometry.groups import SE2
from cableway.records import Measurement, Observation, RodParameters
from cableway.rod.material import LENGTH, PARAMETERS
from cableway.scene.task import Task
from cableway.tracking.plant import Plant

T = TypeVar("T")

INDEFINITE = 1e-6
"""Least eigenvalue of a matrix of correlations, below zero, that rounding does not explain."""

ARM_JOINTS = 6
"""Joints of an arm, for messages."""


class AnsweringPlant:
    """A plant as the loop asks it: whatever it raises or answers instead of a record is a `SimulationError`.

    Arrays are copied both ways, so that a plant may keep and change its own.

    Args:
        plant: What is asked.

    Raises:
        InputError: It is no plant.
        SimulationError: It does not say what its task is.
    """

    def __init__(self, plant: Plant) -> None:
        if isinstance(plant, Task | str | os.PathLike):
            raise InputError(f"the plant must be what is led, such as cableway.CableSimulator(task), got {plant!r}")
        require_interface(plant, "the plant", ("task", "control_step"), {"reset": 0, "step": 1, "measure": 0})
        self._plant, self._moved = plant, False
        self._stations: int | None = None
        self._joints: list[np.ndarray | None] = []
        self.control_step = float(_numbers(plant.control_step, (), "the plant has a control_step"))
        if not 0 < self.control_step < np.inf:
            raise InputError(f"the plant's control_step must be finite and positive, got {self.control_step!r}")
        self._keypoints = self.task.cable.keypoints

    @classmethod
    def of(cls, plant: Plant) -> AnsweringPlant:
        """The plant itself if it is one of these already; raises as the constructor does."""
        return plant if isinstance(plant, AnsweringPlant) else cls(plant)

    @property
    def task(self) -> Task:
        """See `Plant.task`.

        Raises:
            SimulationError: There is none.
        """
        task = _asked(lambda: self._plant.task, "task")
        if not isinstance(task, Task):
            raise SimulationError(f"the plant's task is {_kind(task)}, not a Task")
        return task

    def reset(self) -> Observation:
        """See `Plant.reset`.

        Raises:
            InputError: It answered with no observation of its task's cable.
            SimulationError: The start cannot be taken.
        """
        answer = _asked(self._plant.reset, "reset", CablewayError)
        self._joints = []
        return usable_observation(answer, self._keypoints, "the plant's reset")

    def step(self, action: Float[np.ndarray, "2 3"]) -> Observation:
        """See `Plant.step`.

        Raises:
            SimulationError: The plant cannot go on.
        """
        self._moved = True
        answer = _asked(lambda: self._plant.step(np.array(action)), "step")
        return self._during_a_run(lambda: usable_observation(answer, self._keypoints, "the plant's step"))

    @property
    def can_grasp(self) -> bool:
        """Whether the plant can take hold of the cable and let go of it, see `cableway.tracking.hands`."""
        return bool(getattr(self._plant, "can_grasp", False))

    def take_hold(self, joints: Float[np.ndarray, "t 2 6"], opening: float) -> Observation:
        """Take hold of the cable; the next measurement is that of the start.

        Raises:
            GraspError: A hand missed the cable.
            SimulationError: The plant cannot go on.
        """
        answer = _asked(lambda: cast(Any, self._plant).take_hold(joints.copy(), opening), "take_hold")
        self._joints = []
        return usable_observation(answer, self._keypoints, "the plant's take_hold")

    def let_go(self, joints: Float[np.ndarray, "t 2 6"], opening: float) -> tuple[float, Measurement]:
        """Let go of the cable: how far it moved [m], and the measurement after that, whose joints count for no row.

        Raises:
            SimulationError: The plant cannot go on.
        """
        answer = _asked(lambda: cast(Any, self._plant).let_go(joints.copy(), opening), "let_go")
        measured = self.measure()
        self._joints.pop()
        return float(_numbers(answer, (), "the plant's let_go reported a distance")), measured

    def measure(self) -> Measurement:
        """See `Plant.measure`.

        Raises:
            InputError: Before the first step, the answer is no measurement of the task's cable.
            SimulationError: After it; or the plant raised an error.
        """
        answer = _asked(self._plant.measure, "measure")
        measured = self._during_a_run(lambda: _usable_measurement(answer, self._keypoints, self._stations))
        self._stations = len(measured.centreline)
        self._joints.append(measured.joints)
        return measured

    @property
    def joints(self) -> Float[np.ndarray, "k 2 j"] | None:
        """Joint angles [rad] of the arms in every measurement since the last reset; None where one has none."""
        rows = [row for row in self._joints if row is not None]
        return np.array(rows) if 0 < len(rows) == len(self._joints) and len({row.shape for row in rows}) == 1 else None

    def _during_a_run(self, judge: Callable[[], T]) -> T:
        """What a judge of an answer returns; an answer that it refuses ends the run once something was moved."""
        try:
            return judge()
        except InputError as error:
            if self._moved:
                raise SimulationError(str(error)) from None
            raise


def usable_observation(answer: Any, keypoints: int, who: str) -> Observation:
    """An answer as an observation with arrays of its own, NaN for keypoints and poses that no record can hold; what is
    known of the rod must be finite.

    Args:
        answer: Whatever came.
        keypoints: How many there must be.
        who: Says messages who answered.

    Raises:
        InputError: It is none, or one of other shapes or types.
    """
    _require_kind(answer, Observation, who)
    time = float(_numbers(answer.time, (), f"{who} reported a time"))
    if not np.isfinite(time):
        raise InputError(f"{who} reported a time that is not finite")
    taken, confidence = answer.taken, answer.confidence
    return replace(
        answer,
        time=time,
        keypoints=_possible(_numbers(answer.keypoints, (keypoints, SE2.space), f"{who} reported keypoints")),
        poses=_possible(_numbers(answer.poses, (2, SE2.size), f"{who} reported gripper poses")),
        taken=None if taken is None else float(_numbers(taken, (), f"{who} reported a time of the frame")),
        confidence=None if confidence is None else _numbers(confidence, (keypoints,), f"{who} reported a confidence"),
        rod=None if answer.rod is None else _usable_rod(answer.rod, f"{who} reported a rod"),
    )


def _usable_rod(answer: Any, what: str) -> RodParameters:
    """The same of what is known of a rod."""
    if not isinstance(answer, RodParameters):
        raise InputError(f"{what} as {_kind(answer)}, not as a cableway.records.RodParameters")
    mean = _numbers(answer.mean, (PARAMETERS,), f"{what} with a mean")
    covariance = _numbers(answer.covariance, (PARAMETERS, PARAMETERS), f"{what} with a covariance")
    if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
        raise InputError(f"{what} that is not finite")
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if not (mean[LENGTH] > 0 and deviations.all()):
        raise InputError(f"{what} whose length or one of whose variances is not positive")
    correlations = covariance / np.outer(deviations, deviations)
    if not np.allclose(correlations, correlations.T) or np.linalg.eigvalsh(correlations)[0] < -INDEFINITE:
        raise InputError(f"{what} with a covariance that is none: not symmetric, or not positive")
    return RodParameters(mean, covariance)


def _usable_measurement(answer: Any, keypoints: int, stations: int | None) -> Measurement:
    """An answer as a measurement with arrays of its own, all of which a record can hold; see `usable_observation`."""
    who = "the plant's measure"
    _require_kind(answer, Measurement, who)
    points = len(answer.centreline) if stations is None and np.ndim(answer.centreline) else stations or 0
    if np.ndim(answer.centreline) and points < 2:
        raise InputError(f"{who} reported a centreline of {points} points, fewer than 2")

    def finite(name: str, *shape: int) -> Float[np.ndarray, "..."]:
        numbers = _numbers(getattr(answer, name), shape, f"{who} reported {name}")
        if np.isnan(_possible(numbers)).any():
            raise InputError(f"{who} reported {name} that {'are' if shape else 'is'} not finite, or beyond {LARGEST:g}")
        return numbers

    return Measurement(
        keypoints=finite("keypoints", keypoints, SE2.space),
        poses=finite("poses", 2, SE2.size),
        centreline=finite("centreline", points, SE2.space),
        clearance=float(finite("clearance")),
        gripper_clearance=float(finite("gripper_clearance")),
        joints=None if answer.joints is None else finite("joints", 2, _columns(answer.joints)),
    )


def _columns(value: Any) -> int:
    """Of what should be a table; those of an arm's joints where it is none."""
    try:
        return np.shape(value)[1] or ARM_JOINTS
    except (ValueError, IndexError):
        return ARM_JOINTS


def _possible(numbers: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Numbers, NaN in place of those that no record can hold."""
    return np.where(np.abs(numbers) <= LARGEST, numbers, np.nan)


def _asked(ask: Callable[[], T], name: str, kept: type[Exception] = SimulationError) -> T:
    """What a plant answers; errors of the kind that is kept, and a cancellation, mean what they say.

    Raises:
        SimulationError: It raised another one.
    """
    try:
        return ask()
    except (kept, Cancelled):
        raise
    except raised() as error:
        raise SimulationError(f"the plant's {name} raised {said(error)}") from error


def _require_kind(answer: Any, kind: type, who: str) -> None:
    if not isinstance(answer, kind):
        raise InputError(f"{who} answered with {_kind(answer)}, not with a cableway.records.{kind.__name__}")


def _kind(value: Any) -> str:
    return "None" if value is None else f"a value of type {type(value).__name__}"


def _numbers(value: Any, shape: tuple[int, ...], what: str) -> Float[np.ndarray, "..."]:
    """A copy as real numbers.

    Raises:
        InputError: They are none, or of another shape.
    """
    try:
        array = np.array(value)
    except Exception:  # ragged lists, or what another library's array raises
        array = np.array(None)
    if array.dtype.kind not in "fiu":
        kind = value.dtype.name if isinstance(value, np.ndarray) else type(value).__name__
        raise InputError(f"{what} of type {kind}, not real numbers")
    if array.shape != shape:
        raise InputError(f"{what} of shape {array.shape}, not {shape}")
    return array.astype(float)
