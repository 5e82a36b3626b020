"""The guides: sequences of shapes from start to goal, not yet true, that the realisation starts from.

Each guide is a short method of `Guides`; what several need (the pivot path, the path set) is made once, when it is
first asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from jaxtyping import Float

from cableway.core.errors import PlanningError
from cableway.planning import rrt_connect
from cableway.planning.config import Guide, PlannerConfig
from cableway.planning.projection import fit_sequence
from cableway.planning.routes.passages import find_passages
from cableway.planning.routes.pivot import pivot_keypoint, plan_pivot_path
from cableway.planning.slide import End, slide
from cableway.records import DeformationSequence, PathSet, Plan
from cableway.scene.task import Task
from cableway.tang2025.planning.deformation import optimize_deformation
from cableway.tang2025.planning.path_set import generate_path_set

Progress = Callable[[str, float], None]

STRAIGHT_STEPS = 50
"""Shapes of the straight interpolation; as many as the paper's table gives the deformation."""


class Guides:
    """Makes the guides of one task.

    Args:
        task: The task.
        config: Of all stages.
        seed: For those that draw random numbers.
        progress: Called with the name of a stage and the share of it that is done.
        route: Finds the pivot path, in place of the best one.
        previous: An earlier plan, for the guide of that name.
    """

    def __init__(
        self,
        task: Task,
        config: PlannerConfig,
        seed: int,
        progress: Progress,
        *,
        route: Callable[[], Float[np.ndarray, "P 2"]] | None = None,
        previous: Plan | None = None,
    ) -> None:
        self.task, self.config, self.seed, self.progress = task, config, seed, progress
        self._route, self._previous = route, previous
        self._slides: dict[End, DeformationSequence] = {}

    def make(self, name: Guide) -> tuple[DeformationSequence, PathSet]:
        """A guide and the paths that its keypoints take.

        Raises:
            PlanningError: There is no such guide for this task.
        """
        paths = self.path_set if name in ("head", "tail", "uniform") else None
        pivot = paths.pivot if paths else self.pivot
        self.progress("guide", 0.0)
        match name:
            case "head" | "tail" | "uniform":
                assert paths is not None
                sequence = optimize_deformation(paths, self.task.cable, self.config.deformation, name)
            case "slide-head" | "slide-tail":
                sequence = self._slide("head" if name == "slide-head" else "tail")
            case "straight":
                sequence = straight(self.task)
            case "previous":
                sequence = self._rest()
            case _:
                sequence = self._search(name)
        if paths is None:
            paths = PathSet(np.ascontiguousarray(sequence.shapes.swapaxes(0, 1)), pivot, np.empty((0, 2, 2)))
        self.progress("guide", 1.0)
        return sequence, paths

    @cached_property
    def pivot(self) -> np.ndarray:
        """(P, 2) path of the cable's middle [m]."""
        self.progress("pivot path", 0.0)
        task, middle = self.task, pivot_keypoint(self.task.cable.keypoints)
        if self._route is not None:
            path = self._route()
        else:
            ends = task.start[middle], task.goal[middle]
            path = plan_pivot_path(task.scene, *ends, task.cable.radius, self.config.pivot, seed=self.seed)
        self.progress("pivot path", 1.0)
        return path

    @cached_property
    def path_set(self) -> PathSet:
        """One path per keypoint along the pivot path."""
        pivot = self.pivot
        self.progress("path set", 0.0)
        paths = generate_path_set(self.task, pivot, find_passages(self.task.scene), self.config.path_set)
        self.progress("path set", 1.0)
        return paths

    def _rest(self) -> DeformationSequence:
        """What is left of the previous plan, from the row nearest to the start on."""
        if self._previous is None:
            raise PlanningError("there is no previous plan")
        old = self._previous.shapes
        first = int(np.argmin(np.linalg.norm(old - self.task.start, axis=2).sum(1)))
        shapes = np.concatenate([self.task.start[None], old[first + 1 : -1], self.task.goal[None]])
        return DeformationSequence.in_step(shapes)

    def _slide(self, leading: End) -> DeformationSequence:
        if leading not in self._slides:
            self._slides[leading] = slide(self.task, leading, self.config.pivot, seed=self.seed)
        return self._slides[leading]

    def _search(self, name: Guide) -> DeformationSequence:
        task, config = self.task, self.config.explore
        if name == "corridor":
            sampler = rrt_connect.about_path(task, self.pivot, config)
        elif name == "tube":
            ends = task.start_fit[0], task.goal_fit[0]
            shapes = self._slide("head").shapes
            sampler = rrt_connect.about_shapes(
                fit_sequence(task.cable.rod, shapes, *ends, rrt_connect.TUBE_STEP)[0], config
            )
        else:
            sampler = rrt_connect.anywhere(task, config)

        def tell(share: float) -> None:
            self.progress("guide", share)

        return rrt_connect.explored_guide(task, sampler, config, seed=self.seed, progress=tell)


def straight(task: Task) -> DeformationSequence:
    """Each keypoint goes straight from start to goal: no shapes of a cable in between, nothing avoided."""
    shares = np.linspace(0.0, 1.0, STRAIGHT_STEPS + 1)[:, None, None]
    return DeformationSequence.in_step((1 - shares) * task.start + shares * task.goal)
