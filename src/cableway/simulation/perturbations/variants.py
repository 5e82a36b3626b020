"""Plants that are not what planner and controller believe: another cable, held askew, seen with noise and late.

The same task and name always give the same plant. A plant says what differs from the task; the task is all that a
method is told.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cableway.core.errors import SimulationError, UnknownNameError
from cableway.rod.inverse import equilibria_at
from cableway.scene.cable import Cable
from cableway.scene.files.presets import preset_names, preset_values
from cableway.scene.obstacles import Obstacle, Polygon
from cableway.scene.task import Task
from cableway.simulation.perturbations.grasp import GraspConfig
from cableway.simulation.perturbations.sensing import SensedPlant, SensingConfig
from cableway.simulation.perturbations.setup import PlantSetup

MOVED = 0.010
"""Distance [m] by which obstacles are moved after planning, and the start is off."""

LAB = SensingConfig(keypoint_noise=0.002, drop_rate=0.1, measurement_delay=0.1)
"""Seen with 2 mm of noise and 0.1 s late, a frame in ten lost."""


@dataclass(frozen=True)
class Variant:
    """How a plant differs from what is believed of it.

    Attributes:
        cable: The true cable.
        grasp: How it is held.
        sensing: How it is seen and led.
        start: The task from whose start the cable begins, where that is not the task's own.
        scene: The task with the obstacles as they are, where they have moved; the controller knows, the plan does not.
    """

    cable: Cable
    grasp: GraspConfig = field(default_factory=GraspConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    start: Task | None = None
    scene: Task | None = None

    def true_task(self, task: Task) -> Task:
        """What the plant really is, for the judge."""
        return self.scene or self.start or task

    def build(self, task: Task, seed: int) -> SensedPlant:
        """The plant.

        Args:
            task: What is believed.
            seed: Of the noise.

        Raises:
            SimulationError: The cable cannot take the start.
        """
        setup = PlantSetup(cable=self.cable, grasp=self.grasp, sensing=self.sensing)
        return setup.build(self.true_task(task), seed, believed=self.scene or task)


Draw = Callable[[Task, np.random.Generator], Variant]


def plant_variant(name: str, task: Task, seed: int = 0) -> Variant:
    """The plant of a name for a task; what is random of it follows from the task's name, and with "laid" and
    "drawn" from the seed too.

    Raises:
        UnknownNameError: No such plant; the message lists them.
        SimulationError: There is no such plant for this task.
    """
    if name not in PLANTS:
        raise UnknownNameError("plant", name, PLANTS)
    key = f"{name} {task.name}" + (f" {seed}" if name in ("laid", "drawn") else "")
    return PLANTS[name].draw(task, np.random.default_rng(zlib.crc32(key.encode())))


# ------------------------------------------------------------------------------------------------ draws
def _askew(rng: np.random.Generator, shift: float, turn: float) -> tuple[tuple[float, float, float], ...]:
    """Grasps of both ends that are off by `shift` [m] in any direction and `turn` [degrees] either way."""
    angles, signs = rng.uniform(0, 2 * math.pi, 2), rng.choice([-1, 1], 2)
    return tuple(
        (shift * math.cos(a), shift * math.sin(a), float(s * math.radians(turn)))
        for a, s in zip(angles, signs, strict=True)
    )


def _graded(rng: np.random.Generator) -> tuple[float, float]:
    return (0.5, 2.0) if rng.random() < 0.5 else (2.0, 0.5)


def _half_curved(rng: np.random.Generator, length: float) -> tuple[float, ...]:
    """One half at rest an arc of one radian."""
    curvature = float(rng.choice([-1, 1])) * 2.0 / length
    values = (0.0, 0.0, 0.0, curvature, curvature)
    return values if rng.random() < 0.5 else values[::-1]


def _differing(
    task: Task, rng: np.random.Generator, scale: float, shift: float, turn: float, tau: float, noise: float, late: float
) -> Variant:
    """Of another length, grasped askew, graded, slow, and seen with noise and late."""
    length = scale * task.cable.length
    cable = replace(task.cable, length=length, stiffness_profile=_graded(rng), damping_time=tau)
    left, right = _askew(rng, shift, turn)
    return Variant(
        cable, GraspConfig(left=left, right=right), SensingConfig(keypoint_noise=noise, measurement_delay=late)
    )


def _hard(task: Task, rng: np.random.Generator) -> Variant:
    return _differing(task, rng, 0.99, 0.002, 2.0, 0.5, 0.001, 0.1)


def _very_hard(task: Task, rng: np.random.Generator) -> Variant:
    return _differing(task, rng, 0.97, 0.004, 4.0, 1.5, 0.002, 0.2)


def _stiff_middle(task: Task, rng: np.random.Generator) -> Variant:
    cable = replace(
        task.cable,
        length=1.01 * task.cable.length,
        stiffness_profile=(1.0, 1.0, 3.0, 1.0, 1.0),
        rest_curvature=_half_curved(rng, task.cable.length),
    )
    return Variant(cable, sensing=SensingConfig(keypoint_noise=0.001, measurement_delay=0.1))


def _grasped(task: Task, rng: np.random.Generator) -> Variant:
    left, right = _askew(rng, 0.002, 2.0)
    return Variant(task.cable, GraspConfig(left=left, right=right))


def _slipping(task: Task, rng: np.random.Generator) -> Variant:
    left, right = _askew(rng, 0.005, 3.0)
    end = {"left_after": left} if rng.random() < 0.5 else {"right_after": right}
    return Variant(task.cable, GraspConfig(slip_time=4.0, **end))


def _off(task: Task, rng: np.random.Generator, shift: float, turn: float) -> Task:
    """The task with a start to which the grippers were moved by `shift` [m] and turned by `turn` [degrees].

    Raises:
        SimulationError: No shape of the cable is stable there.
    """
    poses = task.cable.rod.shapes(task.start_fit[0][None])[1][0]
    angles, signs = rng.uniform(0, 2 * math.pi, 2), rng.choice([-1, 1], 2)
    poses = poses + np.column_stack([shift * np.cos(angles), shift * np.sin(angles), math.radians(turn) * signs])
    found = equilibria_at(task.cable.rod, poses)
    if not len(found):
        raise SimulationError("no stable shape between the moved grippers")
    shapes = task.cable.rod.at_keypoints(task.cable.rod.shapes(found)[0])
    nearest = int(np.argmin(np.linalg.norm(shapes - task.start, axis=(1, 2))))
    return replace(task, start=shapes[nearest], start_poses=None)


def _start_off(task: Task, rng: np.random.Generator) -> Variant:
    return Variant(task.cable, start=_off(task, rng, MOVED, 5.0))


def _obstacles_moved(task: Task, rng: np.random.Generator) -> Variant:
    def moved(obstacle: Obstacle) -> Obstacle:
        angle = rng.uniform(0, 2 * math.pi)
        step = MOVED * np.array([math.cos(angle), math.sin(angle)])
        if isinstance(obstacle, Polygon):
            return replace(obstacle, vertices=np.add(obstacle.vertices, step))
        return replace(obstacle, center=tuple(np.add(obstacle.center, step).tolist()))

    obstacles = tuple(moved(obstacle) for obstacle in task.scene.obstacles)
    return Variant(task.cable, scene=replace(task, scene=replace(task.scene, obstacles=obstacles)))


def _cable(**values: Any) -> Draw:
    """A cable with other values; a `scale` multiplies the length."""
    scale = values.pop("scale", 1.0)
    return lambda task, _: Variant(replace(task.cable, length=scale * task.cable.length, **values))


def _sensed(**values: Any) -> Draw:
    return lambda task, _: Variant(task.cable, sensing=SensingConfig(**values))


def _preset(name: str) -> Draw:
    """As long as the task's cable and otherwise that of a preset, seen as in a laboratory."""
    values = {key: value for key, value in preset_values(name).items() if key not in ("length", "radius")}
    return lambda task, _: Variant(replace(task.cable, **values, preset=name), sensing=LAB)


