"""The plant: a task's cable in MuJoCo, led by gripper motions, with its clearance measured at every time step."""

from __future__ import annotations

import math
import reprlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Checked, Positive
from cableway.core.errors import InputError, PressedError, SimulationError
from cableway.core.quantities import limit_text, quantity, told_apart
from cableway.records import Measurement, Observation
from cableway.rod.inverse import nearest_equilibrium
from cableway.scene.cable import Cable
from cableway.scene.clearance import pieces_clearance
from cableway.scene.files.loading import TaskSource, as_task
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.chain import Chain, chain_coordinates
from cableway.simulation.solid_grippers import SolidGrippers

SLIP_DISTANCE = 0.005
"""Distance [m] of a cable end from its gripper beyond which the grasp counts as lost."""

SLIP_ANGLE = 0.1
"""Turn [rad] of a cable end against its gripper beyond which the grasp counts as lost."""


ROUNDING = 1e-9
"""Share of the cable's length by which grippers that hold it straight may be farther apart."""

REFINEMENT = 5
"""Time steps in place of one where the cable is pressed into something."""


@dataclass(frozen=True, kw_only=True)
class PlantConfig(Checked):
    """How the plant is simulated.

    Attributes:
        time_step: MuJoCo's time step [s]; must divide the control step.
        control_step: Time [s] that one step of the plant takes.
        pressed: Penetration [m] from which on a control step is done over with `time_step` / `REFINEMENT`.
        largest_step: Gripper move [m] in one control step beyond which an action is refused.
        largest_turn: Gripper turn [rad] in one control step beyond which an action is refused.

    Raises:
        InputError: A value is out of range.
    """

    time_step: Positive[float] = 0.005
    control_step: Positive[float] = CONTROL_STEP
    pressed: Positive[float] = 0.0008
    largest_step: Positive[float] = 0.05
    largest_turn: Positive[float] = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.time_step > 0.02:
            raise InputError(f"plant.time_step must be at most 0.02 s, got {self.time_step!r}")
        if self.control_step > 1.0:
            raise InputError(f"plant.control_step must be at most 1 s, got {self.control_step!r}")
        if not self.substeps or abs(self.control_step / self.time_step - self.substeps) > 1e-6:
            raise InputError(
                f"plant.time_step must divide the control step {self.control_step:.6g} s, got {self.time_step!r}"
            )

    @property
    def substeps(self) -> int:
        """Time steps in one control step."""
        return round(self.control_step / self.time_step)


@dataclass(frozen=True)
class PlantState:
    """All that the plant's future and its next measurement depend on; see `CableSimulator.state`.

    Attributes:
        chain: MuJoCo's integration state.
        commanded: Gripper poses asked for so far [m, m, rad].
        reached: Those that they got to.
        steps: Control steps since the start.
        clearance: Of the cable in the last step [m].
        gripper_clearance: Of the gripper discs in the last step [m].
    """

    chain: Float[np.ndarray, "s"]
    commanded: Float[np.ndarray, "2 3"]
    reached: Float[np.ndarray, "2 3"]
    steps: int
    clearance: float
    gripper_clearance: float


