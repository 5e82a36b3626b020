"""A camera and a robot between plant and controller: noise, lost frames, hidden keypoints, delays.

Frames are taken at a rate of their own, frame j at j periods after the start, and arrive after a delay. At a control
step the controller gets the newest frame that has arrived since the step before and was not lost; where there is none,
it gets no keypoints (NaN). Gripper poses come from the robot's encoders, at once and exact.

What happens to frame j depends on the seed and on j alone, so a run can be repeated, branched and restored.

Note:
    The plant is simulated at its control steps only. Between them keypoints are interpolated linearly, and an action
    that takes effect between two of them is spread over both in proportion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, cast

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, Checked, Share
from cableway.core.deprecation import renamed
from cableway.core.errors import InputError
from cableway.records import Observation
from cableway.simulation.handling import HandlingPlant
from cableway.simulation.perturbations.grasp import GraspedCable
from cableway.simulation.perturbations.layer import Layer
from cableway.simulation.plant import CableSimulator
from cableway.simulation.table_plant import TablePlant

ROUNDING = 1e-6
"""Share of a frame or a control step up to which two times count as one."""

LONGEST_DELAY = 10.0
"""[s]; what is delayed by longer than this is not controlled."""


@dataclass(frozen=True, kw_only=True)
class SensingConfig(Checked):
    """What is lost between plant and controller; nothing by default.

    Attributes:
        keypoint_noise: Standard deviation of each coordinate of a keypoint [m], independent from frame to frame.
        frame_rate: Frames per second [Hz]; one frame at every control step where None.
        drop_rate: Share of frames that are lost.
        occlusion_rate: Share of frames in which part of the cable is hidden.
        occluded_share: Largest share of the keypoints hidden in such a frame, one keypoint at least.
        measurement_delay: Time [s] from when a frame is taken until it arrives.
        jitter: Largest time [s] by which a frame arrives later still, drawn for each frame; an older one that it
            overtook is left out.
        action_delay: Time [s] from when an action is sent until the grippers begin it.

    Raises:
        InputError: A value is out of range.
    """

    keypoint_noise: Annotated[float, Bounds(0, 1)] = 0.0
    frame_rate: Annotated[float, Bounds(0.1, 1000)] | None = None
    drop_rate: Share = 0.0
    occlusion_rate: Share = 0.0
    occluded_share: Share = 0.3
    measurement_delay: Annotated[float, Bounds(0, LONGEST_DELAY)] = 0.0
    jitter: Annotated[float, Bounds(0, 1)] = 0.0
    action_delay: Annotated[float, Bounds(0, LONGEST_DELAY)] = 0.0


class SensedPlant(Layer["CableSimulator | GraspedCable | TablePlant"]):
    """A simulated cable behind a camera and a robot.

    Before the start the cable lies still and no action is under way. A step that fails leaves all as it was before;
    where the plant refuses an action that was delayed, it refuses it again until `reset` or `restore`.

    Args:
        plant: The cable.
        config: Noise, lost frames and delays; none where None.
        seed: Same seed and same actions, same run.

    Raises:
        InputError: The seed is negative.
    """

    remembers = ("_steps", "_past", "_sent")
    """Control steps since the start; true keypoints (H, n, 2) [m] after the last of them and actions (D, 2, 3) sent in
    them, the newest last."""

    def __init__(
        self, plant: CableSimulator | GraspedCable | TablePlant, config: SensingConfig | None = None, seed: int = 0
    ) -> None:
        if seed < 0:
            raise InputError(f"the seed of a plant must not be negative, got {seed}")
        super().__init__(plant)
        self.config, self.seed = config or SensingConfig(), seed
        rate = self.config.frame_rate
        self._period = self.control_step if rate is None else 1 / rate
        self.reset()

    def reset(self) -> Observation:
        """Go to the start and look; the same run after it gives the same observations bit for bit."""
        return self._begin(self.plant.reset())

    def take_hold(self, joints: Float[np.ndarray, "t 2 6"], opening: float) -> Observation:
        """See `HandlingPlant.take_hold`."""
        return self._begin(cast(HandlingPlant, self.plant).take_hold(joints, opening))

    def _begin(self, truth: Observation) -> Observation:
        """The first observation of a run."""
        # a frame that arrives between two steps is older than its delay by less than one step
        latest = self.config.measurement_delay + self.config.jitter
        count = math.ceil(latest / self.control_step - ROUNDING) + 2
        self._steps = 0
        self._past = np.repeat(truth.keypoints[None], count, axis=0)
        self._sent = np.zeros((math.ceil(self.config.action_delay / self.control_step - ROUNDING) + 1, 2, 3))
        return self._observation(truth)

    def step(self, action: Float[np.ndarray, "2 3"]) -> Observation:
        """Send an action, let the plant do what has arrived of those sent, and look.

        Raises:
            SimulationError: The plant refuses the action or cannot go on.
        """
        sent = np.concatenate([self._sent[1:], self.plant.check(action)[None]])
        truth = self.plant.step(_delayed(sent, self.config.action_delay / self.control_step))
        self._sent, self._steps = sent, self._steps + 1
        self._past = np.concatenate([self._past[1:], truth.keypoints[None]])
        return self._observation(truth)

    def _observation(self, truth: Observation) -> Observation:
        """The newest frame that arrived since the last step and was not lost; without one no keypoints (NaN)."""
        now = self._steps * self.control_step
        for frame in range(self._newest(now), self._newest(now - self.control_step), -1):
            keypoints = self._frame(frame, (now - frame * self._period) / self.control_step)
            if keypoints is not None:
                return replace(truth, keypoints=keypoints)
        return replace(truth, keypoints=np.full_like(truth.keypoints, np.nan))

    def _newest(self, now: float) -> int:
        """Number of the newest frame that has arrived by a time [s]."""
        newest = math.floor((now - self.config.measurement_delay) / self._period + ROUNDING)
        if not self.config.jitter:
            return newest
        arrivals = [self._arrival(newest - k) for k in range(math.ceil(self.config.jitter / self._period) + 1)]
        return newest - next((k for k, arrival in enumerate(arrivals) if arrival <= now + ROUNDING), len(arrivals))

    def _arrival(self, frame: int) -> float:
        """Time [s] at which a frame arrives."""
        later = self.config.jitter * np.random.default_rng((self.seed, frame % 2**32)).random()
        return frame * self._period + self.config.measurement_delay + later

    def _frame(self, frame: int, age: float) -> Float[np.ndarray, "n 2"] | None:
        """The keypoints in a frame taken `age` control steps ago, NaN where hidden; None where it was lost."""
        config, keypoints = self.config, _delayed(self._past, age).copy()
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(frame % 2**32,)))
        # everything is drawn in any case, so that what is switched on changes nothing else
        lost, hidden, share, place = rng.random(4)
        noise = rng.normal(0.0, 1.0, keypoints.shape)
        if lost < config.drop_rate:
            return None
        if config.keypoint_noise:
            keypoints += config.keypoint_noise * noise
        if hidden < config.occlusion_rate:
            longest = max(1, math.floor(config.occluded_share * len(keypoints)))
            count = 1 + math.floor(share * longest)
            first = math.floor(place * (len(keypoints) - count + 1))
            keypoints[first : first + count] = np.nan
        return keypoints


def _delayed(rows: Float[np.ndarray, "k ..."], age: float) -> Float[np.ndarray, "..."]:
    """The row `age` steps before the last one, interpolated linearly between rows."""
    whole = max(0, math.floor(age + ROUNDING))
    share = age - whole
    if share <= ROUNDING:
        return rows[-1 - whole]
    return (1 - share) * rows[-1 - whole] + share * rows[-2 - whole]


__getattr__ = renamed(__name__, {"SensedState": "simulation.perturbations.layer.LayerState"})
