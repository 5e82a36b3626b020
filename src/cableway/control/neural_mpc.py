"""Neural model predictive control: the "Neural MPC Design" of Tang et al., with a learned deformation model.

At every control step, with s_0 and y_0 the keypoints and gripper poses just measured, f the model, s_ref and a_ref
the plan's shapes and gripper steps and b the output offset, find the actions a_0..a_{H-1} that make

    sum_{k=1..H}   lambda_1/2 |s_k + b_k - s_ref,k|^2                                     tracking
                 + lambda_2   obstacle(clearance of the cable and of the gripper discs)   `terms.clearance`
                 + w_s/2      max(0, |x_R,k - x_L,k| - max(stretch L, planned))^2         stretch
                 + lambda_3/2 |a_{k-1} - a_ref,k-1|^2_R                                   control

least, subject to s_{k+1} = s_k + f(s_k, y_k, a_k), y_{k+1} = y_k + a_k and the grippers' limits; then send a_0.

Every term is a square, so a few Gauss-Newton steps in a box suffice (`gauss_newton`), from the solution of the step
before, moved on by one. JAX computes what the model predicts and its derivative; all else is assembled here.

The output offset is what the model keeps getting wrong: the difference between what was measured and what had been
predicted for that moment, low-pass filtered. Without it the loop settles where the model's error balances the pull
to the reference.

Note:
    The feedforward a_ref, the offset, the stretch term and the cost of the cable between its keypoints are ours;
    `MPCConfig.paper()` is without them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cableway.control.base import Controller, ControllerState, Status
from cableway.control.gauss_newton import Residual, Solution, minimize_in_box
from cableway.control.horizon import ActionBox, HorizonCost, Target
from cableway.control.limits import longest_gap, within_limits
from cableway.control.mpc_config import MPCConfig
from cableway.control.prediction import Predictor, compile_predictor
from cableway.control.reference import PlanReference, reference_for
from cableway.control.seen import keypoints_usable, poses_usable
from cableway.errors import ControlError
from cableway.models.base import DeformationModel
from cableway.records import Observation, Plan
from cableway.scene.task import Task


@dataclass(frozen=True)
class Problem:
    """What stays the same during a run.

    Attributes:
        task: The task.
        reference: The plan by time.
        predictor: The compiled model.
        cost: The terms.
    """

    task: Task
    reference: PlanReference
    predictor: Predictor
    cost: HorizonCost


@dataclass(frozen=True, kw_only=True)
class MPCState(ControllerState):
    """State of `NeuralMPC`.

    Attributes:
        problem: What stays the same.
        index: Control steps of the reference that are over.
        actions: (H, 2, 3) the last solution.
        poses: (2, 3) gripper poses [m, m, rad] as last seen, moved on by what was sent since.
        predicted: (n, 2) keypoints [m] that the model, without offset, expects next; None after a blind step.
        offset: (n, 2) output offset [m].
        blind: Steps in a row without a usable observation.
        solution: The last solve, for the record; None before the first.
    """

    problem: Problem
    index: int
    actions: Float[np.ndarray, "H 2 3"]
    poses: Float[np.ndarray, "2 3"]
    predicted: Float[np.ndarray, "n 2"] | None
    offset: Float[np.ndarray, "n 2"]
    blind: int
    solution: Solution | None


class NeuralMPC(Controller[MPCState]):
    """Model predictive control with any deformation model.

    Args:
        model: Predicts the cable's motion.
        config: The settings, the defaults where None.
    """

    def __init__(self, model: DeformationModel, config: MPCConfig | None = None) -> None:
        self.model = model
        self.config = config or MPCConfig()
        self._predictors: dict[int, Predictor] = {}

    def init(self, task: Task, plan: Plan) -> MPCState:
        """See `Controller.init`."""
        reference = reference_for(task, plan, self.config.hold)
        predictor = self._predictor(task.cable.keypoints)
        return MPCState(
            status=Status.STARTED,
            reference=reference.shape(0),
            progress=0.0,
            problem=Problem(task, reference, predictor, HorizonCost(task, self.config)),
            index=0,
            actions=np.zeros((self.config.horizon, 2, 3)),
            poses=plan.poses[0],
            predicted=None,
            offset=np.zeros_like(task.start),
            blind=0,
            solution=None,
        )

    def step(self, state: MPCState, observation: Observation | None) -> tuple[Float[np.ndarray, "2 3"], MPCState]:
        """See `Controller.step`."""
        if observation is None or not poses_usable(observation):
            return self._go_on(state, Status.UNSEEN)
        state = replace(state, poses=np.array(observation.poses, float))
        if not keypoints_usable(observation, state.problem.task.cable):
            return self._go_on(state, Status.UNSEEN)
        try:
            return self._track(state, np.array(observation.keypoints, float))
        except ControlError:
            return self._go_on(state, Status.FAILED)

    def _predictor(self, keypoints: int) -> Predictor:
        """Compiled once per number of keypoints, whatever the number of runs."""
        if keypoints not in self._predictors:
            self._predictors[keypoints] = compile_predictor(self.model, self.config.horizon, keypoints)
        return self._predictors[keypoints]

    def _track(self, state: MPCState, keypoints: np.ndarray) -> tuple[np.ndarray, MPCState]:
        problem, gain = state.problem, self.config.offset_gain
        offset = state.offset
        if state.predicted is not None:
            offset = offset + gain * (keypoints - state.predicted - offset)
        actions, solution = self._solve(state, keypoints, offset)
        action = self._limited(state, actions[0])
        sent = np.concatenate([action[None], actions[1:]])
        predicted = problem.predictor.shapes(keypoints, state.poses, sent)[0]
        if not (np.isfinite(predicted).all() and np.isfinite(offset).all()):
            raise ControlError("the model's prediction is not finite")
        state = replace(state, actions=sent, predicted=predicted, offset=offset, blind=0, solution=solution)
        return action, _advanced(state, action, Status.TRACKING)

    def _solve(
        self, state: MPCState, keypoints: np.ndarray, offset: np.ndarray
    ) -> tuple[Float[np.ndarray, "H 2 3"], Solution]:
        """Actions over the horizon that make the cost least."""
        problem, config, poses = state.problem, self.config, state.poses
        target = self._target(state)
        box = ActionBox.around(target.actions, problem.task.grippers)

        def evaluate(x: np.ndarray) -> Residual:
            actions = box.actions(x)
            predicted = problem.predictor.shapes(keypoints, poses, actions) + offset
            terms = problem.cost.terms(predicted, poses, actions, target)

            def derivative() -> np.ndarray:
                by_actions = problem.predictor.linearized(keypoints, poses, actions)[1]
                return box.by_unknowns(np.concatenate([rows(by_actions) for _, rows in terms]))

            return np.concatenate([residual for residual, _ in terms]), derivative

        start = np.concatenate([state.actions[1:], target.actions[-1:]])
        solution = minimize_in_box(
            evaluate,
            box.unknowns(start),
            box.bound,
            iterations=config.iterations,
            tolerance=config.tolerance,
        )
        return box.actions(solution.x), solution

    def _target(self, state: MPCState) -> Target:
        """What the plan asks of the next H actions."""
        reference, horizon = state.problem.reference, self.config.horizon
        actions = reference.actions(state.index, horizon)
        poses = nearest_turns(reference.poses(state.index, horizon), state.poses)
        return Target(
            reference.shapes(state.index, horizon), poses, actions if self.config.feedforward else 0.0 * actions
        )

    def _go_on(self, state: MPCState, status: Status) -> tuple[np.ndarray, MPCState]:
        """Without a solution: the plan's own motion for a few steps, then none, and the reference waits."""
        blind = state.blind + 1
        state = replace(state, blind=blind, predicted=None)
        if blind > self.config.blind_steps:
            return np.zeros((2, 3)), replace(state, status=Status.STOPPED)
        wanted = state.problem.reference.actions(state.index, self.config.horizon)
        action = self._limited(state, wanted[0])
        return action, _advanced(replace(state, actions=wanted), action, status)

    def _limited(self, state: MPCState, action: np.ndarray) -> np.ndarray:
        task, planned = state.problem.task, state.problem.reference.poses(state.index, 1)
        longest = longest_gap(planned, task.cable.length, self.config.longest)
        return within_limits(action, state.poses, task.grippers, float(longest[0]))


def nearest_turns(wanted: Float[np.ndarray, "H 2 3"], poses: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "H 2 3"]:
    """The same poses with whole turns added, so that the first angles are within half a turn of those of `poses`."""
    turns = np.round((poses[:, 2] - wanted[0, :, 2]) / (2 * np.pi))
    return wanted + 2 * np.pi * turns[:, None] * np.array([0.0, 0.0, 1.0])


def _advanced(state: MPCState, action: np.ndarray, status: Status) -> MPCState:
    """The state after `action` was sent, one step on along the reference."""
    index, reference = state.index + 1, state.problem.reference
    return replace(
        state,
        index=index,
        poses=state.poses + action,
        status=status,
        reference=reference.shape(index),
        progress=reference.progress(index),
    )
