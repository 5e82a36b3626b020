"""What weight does to a held cable in space: shapes with it beside weightless ones, between the same grippers.

    .venv/bin/python studies/in_space.py [--shapes 100] [--seed 0]
    .venv/bin/python studies/in_space.py --speed

Weightless shapes of margin 5 and more are drawn at any orientation, and weight is added little by little with the
grippers held. *Ended*: the shape became unstable on the way, where a cable bends over to another one; those have no
distance, and are counted.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from functools import partial

import numpy as np

from cableway.rod.planar import PlanarRod
from cableway.rod.spatial import SpatialRod
from cableway.rod.spatial_inverse import under_weight
from cableway.scene.files.presets import preset_names, preset_values

SPREAD = (*[0.3] * 3, *[1.2] * 3, *[8.0] * 3, *[2.0] * 3)
"""Standard deviations of the coordinates [m, rad, -, -]."""

LEAST_MARGIN = 5.0


def main() -> None:
    """Print a Markdown table, a row for each preset at its first length."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shapes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--speed", action="store_true", help="processor time a shape, in the plane and in space")
    given = parser.parse_args()
    if given.speed:
        return speed(given.seed)
    print("| cable | gamma | bending length [mm] | off without weight [mm], median, worst | ended |")
    print("|---|---|---|---|---|")
    for name in preset_names():
        values = preset_values(name)
        rod = SpatialRod.of_material(values["length"], values["bending_stiffness"], values["linear_density"])
        print(row(name, rod, given.shapes, given.seed), flush=True)


def row(name: str, rod: SpatialRod, shapes: int, seed: int) -> str:
    """Figures of one cable."""
    light, off = replace(rod, weight=0.0), []
    for q in drawn(light, shapes, seed):
        found = under_weight(light, q, rod.weight)
        if found is not None:
            off.append(np.linalg.norm(rod.shapes(found[None])[0] - light.shapes(q[None])[0], axis=2).max())
    median, worst = (f"{1000 * each:.1f}" for each in (np.median(off), max(off))) if off else ("", "")
    bending_length = 1000 * rod.length / rod.weight ** (1 / 3)
    return f"| {name} | {rod.weight:.1f} | {bending_length:.0f} | {median}, {worst} | {shapes - len(off)}/{shapes} |"


def drawn(rod: SpatialRod, count: int, seed: int) -> np.ndarray:
    """Coordinates (count, 12) of stable shapes."""
    rng, found = np.random.default_rng(seed), np.zeros((0, 12))
    while len(found) < count:
        q = rng.normal(0, SPREAD, (count, 12))
        found = np.vstack([found, q[rod.stability(q, ceiling=LEAST_MARGIN)[0] >= LEAST_MARGIN]])
    return found[:count]


def speed(seed: int) -> None:
    """Print a Markdown table: microseconds of one core for shapes, with derivatives, and whether they are stable."""
    rng, rows = np.random.default_rng(seed), 3000
    space, plane = SpatialRod(0.34, weight=20.0), PlanarRod(0.34)
    print("| rod | shape [us] | with derivatives [us] | stable? [us] |")
    print("|---|---|---|---|")
    for name, rod, spread in (("in space", space, SPREAD), ("planar", plane, (0.3, 0.3, 1.2, 8.0, 8.0, 2.0))):
        q, taken = rng.normal(0, spread, (rows, rod.dof)), []
        for call in (rod.shapes, rod.jacobians, partial(rod.stability, ceiling=1e-3)):
            call(q[:2])
            began = time.process_time()
            call(q)
            taken.append(f"{1e6 * (time.process_time() - began) / rows:.1f}")
        print(f"| {name} | {' | '.join(taken)} |")


if __name__ == "__main__":
    main()
