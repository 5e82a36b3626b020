"""Perturbations by name, as the benchmark draws them.

The same task and name always give the same perturbation, up to those that are drawn for each seed.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cableway.core.deprecation import renamed_value
from cableway.core.errors import InputError, UnknownNameError
from cableway.scene.cable import Cable
from cableway.scene.files.presets import preset_names, preset_values
from cableway.scene.task import Task
from cableway.simulation.perturbations.faults import FaultConfig
from cableway.simulation.perturbations.grasp import GraspConfig, Offset
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.sensing import SensingConfig
from cableway.simulation.table_plant import TableConfig

DISPLACEMENT = 0.010
"""Distance [m] by which "obstacles-moved" displaces each obstacle, and "start-off" each gripper."""

LAB = SensingConfig(keypoint_noise=0.002, drop_rate=0.1, measurement_delay=0.1)
"""Sensing as in a laboratory: 2 mm of noise, 0.1 s of latency, one frame in ten lost."""

SHORTEST = 0.95
"""Largest distance of the grippers at start or goal, over the length of a cable that is drawn shorter."""

DRAWN_PER_SEED = ("laid", "drawn")
"""Perturbations that depend on the seed of an episode, not on its task alone."""

Draw = Callable[[Task, np.random.Generator], Perturbation]


RENAMED = {"seen-late": "frames-late"}
"""New name of each old one, which files may still have."""


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


# ------------------------------------------------------------------------------------------------ draws
def _offsets(rng: np.random.Generator, shift: float, turn: float) -> tuple[Offset, Offset]:
    """Offsets of both grippers by `shift` [m] in random directions and `turn` [degrees] either way."""
    angles, signs = rng.uniform(0, 2 * math.pi, 2), rng.choice([-1, 1], 2)
    left, right = (
        (shift * math.cos(a), shift * math.sin(a), float(s * math.radians(turn)))
        for a, s in zip(angles, signs, strict=True)
    )
    return left, right


def _askew(rng: np.random.Generator, shift: float, turn: float) -> GraspConfig:
    left, right = _offsets(rng, shift, turn)
    return GraspConfig(left=left, right=right)


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
        return Perturbation(cable=cable, grasp=_askew(rng, shift, turn), sensing=sensing)

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
    left, right = _offsets(rng, 0.005, 3.0)
    end = {"left_after": left} if rng.random() < 0.5 else {"right_after": right}
    return Perturbation(grasp=GraspConfig(slip_time=4.0, **end))


def _obstacles_moved(task: Task, rng: np.random.Generator) -> Perturbation:
    angles = [rng.uniform(0, 2 * math.pi) for _ in task.scene.obstacles]
    return Perturbation(obstacles=tuple((DISPLACEMENT * math.cos(a), DISPLACEMENT * math.sin(a)) for a in angles))


def _cable(**values: Any) -> Draw:
    """A cable with other values; a `scale` multiplies the length."""
    scale = values.pop("scale", 1.0)
    return lambda task, _: Perturbation(cable=replace(task.cable, length=scale * task.cable.length, **values))


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
    "friction": Variant("friction 0.3 on the table", _cable(friction=0.3)),
    "start-off": Variant("the grippers start 10 mm and 5 degrees from the planned start",
                         lambda task, rng: Perturbation(start=_offsets(rng, DISPLACEMENT, 5.0))),
    "short-1": Variant("1% short", _cable(scale=0.99)),
    "long-1": Variant("1% long", _cable(scale=1.01)),
    "short-3": Variant("3% short", _cable(scale=0.97)),
    "long-3": Variant("3% long", _cable(scale=1.03)),
    "grasp": Variant("both ends held 2 mm and 2 degrees askew",
                     lambda task, rng: Perturbation(grasp=_askew(rng, 0.002, 2.0))),
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
    "obstacles-moved": Variant("every obstacle 10 mm from where it was planned", _obstacles_moved),
}  # fmt: skip


def _on_a_table(**differs: Callable[[Cable, np.random.Generator], dict[str, Any]]) -> Draw:
    """The table plant: 2 to 5% longer or shorter, held 3 to 5 mm and 5 to 10 degrees askew, measured 0.1 s late with 1
    to 2 mm of noise.

    Args:
        differs: Draw the keys of `cable` and of `table` that differ besides.
    """

    def draw(task: Task, rng: np.random.Generator) -> Perturbation:
        nominal, sign = task.cable, float(rng.choice([-1, 1]))
        length = nominal.length * (1 + sign * rng.uniform(0.02, 0.05))
        spans = [np.linalg.norm(shape[-1] - shape[0]) for shape in (task.start, task.goal)]
        if length < max(spans) / SHORTEST:
            length = 2 * nominal.length - length
        values = {"friction": 0.0, "length": float(length), "damping_time": 0.1}
        table: dict[str, Any] = {"friction": float(rng.uniform(0.2, 0.5))}
        if "cable" in differs:
            values |= differs["cable"](nominal, rng)
        if "table" in differs:
            table |= differs["table"](nominal, rng)
        shift, turn = float(rng.uniform(0.003, 0.005)), float(rng.uniform(5.0, 10.0))
        sensing = SensingConfig(keypoint_noise=float(rng.uniform(0.001, 0.002)), measurement_delay=0.1)
        return Perturbation(
            cable=replace(nominal, **values),
            grasp=_askew(rng, shift, turn),
            sensing=sensing,
            table=TableConfig(**table),
        )

    return draw


def _coiled(cable: Cable, rng: np.random.Generator) -> dict[str, Any]:
    """Rest curvature of 3 to 8 1/m on 0.3 m that changes sign two to four times along the cable."""
    count = int(rng.integers(3, 6))
    signs = float(rng.choice([-1, 1])) * (-1.0) ** np.arange(count)
    return {"rest_curvature": tuple((signs * rng.uniform(3.0, 8.0, count) * 0.3 / cable.length).tolist())}


def _limp(cable: Cable, rng: np.random.Generator) -> dict[str, Any]:
    return {"bending_stiffness": cable.bending_stiffness * float(rng.uniform(0.1, 0.3))}


def _stiff_third(cable: Cable, rng: np.random.Generator) -> dict[str, Any]:
    """A slow cable of which one third is five times as stiff."""
    profile, third = np.ones(9), 3 * int(rng.integers(3))
    profile[third : third + 3] = 5.0
    return {"stiffness_profile": tuple(profile.tolist()), "damping_time": float(rng.uniform(0.3, 1.0))}


def _rough(cable: Cable, rng: np.random.Generator) -> dict[str, Any]:
    """Much friction, half or twice as much across the cable as along it."""
    return {"friction": float(rng.uniform(0.4, 0.8)), "across": float(rng.choice([0.5, 2.0]))}


def _everything(cable: Cable, rng: np.random.Generator) -> dict[str, Any]:
    return {**_coiled(cable, rng), **_stiff_third(cable, rng), **_limp(cable, rng)}


_TABLE = {
    "table-uniform": Variant("the table plant, a uniform cable", _on_a_table(), noisy=True),
    "table-coiled": Variant("the table plant, a coiled cable", _on_a_table(cable=_coiled), noisy=True),
    "table-limp": Variant("the table plant, a limp cable", _on_a_table(cable=_limp), noisy=True),
    "table-rough": Variant("the table plant, much friction", _on_a_table(table=_rough), noisy=True),
    "table-stiff-third": Variant("the table plant, slow, a third of the cable stiff", _on_a_table(cable=_stiff_third),
                                 noisy=True),
    "table-all": Variant("the table plant, all of these", _on_a_table(cable=_everything, table=_rough), noisy=True),
}  # fmt: skip

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

PEG = 0.006
"""Radius [m] of a peg that nobody knows of."""

PEG_ROOM = 0.025
"""Least distance [m] of a peg from start, goal and obstacles."""


def _faulty(
    faults: Callable[[np.random.Generator], dict[str, Any]] | None = None,
    sensing: dict[str, Any] | None = None,
    table: bool = False,
    **differs: Callable[[Task, np.random.Generator], Any],
) -> Draw:
    """Faults on a plant that is sensed as in a laboratory, or on the table plant.

    Args:
        faults: Draws what goes wrong.
        sensing: What is sensed otherwise.
        table: Whether the plant is the table's.
        differs: Draw other fields of the perturbation.
    """

    def draw(task: Task, rng: np.random.Generator) -> Perturbation:
        under = _on_a_table()(task, rng) if table else Perturbation(sensing=LAB)
        return replace(
            under,
            sensing=replace(under.sensing, **(sensing or {})),
            faults=FaultConfig(**(faults(rng) if faults else {})),
            **{name: drawn(task, rng) for name, drawn in differs.items()},
        )

    return draw


def _robot(rng: np.random.Generator) -> dict[str, Any]:
    """One gripper in another turn, a stall, repeated messages and a clock that jumps back."""
    begin = float(rng.uniform(2.0, 5.0))
    return {
        "turns": (0, int(rng.choice([-1, 1]))),
        "wrapped": True,
        "stalled": str(rng.choice(["left", "right", "both"])),
        "stall": (begin, begin + float(rng.uniform(0.5, 2.0))),
        "repeated": 0.2,
        "clock_jump": (float(rng.uniform(2.0, 5.0)), -5.0),
    }


def _camera(rng: np.random.Generator) -> dict[str, Any]:
    """Ends hidden, keypoints exchanged and astray, and a picture that freezes."""
    begin = float(rng.uniform(2.0, 5.0))
    return {"hidden_ends": 2, "swapped": 0.2, "strays": 0.2, "frozen_camera": (begin, begin + 1.0)}


def _window(name: str, least: float, most: float) -> Callable[[np.random.Generator], dict[str, Any]]:
    """A fault that begins after 2 to 5 s and lasts for `least` to `most` [s]."""

    def draw(rng: np.random.Generator) -> dict[str, Any]:
        begin = float(rng.uniform(2.0, 5.0))
        return {name: (begin, begin + float(rng.uniform(least, most)))}

    return draw


def _chosen(*names: str) -> Callable[[np.random.Generator], dict[str, Any]]:
    """Some of what `_robot` draws."""
    return lambda rng: {name: value for name, value in _robot(rng).items() if name in names}


def _biased(rng: np.random.Generator) -> dict[str, Any]:
    """5 mm and 1 degree."""
    angle, sign = float(rng.uniform(0, 2 * math.pi)), float(rng.choice([-1, 1]))
    return {"bias": (0.005 * math.cos(angle), 0.005 * math.sin(angle), sign * math.radians(1.0))}


def _peg(task: Task, rng: np.random.Generator) -> tuple[tuple[float, float, float], ...]:
    """A peg half-way between start and goal of some part of the cable.

    Raises:
        InputError: There is no room for one.
    """
    ends = task.cable.rod.shapes(np.array([task.start_equilibrium, task.goal_equilibrium]))[0]
    for _ in range(1000):
        share, station = rng.uniform(0.3, 0.7), int(rng.integers(ends.shape[1] // 5, 4 * ends.shape[1] // 5))
        place = (1 - share) * ends[0, station] + share * ends[1, station]
        room = min(np.linalg.norm(ends - place, axis=-1).min(), float(task.scene.signed_distance(place[None]).min()))
        if room > PEG + PEG_ROOM:
            return ((float(place[0]), float(place[1]), PEG),)
    raise InputError(f"{task.name} has no room for a peg")


def _soon(_: Task, rng: np.random.Generator) -> float:
    """When something becomes known [s]."""
    return float(rng.uniform(0.5, 4.0))


_FAULTS = {
    "fault-turned": Variant("one gripper's angle reported in another turn", _faulty(_chosen("turns", "wrapped"))),
    "fault-stalled": Variant("a gripper stalls for 0.5 to 2 s", _faulty(_chosen("stall", "stalled"))),
    "fault-link-frozen": Variant("all messages frozen for 1 to 3 s", _faulty(_window("frozen_link", 1.0, 3.0))),
    "fault-repeated": Variant("a third of the messages repeated", _faulty(lambda _: {"repeated": 0.33})),
    "fault-clock": Variant("the robot's clock jumps back by 5 s", _faulty(_chosen("clock_jump"))),
    "fault-camera-frozen": Variant("a frozen picture for 1 to 3 s", _faulty(_window("frozen_camera", 1.0, 3.0))),
    "fault-jitter": Variant("frames up to 0.3 s later still", _faulty(sensing={"jitter": 0.3})),
    "fault-swapped": Variant("keypoints exchanged or astray in half of the frames",
                             _faulty(lambda _: {"swapped": 0.3, "strays": 0.3})),
    "fault-ends-hidden": Variant("both ends of the cable hidden, latency 0.3 s",
                                 _faulty(lambda _: {"hidden_ends": 2}, {"measurement_delay": 0.3})),
    "fault-few": Variant("up to 70% of the cable hidden in every frame",
                         _faulty(sensing={"occlusion_rate": 1.0, "occluded_share": 0.7})),
    "fault-biased": Variant("a camera that is off by 5 mm and 1 degree", _faulty(_biased)),
    "fault-peg": Variant("a peg on the way that nobody knows of", _faulty(pegs=_peg, revealed=lambda *_: None)),
    "fault-appears": Variant("a peg on the way that is seen after 0.5 to 4 s", _faulty(pegs=_peg, revealed=_soon)),
    "fault-moves": Variant("every obstacle 10 mm away from 0.5 to 4 s on", _faulty(
        obstacles=lambda task, rng: _obstacles_moved(task, rng).obstacles, revealed=_soon)),
    "fault-robot": Variant("turned, stalled, repeated, clock", _faulty(_robot)),
    "fault-camera": Variant("ends hidden, exchanged, astray, frozen for 1 s, jitter of 0.2 s",
                            _faulty(_camera, {"jitter": 0.2})),
    "fault-all": Variant("robot, camera, and a peg that appears", _faulty(
        lambda rng: {**_robot(rng), **_camera(rng)}, {"jitter": 0.2}, pegs=_peg, revealed=_soon)),
    "fault-table": Variant("the table plant; robot and camera", _faulty(
        lambda rng: {**_robot(rng), **_camera(rng)}, table=True)),
    "fault-raises": Variant("the controller raises an error in one step of four", _faulty()),
    "fault-nonsense": Variant("the controller answers nonsense in one step of four", _faulty()),
}  # fmt: skip
_FAULTS = {name: replace(variant, noisy=True) for name, variant in _FAULTS.items()}

VARIANTS: dict[str, Variant] = {
    "nominal": Variant("the task's cable", lambda task, _: Perturbation()),
    **_PLANTS,
    **_SENSING,
    **_TABLE,
    **_FAULTS,
    "laid": Variant("the start off by 5 mm and 3 degrees, sensed as 'lab'",
                    lambda task, rng: Perturbation(sensing=LAB, start=_offsets(rng, 0.005, 3.0)), noisy=True),
    "drawn": Variant("a cable drawn from the ranges of the task's preset, sensed as 'lab'",
                     lambda task, rng: Perturbation(cable=task.cable.sample(int(rng.integers(2**31))), sensing=LAB),
                     noisy=True),
    **{name: Variant(f"a cable of the preset {name}, as long as the task's, sensed as 'lab'", _preset(name), noisy=True)
       for name in preset_names()},
}  # fmt: skip
"""Perturbations by name."""

PLANTS_SUITE = tuple(_PLANTS)
"""Perturbations of the suite "plants"."""

SENSING_SUITE = tuple(_SENSING)
"""Perturbations of the suite "sensing"."""

TABLE_SUITE = tuple(_TABLE)
"""Perturbations of the suite "table"."""

FAULTS_SUITE = tuple(_FAULTS)
"""Perturbations of the suite "faults"."""
