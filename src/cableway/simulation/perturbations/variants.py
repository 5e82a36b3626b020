"""Perturbations by name, as the benchmark draws them.

The same task and name always give the same perturbation, up to those that are drawn for each seed.
"""

from __future__ import annotations

import zlib
from dataclasses import replace
from typing import Any

import numpy as np

from cableway.core.deprecation import renamed_value
from cableway.core.errors import UnknownNameError
from cableway.scene.files.presets import preset_names, preset_values
from cableway.scene.task import Task
from cableway.simulation.perturbations.fault_variants import FAULT_KINDS
from cableway.simulation.perturbations.grasp import GraspConfig
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.sensing import SensingConfig
from cableway.simulation.perturbations.table_variants import LIMP_KINDS, TABLE_KINDS
from cableway.simulation.perturbations.variant import DISPLACEMENT, LAB, Draw, Variant, askew, obstacles_moved, offsets

DRAWN_PER_SEED = ("laid", "drawn")
"""Perturbations that depend on the seed of an episode, not on its task alone."""

FRICTION = 0.3
"""Coefficient between table and cable."""

RENAMED = {"seen-late": "frames-late"}
"""New name of each old one, which files may still have."""


def variant(name: str) -> Variant:
    """The variant of that name, which may be an old one.

    Raises:
        UnknownNameError: There is no such name; the message lists them.
    """
    name = renamed_value("plant", name, RENAMED)
    if name not in VARIANTS:
        raise UnknownNameError("plant", name, VARIANTS)
    return VARIANTS[name]


def named_perturbation(name: str, task: Task, seed: int = 0) -> Perturbation:
    """The perturbation of that name for a task.

    What is random of it follows from the names of both and, for `DRAWN_PER_SEED`, from the seed.

    Raises:
        UnknownNameError: There is no such name; the message lists them.
    """
    found = variant(name)
    key = f"{name} {task.name}" + (f" {seed}" if name in DRAWN_PER_SEED else "")
    return found.draw(task, np.random.default_rng(zlib.crc32(key.encode())))


def _graded(rng: np.random.Generator) -> tuple[float, float]:
    return (0.5, 2.0) if rng.random() < 0.5 else (2.0, 0.5)


def _half_curved(rng: np.random.Generator, length: float) -> tuple[float, ...]:
    """One half at rest an arc of one radian."""
    curvature = float(rng.choice([-1, 1])) * 2.0 / length
    values = (0.0, 0.0, 0.0, curvature, curvature)
    return values if rng.random() < 0.5 else values[::-1]


def _hard(scale: float, shift: float, turn: float, damping_time: float, noise: float, delay: float) -> Draw:
    """Another length, grasped askew, graded stiffness, slow, noise and latency."""

    def draw(task: Task, rng: np.random.Generator) -> Perturbation:
        length = scale * task.cable.length
        cable = replace(task.cable, length=length, stiffness_profile=_graded(rng), damping_time=damping_time)
        sensing = SensingConfig(keypoint_noise=noise, measurement_delay=delay)
        return Perturbation(cable=cable, grasp=askew(rng, shift, turn), sensing=sensing)

    return draw


def _stiff_middle(task: Task, rng: np.random.Generator) -> Perturbation:
    cable = replace(
        task.cable,
        length=1.01 * task.cable.length,
        stiffness_profile=(1.0, 1.0, 3.0, 1.0, 1.0),
        rest_curvature=_half_curved(rng, task.cable.length),
    )
    return Perturbation(cable=cable, sensing=SensingConfig(keypoint_noise=0.001, measurement_delay=0.1))


def _slipping(task: Task, rng: np.random.Generator) -> Perturbation:
    left, right = offsets(rng, 0.005, 3.0)
    slipping = GraspConfig(slip_time=4.0)
    end = replace(slipping, left_after=left) if rng.random() < 0.5 else replace(slipping, right_after=right)
    return Perturbation(grasp=end)


def _cable(**values: Any) -> Draw:
    """A cable with other values; a `scale` multiplies the length."""
    scale = values.pop("scale", 1.0)
    return lambda task, _: Perturbation(cable=replace(task.cable, length=scale * task.cable.length, **values))


def _on_friction(draw: Draw) -> Draw:
    """With friction on the table besides."""

    def rough(task: Task, rng: np.random.Generator) -> Perturbation:
        drawn = draw(task, rng)
        return replace(drawn, cable=replace(drawn.cable or task.cable, friction=FRICTION))

    return rough


def _sensed(**values: Any) -> Draw:
    return lambda task, _: Perturbation(sensing=SensingConfig(**values))


def _lab(**values: Any) -> Draw:
    return lambda task, _: Perturbation(sensing=replace(LAB, **values))


def _preset(name: str) -> Draw:
    """As long as the task's cable and otherwise that of a preset, sensed as in a laboratory."""
    values = {key: value for key, value in preset_values(name).items() if key not in ("length", "radius")}
    return lambda task, _: Perturbation(cable=replace(task.cable, **values, preset=name), sensing=LAB)


