"""The paper's chain for one task: from a pivot path to a path set, and from that to a deformation.

This is what `cableway.planning.initial_trajectories` asks for "head", "tail" and "uniform".
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from cableway.planning.config import PlannerConfig
from cableway.planning.routes.passages import find_passages
from cableway.records import PaperStages
from cableway.scene.task import Task
from cableway.tang2025.planning.config import PaperPlannerConfig
from cableway.tang2025.planning.deformation import GUESSES, Guess, optimize_deformation
from cableway.tang2025.planning.path_set import PathSet, generate_path_set


class PaperChain:
    """Path set and deformation of a task along a pivot path; the path set is made once.

    Args:
        task: The task.
        config: With the settings of both stages, or without, for our values.
        pivot: (P, 2) pivot path [m].
        progress: Called with the name of a stage and the share of it that is done.
    """

    def __init__(
        self,
        task: Task,
        config: PlannerConfig,
        pivot: Float[np.ndarray, "P 2"],
        progress: Callable[[str, float], None] = lambda stage, share: None,
    ) -> None:
        self.task, self.pivot, self.progress = task, pivot, progress
        self.config = config if isinstance(config, PaperPlannerConfig) else PaperPlannerConfig()

    @cached_property
    def path_set(self) -> PathSet:
        """One path per keypoint along the pivot path."""
        self.progress("path set", 0.0)
        paths = generate_path_set(self.task, self.pivot, find_passages(self.task.scene), self.config.path_set)
        self.progress("path set", 1.0)
        return paths

    def deformation(self, guess: Guess | Literal["least-energy"]) -> tuple[Float[np.ndarray, "t n 2"], PaperStages]:
        """The shapes [m] optimised from a first guess, and all that was made on the way, with how Ipopt ended.

        From "least-energy" it is the one of least energy of those from all three first guesses.

        Raises:
            PlanningError: Ipopt failed.
        """
        paths = self.path_set
        self.progress("initial trajectory", 0.0)
        tried = [
            optimize_deformation(paths, self.task.cable, self.config.deformation, each)
            for each in (GUESSES if guess == "least-energy" else (guess,))
        ]
        made = min(tried, key=lambda made: (not made.converged, made.energy))
        self.progress("initial trajectory", 1.0)
        kept = ("guess", "energy", "status", "iterations", "converged")
        made_by = {"ipopt": {name: getattr(made, name) for name in kept}}
        return made.shapes, PaperStages(paths.pivot, paths.passages, paths.paths, made.progress, metadata=made_by)
