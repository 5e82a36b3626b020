"""Perturbations of the suite "faults": what goes wrong with robots, links, cameras and controllers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from cableway.core.errors import InputError
from cableway.scene.task import Task
from cableway.simulation.perturbations.faults import FaultConfig
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.table_variants import on_a_table
from cableway.simulation.perturbations.variant import LAB, Draw, Variant, obstacles_moved

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
        under = on_a_table()(task, rng) if table else Perturbation(sensing=LAB)
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


_KINDS = {
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
        obstacles=lambda task, rng: obstacles_moved(task, rng).obstacles, revealed=_soon)),
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
FAULT_KINDS = {name: replace(kind, noisy=True) for name, kind in _KINDS.items()}
"""By name."""
