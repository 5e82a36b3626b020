"""A run under way: plant and controller, what was observed last, and the record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from cableway.control.base import Controller, ControllerState
from cableway.control.limits import last_filter
from cableway.core.errors import CablewayError, ControlError, SimulationError, raised, said
from cableway.estimation.delay import LONGEST_DELAY
from cableway.estimation.gating import connected, is_blind, poses_usable
from cableway.geometry.groups import SE2
from cableway.outcome import Outcome
from cableway.records import Observation, Plan
from cableway.robot.held_arms import HeldArms
from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.tracking import hands
from cableway.tracking.logbook import Log, OnRow
from cableway.tracking.plant import Plant
from cableway.tracking.robot import Attachment, FollowingError, MessageGate, Silence
from cableway.tracking.slack import Slack
from cableway.tracking.stopping import Ending, StopRule, TrackConfig
from cableway.tracking.suspicion import Obstruction, narrowed
from cableway.tracking.watchdog import Guard, Watchdog
from cableway.tracking.way_back import ROOM_BACK, Motion, had_room

T = TypeVar("T")

LOST = "off the plan: stopped"
"""Status of a step in which the grippers stand still because the cable has left its plan."""

BLOCKED = "the way is blocked: stopped"
"""The same because something stands where the plan leads."""

LOOKING = "something unknown may hold the cable: stopped"
"""The same because the controller doubts that nothing does."""

BACKING_OFF = "something unknown holds the cable: going back"
"""Status of a step that takes back one before."""

HOLDING = "a gripper does not follow: holding"
"""The same because a gripper is not where it was sent."""

WAITING = "a gripper is late or was not reported: waiting"
"""The same because a gripper has not come yet where it was sent, or may not have."""

TRIAL = "a gripper did not follow: trying it alone"
"""Status of a step in which only that gripper may move."""

BLIND = "where the cable lies is not known: stopped"
"""The same because whoever looks at the cable says so."""

DOUBTED = 0.13
"""Confidence of an observed keypoint below which the cable is not said to have settled: of those that are found in
pictures, one with a standard deviation of 10 mm has it."""


def _still() -> np.ndarray:
    """No motion of either gripper."""
    return np.zeros((2, SE2.dof))


def _begun(controller: Controller[Any], task: Task, plan: Plan) -> ControllerState:
    """The controller's state before the first step.

    Raises:
        ControlError: It cannot make one.
    """
    try:
        state = controller.init(task, plan)
    except CablewayError:
        raise
    except raised() as error:
        raise ControlError(f"the controller cannot begin: {said(error)}") from error
    if not isinstance(state, ControllerState):
        raise ControlError(f"the controller cannot begin: init() must return a ControllerState, got {state!r:.80}")
    return state


class Loop:
    """A run: plant and controller, what was observed last, and the record."""

    def __init__(
        self,
        plant: Plant,
        controller: Controller[Any],
        plan: Plan,
        config: TrackConfig,
        watchdog: Watchdog,
        on_row: OnRow | None = None,
    ) -> None:
        self.plant, self._controller, self._config, self._on_row = plant, controller, config, on_row
        self.guard = Guard(watchdog, controller, plant.task, plant.control_step)
        self._scene: Scene | None = None
        self._followed = -1
        self.suspected: list[Disc] = []
        self._way: list[Motion] = []
        self._taken_back = False
        self.plan = plan
        self.state = _begun(controller, plant.task, plan)
        self._rule = StopRule(config, plan, plant.control_step, plant.task.cable.swing_period)
        self._silence, self._attachment = Silence(), Attachment(plant.control_step)
        self._slack = Slack(plant.task.cable)
        self._lies: np.ndarray | None = None
        self._unsure = False
        self._arms: HeldArms | None = None
        self.hands: dict[str, Any] = {}
        self._begin(plant.reset())

    def _begin(self, message: Observation) -> None:
        """The start as it is now."""
        self._gate, self.log = MessageGate(), Log(self._on_row)
        self._see(message)
        start = self.observation.poses if poses_usable(self.observation) else self.plan.poses[0]
        self._robot = FollowingError(SE2.continued(start, self.plan.poses[0]), self.plant.control_step)
        self.log.see(0.0, self.observation, self.plant.measure(), self.state.reference)

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self.log.times[-1]

    @property
    def task(self) -> Task:
        """The plant's task, with what is suspected in its scene."""
        known = self.plant.task
        if not self.suspected:
            return known
        return known.in_scene(replace(known.scene, obstacles=(*known.scene.obstacles, *self.suspected)))

    @property
    def poses(self) -> Float[np.ndarray, "2 3"]:
        """Where the grippers were when that was last reported [m, m, rad]."""
        return self._robot.poses

    @property
    def waits(self) -> bool:
        """Whether the plan waits for a gripper: one is late, did not follow, or may stall unseen by a taut cable.

        The cable is not where the plan has it then.
        """
        robot = self._robot
        return robot.short or robot.holding or robot.on_trial or self._would_tear

    @property
    def _would_tear(self) -> bool:
        """Whether no poses came and the next motion like the last would pull the cable taut, had a gripper stalled."""
        if poses_usable(self.observation) or not self._way:
            return False
        ahead = SE2.position(SE2.plus(self._robot.target, self._way[-1].action))
        behind = SE2.position(self._robot.poses)
        return float(np.linalg.norm(ahead - behind[::-1], axis=1).max()) > self._most_span

    @property
    def obstructed(self) -> Obstruction | None:
        """What stands in the way of a gripper that goes back but not ahead; None for nothing."""
        side = self._robot.obstructed
        return None if side is None else Obstruction(side, SE2.position(self._robot.poses)[side], self._robot.ahead)

    def give_in(self) -> Ending | None:
        """Go back to before a gripper ran into something; how the run ended, if it did. The way here ends there."""
        before, ending = self._robot.came_from, None
        self._robot.forget()
        if before is None:
            return None
        there = next((k for k, made in enumerate(self._way) if np.array_equal(made.poses, before)), len(self._way))
        del self._way[there:]
        for _ in range(LONGEST_DELAY):
            action = self._filtered(self._robot.towards(before, self.plant.task.grippers))
            if ending is not None or not action.any():
                break
            ending = self._without_motion(action, BACKING_OFF)
        return ending

    def take_hold(self) -> None:
        """Note where the arms are, and take hold of the cable where plan and plant can; see `tracking.hands`.

        Raises:
            GraspError: A hand missed the cable.
            SimulationError: They cannot hold the grippers where they are.
        """
        self._arms = HeldArms.of_plan(self.plan, self.task, self._robot.target)
        if (message := hands.take_hold(self.plant, self.plan)) is not None:
            self.hands = {"grasped": True}
            self._begin(message)

    def let_go(self) -> None:
        """Let go of the cable, where the arms took hold of it; `hands` says what became of that."""
        if not self.hands or self._arms is None or self._lies is None:
            return
        found, measured = hands.let_go(self.plant, self._arms, self._robot.target, self._lies, self.task)
        self.hands |= found
        if measured is not None:
            last = self.log.measured[-1]
            least = min(last.gripper_clearance, measured.gripper_clearance)
            self.log.measured[-1] = replace(last, gripper_clearance=least)

    def back_off(self, steps: int, far_enough: Callable[[], bool] = lambda: False) -> Ending | None:
        """Stop, then take back the last gripper motions as far as that is safe; how the run ended, if it did.

        Args:
            steps: As many as that, at most.
            far_enough: Asked before each whether that was enough.
        """
        ending = self.stand(BACKING_OFF) if self._before.any() or self._robot.short else None
        for _ in range(steps):
            if ending is not None or not self._way or far_enough():
                break
            self.look_round()
            if self._robot.short and not self._robot.holding:
                ending = self._without_motion(_still(), BACKING_OFF)
                continue
            back = self._filtered(-self._way[-1].action)
            known = had_room(self._way, self.observation, self.guard.task)
            if self._robot.holding or not (known or self.guard.is_safe(back, self.observation, ROOM_BACK)):
                return None
            self._way.pop()
            self._taken_back = False
            self.state = self.state.overruled(back, BACKING_OFF)
            self.log.act(back, 0.0, BACKING_OFF, self.state.estimates())
            ending = self._send(back)
        return ending

    @property
    def recent_references(self) -> Float[np.ndarray, "k n 2"]:
        """Reference of the last control steps [m], as far back as the latency of a frame may reach."""
        since = max(self._followed, len(self.log.reference) - 1 - LONGEST_DELAY)
        return np.array([*self.log.reference[since + 1 :], self.state.reference])

    def suspect(self, discs: list[Disc], keypoints: Float[np.ndarray, "n 2"]) -> None:
        """Take it that something stands there from now on, but nowhere where the cable lies [m]."""
        new = [disc for disc in discs if disc not in self.suspected]
        self.suspected = narrowed([*self.suspected, *new], keypoints, self.plant.task)

    def follow(self, task: Task, plan: Plan) -> None:
        """Go on with another plan; what was to be tried on the way of the last one is not."""
        self._robot.forget()
        self.plan, self._followed = plan, len(self.log.reference) - 1
        self.state = self._controller.resume(self.state, task, plan)
        self._rule = StopRule(self._config, plan, self.plant.control_step, self.task.cable.swing_period)

    def look_round(self) -> None:
        """Give controller and watchdog the scene as it is known, where it is another one than last time."""
        task = self.task
        if not (task.scene is self._scene or task.scene == self._scene):
            self._scene, self.guard.task = task.scene, task
            self._arms = self._arms and self._arms.in_task(task)
            self.state = self._controller.in_scene(self.state, task)

    def step(self, stops: Callable[[ControllerState], bool] = lambda state: False) -> Ending | None:
        """One control step; how the run ended, if it did.

        Args:
            stops: Whether the grippers are to stand instead of what the controller answers, given its new state.
        """
        self._taken_back = False
        if self._robot.holding:
            return self._hold()
        if self.waits:
            return self._wait()
        if is_blind(self.observation):
            return self._stay()
        hold = partial(self._robot.stop, self.plant.task.grippers)
        answer = self.guard.step(self.state, self.observation, self._before, self._filtered, hold)
        self.state = answer.state
        if stops(self.state):
            self.state = self.state.cut(_still(), 0.0)
            self.log.act(_still(), answer.seconds, LOOKING, self.state.estimates())
            return self._send(_still())
        self.log.act(answer.action, answer.seconds, answer.status, self.state.estimates())
        ending, missing = self._move(answer.action), self._silence.lasting(self.time)
        return ending or self._over(missing) or self.guard.outcome

    def stand(self, status: str = LOST) -> Ending | None:
        """One control step without motion; what a gripper that is short of its command has yet to do is taken back.

        Once: where poses are reported late, the next ones do not show yet that it was, and the grippers would go to
        and fro.
        """
        action = _still()
        if self._robot.short and (not self._taken_back or self._before.any()):
            action = self._robot.stop(self.plant.task.grippers, anew=not self._taken_back)
            self._taken_back = True
        return self._without_motion(action, status)

    def compute(self, function: Callable[[], T], status: str) -> T | Ending:
        """What a function returns, or how the run ended meanwhile; in real time the grippers stand until it does."""
        future = self.guard.thinker.begin(function)
        while not future.done():
            if (ending := self.stand(status)) is not None:
                return ending
        return future.result()

    def _without_motion(self, action: np.ndarray, status: str) -> Ending | None:
        """One control step in which the plan does not go on, and whose motion is none to take back later."""
        self._act_in_place(action, status)
        return self._send(action)

    def _act_in_place(self, action: np.ndarray, status: str) -> None:
        self.state = self.state.overruled(action, status, waits=True)
        self.log.act(action, 0.0, status, self.state.estimates())

    def _filtered(self, action: np.ndarray) -> np.ndarray:
        """What of an action may leave for the plant; a stop needs not ask."""
        return last_filter(
            action, self._robot.target, self.guard.task, self._most_span, self._before, self._lies, self._arms
        )

    @property
    def _before(self) -> np.ndarray:
        """The action of the control step before; the grippers stand at the start."""
        return self.log.actions[-1] if self.log.actions else _still()

    def _see(self, message: Observation) -> None:
        self.observation = self._gate.accepted(message)
        self._most_span = self._slack.most_span(self.observation)
        keypoints = connected(self.observation.keypoints, self.guard.task.cable)
        self._lies = keypoints if np.isfinite(keypoints).all() else self._lies
        confidence, seen = self.observation.confidence, np.isfinite(self.observation.keypoints[:, 0])
        blind = is_blind(self.observation)
        if seen.any() or blind:  # where nothing came, what is doubted stays so
            self._unsure = confidence is not None and (blind or bool((confidence[seen] < DOUBTED).any()))

    def _hold(self) -> Ending | None:
        """One control step in which the measured gripper poses become the target."""
        action = self._robot.stop(self.plant.task.grippers)
        self._act_in_place(action, HOLDING)
        return self._move(action)

    def _wait(self) -> Ending | None:
        """One control step in which the plan waits for a gripper that is late, or that is on trial after a hold.

        A taut cable buckles at once when only one gripper goes on.
        """
        motion, status = _still(), WAITING
        if self._robot.on_trial:
            motion, status = self._robot.trial(self.plant.task.grippers), TRIAL
        action = self._filtered(motion)
        self._act_in_place(action, status)
        return self._move(action) or self._over()

    def _over(self, missing: str = "") -> Ending | None:
        """See `StopRule.outcome`."""
        return self._rule.outcome(self.state, self.observation, missing, unsure=self._unsure)

    def _stay(self) -> Ending | None:
        """One control step without motion as long as the cable is not known; not for ever."""
        ending, missing = self.stand(BLIND), self._silence.lasting(self.time)
        if ending is None and missing and is_blind(self.observation):
            return Ending(Outcome.PLANT_FAILED, missing)
        return ending or self._over(missing)

    def _move(self, action: np.ndarray) -> Ending | None:
        if action.any():
            seen = connected(self.observation.keypoints, self.guard.task.cable)
            self._way.append(Motion(action, seen, self._robot.poses))
        return self._send(action)

    def _send(self, action: np.ndarray) -> Ending | None:
        try:
            self._robot.commanded(action)
            self._arms = self._arms and self._arms.led(self._robot.target)
            self._see(self.plant.step(action))
            self._robot.measured(self.observation)
            now = len(self.log.times) * self.plant.control_step
            self.log.see(now, self.observation, self.plant.measure(), self.state.reference)
        except SimulationError as error:
            return self.log.end_early(error)
        self._silence.noted(self.observation, now)
        lost = self._silence.lasting(now, never=True) or self._attachment.lost(self.observation, self.state.reference)
        failure = self._robot.error if self._robot.failed else lost
        return Ending(Outcome.PLANT_FAILED, failure) if failure else None
