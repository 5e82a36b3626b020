"""Neural model predictive control: the "Neural MPC Design" of Tang et al., with a learned deformation model.

At every control step, with s_0 and y_0 the keypoints and gripper poses just measured, f the model, s_ref and a_ref
the plan's shapes and gripper steps and b the output offset, find the actions a_0..a_{H-1} that make

    sum_{k=1..H}   lambda_1/2 |s_k + b_k - s_ref,k|^2                                     tracking
                 + lambda_2   obstacle(clearance of the cable and of the gripper discs)   `terms.clearance`
                 + w_s/2      max(0, |x_R,k - x_L,k| - max(soft_span L, planned))^2       gripper span
                 + lambda_3/2 |a_{k-1} - a_ref,k-1|^2_R                                   control

least, subject to s_{k+1} = s_k + f(s_k, y_k, a_k), y_{k+1} = y_k + a_k and the grippers' limits; then send a_0.

Every term is a square, so a few Gauss-Newton steps in a box suffice (`gauss_newton`), from the solution of the step
before, moved on by one. JAX computes what the model predicts and its derivative; all else is assembled here.

The output offset is what the model keeps getting wrong: the difference between the newest keypoints and what the model
predicts from the frame before and the gripper motion since, low-pass filtered. Without it the loop settles where the
model's error balances the pull to the reference. Hidden keypoints are taken to be where the model predicts them. A late
frame is first predicted forward by the gripper motions made or sent since it was taken (`tracker`).

With `adapt_every` the model itself is adapted to the cable at hand: its decoder, as in the paper, or its rod
(`models.adaptation`), from the frames that show the whole cable.

Beside the model the rod's parameters are estimated as `RodMPC` does: for the latency of frames without the cable's
ends, for contacts with something unknown, and for new plans.

Note:
    The feedforward a_ref, the offset, the handling of latency, the span term, the cost of the cable between its
    keypoints and the rod's estimate are ours; `MPCConfig.paper()` has no feedforward, offset, span term, points between
    or estimate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cableway.control.base import Controller, Status
from cableway.control.estimating import EstimatingState
from cableway.control.limits import span_limit
from cableway.core.errors import ControlError, InputError
from cableway.geometry.groups import SE2
from cableway.records import Estimate, Observation, Plan
from cableway.scene.task import Task
from cableway.tang2025.control.gauss_newton import Residual, Solution, minimize_in_box
from cableway.tang2025.control.horizon import ActionBox, HorizonCost, Target
from cableway.tang2025.control.learning import Learning
from cableway.tang2025.control.mpc_config import MPCConfig
from cableway.tang2025.control.prediction import Predictor, compile_predictor
from cableway.tang2025.models.adaptation import AdaptationConfig
from cableway.tang2025.models.base import DeformationModel
from cableway.tang2025.models.learned import LearnedModel


@dataclass(frozen=True)
class NeuralProblem:
    """What stays the same during a run.

    Attributes:
        predictor: The compiled model.
        cost: The terms.
    """

    predictor: Predictor
    cost: HorizonCost


@dataclass(frozen=True, kw_only=True)
class MPCState(EstimatingState):
    """State of `NeuralMPC`.

    Attributes:
        problem: What stays the same.
        actions: (H, 2, 3) the last solution.
        last_frame: The last keypoints (n, 2) [m] with gripper poses (2, 3) of the same time; None before the first.
        offset: (n, 2) output offset [m].
        solution: The last solve, for the record; None before the first.
        learning: The model that is adapted; None where it is not.
        waited: Control steps for which the reference has waited.
    """

    problem: NeuralProblem
    actions: Float[np.ndarray, "H 2 3"]
    last_frame: tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "2 3"]] | None
    offset: Float[np.ndarray, "n 2"]
    solution: Solution | None
    learning: Learning | None = None
    waited: int = 0

    def estimates(self) -> Mapping[str, Estimate]:
        """See `ControllerState.estimates`; those of the model where it is adapted."""
        if self.learning is not None:
            return self.learning.estimates()
        return super().estimates() if self.estimator.adapts else {}


class NeuralMPC(Controller[MPCState]):
    """Model predictive control with any deformation model.

    Args:
        model: Predicts the cable's motion.
        config: The settings, the defaults where None.
        adaptation: How the model is adapted where the settings ask for it; as `start_adaptation` has it where None.

    Raises:
        InputError: A model that nothing was learned of is to be adapted.
    """

    def __init__(
        self, model: DeformationModel, config: MPCConfig | None = None, adaptation: AdaptationConfig | None = None
    ) -> None:
        self.model = model
        self.config = config or MPCConfig()
        self._adaptation = adaptation
        if self.config.adapt_every and not isinstance(model, LearnedModel):
            raise InputError(f"adapt_every must be 0 for a {type(model).__name__}, which has nothing to adapt")
        self._predictors: dict[int, Predictor] = {}

    def init(self, task: Task, plan: Plan) -> MPCState:
        """See `Controller.init`."""
        beginning, learning = EstimatingState.estimating(task, plan, self.config), None
        if isinstance(self.model, LearnedModel) and self.config.adapt_every:
            learning = Learning.of(self.model, self._adaptation, self.config.adapt_every, task.cable.keypoints)
        state = MPCState(
            **beginning,
            problem=NeuralProblem(self._predictor(task.cable.keypoints), HorizonCost(task, self.config)),
            actions=np.zeros((self.config.horizon, *task.cable.rod.step_shape)),
            last_frame=None,
            offset=np.zeros_like(task.start),
            solution=None,
            learning=learning,
        )
        self.step(state, Observation(0.0, plan.shapes[0], plan.poses[0]))  # loads and compiles what a step needs
        return state

    def resume(self, state: MPCState, task: Task, plan: Plan) -> MPCState:
        """See `Controller.resume`."""
        begun = self.init(task, plan).knowing(state)
        if state.learning is None:
            return begun
        predictor = begun.problem.predictor.of(state.learning.state.model)
        return replace(begun, learning=state.learning, problem=replace(begun.problem, predictor=predictor))

    def in_scene(self, state: MPCState, task: Task) -> MPCState:
        """See `Controller.in_scene`."""
        return replace(state, task=task, problem=replace(state.problem, cost=HorizonCost(task, self.config)))

    def step(self, state: MPCState, observation: Observation | None) -> tuple[Float[np.ndarray, "2 3"], MPCState]:
        """See `Controller.step`."""
        estimates = state.estimator.adapts
        state = state.observing(observation) if estimates else state.looking(observation)
        if state.must_stop:
            return self._sent(state, np.zeros_like(state.actions[0]), Status.STOPPED)
        state = state.updated() if estimates else state
        try:
            return self._track(state)
        except ControlError:
            wanted = state.plan.actions(state.index, self.config.horizon)
            return self._sent(replace(state, actions=wanted, last_frame=None), wanted[0], Status.FAILED)

    def _predictor(self, keypoints: int) -> Predictor:
        """Compiled once per number of keypoints, whatever the number of runs."""
        if keypoints not in self._predictors:
            self._predictors[keypoints] = compile_predictor(self.model, self.config.horizon, keypoints)
        return self._predictors[keypoints]

    def _track(self, state: MPCState) -> tuple[np.ndarray, MPCState]:
        state = self._adapted(state)
        tracker, offset = state.tracker, state.offset
        keypoints = tracker.keypoints
        if state.last_frame is not None:
            expected = self._rolled(state, *state.last_frame, tracker.at_frame[None])
            error = np.where(np.isfinite(keypoints), keypoints - expected, offset)
            offset = offset + self.config.offset_gain * (error - offset)
            keypoints = np.where(np.isfinite(keypoints), keypoints, expected + offset)
        if not np.isfinite(keypoints).all():
            return self._sent(state, state.plan.actions(state.index, 1)[0], Status.UNSEEN)
        state = replace(state, last_frame=(keypoints, tracker.at_frame), offset=offset)
        way = tracker.path
        actions, solution = self._solve(state, self._rolled(state, keypoints, way[0], way[1:]), offset)
        error = float(np.linalg.norm(keypoints - state.reference)) / len(keypoints)
        waits = 0 < self.config.waits_above < error and state.waited < self.config.patience
        state = replace(state, actions=actions, solution=solution, waited=state.waited + 1 if waits else 0)
        return self._sent(state, actions[0], state.tracking_status, waits)

    def _adapted(self, state: MPCState) -> MPCState:
        """With the model adapted to the newest frame."""
        if state.learning is None:
            return state
        learning = state.learning.seeing((state.tracker.keypoints, state.tracker.at_frame))
        if learning.state.model is state.learning.state.model:
            return replace(state, learning=learning)
        problem = replace(state.problem, predictor=state.problem.predictor.of(learning.state.model))
        return replace(state, learning=learning, problem=problem, offset=np.zeros_like(state.offset))

    def _rolled(
        self,
        state: MPCState,
        keypoints: Float[np.ndarray, "n 2"],
        poses: Float[np.ndarray, "2 3"],
        way: Float[np.ndarray, "k 2 3"],
    ) -> Float[np.ndarray, "n 2"]:
        """Keypoints [m] after the grippers went from `poses` along `way`, as the model has it.

        Raises:
            ControlError: They are not finite.
        """
        horizon = self.config.horizon
        for first in range(0, len(way), horizon):
            part = way[first : first + horizon]
            motions = np.zeros((horizon, *state.task.cable.rod.step_shape))
            motions[: len(part)] = SE2.minus(part, np.concatenate([poses[None], part[:-1]]))
            keypoints = state.problem.predictor.shapes(keypoints, poses, motions)[len(part) - 1]
            poses = part[-1]
        if not np.isfinite(keypoints).all():
            raise ControlError("the model's prediction is not finite")
        return keypoints

    def _solve(
        self, state: MPCState, keypoints: np.ndarray, offset: np.ndarray
    ) -> tuple[Float[np.ndarray, "H 2 3"], Solution]:
        """Actions over the horizon that make the cost least."""
        problem, config, poses = state.problem, self.config, state.tracker.commanded
        target = self._target(state)
        box = ActionBox.around(target.actions, state.task.grippers)

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
        reference, horizon = state.plan, self.config.horizon
        actions = reference.actions(state.index, horizon)
        poses = reference.poses(state.index, horizon)
        poses += SE2.continued(poses[0], state.tracker.commanded) - poses[0]  # angles run on, in the grippers' turn
        return Target(
            reference.shapes(state.index, horizon), poses, actions if self.config.feedforward else 0.0 * actions
        )

    def _sent(
        self, state: MPCState, action: np.ndarray, status: Status, waits: bool = False
    ) -> tuple[np.ndarray, MPCState]:
        max_span = span_limit(state.plan.poses(state.index, 1), state.task.cable.length, self.config.max_span)
        action, state = state.sending(action, status, float(max_span[0]), waits)
        return action, replace(state, actions=np.concatenate([action[None], state.actions[1:]]))
