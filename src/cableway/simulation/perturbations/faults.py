"""What goes wrong between a working plant and its controller: robot, link, camera, and what nobody knew of the scene.

Times are those of the run [s]; a window is (begin, end). What happens by chance depends on the seed and the control
step alone, so a run can be repeated, branched and restored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, Checked, Choice, Share
from cableway.core.deprecation import renamed
from cableway.core.errors import InputError
from cableway.geometry import se2
from cableway.geometry.groups import SE2
from cableway.records import Observation
from cableway.scene.task import Task
from cableway.simulation.perturbations.grasp import Offset
from cableway.simulation.perturbations.layer import Layer
from cableway.simulation.perturbations.sensing import SensedPlant

Window = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class FaultConfig(Checked):
    """What goes wrong; nothing by default.

    Attributes:
        turns: Whole turns that the reported angles of the left and right gripper are off by.
        wrapped: Whether they are reported in (-pi, pi] besides.
        stalled: Which gripper stalls.
        stall: When it stands still; it makes up for that afterwards, at its limits.
        frozen_link: When every message repeats the last one before, its time included.
        frozen_camera: When the keypoints of the last frame before are repeated.
        repeated: Share of the messages that repeat the one before.
        clock_jump: (time, seconds) by which the robot's clock goes wrong, and when.
        swapped: Share of the frames in which two keypoints are exchanged.
        strays: Share of the frames in which one keypoint is somewhere else on the table.
        hidden_ends: Keypoints that are never seen, at each end of the cable.
        bias: What the camera is off by: (dx, dy, turn) about the middle of the workspace [m, m, rad].

    Raises:
        InputError: A value is out of range.
    """

    turns: tuple[int, int] = (0, 0)
    wrapped: bool = False
    stalled: Annotated[Literal["left", "right", "both"], Choice("gripper")] = "left"
    stall: Window | None = None
    frozen_link: Window | None = None
    frozen_camera: Window | None = None
    repeated: Share = 0.0
    clock_jump: tuple[float, float] | None = None
    swapped: Share = 0.0
    strays: Share = 0.0
    hidden_ends: Annotated[int, Bounds(0, 10)] = 0
    bias: Offset = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("stall", "frozen_link", "frozen_camera"):
            window = getattr(self, name)
            if window is not None and not 0 <= window[0] <= window[1] < math.inf:
                raise InputError(f"faults.{name} must be a begin and an end in seconds, got {list(window)}")
        for name in ("clock_jump", "bias"):
            if getattr(self, name) is not None and not np.isfinite(getattr(self, name)).all():
                raise InputError(f"faults.{name} must be finite, got {getattr(self, name)!r}")

    @property
    def stalls(self) -> Float[np.ndarray, "2"]:
        """Which grippers stall, left and right."""
        return np.array([self.stalled != "right", self.stalled != "left"])


class FaultyPlant(Layer[SensedPlant]):
    """A plant with faults between it and the controller.

    Args:
        plant: The plant.
        config: What goes wrong.
        planned: The task as the planner knew it.
        revealed: Time [s] from which the controller knows the scene of the plant's task instead; never where None.
    """

    remembers = ("_steps", "_pending", "_message", "_frame", "_passed")
    """Control steps since the start; motion (2, 3) sent and still to be made [m, m, rad]; the last message that came
    from the plant as it should; keypoints (n, 2) last sent [m]; the message last passed on."""

    def __init__(self, plant: SensedPlant, config: FaultConfig, planned: Task, revealed: float | None = 0.0) -> None:
        super().__init__(plant)
        self.config = config
        self._planned, self._revealed = planned, math.inf if revealed is None else revealed
        self.reset()

    @property
    def task(self) -> Task:
        """What the controller knows."""
        return self.plant.task if self._steps * self.control_step >= self._revealed else self._planned

    def reset(self) -> Observation:
        """Go to the start and look."""
        return self._begin(self.plant.reset())

    def take_hold(self, joints: Float[np.ndarray, "t 2 6"], opening: float) -> Observation:
        """See `HandlingPlant.take_hold`."""
        return self._begin(self.plant.take_hold(joints, opening))

    def _begin(self, truth: Observation) -> Observation:
        """The first message of a run."""
        self._steps, self._pending = 0, np.zeros((2, SE2.dof))
        self._message = self._passed = truth
        self._frame = truth.keypoints
        return self._pass_on(truth)

    def step(self, action: Float[np.ndarray, "2 3"]) -> Observation:
        """Send an action, of which the grippers make what they can; see `SensedPlant.step`."""
        pending, config = self._pending + action, self.config
        made = pending.copy()
        if config.stall is not None and self._time >= config.stall[0]:
            made /= np.maximum(self.plant.task.grippers.efforts(pending), 1.0)[:, None]
            if self._time < config.stall[1]:
                made[config.stalls] = 0.0
        truth = self.plant.step(made)
        self._pending, self._steps = pending - made, self._steps + 1
        return self._pass_on(truth)

    @property
    def _time(self) -> float:
        return self._steps * self.control_step

    def _pass_on(self, truth: Observation) -> Observation:
        """What the controller gets in place of a message."""
        config = self.config
        rng = np.random.default_rng(np.random.SeedSequence(self.plant.seed, spawn_key=(1, self._steps)))
        repeated, swapped, stray = rng.random(3)
        if not _within(config.frozen_camera, self._time):
            self._frame = self._seen(truth.keypoints, swapped, stray, rng)
        if not _within(config.frozen_link, self._time):
            self._message = replace(
                truth, time=self._reported(truth.time), keypoints=self._frame, poses=self._angles(truth.poses)
            )
        if self._steps and repeated < config.repeated:
            return self._passed
        self._passed = self._message
        return self._passed

    def _reported(self, time: float) -> float:
        jump = self.config.clock_jump
        return time + jump[1] if jump is not None and time >= jump[0] else time

    def _angles(self, poses: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 3"]:
        turned = np.array(poses)
        if self.config.wrapped:
            turned[:, 2] = se2.wrap_angle(turned[:, 2])
        turned[:, 2] += 2 * math.pi * np.array(self.config.turns)
        return turned

    def _seen(
        self, keypoints: Float[np.ndarray, "n 2"], swapped: float, stray: float, rng: np.random.Generator
    ) -> Float[np.ndarray, "n 2"]:
        """A frame as the camera has it."""
        config, n, size = self.config, len(keypoints), np.array(self._planned.scene.size)
        frame = keypoints.copy()
        pair, somewhere = rng.choice(n, 2, replace=False), rng.uniform(0, size)
        if swapped < config.swapped:
            frame[pair] = frame[pair[::-1]]
        if stray < config.strays:
            frame[pair[0]] = somewhere
        if config.hidden_ends:
            frame[: config.hidden_ends] = frame[-config.hidden_ends :] = np.nan
        if any(config.bias):
            dx, dy, turn = config.bias
            frame = size / 2 + (frame - size / 2) @ se2.rotation(turn).T + [dx, dy]
        return frame


def _within(window: Window | None, time: float) -> bool:
    return window is not None and window[0] <= time < window[1]


__getattr__ = renamed(__name__, {"FaultyState": "simulation.perturbations.layer.LayerState"})
