"""How well what stands on a table is found by depth cameras, and what is missed or invented.

    .venv/bin/python studies/survey.py [--first 7100] [--count 12] [--frames 1] [--out out/survey]

Random tasks of each kind, their obstacles 15 to 120 mm high, the cable on the table at its start; rendered by cameras
of 640 x 480 pixels with the errors of `DepthSensor`, by default about those of a RealSense D415. "arms" are tasks of
kind "cell" with both arms at their start, whose pixels are known. Obstacles that touch, or that one outline covers,
count as one. Of each: how far its outline and the one found are apart (Hausdorff), how far the true one stands out of
what was found, and how far the found height is too large; median, 95th percentile and worst. A true one of which
nothing was found is missed, and a found one that touches no true one is invented; in brackets, how many of those
missed are lower than what is looked for. "unsafe" is the share of true obstacles of which a piece is more than 1 mm
outside of all that was found and all that is said to be hidden. With several frames, depths are medians of as many.
Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from cableway.perception.depth import DepthView, middle
from cableway.perception.placement import camera_at
from cableway.perception.survey import Survey, depth_view, held, survey
from cableway.rendering.cell import ARMS, GRIPPERS, CellScene, Label
from cableway.rendering.depth_sensor import DepthSensor, measured
from cableway.rendering.picture import Light, render
from cableway.robot.branches import ArmMotion, arm_motion
from cableway.scene.obstacles import to_shapely
from cableway.scene.task import Task
from cableway.tasks.generation import random_task
from cableway.tracking.photographer import LOOK

KINDS = ("clutter", "dense", "maze", "cell")
SETUPS = {"above": ("above",), "front": ("front",), "front, back": ("front", "back"),
          "above, front, back": ("above", "front", "back")}  # fmt: skip
HEIGHTS = (0.015, 0.12)
OUT = 0.001
SPACING = 0.001
"""Of the points [m] on outlines between which distances are taken."""


def drawn(kind: str, seed: int) -> Task:
    """A task with obstacles of heights of their own."""
    task, rng = random_task(seed, kind), np.random.default_rng(seed)
    tall = [replace(each, height=round(float(rng.uniform(*HEIGHTS)), 3)) for each in task.scene.obstacles]
    scene = replace(task.scene, obstacles=tuple(tall))
    return Task(**{**vars(task.unchecked()), "scene": scene, "cell": task.cell if kind == "cell" else None})


def views(task: Task, places: tuple[str, ...], arms: bool, frames: int, seed: int) -> list[DepthView]:
    """What the cameras show at the start of the task."""
    motion, poses = None, task.gripper_poses("start")
    if arms and task.cell is not None:
        motion = arm_motion(np.stack([poses, poses]), task, task.cell, made=True)
        assert isinstance(motion, ArmMotion), motion
    scene = CellScene(task, None if motion is None else motion.way, LOOK)
    mesh = scene.mesh(task.start, poses=poses) if motion is None else scene.mesh(task.start, joints=motion.joints[0])
    rng, taken = np.random.default_rng(seed), []
    for place in places:
        camera = camera_at(place, task.scene.size)
        shown = render(mesh, camera.pinhole, Light(position=(0.35, -0.15, 3.2), shadows=0))
        sensor, focal = DepthSensor().drawn(rng), camera.pinhole.focal[0]
        depth = middle(np.stack([measured(shown.depth, focal, sensor, rng) for _ in range(frames)]))
        cable, hides = shown.label == Label.CABLE, np.isin(shown.label, (*GRIPPERS, *ARMS))
        taken.append(depth_view(camera, depth, cable, hides))
    return taken


def compared(task: Task, found: Survey) -> list[dict[str, float | int]]:
    """Of each group of obstacles that belong together how well they were found."""
    truth = [to_shapely(each) for each in task.scene.obstacles]
    seen = [to_shapely(each) for each in found.obstacles]
    doubt = shapely.union_all([to_shapely(each) for each in (*found.obstacles, *found.hidden)])
    group = list(range(len(truth) + len(seen)))
    for i, j in zip(*shapely.STRtree([*truth, *seen]).query([*truth, *seen], "intersects"), strict=True):
        old, new = group[int(i)], group[int(j)]
        group = [new if each == old else each for each in group]
    rows = []
    for number in set(group):
        members = [k for k in range(len(group)) if group[k] == number]
        true = [k for k in members if k < len(truth)]
        mine = [k - len(truth) for k in members if k >= len(truth)]
        row: dict[str, float | int] = {"true": len(true), "found": len(mine)}
        if true:
            row["bare"] = max(_out_of(truth[k], doubt) for k in true)
            row["low"] = max(task.scene.obstacles[k].height or 0.0 for k in true) < found.lowest
        if true and mine:
            whole, outline = shapely.union_all([truth[k] for k in true]), shapely.union_all([seen[k] for k in mine])
            heights = [task.scene.obstacles[k].height or 0.0 for k in true]
            row["out"], row["excess"] = _out_of(whole, outline), _out_of(outline, whole)
            row["apart"] = max(row["out"], row["excess"])
            row["height"] = max(found.obstacles[k].height or 0.0 for k in mine) - max(heights)
        rows.append(row)
    return rows


def _out_of(inner: shapely.Geometry, outer: shapely.Geometry) -> float:
    """How far [m] an area stands out of another one."""
    if shapely.is_empty(outer):
        return float(np.sqrt(shapely.area(inner)))
    points = shapely.points(shapely.get_coordinates(shapely.segmentize(shapely.boundary(inner), SPACING)))
    return float(shapely.distance(points, outer).max())


def figures(kind: str, seed: int, frames: int) -> dict[str, dict]:
    """Of each group of cameras what came out."""
    task, made = drawn(kind.split("-")[0], seed), {}
    for name, places in SETUPS.items():
        taken = views(task, places, kind == "cell-arms", frames, seed)
        begun = time.process_time()
        found = survey(taken, task.scene.size, held(task))
        spent = time.process_time() - begun
        area = sum(to_shapely(each).area for each in found.hidden) / np.prod(task.scene.size)
        made[name] = {"groups": compared(task, found), "seen": found.seen, "hidden": area, "spent": spent,
                      "lowest": found.lowest, "specks": found.specks}  # fmt: skip
    return made


def spread(values: list[float], digits: int = 1) -> str:
    """Median, 95th percentile and worst [mm]."""
    return ", ".join(f"{1e3 * np.percentile(values, q):.{digits}f}" for q in (50, 95, 100)) if values else "-"


def show(found: dict[str, list[dict]]) -> None:
    """Print the table."""
    print("\n| kind | cameras | outlines | missed | invented | apart [mm] | stands out [mm] | height too large [mm] |"
          " unsafe | not seen [%] | time [s] |")  # fmt: skip
    print("|---" * 11 + "|")
    for kind, scenes in found.items():
        for name in scenes[0]:
            groups = [row for scene in scenes for row in scene[name]["groups"]]
            both = [row for row in groups if row["true"] and row["found"]]
            true = [row for row in groups if row["true"]]
            cells = [
                kind, name, len(true), _missed(true),
                sum(not row["true"] for row in groups), spread([row["apart"] for row in both]),
                spread([row["out"] for row in both]), spread([row["height"] for row in both]),
                f"{sum(row['bare'] > OUT for row in true)}",
                f"{100 * np.mean([1 - scene[name]['seen'] for scene in scenes]):.1f}",
                f"{np.median([scene[name]['spent'] for scene in scenes]):.1f}",
            ]  # fmt: skip
            print("| " + " | ".join(map(str, cells)) + " |")


def _missed(true: list[dict]) -> str:
    missed = [row for row in true if not row["found"]]
    low = sum(row["low"] for row in missed)
    return f"{len(missed)} ({low})" if low else f"{len(missed)}"


def main() -> None:
    """Survey the scenes and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=7100)
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--kinds", nargs="+", default=[*KINDS, "cell-arms"])
    parser.add_argument("--frames", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/survey"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    found: dict[str, list[dict]] = {}
    for kind in given.kinds:
        for seed in range(given.first, given.first + given.count):
            file = given.out / f"{kind}-{seed}-{given.frames}.json"
            if not file.exists():
                file.write_text(json.dumps(figures(kind, seed, given.frames)))
            found.setdefault(kind, []).append(json.loads(file.read_text()))
    show(found)


if __name__ == "__main__":
    main()
