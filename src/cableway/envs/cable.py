"""The environment: lead a cable from start to goal, past obstacles, by motions of its two grippers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from cableway.control.base import Controller, ControllerState
from cableway.control.following import LEAST_RATE
from cableway.control.limits import within_limits
from cableway.core.errors import InputError, PlanningError, SimulationError, TaskError, UnknownNameError
from cableway.estimation.gating import poses_usable
from cableway.geometry.groups import SE2
from cableway.outcome import SUCCESS_ERROR, stacked_limit
from cableway.records import Observation
from cableway.scene.files.loading import TaskSource, as_task
from cableway.scene.scene import Scene
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.perturbations.variants import named_perturbation, variant
from cableway.tasks.generation import FIRST_SEED, KINDS, random_task
from cableway.tracking.photographer import EyesConfig, Photographer, State
from cableway.tracking.plant import Plant
from cableway.workflow.registry import make_controller
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

GRID = 32
"""Cells across and along the map of clearance."""

FARTHEST = 100.0
"""[m] and [rad]: bound of the numbers in an observation, far beyond any table."""

SETTLED = 5
"""Control steps in a row within the limit of success that end an episode."""

TRIES = 20
"""Random tasks that are drawn until one is found, and planned where there is an expert."""


@dataclass
class _Expert:
    """A controller that is asked in every step, whoever leads.

    Attributes:
        controller: Who is asked.
        state: Before its next step.
        action: (2, 3) what it would do now [m, m, rad].
        after: The state if that is done.
    """

    controller: Controller[Any]
    state: ControllerState
    action: Float[np.ndarray, "2 3"]
    after: ControllerState

    def asked(self, observation: Observation) -> None:
        """Make up its mind about an observation."""
        self.action, self.after = self.controller.step(self.state, observation)

    def told(self, action: Float[np.ndarray, "2 3"]) -> None:
        """What was done instead. Its reference goes on by the share of its own motion in that, or waits."""
        wanted = float(np.sum(self.action**2))
        share = float(np.clip(np.sum(action * self.action) / wanted, 0.0, 1.0)) if wanted else 1.0
        if np.array_equal(action, self.action):
            self.state = self.after
        elif share < LEAST_RATE:
            self.state = self.state.overruled(action, "not followed", waits=True)
        else:
            self.state = self.after.cut(action, share)


class CableEnv(gymnasium.Env[dict[str, Any], np.ndarray]):
    """A cable, held by two grippers, is led from start to goal; one control step of 0.1 s after the other.

    An *observation* is a dict of arrays in the world frame of the task [m, rad], left before right:
    `keypoints` (n, 2), those not seen where they were seen last, and `seen` (n,), 1 for those that were;
    `grippers` (2, 3), as reported; `goal` (n, 2) and `goal_grippers` (2, 3); `clearance` (32, 32), of points spread
    evenly over the workspace, first axis y, negative within obstacles; `workspace` (2,), its size; and, where `images`
    asks for them, `images` (cameras, height, width, 3), from 0 to 255, of how everything stands at that moment.

    An *action* (2, 3) is the motion (dx, dy, dtheta) of both grippers in shares of their limits, from -1 to 1. It is
    cut to what the grippers may do in a step, and where they would pull the cable taut.

    The *reward* is by how much nearer to the goal the keypoints came on average, in distances of the start, and 1 more
    for success, 1 less for a contact or a plant that failed. An episode *terminates* with success, once the stacked
    error has been below that of the paper for half a second, with the first contact of cable or grippers, and where the
    plant cannot go on. `info` has the truth: `error`, the stacked error [m], `clearance` [m], `success`, `failure`, a
    sentence or "", and `task`, the name; with an expert `expert_action` (2, 3), in shares of the limits as well. A
    success is never one of a run that touched anything.

    Args:
        task: The task of every episode, or its name or file; None for a random one of `kind` in each.
        kind: Of random tasks, one of those of `cableway tasks --random`.
        perturbations: Names of plants, as of the benchmark's episodes, of which each episode has one.
        expert: Name of a controller that is asked what it would do, along a plan made for each episode. It follows
            that plan by time: where it is not followed it waits, and leads back to where it waits.
        images: Cameras, and what their pictures are like; none where None. Pictures show hands without arms. There is
            neither a tracker nor a rate of pictures here, and none is late or lost: one comes with each observation.
        render_mode: "rgb_array" or None.

    Raises:
        UnknownNameError: A name of a kind, a perturbation or a controller is not known.
        InputError: There is no perturbation.
        MissingExtraError: The expert needs packages that are not installed.
    """

    metadata: ClassVar[dict[str, Any]] = {  # pyright: ignore[reportIncompatibleVariableOverride]
        "render_modes": ["rgb_array"],
        "render_fps": 10,
    }

    def __init__(
        self,
        task: TaskSource | None = None,
        *,
        kind: str = "clutter",
        perturbations: str | Sequence[str] = "nominal",
        expert: str | None = None,
        images: EyesConfig | None = None,
        render_mode: str | None = None,
    ) -> None:
        if kind not in KINDS:
            raise UnknownNameError("kind of random task", kind, KINDS)
        self._given = None if task is None else as_task(task)
        self._kind = kind
        self._perturbations = (perturbations,) if isinstance(perturbations, str) else tuple(perturbations)
        if not self._perturbations:
            raise InputError("perturbations must name one plant at least, got none")
        for name in self._perturbations:
            variant(name)
        self._controller = None if expert is None else make_controller(expert)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise UnknownNameError("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode, self._images = render_mode, images
        self._keypoints = n = (self._given or random_task(FIRST_SEED, kind)).cable.keypoints
        self.action_space = spaces.Box(-1.0, 1.0, (2, 3), np.float32)
        shown = {} if images is None else {"images": _pictures(images)}
        self.observation_space = spaces.Dict(
            {
                **shown,
                "keypoints": _numbers(n, 2),
                "seen": spaces.MultiBinary(n),
                "grippers": _numbers(2, 3),
                "goal": _numbers(n, 2),
                "goal_grippers": _numbers(2, 3),
                "clearance": _numbers(GRID, GRID),
                "workspace": spaces.Box(0.0, FARTHEST, (2,), np.float32),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Of tasks, perturbations and noise from now on.
            options: `task` and `perturbation` of this episode in place of drawn ones.

        Raises:
            InputError: An option is not known, or the task has a port or another number of keypoints than those before.
            PlanningError: There is an expert, and no plan for the task given, or for any of those drawn.
            SimulationError: The plant cannot take the start of the task given.
        """
        super().reset(seed=seed)
        options = options or {}
        if unknown := set(options) - {"task", "perturbation"}:
            raise InputError(f"reset has no option {sorted(unknown)[0]!r}; there are task, perturbation")
        given = self._given if options.get("task") is None else as_task(options["task"])
        name = options.get("perturbation") or str(self.np_random.choice(self._perturbations))
        for attempt in range(TRIES):
            task = given or random_task(FIRST_SEED + int(self.np_random.integers(2**31)), self._kind)
            if task.port is not None:
                raise InputError(f"the task {task.name} has a port, and the environment puts no plug into one")
            if task.cable.keypoints != self._keypoints:
                there = f"{task.cable.keypoints} keypoints, and the environment is for {self._keypoints}"
                raise InputError(f"the task {task.name} has {there}")
            try:
                return self._begun(task, name)
            except (InputError, PlanningError, SimulationError, TaskError):  # a drawn cable may be too short for a task
                if given is not None or attempt == TRIES - 1:
                    raise
        raise AssertionError

    def _begun(self, task: Task, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
        seed = int(self.np_random.integers(2**31))
        perturbation = named_perturbation(name, task, seed)
        self._task, self._scene, self._settled = task, task.scene, 0
        self._lasting = _bounded(
            goal=task.goal,
            goal_grippers=task.gripper_poses("goal"),
            clearance=_clearance(task.scene),
            workspace=np.array(task.scene.size),
        )
        self._plant: Plant = perturbation.build(task, seed)
        self._photographer = None
        if self._images is not None:
            config, there = replace(self._images, seed=seed), perturbation.known_task(task).scene
            self._photographer, self._noise = Photographer(task, None, config, there), np.random.default_rng(seed)
        observation = self._plant.reset()
        self._truth, self._steps = self._plant.measure(), 0
        self._commanded = np.array(observation.poses, float)
        self._known = np.array(task.start, float)
        self._first = max(self._distance(), 1e-3)
        self._expert = None
        if self._controller is not None:
            run = solve(task, SolveOptions(track=False, perturbation=perturbation, seed=seed))
            if run.plan is None:
                raise PlanningError(f"{task.name}: {run.report.failure}", run.attempt, run.report.outcome)
            state = self._controller.init(task, run.plan)
            self._expert = _Expert(self._controller, state, np.zeros((2, 3)), state)
            self._expert.asked(observation)
        return self._seen(observation), self._info("")

    def step(self, action: np.ndarray) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Move the grippers by shares of their limits and look; see the class.

        Raises:
            InputError: The action is not of shape (2, 3), or not finite.
        """
        shares = np.asarray(action, float)
        if shares.shape != (2, 3) or not np.isfinite(shares).all():
            raise InputError(f"an action must be (2, 3) finite numbers, got {action!r}")
        task = self._task
        motion = within_limits(shares * self._limits, self._commanded, task.grippers, task.cable.length)
        before, failure, self._steps = self._distance(), "", self._steps + 1
        if self._expert is not None:
            self._expert.told(motion)
        try:
            observation = self._plant.step(motion)
        except SimulationError as error:
            failure, observation = str(error), _nothing(self._commanded, len(task.start))
        else:
            self._commanded = SE2.plus(self._commanded, motion)
            self._truth = self._plant.measure()
        if self._expert is not None and not failure:
            self._expert.asked(observation)
        if not failure and min(self._truth.clearance, self._truth.gripper_clearance) <= 0:
            failure = "the cable or a gripper touched something"
        self._settled = self._settled + 1 if self._error() < stacked_limit(SUCCESS_ERROR, len(task.goal)) else 0
        success = not failure and self._settled >= SETTLED
        reward = (before - self._distance()) / self._first + float(success) - float(bool(failure))
        return self._seen(observation), reward, success or bool(failure), False, self._info(failure, success)

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The scene with cable, grippers and goal as an image (rows, columns, 3); None without a render mode."""
        from cableway.figures.moment import picture

        return picture(self._task, self._truth) if self.render_mode == "rgb_array" else None

    @property
    def _limits(self) -> Float[np.ndarray, "3"]:
        """Of a motion [m, m, rad]."""
        grippers = self._task.grippers
        return np.array([grippers.max_step, grippers.max_step, grippers.max_turn])

    def _error(self) -> float:
        return float(np.linalg.norm(self._truth.keypoints - self._task.goal))

    def _distance(self) -> float:
        return float(np.linalg.norm(self._truth.keypoints - self._task.goal, axis=1).mean())

    def _seen(self, observation: Observation) -> dict[str, Any]:
        seen = np.asarray(np.isfinite(observation.keypoints).all(axis=1))
        self._known = np.where(seen[:, None], observation.keypoints, self._known)
        if poses_usable(observation):
            self._reported = SE2.continued(observation.poses, self._commanded)
        if self._plant.task.scene != self._scene:  # something moved, or was revealed
            self._scene = self._plant.task.scene
            self._lasting |= _bounded(clearance=_clearance(self._scene))
        lasting = {key: value.copy() for key, value in self._lasting.items()}
        if self._photographer is not None:
            state = State(self._steps * CONTROL_STEP, self._truth.centreline, self._truth.poses, None)
            lasting["images"] = np.stack(self._photographer.pictures(state, self._noise))
        return lasting | _bounded(keypoints=self._known, grippers=self._reported) | {"seen": seen.astype(np.int8)}

    def _info(self, failure: str, success: bool = False) -> dict[str, Any]:
        info: dict[str, Any] = {
            "task": self._task.name,
            "error": self._error(),
            "clearance": float(min(self._truth.clearance, self._truth.gripper_clearance)),
            "success": success,
            "failure": failure,
        }
        if self._expert is not None:
            info["expert_action"] = np.clip(self._expert.action / self._limits, -1.0, 1.0).astype(np.float32)
        return info


def _numbers(*shape: int) -> spaces.Box:
    return spaces.Box(-FARTHEST, FARTHEST, shape, np.float32)


def _pictures(images: EyesConfig) -> spaces.Box:
    width, height = images.picture
    return spaces.Box(0, 255, (len(images.cameras), height, width, 3), np.uint8)


def _nothing(poses: Float[np.ndarray, "2 3"], keypoints: int) -> Observation:
    """What is seen of a plant that failed."""
    return Observation(0.0, np.full((keypoints, 2), np.nan), poses)


def _clearance(scene: Scene) -> Float[np.ndarray, "g g"]:
    """Clearance [m] of points spread evenly over the workspace."""
    across, along = ((np.arange(GRID) + 0.5) / GRID * size for size in scene.size)
    return scene.signed_distance(np.stack(np.meshgrid(across, along), axis=-1))


def _bounded(**arrays: Float[np.ndarray, "..."]) -> dict[str, Any]:
    """Arrays as an observation has them."""
    return {key: np.clip(value, -FARTHEST, FARTHEST).astype(np.float32) for key, value in arrays.items()}
