"""What is done about a cable that has left its plan for good, and about a plan that something stands in the way of."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Checked, NotNegative
from cableway.core.errors import PlanningError, PlanningInterrupted, TaskError
from cableway.estimation.gating import poses_usable
from cableway.motion.clearance import clearances
from cableway.outcome import Outcome
from cableway.records import Observation, Plan
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.tracking.loop import BLOCKED, LOST, Loop
from cableway.tracking.setup import disagreement
from cableway.tracking.stopping import Ending


@dataclass(frozen=True, kw_only=True)
class Recovery(Checked):
    """What happens when the cable leaves its plan for good: it snapped to another shape, slipped, or is blocked.

    The same happens when the scene of the plant's task turns out to have something where the plan leads; controllers
    make room by themselves for what reaches into it by no more than `room`. The grippers stop and stand still; a new
    plan is made from where the cable is, and the run goes on with it. So it is, too, where the cable does not lie at
    the start of the plan, or comes to rest away from its end; a nearly straight one may even bend to the other side.
    Where that plan fails, the first one is followed, or the run ends.

    Attributes:
        replan: Plans a task that starts where the cable is, given the plan that was left. Raises `PlanningError` where
            there is no way.
        times: Recoveries in one run, after which it ends.
        start: Mean distance [m] of the keypoints from the plan's first shape from which the cable lies elsewhere.
        deviation: Mean distance [m] of the keypoints from their reference from which the cable is not on its plan.
        beside: The same where a keypoint is farther from its reference than anything is from an obstacle.
        patience: Time [s] for which that must be so.
        goal: Mean distance [m] of the keypoints from the plan's last shape from which a cable at rest has missed it.
        rest: Time [s] that the grippers stand still.
        room: Depth [m] to which cable or gripper discs of the plan may be in an obstacle: 10 mm of a move less the 4 mm
            that plans keep.

    Raises:
        InputError: A value is out of range.
    """

    replan: Callable[[Task, Plan], Plan]
    times: NotNegative[int] = 8
    start: NotNegative[float] = 0.015
    deviation: NotNegative[float] = 0.03
    beside: NotNegative[float] = 0.01
    patience: NotNegative[float] = 0.2
    goal: NotNegative[float] = 0.01
    rest: NotNegative[float] = 1.0
    room: NotNegative[float] = 0.006


class Watch:
    """Sees that the cable has left its plan, and brings it back."""

    def __init__(self, recovery: Recovery, control_step: float) -> None:
        self._recovery = recovery
        self._patience = max(1, math.ceil(recovery.patience / control_step))
        self._rest = max(1, math.ceil(recovery.rest / control_step))
        self._off = 0
        self._checked: tuple[Plan, Scene, Float[np.ndarray, "t"]] | None = None
        self.recovered: list[float] = []

    def is_elsewhere(self, observation: Observation, start: Float[np.ndarray, "n 2"]) -> bool:
        """Whether the cable does not lie where its plan begins; hidden keypoints do not count."""
        return _mean_distance(observation, start) > self._recovery.start

    def is_lost(self, observation: Observation, reference: Float[np.ndarray, "n 2"], task: Task) -> bool:
        """Whether the keypoints have been far from their reference for long enough; hidden ones do not count."""
        mean = _mean_distance(observation, reference)
        if np.isfinite(mean):
            far = mean > self._recovery.deviation
            close = (
                mean > self._recovery.beside
                and _clearance(observation, task) < _distances(observation, reference).max()
            )
            self._off = self._off + 1 if far or close else 0
        return self._off >= self._patience

    def is_off_goal(self, observation: Observation, plan: Plan) -> bool:
        """Whether the cable came to rest away from where the plan ends; hidden keypoints do not count."""
        return _mean_distance(observation, plan.shapes[-1]) > self._recovery.goal

    def is_blocked(self, task: Task, plan: Plan, progress: float) -> bool:
        """Whether what is left of a plan after a share of it leads into something."""
        if self._checked is None or self._checked[0] is not plan or self._checked[1] != task.scene:
            self._checked = plan, task.scene, clearances(plan.shapes, plan.poses, task).min(axis=1)
        return float(self._checked[2][round(progress * plan.steps) :].min()) < -self._recovery.room

    def recover(self, loop: Loop, why: Outcome | None) -> Ending | None:
        """Stand still, replan from where the cable is and follow the new plan; how the run ended, if it did.

        Args:
            loop: The run.
            why: How the run ends where it cannot go on; None where the first plan may still be followed.
        """
        if len(self.recovered) >= self._recovery.times:
            return Ending(why, f"already replanned {len(self.recovered)} times") if why else None
        keypoints = np.full_like(loop.observation.keypoints, np.nan)
        status = BLOCKED if why is Outcome.BLOCKED_WAY else LOST
        for _ in range(self._rest):
            ending = loop.stand(status)
            if ending is not None:
                return ending
            observed = loop.observation.keypoints
            keypoints = np.where(np.isfinite(observed), observed, keypoints)
        if np.isfinite(keypoints).all() and (wrong := disagreement(keypoints, loop.observation)):
            return Ending(why or Outcome.WRONG_SETUP, wrong)
        try:
            task = loop.plant.task.resumed_from(keypoints)
            plan = loop.compute(lambda: self._recovery.replan(task, loop.plan), status)
            if isinstance(plan, Ending):
                return plan
            loop.follow(task, plan)
        except PlanningInterrupted as error:
            return Ending(Outcome.INTERRUPTED, str(error))
        except (TaskError, PlanningError) as error:
            return Ending(why, str(error)) if why else None
        self._off = 0
        self.recovered.append(loop.time)
        return None


def _distances(observation: Observation, shape: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k"]:
    """Of the observed keypoints from those of a shape [m]."""
    distance = np.linalg.norm(observation.keypoints - shape, axis=1)
    return distance[np.isfinite(distance)]


def _mean_distance(observation: Observation, shape: Float[np.ndarray, "n 2"]) -> float:
    """Mean of `_distances`; NaN where there are none."""
    observed = _distances(observation, shape)
    return float(observed.mean()) if len(observed) else np.nan


def _clearance(observation: Observation, task: Task) -> float:
    """Of the observed cable and the grippers [m]; infinite where a keypoint or a gripper pose is missing."""
    if not (np.isfinite(observation.keypoints).all() and poses_usable(observation)):
        return math.inf
    return float(clearances(observation.keypoints[None], observation.poses[None], task).min())