class CableSimulator:
    """A cable in the scene of a task, starting at the rod's equilibrium nearest to the task's start.

    A step that fails leaves the plant as it was before that step. A gripper that runs into something stands still.

    Args:
        task: Scene, start and grippers, or their name or file; its cable unless `cable` is given.
        config: Time step and bounds.
        cable: The plant's true cable where it differs from the task's. It starts with the grippers where the task's
            cable has them, at the stable shape nearest to the start; one that does not bend as a uniform elastic rod
            (`Cable.bends_as_rod`) settles from there.

    Raises:
        InputError: `cable` has another number of keypoints or is shorter than the distance of the grippers.
        SimulationError: The cable overlaps an obstacle or a wall at the start, or has no stable shape there.

    Note:
        The chain is planar; the table acts on it by friction and drag.
    """

    def __init__(self, task: TaskSource, config: PlantConfig | None = None, cable: Cable | None = None) -> None:
        self.task = task = as_task(task)
        self.config = config or PlantConfig()
        self.cable = cable or task.cable
        self._chain = Chain(self.cable, task.scene, self.config.time_step)
        start = start_equilibrium(task, self.cable)
        self._free_clearances(chain_coordinates(self.cable.rod, start))
        self._commanded = self._reached = self._chain.place(start)
        self._solid = SolidGrippers(task)
        self._steps = 0
        self._clearance, self._gripper_clearance = self._free_clearances(self._chain.coordinates)
        self._initial = self.state()

    @property
    def control_step(self) -> float:
        """Time [s] that one step takes."""
        return self.config.control_step

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self._steps * self.control_step

    @property
    def commanded(self) -> Float[np.ndarray, "2 3"]:
        """Gripper poses asked for so far [m, m, rad]."""
        return self._commanded.copy()

    @property
    def reached(self) -> Float[np.ndarray, "2 3"]:
        """Gripper poses that they got to [m, m, rad]."""
        return self._reached.copy()

    @property
    def is_obstructed(self) -> bool:
        """Whether a gripper is not where it was commanded, since something was in its way."""
        return not np.array_equal(self._reached, self._commanded)

    @property
    def unmodelled(self) -> tuple[str, ...]:
        """What this task holds that the plant leaves out, one sentence each, for reports; see also `docs/limits.md`."""
        notes: list[str] = []
        if self.cable.friction > 0:
            notes.append("The cable lies flat on the table, ends included, for friction with it.")
        if self.task.plug is not None:
            notes.append("The plug does not collide; the clearance of its outline is measured afterwards.")
        return tuple(notes)

    def reset(self) -> Observation:
        """Go back to the start; the same run after it gives the same result bit for bit."""
        self.restore(self._initial)
        return self._observe()

    def step(self, action: Float[np.ndarray, "2 3"]) -> Observation:
        """Move the grippers at constant speed by `action` (dx, dy, dtheta) [m, m, rad] in one control step.

        Raises:
            SimulationError: The action is refused (wrong shape, not finite, too large, grippers farther apart than
                the cable is long), or the simulation failed (diverged, grasp lost, centreline inside an obstacle).
        """
        target = self._target(self.check(action))
        before = self._chain.save()
        try:
            clearance, gripper_clearance, reached = self._lead(self._chain, target, self.config.substeps)
            if clearance < -self.config.pressed:
                self._fine.restore(before)
                steps = REFINEMENT * self.config.substeps
                clearance, gripper_clearance, reached = self._lead(self._fine, target, steps)
                self._chain.restore(self._fine.save())
        except SimulationError as error:
            self._chain.restore(before)
            raise SimulationError(f"{error} {self._step_text()}") from None
        if clearance < -self.cable.radius:
            self._chain.restore(before)
            depth = f"{quantity(-clearance)} into an obstacle or wall, more than its radius"
            raise PressedError(f"the cable was pressed {depth} {self._step_text()}", clearance)
        self._commanded, self._reached, self._steps = target, reached, self._steps + 1
        self._clearance, self._gripper_clearance = clearance, gripper_clearance
        return self._observe()

    def _step_text(self) -> str:
        return f"(step {self._steps + 1}, t = {self.time:.1f} s)"

    def _lead(
        self, chain: Chain, target: Float[np.ndarray, "2 3"], substeps: int
    ) -> tuple[float, float, Float[np.ndarray, "2 3"]]:
        """Lead the grippers to a target; the least clearances of cable and grippers on the way, and where they got to.

        Raises:
            SimulationError: The chain cannot go on, or a grasp is lost.
        """
        path, kept_from = self._solid.path(self._reached, self._commanded, target, substeps)
        coordinates = chain.advance(path)
        lines = chain.polylines(coordinates)
        poses = chain.end_poses(coordinates, lines)
        _check_grasp(poses - path)
        cable, grippers = self._clearances(lines, poses)
        free = math.isinf(kept_from) and not self.is_obstructed
        return cable, min(grippers, kept_from), target if free else path[-1]

    @cached_property
    def _fine(self) -> Chain:
        """The same chain with shorter time steps: a cable enters as deep as it travels in one of them."""
        return Chain(self.cable, self.task.scene, self.config.time_step / REFINEMENT)

    def measure(self) -> Measurement:
        """The truth after the last step, with the least clearances during it."""
        coordinates = self._chain.coordinates[None]
        line = self._chain.polylines(coordinates)
        return Measurement(
            keypoints=self._chain.keypoints(line)[0],
            poses=self._chain.end_poses(coordinates, line)[0],
            centreline=line[0],
            clearance=self._clearance,
            gripper_clearance=self._gripper_clearance,
        )

    def state(self) -> PlantState:
        """A copy of the whole state, to branch a run from."""
        return PlantState(
            self._chain.save(), self._commanded.copy(), self._reached.copy(), self._steps, self._clearance,
            self._gripper_clearance,
        )  # fmt: skip

    def restore(self, state: PlantState) -> None:
        """Go back to a state of this plant; what follows is the same bit for bit.

        Raises:
            InputError: The state is that of another model.
        """
        self._chain.restore(state.chain)
        self._commanded, self._reached, self._steps = state.commanded.copy(), state.reached.copy(), state.steps
        self._clearance, self._gripper_clearance = state.clearance, state.gripper_clearance

    def _observe(self) -> Observation:
        truth = self.measure()
        return Observation(time=self.time, keypoints=truth.keypoints, poses=truth.poses)

    def check(self, action: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 3"]:
        """The action as an array.

        Raises:
            SimulationError: It has the wrong shape, is not finite or is too large, wherever the grippers are.
        """
        return checked_action(action, self.config)

    def _target(self, action: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 3"]:
        """Where an action leads the grippers; farther apart than the cable is long is an error."""
        target = self._commanded + action
        gap = float(np.linalg.norm(target[1, :2] - target[0, :2]))
        if gap > (1 + ROUNDING) * self.cable.length:
            raise SimulationError(
                f"the grippers would be {told_apart(gap, self.cable.length)} apart, farther than the cable is long "
                f"({limit_text(self.cable.length)})"
            )
        return target

    def _free_clearances(self, coordinates: Float[np.ndarray, "c"]) -> tuple[float, float]:
        """Clearances at the start; an overlap of the cable is an error."""
        line = self._chain.polylines(coordinates[None])
        cable, discs = self._clearances(line, self._chain.end_poses(coordinates[None], line))
        if cable < 0:
            raise SimulationError(f"the cable overlaps the scene by {quantity(-cable)} at the start")
        return cable, discs

    def _clearances(self, lines: Float[np.ndarray, "k v 2"], poses: Float[np.ndarray, "k 2 3"]) -> tuple[float, float]:
        scene = self.task.scene
        cable = float(scene.clearance(lines, self.cable.radius).min())
        discs = float(scene.signed_distance(lines[:, [0, -1]]).min()) - self.task.grippers.radius
        return cable, min(discs, float(pieces_clearance(lines, poses, self.task).min()))


def _check_grasp(slip: Float[np.ndarray, "k 2 3"]) -> None:
    """An end of the cable that is `slip` [m, m, rad] away from its gripper, too far, is an error."""
    distance, angle = float(np.hypot(slip[..., 0], slip[..., 1]).max()), float(np.abs(slip[..., 2]).max())
    if distance > SLIP_DISTANCE or angle > SLIP_ANGLE:
        raise SimulationError(
            f"the cable slipped in a gripper by {quantity(distance)} and {quantity(angle, 'rad')}, "
            "pulled too far or pressed against something"
        )


def checked_action(action: Any, config: PlantConfig) -> Float[np.ndarray, "2 3"]:
    """An action as an array; see `CableSimulator.check`."""
    action = _numbers(action)
    if action.shape != (2, 3):
        raise SimulationError(f"an action must have shape (2, 3), got {action.shape}")
    if not np.isfinite(action).all():
        raise SimulationError(f"an action must be finite, got {action.tolist()}")
    moves, turns = np.hypot(action[:, 0], action[:, 1]), np.abs(action[:, 2])
    for name, values, limit, unit in (
        ("step", moves, config.largest_step, "m"),
        ("turn", turns, config.largest_turn, "rad"),
    ):
        if values.max() > limit:
            side = ("left", "right")[int(np.argmax(values))]
            found, most = told_apart(values.max(), limit, unit), limit_text(limit, unit)
            raise SimulationError(f"the {side} gripper's {name} of {found} exceeds the plant's {most}")
    return action


def _numbers(action: Any) -> Float[np.ndarray, "..."]:
    """The action as an array of real numbers, whatever was given."""
    try:
        given = np.asarray(action)
    except ValueError:
        given = None
    if given is None or given.dtype.kind not in "fiu":
        raise SimulationError(f"an action must be an array (2, 3) of numbers, got {reprlib.repr(action)}")
    return given.astype(float)


def start_equilibrium(task: Task, cable: Cable) -> Float[np.ndarray, "6"]:
    """The equilibrium q of `cable` from which a run of `task` starts.

    Raises:
        InputError: The cable has another number of keypoints or is shorter than the distance of the grippers.
        SimulationError: The cable has no stable shape between the grippers of the task's start.
    """
    if cable.keypoints != task.cable.keypoints:
        raise InputError(
            f"the plant's cable has {cable.keypoints} keypoints, the task's {task.cable.keypoints}; they must agree"
        )
    q = task.start_equilibrium
    if cable.rod == task.cable.rod:
        return q
    return nearest_start(cable, task, task.cable.rod.end_poses(q[None])[0])


def nearest_start(cable: Cable, task: Task, ends: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "6"]:
    """The equilibrium q of `cable` with its ends at `ends` that is nearest to the start of `task`.

    Raises:
        InputError: The cable is shorter than the distance of the grippers.
        SimulationError: The cable has no stable shape there.
    """
    found = nearest_equilibrium(cable.rod, ends, task.start)
    if found is None:
        raise SimulationError("the plant's cable has no stable shape between the grippers at the task's start")
    return found
