"""What controllers in space share: they follow a plan by time, remember the grippers' poses, and keep their limits."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Float

from cableway.control.base import Status
from cableway.control.limits import SHARES, allowed_part
from cableway.core.errors import InputError
from cableway.geometry.groups import SE3
from cableway.motion.spatial import SpatialProblem
from cableway.records import Estimate, Observation, Plan
from cableway.scene.spatial.grippers import SpatialGrippers
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP

ROUNDING = 1.0 - 1e-9
"""Factor on the limits, so that rounding in the sums of poses does not exceed them."""

REMEMBERED = 100
"""Poses of the grippers that are kept: frames later than so many control steps are not used."""

BLIND_STEPS = 10
"""Control steps in a row without keypoints after which the grippers stop."""


@dataclass(frozen=True, kw_only=True)
class SpatialState:
    """State of a controller in space.

    Attributes:
        task: The task.
        problem: The same as values.
        plan: The plan.
        steps: Control steps made.
        commanded: Gripper poses asked for so far.
        seen: Times [s] and gripper poses reported then, newest last.
        blind: Control steps since keypoints were last seen.
        status: How the last action came about.
    """

    task: SpatialTask
    problem: SpatialProblem
    plan: Plan
    steps: int
    commanded: Float[np.ndarray, "2 7"]
    seen: tuple[tuple[float, Float[np.ndarray, "2 7"]], ...] = ()
    blind: int = 0
    status: str = Status.STARTED

    def poses_at_frame(self, observation: Observation) -> tuple[Float[np.ndarray, "2 7"], Float[np.ndarray, "2 7"]]:
        """Gripper poses reported nearest to when a frame was taken, and the ones before.

        A frame that does not say when is taken to be as new as its message.
        """
        taken = observation.time if observation.taken is None else observation.taken
        k = min(range(len(self.seen)), key=lambda k: abs(self.seen[k][0] - taken))
        return self.seen[k][1], self.seen[max(0, k - 1)][1]

    def estimates(self) -> Mapping[str, Estimate]:
        """What is estimated of the cable, by name; by default nothing."""
        return {}


S = TypeVar("S", bound=SpatialState)


class SpatialFollower(ABC, Generic[S]):
    """A controller in space.

    Args:
        hold: Time [s] at the plan's first row before it is followed.
        max_span: Distance between the grippers over the cable's length, never exceeded unless by the plan.
    """

    def __init__(self, hold: float, max_span: float) -> None:
        self._held_steps, self._max_span = round(hold / CONTROL_STEP), max_span

    @abstractmethod
    def init(self, task: SpatialTask, plan: Plan) -> S:
        """The state before the first step.

        Raises:
            InputError: The plan has no rod coordinates, or another number of keypoints than the task.
        """

    @abstractmethod
    def answer(
        self, state: S, observation: Observation, forward: Float[np.ndarray, "2 6"]
    ) -> tuple[Float[np.ndarray, "2 6"], S]:
        """An action where keypoints were seen, given the plan's own motion, and the state with its status."""

    def in_scene(self, state: S, task: SpatialTask) -> S:
        """The state once obstacles are known to be where the task has them."""
        return replace(state, task=task, problem=replace(state.problem, world=task.scene.world))

    def resume(self, state: S, plan: Plan) -> S:
        """The state with another plan, which begins where the last one was left; what was learned stays.

        Raises:
            InputError: See `init`.
        """
        require_coordinates(state.task, plan)
        return replace(state, plan=plan, steps=self._held_steps)

    def row(self, state: SpatialState, ahead: int = 0) -> int:
        """Row of the plan that is the reference after so many steps more."""
        return min(max(state.steps + ahead - self._held_steps, 0), state.plan.steps)

    def step(self, state: S, observation: Observation) -> tuple[Float[np.ndarray, "2 6"], S]:
        """The next action [m, rad], within the grippers' limits, and the state after it."""
        there = np.isfinite(observation.keypoints).all()
        seen = (*state.seen[1 - REMEMBERED :], (observation.time, observation.poses))
        state, plan = replace(state, seen=seen, blind=0 if there else state.blind + 1), state.plan
        here, ahead = self.row(state), self.row(state, 1)
        action = SE3.minus(plan.poses[ahead], plan.poses[here])
        if state.blind > BLIND_STEPS or not np.isfinite(observation.poses).all():
            action, state = np.zeros_like(action), replace(state, status=Status.STOPPED)
        elif state.blind:
            state = replace(state, status=Status.UNSEEN)
        else:
            action, state = self.answer(state, observation, action)
        span = np.linalg.norm(plan.poses[ahead, 1, :3] - plan.poses[ahead, 0, :3])
        most = max(float(span), self._max_span * state.task.cable.length)
        action = within_limits(action, state.commanded, state.task.grippers, most)
        action = kept_clear(action, state.commanded, state.problem)
        return action, replace(state, steps=state.steps + 1, commanded=SE3.plus(state.commanded, action))


def begun(task: SpatialTask, plan: Plan) -> SpatialState:
    """The state of a controller that keeps nothing else, before the first step.

    Raises:
        InputError: See `SpatialFollower.init`.
    """
    require_coordinates(task, plan)
    return SpatialState(task=task, problem=SpatialProblem.of(task), plan=plan, steps=0, commanded=plan.poses[0])


def require_coordinates(task: SpatialTask, plan: Plan) -> None:
    """Require of a plan that it can be followed.

    Raises:
        InputError: See `SpatialFollower.init`.
    """
    if plan.q is None or plan.q.shape[1] != task.rod.dof:
        raise InputError("a plan in space must have the rod coordinates of its shapes")
    if plan.shapes.shape[1] != task.cable.keypoints:
        raise InputError(f"the plan has {plan.shapes.shape[1]} keypoints, the task {task.cable.keypoints}")


def within_limits(
    action: Float[np.ndarray, "2 6"], poses: Float[np.ndarray, "2 7"], grippers: SpatialGrippers, max_span: float
) -> Float[np.ndarray, "2 6"]:
    """The action made safe: no step or turn beyond the grippers' limits, no pulling apart beyond `max_span` [m].

    Where the grippers would come farther apart, what they do relative to each other is left out; an action that is not
    finite becomes standing still.
    """
    if not np.isfinite(action).all():
        return np.zeros_like(action)
    moves, turns = (
        part * np.minimum(1.0, ROUNDING * most / np.maximum(np.linalg.norm(part, axis=1, keepdims=True), 1e-30))
        for part, most in ((action[:, :3], grippers.max_step), (action[:, 3:], grippers.max_turn))
    )
    apart, change = poses[1, :3] - poses[0, :3], moves[1] - moves[0]
    if np.linalg.norm(apart + change) > max(max_span, float(np.linalg.norm(apart))):
        moves = np.tile(moves.mean(axis=0), (2, 1))
    return np.concatenate([moves, turns], axis=1)


def kept_clear(
    action: Float[np.ndarray, "2 6"], poses: Float[np.ndarray, "2 7"], problem: SpatialProblem
) -> Float[np.ndarray, "2 6"]:
    """As much of the action, in steps of a quarter, as leads no hand into an obstacle, a wall or the other hand.

    Those that are in something already may not go deeper.

    Args:
        action: (2, 6) gripper motion [m, rad].
        poses: (2, 7) gripper poses before it [m, 1].
        problem: With the hands and what they may meet.
    """
    gaps = problem.bodies.gaps(SE3.plus(poses, SHARES[:, None, None] * action), problem.world)
    return allowed_part(action, gaps)
