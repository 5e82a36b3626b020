"""How many pictures of a cell a second are rendered, of processor time on one core.

    .venv/bin/python studies/rendering.py [--task multi-obstacle-2] [--cell dual-ur5e] [--size 640x480] [--count 100]

The rows are spread over a plan. Prints a table: what is made, the median, the 95th percentile and the most of the
processor time of a picture [ms], and pictures a second by the median.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

import cableway as cw
from cableway.figures import scene
from cableway.figures.perspective import AMBIENT, LAMP, LOOK, VIEW, view_direction, way_of
from cableway.rendering.camera import Camera
from cableway.rendering.cell import CellScene
from cableway.rendering.picture import Light, render
from cableway.scene.files.loading import load_cell


def timed(make: Callable[[int], Any], count: int) -> np.ndarray:
    """Processor times [s] of a number of calls, after one that does not count."""
    make(0)
    times = []
    for row in range(count):
        begun = time.process_time()
        make(row)
        times.append(time.process_time() - begun)
    return np.array(times)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--task", default="multi-obstacle-2")
    parser.add_argument("--cell", default="dual-ur5e")
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--count", type=int, default=100)
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    cell = load_cell(given.cell)
    task = cw.load_task(given.task).in_cell(cell)
    plan = cw.plan(task)
    way = way_of(task, plan)
    if way is None or plan.joints is None:
        raise SystemExit("the plan has no joints")
    built, joints = CellScene(task, way, LOOK), plan.joints
    rows = np.linspace(0, plan.steps, given.count).round().astype(int)
    cables = scene.smooth(plan.shapes)
    direction = view_direction(task, cell)
    eye = Camera.framing(built.bounds(joints), direction, size=(width, height), view=VIEW)
    lamp = Light(position=LAMP, ambient=AMBIENT, shadows=0)
    shadows = replace(lamp, shadows=1024)
    meshes = [built.mesh(cables[row], joints=joints[row]) for row in rows]
    bare = [built.mesh(cables[row], poses=plan.poses[row]) for row in rows]
    made: dict[str, Callable[[int], Any]] = {
        "triangles": lambda k: built.mesh(cables[rows[k]], joints=joints[rows[k]]),
        "colours, depth, labels": lambda k: render(meshes[k], eye, lamp),
        "without arms": lambda k: render(bare[k], eye, lamp),
        "with shadows": lambda k: render(meshes[k], eye, shadows),
        "with shadows and nine samples a pixel": lambda k: render(meshes[k], eye, shadows, samples=3),
    }
    print(f"{given.task} in {given.cell}, {given.size}, {len(meshes[0].corners)} triangles, {given.count} rows\n")
    print("| what | median [ms] | 95% [ms] | most [ms] | a second |")
    print("|---|---|---|---|---|")
    with threadpool_limits(1):
        for name, make in made.items():
            times = 1e3 * timed(make, given.count)
            median, high = np.percentile(times, [50, 95])
            print(f"| {name} | {median:.1f} | {high:.1f} | {times.max():.1f} | {1e3 / median:.0f} |")


if __name__ == "__main__":
    main()
