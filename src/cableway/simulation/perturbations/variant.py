"""A named perturbation, and what several of them draw."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cableway.scene.task import Task
from cableway.simulation.perturbations.grasp import GraspConfig, Offset
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.sensing import SensingConfig

DISPLACEMENT = 0.010
"""Distance [m] by which "obstacles-moved" displaces each obstacle, and "start-off" each gripper."""

LAB = SensingConfig(keypoint_noise=0.002, drop_rate=0.1, measurement_delay=0.1)
"""Sensing as in a laboratory: 2 mm of noise, 0.1 s of latency, one frame in ten lost."""

Draw = Callable[[Task, np.random.Generator], Perturbation]


@dataclass(frozen=True)
class Variant:
    """A named perturbation.

    Attributes:
        description: What differs.
        draw: Makes the perturbation for a task.
        noisy: Whether the plant depends on the seed of its noise.
    """

    description: str
    draw: Draw
    noisy: bool = False


def offsets(rng: np.random.Generator, shift: float, turn: float) -> tuple[Offset, Offset]:
    """Offsets of both grippers by `shift` [m] in random directions and `turn` [degrees] either way."""
    angles, signs = rng.uniform(0, 2 * math.pi, 2), rng.choice([-1, 1], 2)
    left, right = (
        (shift * math.cos(a), shift * math.sin(a), float(s * math.radians(turn)))
        for a, s in zip(angles, signs, strict=True)
    )
    return left, right


def askew(rng: np.random.Generator, shift: float, turn: float) -> GraspConfig:
    """Both ends held by `shift` [m] and `turn` [degrees] askew."""
    left, right = offsets(rng, shift, turn)
    return GraspConfig(left=left, right=right)


def obstacles_moved(task: Task, rng: np.random.Generator) -> Perturbation:
    """Every obstacle displaced by `DISPLACEMENT` in a direction of its own."""
    angles = [rng.uniform(0, 2 * math.pi) for _ in task.scene.obstacles]
    return Perturbation(obstacles=tuple((DISPLACEMENT * math.cos(a), DISPLACEMENT * math.sin(a)) for a in angles))
