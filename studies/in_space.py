"""What weight does to a held cable in space: shapes with it beside weightless ones, between the same grippers.

    .venv/bin/python studies/in_space.py [--shapes 100] [--seed 0]
    .venv/bin/python studies/in_space.py --speed
    .venv/bin/python studies/in_space.py --followed 30 [--seed 0]
    .venv/bin/python studies/in_space.py --lines 100 [--seed 1000]

`--followed` leads the judge's rod (`cableway.verification.spatial_follower`) along straight lines in q; `--lines`
counts in how many draws of random tasks such a line meets no obstacle, which are then drawn anew.

Weightless shapes of margin 5 and more are drawn at any orientation, and weight is added little by little with the
grippers held. *Ended*: the shape became unstable on the way, where a cable bends over to another one; those have no
distance, and are counted.
"""

from __future__ import annotations

import argparse
import time
import zlib
from dataclasses import replace
from functools import partial

import numpy as np

from cableway.rod.planar import PlanarRod
from cableway.rod.spatial import SpatialRod
from cableway.rod.spatial_inverse import under_weight
from cableway.scene.files.presets import preset_names, preset_values
from cableway.tasks.space.generation import SPATIAL_KINDS, Kind, Rejected, line_is_free, random_cable, random_end
from cableway.verification.spatial_follower import follow_in_space

SPREAD = (*[0.3] * 3, *[1.2] * 3, *[8.0] * 3, *[2.0] * 3)
"""Standard deviations of the coordinates [m, rad, -, -]."""

LEAST_MARGIN = 5.0


def main() -> None:
    """Print a Markdown table, a row for each preset at its first length."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shapes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--speed", action="store_true", help="processor time a shape, in the plane and in space")
    parser.add_argument(
        "--followed", type=int, default=0, help="motions at each weight that the judge's rod is led along"
    )
    parser.add_argument("--lines", type=int, default=0, help="draws of each kind of random task")
    given = parser.parse_args()
    if given.lines:
        return lines(given.lines, given.seed)
    if given.speed:
        return speed(given.seed)
    if given.followed:
        return followed(given.followed, given.seed)
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


WEIGHTS = (0.0, 18.5, 50.0, 100.0)


def followed(count: int, seed: int) -> None:
    """Print a Markdown table: how far the judge's rod is off motions of margin 5 and more, 0.5 m long, 8 rows each."""
    print("| gamma | motions | lost | largest deviation [mm], median, worst |")
    print("|---|---|---|---|")
    for weight in WEIGHTS:
        rod, rng, off, lost = SpatialRod(0.5, weight=weight), np.random.default_rng(seed), [], 0
        while len(off) < count:
            line = rod.between(*rng.normal(0, SPREAD, (2, rod.dof)), np.linspace(0, 1, 8))
            if rod.stability(line, ceiling=LEAST_MARGIN)[0].min() < LEAST_MARGIN:
                continue
            stations, poses = rod.shapes(line)
            turns = round(line[0, 9] / rod.twist / (2 * np.pi))
            found = follow_in_space(stations, poses, length=0.5, twist=rod.twist, weight=weight, turns=turns)
            lost += found.lost_at is not None
            off.append(1000 * found.deviation.max(initial=0.0))
        print(f"| {weight:g} | {count} | {lost} | {np.median(off):.2f}, {max(off):.2f} |", flush=True)


def lines(count: int, seed: int) -> None:
    """Print a Markdown table: in how many of the first draws of tasks the straight line in q meets no obstacle."""
    print("| kind | draws | straight line free |")
    print("|---|---|---|")
    for kind, draw_scene in SPATIAL_KINDS.items():
        free = sum(_line_of(kind, draw_scene, each) for each in range(seed, seed + count))
        print(f"| {kind} | {count} | {free} |", flush=True)


def _line_of(kind: str, draw_scene: Kind, seed: int) -> bool:
    """Whether the straight line between the first ends that are drawn for a seed is free."""
    rng = np.random.default_rng([zlib.crc32(kind.encode()), seed])
    cable = random_cable(rng)
    while True:
        draw = draw_scene(rng, seed, None)
        try:
            ends = np.array([random_end(rng, draw, cable, part) for part in draw.parts])
        except Rejected:
            continue
        return line_is_free(ends, draw.scene, cable, draw.radius)


if __name__ == "__main__":
    main()