def _laid(task: Task, rng: np.random.Generator) -> Variant:
    return Variant(task.cable, sensing=LAB, start=_off(task, rng, 0.005, 3.0))


def _drawn(task: Task, rng: np.random.Generator) -> Variant:
    return Variant(task.cable.sample(int(rng.integers(2**31))), sensing=LAB)


@dataclass(frozen=True)
class PlantKind:
    """A kind of plant.

    Attributes:
        description: What differs.
        draw: Makes the plant of a task.
        noisy: Whether it depends on the seed of the noise.
    """

    description: str
    draw: Draw
    noisy: bool = False


_DIFFERING = {
    "tau-0.05": PlantKind("damping time 0.05 s", _cable(damping_time=0.05)),
    "tau-0.2": PlantKind("damping time 0.2 s", _cable(damping_time=0.2)),
    "tau-1.5": PlantKind("damping time 1.5 s", _cable(damping_time=1.5)),
    "friction": PlantKind("friction 0.3 on the table", _cable(friction=0.3)),
    "start-off": PlantKind("the grippers begin 10 mm and 5 degrees beside the planned start", _start_off),
    "short-1": PlantKind("1% short", _cable(scale=0.99)),
    "long-1": PlantKind("1% long", _cable(scale=1.01)),
    "short-3": PlantKind("3% short", _cable(scale=0.97)),
    "long-3": PlantKind("3% long", _cable(scale=1.03)),
    "grasp": PlantKind("both ends held 2 mm and 2 degrees askew", _grasped),
    "graded": PlantKind("stiffness from half to twice along the length", lambda task, rng: Variant(
        replace(task.cable, stiffness_profile=_graded(rng)))),
    "half-curved": PlantKind("one half at rest an arc of one radian", lambda task, rng: Variant(
        replace(task.cable, rest_curvature=_half_curved(rng, task.cable.length)))),
    "hard": PlantKind(
        "1% short, held 2 mm and 2 degrees askew, graded, damping time 0.5 s, 1 mm of noise, seen 0.1 s late",
        _hard, noisy=True),
    "very-hard": PlantKind(
        "3% short, held 4 mm and 4 degrees askew, graded, damping time 1.5 s, 2 mm of noise, seen 0.2 s late",
        _very_hard, noisy=True),
    "stiff-middle": PlantKind(
        "1% long, three times as stiff in the middle, half curved, 1 mm of noise, seen 0.1 s late",
        _stiff_middle, noisy=True),
    "slip": PlantKind("after 4 s one end slips by 5 mm and 3 degrees", _slipping),
    "obstacles-moved": PlantKind("every obstacle 10 mm from where it was planned", _obstacles_moved),
}  # fmt: skip

