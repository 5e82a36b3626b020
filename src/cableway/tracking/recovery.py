"""What is done about a cable that has left its plan for good, and about a plan that something stands in the way of."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from cableway.control.base import Contact, ControllerState
from cableway.core.errors import PlanningError, PlanningInterrupted, TaskError
from cableway.estimation.gating import LEAST_SHARE, connected, poses_usable
from cableway.outcome import Outcome
from cableway.records import Observation, Plan
from cableway.rod.contact import contacts_on
from cableway.rod.inverse import nearest_shapes
from cableway.scene.clearance import clearances
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.tracking import observed
from cableway.tracking.loop import BACKING_OFF, BLOCKED, LOOKING, LOST, Loop
from cableway.tracking.observed import LEAVING, at_rest, distances, mean, swing
from cableway.tracking.recovering import ATTEMPTS, BACK, Recovery
from cableway.tracking.setup import disagreement
from cableway.tracking.stopping import Ending
from cableway.tracking.suspicion import LEAST_ROOM, Obstruction, has_left, held_up, suspected

LOGGER = logging.getLogger(__name__)

FRICTION = 0.004
"""Root mean square distance [m] from the way it went of a cable that was led back, from which friction holds it. Noise
of 2 mm makes 1.4 mm of it, on development tasks, friction that passes for a contact 4 mm and more in most cases."""

FORESEEN = 3
"""Times in one run that the grippers stop because of what the estimated cable would do."""

DOUBT = 0.7
"""Share of what the controller takes for a contact from which the grippers stop to look."""

LOOKS = 3
"""Times in one run that they do so."""

FOLDING = 5.0
"""Stability margin below which the estimated cable would soon snap to another shape."""

AHEAD = 2
"""Control steps by which clearance is extrapolated: a frame is late, and grippers take a step to stop."""

NEAR = 0.006
"""Clearance [m] so extrapolated from which a cable that is as much nearer than its plan is about to touch something."""

NEARER = 0.001
"""How much less clearance [m], the same, than where a new plan began means that the cable is about to touch something,
where it is that near from the beginning. By nearness alone a cable that lies still would be replanned for ever."""

ROWS_APART = 4
"""Rows of the plan from one that is looked at to the next."""

CLOSER = 0.9
"""Share of its last distance from the goal below which a cable at rest came closer, and a further plan may help."""


class Watch:
    """Sees that the cable has left its plan, and brings it back."""

    def __init__(self, recovery: Recovery, control_step: float) -> None:
        self._recovery = recovery
        self._patience = max(1, math.ceil(recovery.patience / control_step))
        self._rest = max(1, math.ceil(recovery.rest / control_step))
        self._off = 0
        self._checked: tuple[Plan, Scene, Float[np.ndarray, "t"]] | None = None
        self._recent: deque[float] = deque(maxlen=AHEAD + 1)
        self._near = NEAR
        self.recovered: list[float] = []
        self._missed = math.inf
        self.friction = 0.0
        self._steps, self._foreseen, self._looks = 0, 0, 0
        self._foresight = max(1, math.ceil(recovery.foresight / control_step))

    def foresees(self, loop: Loop) -> bool:
        """Whether the cable, as it is estimated by now, would fold or touch something on the rest of the plan.

        Each row is taken for the shape of that cable nearest to it, as controllers do that know it.
        """
        self._steps += 1
        cable, plan = loop.state.estimated_cable(), loop.plan
        if self._steps % self._foresight or cable is None or plan.q is None or self._foreseen >= FORESEEN:
            return False
        first = round(loop.state.progress * plan.steps)
        rows = np.unique([*range(first, plan.steps, ROWS_APART), plan.steps])
        q = nearest_shapes(cable.rod, plan.q[rows], plan.shapes[rows])
        stations, poses = cable.rod.shapes(q)
        least = clearances(cable.rod.at_keypoints(stations), poses, loop.task).min()
        if least > 0 and cable.rod.stability(q, ceiling=FOLDING)[0].min() >= FOLDING:
            return False
        self._foreseen += 1
        return True

    def is_elsewhere(self, observation: Observation, plan: Plan, task: Task) -> bool:
        """Whether the cable does not lie where its plan begins; hidden keypoints do not count."""
        return mean(distances(observation, plan.shapes[0], task)) > self._recovery.start

    def is_lost(self, observation: Observation, references: Float[np.ndarray, "k n 2"], task: Task) -> bool:
        """Whether the keypoints have been far from their reference for long enough; hidden ones do not count.

        Args:
            observation: The newest one.
            references: (k, n, 2) where the cable should have been when the frame may have been taken [m].
            task: With the scene as it is known.
        """
        each = [distances(observation, reference, task) for reference in references]
        nearest = min(each, key=mean)
        if len(nearest):
            off = mean(nearest) - swing(task)
            far = off > self._recovery.deviation
            close = off > self._recovery.beside and observed.clearance(observation, task) < nearest.max()
            self._off = self._off + 1 if far or close else 0
        return self._off >= self._patience

    def is_closing_in(self, observation: Observation, plan: Plan, progress: float, task: Task) -> bool:
        """Whether the cable, unlike its plan, is about to touch something, as the last frames show it in full.

        Its clearance goes on as in the last `AHEAD` control steps, for as many; where a new plan began with little of
        it, only if it becomes less than that.
        """
        self._recent.append(observed.clearance(observation, task))
        if len(self._recent) <= AHEAD or not np.isfinite(self._recent).all():
            return False
        now, row = self._recent[-1], round(progress * plan.steps)
        planned = float(self._kept(task, plan)[max(0, row - AHEAD) : row + 1].min())
        return 2 * now - self._recent[0] < self._near and planned - now - swing(task) > NEAR

    def is_off_goal(self, observation: Observation, plan: Plan, task: Task) -> bool:
        """Whether the cable came to rest away from where the plan ends, and nearer than the last time.

        Hidden keypoints do not count.
        """
        off = observed.root_mean_square(distances(observation, plan.shapes[-1], task))
        if not self._recovery.goal + swing(task) < off < CLOSER * self._missed:
            return False
        self._missed = off
        return True

    def _is_at(self, keypoints: Float[np.ndarray, "n 2"], shape: Float[np.ndarray, "n 2"]) -> bool:
        """Whether a cable at rest is as near to a shape as it must be to its goal."""
        return observed.root_mean_square(np.linalg.norm(keypoints - shape, axis=1)) < self._recovery.goal

    def is_blocked(self, task: Task, plan: Plan, progress: float) -> bool:
        """Whether what is left of a plan after a share of it leads into something."""
        return float(self._kept(task, plan)[round(progress * plan.steps) :].min()) < -self._recovery.room

    def _kept(self, task: Task, plan: Plan) -> Float[np.ndarray, "t"]:
        """Clearance [m] of each row of a plan, as `observed.clearance` has it."""
        if self._checked is None or self._checked[0] is not plan or self._checked[1] != task.scene:
            self._checked = plan, task.scene, clearances(plan.shapes, plan.poses, task, LEAVING).min(axis=1)
        return self._checked[2]

    def takes_for_friction(self, contact: Contact) -> bool:
        """Whether friction, as it was seen so far, holds the cable as far off as that."""
        return contact.off is not None and contact.off < self.friction

    def may_be_held(self, loop: Loop) -> bool:
        """Whether something unknown may hold the cable, so that it is worth a stop; a few times in one run."""
        doubtful = self._is_doubtful(loop.state)
        self._looks += doubtful
        return doubtful

    def _is_doubtful(self, state: ControllerState) -> bool:
        return not self.friction and self._looks < LOOKS and state.contact(DOUBT) is not None

    def stops(self, state: ControllerState) -> bool:
        """Whether the grippers are to stop at once, since something holds the cable, or may."""
        contact = state.contact()
        return self._is_doubtful(state) or (contact is not None and not self.takes_for_friction(contact))

    def look(self, loop: Loop) -> Ending | None:
        """Stop and look whether something unknown holds the cable, and avoid it if so; how the run ended, if it did."""
        seen = self._rested(loop, LOOKING, self._rest // 2)
        if isinstance(seen, Ending):
            return None if seen.outcome is Outcome.NO_PLAN else seen
        found = self._contacts(loop, seen, LOOKING)
        return found if isinstance(found, Ending) else self._go_round(loop, found) if found else None

    def avoid(self, loop: Loop, contact: Contact | None) -> Ending | None:
        """Stop and look, go back from something that nobody knew of, and replan round where it seems to be.

        Args:
            loop: The run.
            contact: As the controller has it; None where the cable has only left its plan. Where it then rests where
                the plan ends, the run has settled; where nothing is seen to hold it, either, a plan is made from where
                it is. Of a cable that swings, or that friction holds, that cannot be seen.

        Returns:
            How the run ended, if it did.
        """
        hidden = bool(loop.task.cable.swing_period or self.friction)
        if contact is None and hidden:
            return self.recover(loop, Outcome.LEFT_PLAN)
        status = LOST if contact is None else BACKING_OFF
        seen = self._rested(loop, status, self._rest // 2)
        if isinstance(seen, Ending) and seen.outcome is not Outcome.NO_PLAN:
            return seen
        if contact is None and not isinstance(seen, Ending) and self._is_at(seen, loop.plan.shapes[-1]):
            LOGGER.info("at %.1f s: stopped where the plan ends", loop.time)
            return Ending(Outcome.SETTLED)
        contacts = [] if hidden or isinstance(seen, Ending) else self._contacts(loop, seen, status)
        if isinstance(contacts, Ending):
            return contacts
        contacts = contacts or ([] if contact is None else [contact])
        return self._go_round(loop, contacts) if contacts else self.recover(loop, Outcome.LEFT_PLAN)

    def _contacts(self, loop: Loop, seen: Float[np.ndarray, "n 2"], status: str) -> list[Contact] | Ending:
        """Where something may hold a cable that lies at rest [m]; how the run ended meanwhile, if it did."""
        poses, rod = loop.poses, loop.task.cable.rod
        found = loop.compute(lambda: contacts_on(rod, seen, poses), status)
        return found if isinstance(found, Ending) else [Contact(*one) for one in found]

    def _go_round(self, loop: Loop, contacts: Sequence[Contact]) -> Ending | None:
        """Go back from a contact and replan round it, but not round what turns out to be friction by then."""
        way = np.array([connected(frame, loop.task.cable) for frame in loop.log.observed])
        seen = self._led_back(loop, contacts)
        off = FRICTION if isinstance(seen, Ending) else observed.hysteresis(seen, way)
        if off > FRICTION:
            LOGGER.info("at %.1f s: friction: %.1f mm off the way here", loop.time, 1000 * off)
            self.friction = max(self.friction, off)
            return self.recover(loop, Outcome.LEFT_PLAN, seen=seen)
        if not (isinstance(seen, Ending) or has_left(contacts, seen, loop.poses, loop.plant.task)):
            seen = self._led_back(loop, contacts)
        return self._plan_round(loop, contacts, seen, held_up(contacts[0]))

    def go_round(self, loop: Loop, found: Obstruction) -> Ending | None:
        """Go back from what a gripper ran into and replan round it; how the run ended, if it did."""
        contacts = found.contacts(loop.plant.task)
        seen = loop.give_in() or self._led_back(loop, contacts)
        return self._plan_round(loop, contacts, seen, str(found))

    def _plan_round(
        self, loop: Loop, contacts: Sequence[Contact], seen: Float[np.ndarray, "n 2"] | Ending, what: str
    ) -> Ending | None:
        if isinstance(seen, Ending) and seen.outcome is not Outcome.NO_PLAN:
            return seen
        ending = self.recover(loop, Outcome.BLOCKED_WAY, contacts, seen)
        return ending and Ending(ending.outcome, f"{what}; {ending.detail}")

    def _led_back(self, loop: Loop, contacts: Sequence[Contact]) -> Float[np.ndarray, "n 2"] | Ending:
        """Where the cable lies [m] once the grippers went back from a contact; "no plan" where it is not seen.

        They go back for `BACK` seconds, and as long again where it does not seem to have left the contact by then.
        """

        def left() -> bool:
            now = connected(loop.observation.keypoints, loop.task.cable)
            return has_left(contacts, now, loop.poses, loop.plant.task)

        steps = math.ceil(BACK / loop.plant.control_step)
        return loop.back_off(steps) or loop.back_off(steps, left) or self._rested(loop, BACKING_OFF, self._rest)

    def recover(
        self,
        loop: Loop,
        why: Outcome | None,
        contacts: Sequence[Contact] = (),
        seen: Float[np.ndarray, "n 2"] | Ending | None = None,
    ) -> Ending | None:
        """Stand still, replan from where the cable is and follow the new plan; how the run ended, if it did.

        Where no plan is found the grippers go back the way they came, and it is tried again from there.

        Args:
            loop: The run.
            why: How the run ends where it cannot go on; None where the first plan may still be followed.
            contacts: Places of one with something unknown, to plan round.
            seen: Where the cable lies [m], or why that is not known, if the grippers stand still already.
        """
        LOGGER.info("at %.1f s: replanning: %s", loop.time, why or "the way ahead, or the end, is not as planned")
        if len(self.recovered) >= self._recovery.times:
            return Ending(why, f"already replanned {len(self.recovered)} times") if why else None
        ending = self._replan(loop, why, contacts, seen, first=True)
        for _ in range(ATTEMPTS - 1):
            if ending is None or why is None or ending.outcome is not why:
                break
            ending = loop.back_off(math.ceil(BACK / loop.plant.control_step)) or self._replan(loop, why, contacts)
        return ending if ending is None or why is not None or ending.outcome is not Outcome.NO_PLAN else None

    def _replan(
        self,
        loop: Loop,
        why: Outcome | None,
        contacts: Sequence[Contact],
        seen: Float[np.ndarray, "n 2"] | Ending | None = None,
        first: bool = False,
    ) -> Ending | None:
        """One attempt of `recover`, from where the cable is; "no plan" where it failed and `why` is None.

        The first one fails, too, where the cable touches something and may go back.
        """
        failed, status = why or Outcome.NO_PLAN, BLOCKED if why is Outcome.BLOCKED_WAY else LOST
        keypoints = self._rested(loop, status, self._rest) if seen is None else seen
        if isinstance(keypoints, Ending):
            return keypoints._replace(outcome=failed) if keypoints.outcome is Outcome.NO_PLAN else keypoints
        loop.suspect(suspected(contacts, keypoints, loop.poses, loop.plant.task), keypoints)
        if wrong := disagreement(keypoints, loop.poses, loop.state.reference):
            return Ending(Outcome.PLANT_FAILED if np.any(loop.log.actions) else Outcome.WRONG_SETUP, wrong)
        room = clearances(keypoints[None], loop.poses[None], loop.task, LEAVING)
        if first and why is not None and room.min() < LEAST_ROOM:
            return Ending(failed, "the cable touches something")
        try:
            found = loop.compute(lambda: self._plan_from(loop, keypoints, why is None), status)
            if isinstance(found, Ending):
                return found
            loop.follow(*found)
        except PlanningInterrupted as error:
            return Ending(Outcome.INTERRUPTED, str(error))
        except (TaskError, PlanningError) as error:
            LOGGER.info("at %.1f s: no new plan: %s", loop.time, error)
            return Ending(failed, str(error))
        self._off = 0
        self._recent.clear()
        self._near = min(NEAR, float(room.min()) - NEARER)
        self.recovered.append(loop.time)
        LOGGER.info("from %.1f s on: a new plan of %d steps", loop.time, loop.plan.steps)
        return None

    def _rested(self, loop: Loop, status: str, steps: int) -> Float[np.ndarray, "n 2"] | Ending:
        """Where the cable lies [m] after the grippers have stood still for a while; "no plan" where it is not seen."""
        frames, reported = [], False
        for _ in range(max(1, steps)):
            ending = loop.stand(status)
            if ending is not None:
                return ending
            frames.append(connected(loop.observation.keypoints, loop.task.cable))
            reported = reported or poses_usable(loop.observation)
        if not reported:
            return Ending(Outcome.NO_PLAN, "the robot reports no gripper poses")
        if np.isfinite(frames).any(axis=(0, 2)).mean() < LEAST_SHARE:
            return Ending(Outcome.NO_PLAN, "too little of the cable is observed")
        return at_rest(frames, loop.poses)

    def _plan_from(self, loop: Loop, keypoints: Float[np.ndarray, "n 2"], may_stay: bool) -> tuple[Task, Plan]:
        """A plan from there, and its task: for the cable as it turned out to be, or else for the task's own.

        The latter only where that is all there is, or the present plan cannot be followed.
        """
        cable = loop.state.estimated_cable()
        if cable is not None and loop.task.port is None:
            try:
                task = loop.task.resumed_from(keypoints, cable)
                plan = self._recovery.replan(task, loop.plan)
                # as the estimate becomes better, what comes nearest to the goal changes
                return task, replace(plan, shapes=np.concatenate([plan.shapes[:-1], loop.task.goal[None]]))
            except PlanningInterrupted:
                raise
            except (TaskError, PlanningError):
                if may_stay:
                    raise
        task = loop.task.resumed_from(keypoints)
        return task, self._recovery.replan(task, loop.plan)
