"""Perturbations of the suites "table" and "limp": another kind of cable in another simulator each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from cableway.scene.cable import Cable
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.sensing import SensingConfig
from cableway.simulation.perturbations.variant import Draw, Variant, askew
from cableway.simulation.table_plant import TableConfig

SHORTEST = 0.95
"""Largest distance of the grippers at start or goal, over the length of a cable that is drawn shorter."""


def on_a_table(**differs: Callable[[Cable, np.random.Generator], dict[str, Any]]) -> Draw:
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
            grasp=askew(rng, shift, turn),
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


def _held_by_friction(number: float) -> Draw:
    """A uniform cable whose bending stiffness gives it a `Cable.friction_number` on its table."""
    uniform = on_a_table()

    def draw(task: Task, rng: np.random.Generator) -> Perturbation:
        drawn = uniform(task, rng)
        assert drawn.cable is not None
        stiffness = drawn.cable.bending_stiffness * drawn.friction_number(task) / number
        return replace(drawn, cable=replace(drawn.cable, bending_stiffness=stiffness))

    return draw


TABLE_KINDS = {
    "table-uniform": Variant("the table plant, a uniform cable", on_a_table(), noisy=True),
    "table-coiled": Variant("the table plant, a coiled cable", on_a_table(cable=_coiled), noisy=True),
    "table-limp": Variant("the table plant, a limp cable", on_a_table(cable=_limp), noisy=True),
    "table-rough": Variant("the table plant, much friction", on_a_table(table=_rough), noisy=True),
    "table-stiff-third": Variant("the table plant, slow, a third of the cable stiff", on_a_table(cable=_stiff_third),
                                 noisy=True),
    "table-all": Variant("the table plant, all of these", on_a_table(cable=_everything, table=_rough), noisy=True),
}  # fmt: skip
"""By name."""

LIMP_KINDS = {
    f"limp-{number}": Variant(f"the table plant, a uniform cable of mu rho g L^3 / EI = {number}",
                              _held_by_friction(number), noisy=True)
    for number in (3, 10, 30, 100, 300)
}  # fmt: skip
"""By name: from friction that hardly matters to friction that, not the grippers, decides the shape."""
