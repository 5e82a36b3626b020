"""Initial trajectories: sequences of shapes from start to goal, in general no equilibria, that a plan is made from.

Each is a short method of `InitialTrajectories`; what several need (the pivot path) is made once, when it is first asked
for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pkgutil import resolve_name
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import PlanningError
from cableway.motion.interpolation import rows_at
from cableway.planning import rrt_connect
from cableway.planning.config import InitialName, PlannerConfig
from cableway.planning.projection import fit_sequence
from cableway.planning.routes.pivot import pivot_keypoint, plan_pivot_path
from cableway.planning.slide import End, slide
from cableway.records import PaperStages, Plan
from cableway.scene.task import Task

Progress = Callable[[str, float], None]

DEFORMED: tuple[InitialName, ...] = ("head", "tail", "uniform", "least-energy")
"""Those that the chain of Tang et al. makes, by the end that leads in its first guess."""

PIVOTED: tuple[InitialName, ...] = ("corridor", *DEFORMED)
"""The initial trajectories that follow the pivot path."""

ROUTED: tuple[InitialName, ...] = ("slide-head", "slide-tail", "tube", *PIVOTED)
"""Those that follow a route that is asked for; those that keep its homotopy class come first."""

RESTARTS: tuple[tuple[InitialName, int], ...] = tuple(
    (name, samples) for samples in (12_000, 24_000, 48_000, 96_000) for name in ("tube", "corridor")
)
"""The searches of "restarts": where each samples, and how often. Each has a seed of its own.

In the narrow maze `random_task(20162, "maze")`, 0 of 16, 4 of 12, 4 of 8 and 4 of 4 searches "tube" succeed with 6,000,
12,000, 24,000 and 48,000 samples, after 0.2 to 0.8 s; of "corridor" 0 of 16, 0 of 12, 1 of 8 and 2 of 4.
"""

PAPER_CHAIN = "cableway.tang2025.planning.chain:PaperChain"
"""Where that chain is; imported only when it is asked for."""

STRAIGHT_STEPS = 50
"""Shapes of the straight interpolation; as many as the paper's table gives the deformation."""


def routed(names: Sequence[InitialName]) -> tuple[InitialName, ...]:
    """Of some names those in `ROUTED`, in its order."""
    return tuple(name for name in ROUTED if name in names)


@dataclass(frozen=True)
class InitialTrajectory:
    """Shapes from start to goal that a projection starts from.

    Attributes:
        shapes: (R+1, n, 2) keypoints [m].
        stages: What the paper's chain made on the way, if it made them; progress (R+1, n) belongs to `shapes`.
    """

    shapes: Float[np.ndarray, "r n 2"]
    stages: PaperStages | None = None

    def stages_at(self, places: Float[np.ndarray, "t"]) -> PaperStages | None:
        """The stages with the progress at fractional rows of `shapes`."""
        return None if self.stages is None else replace(self.stages, progress=rows_at(self.stages.progress, places))


class InitialTrajectories:
    """Makes the initial trajectories of one task.

    Args:
        task: The task.
        config: Of all stages.
        seed: For those that draw random numbers.
        progress: Called with the name of a stage and the share of it that is done.
        route: (P, 2) the pivot path [m], in place of the best one.
        previous: An earlier plan, for the trajectory of that name.
    """

    def __init__(
        self,
        task: Task,
        config: PlannerConfig,
        seed: int = 0,
        progress: Progress = lambda stage, share: None,
        *,
        route: Float[np.ndarray, "P 2"] | None = None,
        previous: Plan | None = None,
    ) -> None:
        self.task, self.config, self.seed, self.progress = task, config, seed, progress
        self.route, self._previous = route, previous
        self._slides: dict[End, Float[np.ndarray, "r n 2"]] = {}

    def make(self, name: InitialName, restart: int = 0) -> InitialTrajectory:
        """The initial trajectory of that name; for "restarts", the one of that place in `RESTARTS`.

        Raises:
            PlanningError: There is none for this task.
            MissingExtraError: It is one of the paper's, and the extra `tang2025` is not installed.
        """
        if name in PIVOTED:
            _ = self.pivot  # first, as a stage of its own
        if name in DEFORMED:
            return InitialTrajectory(*self._paper_chain.deformation(name))
        self.progress("initial trajectory", 0.0)
        match name:
            case "slide-head" | "slide-tail":
                shapes = self._slide("head" if name == "slide-head" else "tail")
            case "straight":
                shapes = straight(self.task)
            case "previous":
                shapes = self._rest()
            case _:
                shapes = self._search(name, restart)
        self.progress("initial trajectory", 1.0)
        return InitialTrajectory(shapes)

    @cached_property
    def pivot(self) -> Float[np.ndarray, "P 2"]:
        """(P, 2) path of the cable's middle [m]."""
        if self.route is not None:
            return self.route
        self.progress("pivot path", 0.0)
        task, middle = self.task, pivot_keypoint(self.task.cable.keypoints)
        ends = task.start[middle], task.goal[middle]
        path = plan_pivot_path(task.scene, *ends, task.cable.radius, self.config.pivot, seed=self.seed)
        self.progress("pivot path", 1.0)
        return path

    @cached_property
    def _paper_chain(self) -> Any:
        return resolve_name(PAPER_CHAIN)(self.task, self.config, self.pivot, self.progress)

    def _rest(self) -> Float[np.ndarray, "r n 2"]:
        """What is left of the previous plan, from the row nearest to the start on."""
        if self._previous is None:
            raise PlanningError("there is no previous plan")
        old = self._previous.shapes
        first = int(np.argmin(np.linalg.norm(old - self.task.start, axis=2).sum(1)))
        return np.concatenate([self.task.start[None], old[first + 1 : -1], self.task.goal[None]])

    def _slide(self, leading: End) -> Float[np.ndarray, "r n 2"]:
        if leading not in self._slides:
            self._slides[leading] = slide(self.task, leading, self.config.pivot, seed=self.seed, route=self.route)
        return self._slides[leading]

    def _search(self, name: InitialName, restart: int) -> Float[np.ndarray, "r n 2"]:
        config, seed, rod = self.config.rrt_connect, self.seed, self.task.cable.rod
        if name == "restarts":
            name, samples = RESTARTS[restart]
            config, seed = replace(config, samples=samples), (seed, restart)
        report = partial(self.progress, "initial trajectory")
        q = rrt_connect.rrt_connect_path(self.task, self._sampler(name), config, seed=seed, progress=report)
        return np.ascontiguousarray(rod.at_keypoints(rod.shapes(q)[0]))

    def _sampler(self, name: InitialName) -> rrt_connect.Sampler:
        task = self.task
        match name:
            case "corridor":
                return rrt_connect.about_path(task, self.pivot)
            case "tube":
                ends = task.start_equilibrium, task.goal_equilibrium
                q = fit_sequence(task.cable.rod, self._slide("head"), *ends, rrt_connect.TUBE_STEP)[0]
                return rrt_connect.about_shapes(q)
            case _:
                return rrt_connect.anywhere(task)


def straight(task: Task) -> Float[np.ndarray, "r n 2"]:
    """Each keypoint goes straight from start to goal: no shapes of a cable in between, nothing avoided."""
    shares = np.linspace(0.0, 1.0, STRAIGHT_STEPS + 1)[:, None, None]
    return (1 - shares) * task.start + shares * task.goal