_PLANTS = {
    "tau-0.05": Variant("damping time 0.05 s", _cable(damping_time=0.05)),
    "tau-0.2": Variant("damping time 0.2 s", _cable(damping_time=0.2)),
    "tau-1.5": Variant("damping time 1.5 s", _cable(damping_time=1.5)),
    "friction": Variant(f"friction {FRICTION} on the table", _cable(friction=FRICTION)),
    "start-off": Variant("the grippers start 10 mm and 5 degrees from the planned start",
                         lambda task, rng: Perturbation(start=offsets(rng, DISPLACEMENT, 5.0))),
    "short-1": Variant("1% short", _cable(scale=0.99)),
    "long-1": Variant("1% long", _cable(scale=1.01)),
    "short-3": Variant("3% short", _cable(scale=0.97)),
    "long-3": Variant("3% long", _cable(scale=1.03)),
    "grasp": Variant("both ends held 2 mm and 2 degrees askew",
                     lambda task, rng: Perturbation(grasp=askew(rng, 0.002, 2.0))),
    "graded": Variant("stiffness from half to twice along the length", lambda task, rng: Perturbation(
        cable=replace(task.cable, stiffness_profile=_graded(rng)))),
    "half-curved": Variant("one half at rest an arc of one radian", lambda task, rng: Perturbation(
        cable=replace(task.cable, rest_curvature=_half_curved(rng, task.cable.length)))),
    "hard": Variant(
        "1% short, held 2 mm and 2 degrees askew, graded, damping time 0.5 s, 1 mm of noise, latency 0.1 s",
        _hard(0.99, 0.002, 2.0, 0.5, 0.001, 0.1), noisy=True),
    "very-hard": Variant(
        "3% short, held 4 mm and 4 degrees askew, graded, damping time 1.5 s, 2 mm of noise, latency 0.2 s",
        _hard(0.97, 0.004, 4.0, 1.5, 0.002, 0.2), noisy=True),
    "stiff-middle": Variant(
        "1% long, three times as stiff in the middle, half curved, 1 mm of noise, latency 0.1 s",
        _stiff_middle, noisy=True),
    "slip": Variant("after 4 s one end slips by 5 mm and 3 degrees", _slipping),
    "obstacles-moved": Variant("every obstacle 10 mm from where it was planned", obstacles_moved),
}  # fmt: skip


_ROUGH = {
    f"rough-{name}": Variant(f"friction {FRICTION}; {each.description}", _on_friction(each.draw), each.noisy)
    for name, each in _PLANTS.items()
    if name != "friction"
}


_SENSING = {
    "noise-1": Variant("1 mm of noise on keypoints", _sensed(keypoint_noise=0.001), noisy=True),
    "noise-2": Variant("2 mm of noise on keypoints", _sensed(keypoint_noise=0.002), noisy=True),
    "frames-late": Variant("keypoints arrive 0.1 s late", _sensed(measurement_delay=0.1)),
    "moved-late": Variant("actions begin 0.1 s late", _sensed(action_delay=0.1)),
    "dropped": Variant("one frame in five lost", _sensed(drop_rate=0.2), noisy=True),
    "occluded": Variant("part of the cable hidden in every second frame", _sensed(occlusion_rate=0.5), noisy=True),
    "lab": Variant("2 mm of noise, latency 0.1 s, one frame in ten lost", _lab(), noisy=True),
    "all-faults": Variant(
        "2 mm of noise, keypoints and actions 0.1 s late, one frame in five lost, part hidden in every second",
        _lab(drop_rate=0.2, occlusion_rate=0.5, action_delay=0.1), noisy=True),
}  # fmt: skip

VARIANTS: dict[str, Variant] = {
    "nominal": Variant("the task's cable", lambda task, _: Perturbation()),
    **_PLANTS,
    **_ROUGH,
    **_SENSING,
    **TABLE_KINDS,
    **LIMP_KINDS,
    **FAULT_KINDS,
    "laid": Variant("the start off by 5 mm and 3 degrees, sensed as 'lab'",
                    lambda task, rng: Perturbation(sensing=LAB, start=offsets(rng, 0.005, 3.0)), noisy=True),
    "drawn": Variant("a cable drawn from the ranges of the task's preset, sensed as 'lab'",
                     lambda task, rng: Perturbation(cable=task.cable.sample(int(rng.integers(2**31))), sensing=LAB),
                     noisy=True),
    **{name: Variant(f"a cable of the preset {name}, as long as the task's, sensed as 'lab'", _preset(name), noisy=True)
       for name in preset_names()},
}  # fmt: skip
"""Perturbations by name."""

PLANTS_SUITE = tuple(_PLANTS)
"""Perturbations of the suite "plants"."""

ROUGH_SUITE = ("friction", *_ROUGH)
"""The same with friction: perturbations of the suite "plants-rough"."""

SENSING_SUITE = tuple(_SENSING)
"""Perturbations of the suite "sensing"."""

TABLE_SUITE = tuple(TABLE_KINDS)
"""Perturbations of the suite "table"."""

CELL_SUITE = ("table-uniform", "table-coiled", "table-limp")
"""Perturbations of the suite "cell"."""

LIMP_SUITE = tuple(LIMP_KINDS)
"""Perturbations of the suite "limp"."""

FAULTS_SUITE = tuple(FAULT_KINDS)
"""Perturbations of the suite "faults"."""