_SENSED = {
    "noise-1": PlantKind("keypoints with 1 mm of noise", _sensed(keypoint_noise=0.001), noisy=True),
    "noise-2": PlantKind("keypoints with 2 mm of noise", _sensed(keypoint_noise=0.002), noisy=True),
    "seen-late": PlantKind("seen 0.1 s late", _sensed(measurement_delay=0.1)),
    "moved-late": PlantKind("moved 0.1 s late", _sensed(action_delay=0.1)),
    "dropped": PlantKind("a frame in five lost", _sensed(drop_rate=0.2), noisy=True),
    "occluded": PlantKind("a stretch hidden in every second frame", _sensed(occlusion_rate=0.5), noisy=True),
    "lab": PlantKind("2 mm of noise, seen 0.1 s late, a frame in ten lost",
                     lambda task, _: Variant(task.cable, sensing=LAB), noisy=True),
    "all-faults": PlantKind(
        "2 mm of noise, seen and moved 0.1 s late, a frame in five lost, a stretch hidden in every second",
        lambda task, _: Variant(task.cable, sensing=replace(LAB, drop_rate=0.2, occlusion_rate=0.5, action_delay=0.1)),
        noisy=True),
}  # fmt: skip

PLANTS: dict[str, PlantKind] = {
    "nominal": PlantKind("the cable that is believed", _cable()),
    **_DIFFERING,
    **_SENSED,
    "laid": PlantKind("the start off by 5 mm and 3 degrees, seen as 'lab'", _laid, noisy=True),
    "drawn": PlantKind("a cable drawn from the ranges of the task's preset, seen as 'lab'", _drawn, noisy=True),
    **{name: PlantKind(f"a cable of the preset {name}, as long as believed, seen as 'lab'", _preset(name), noisy=True)
       for name in preset_names()},
}  # fmt: skip
"""Plants by name."""

DIFFERING = tuple(_DIFFERING)
"""Plants of the suite "plants"."""

SENSED = tuple(_SENSED)
"""Plants of the suite "sensing"."""
