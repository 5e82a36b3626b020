"""What is left of a cable in the masks of pictures under the conditions of the suite "eyes", and how a tracker fares.

    .venv/bin/python studies/masks.py [--first 6000] [--count 6] [--every 8] [--out out/masks]

Runs random tasks of kind "cell" as `perception.py` does, renders rows of their rollouts by two low cameras under each
condition, and compares two masks: of pixels within a fixed angle of the cable's colour, and the product's, of pixels
with more of the cable's colour than of the background's, too. "Points" are those of the axis in both cameras, "strays"
those more than 5 mm off the true curve. Rollouts are kept in the folder. Prints Markdown.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from perception import rollout_of
from scipy.spatial import KDTree

from cableway.benchmark.conditions import CONDITIONS
from cableway.figures.perspective import way_of
from cableway.geometry import polyline
from cableway.perception.rod_tracker import RodTracker
from cableway.perception.segmentation import cable_mask
from cableway.perception.views import View, axis_points
from cableway.records import Rollout
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.task import CONTROL_STEP, Task
from cableway.tasks.generation import random_task
from cableway.tracking.photographer import ORANGE, Photographer, State

LOOKED_AT = ("two-low", "blurred", "noisy", "faded", "dim", "glaring", "shadows", "alike", "person", "second-cable")
FAR = 0.005
"""Distance [m] from the true curve from which on a point is a stray."""

Mask = Callable[[np.ndarray], np.ndarray]


def by_angle(image: np.ndarray) -> np.ndarray:
    """The pixels within `CableColor.angle` of the cable's colour, and as bright as it allows."""
    reference = np.array(ORANGE.color, float)
    length, pixels = float(np.linalg.norm(reference)), image.astype(float)
    size, along = np.linalg.norm(pixels, axis=2), pixels @ reference / length
    bright = (ORANGE.darkest * length <= size) & (size <= ORANGE.brightest * length)
    return bright & (along >= np.cos(ORANGE.angle) * size)


MASKS: dict[str, Mask] = {"fixed angle": by_angle, "cable_mask": lambda image: cable_mask(image, ORANGE)}


class Frame(NamedTuple):
    """What is noted of one frame: numbers of points and strays, whether it is known, the mean keypoint error [mm]."""

    points: int
    strays: int
    known: bool
    error: float


def frames(task: Task, rollout: Rollout, condition: str, seed: int, every: int, mask: Mask) -> Iterator[Frame]:
    """The frames of a rollout under a condition."""
    way = way_of(task, rollout)
    assert way is not None
    assert rollout.joints is not None
    kinematics = CellKinematics(task, way)
    poses = np.array([kinematics.poses(np.ascontiguousarray(joints)) for joints in rollout.joints])
    photographer = Photographer(task, way, CONDITIONS[condition].seen(seed))
    tracker, rng = RodTracker(task.cable, every * CONTROL_STEP), np.random.default_rng(seed)
    track = tracker.start(poses[0], task.start_equilibrium)
    for row in range(0, len(rollout.times), every):
        state = State(float(rollout.times[row]), rollout.centreline[row], poses[row], rollout.joints[row])
        shot = zip(photographer.cameras, photographer.shot(state, rng), strict=True)
        views = [View(camera, mask(picture), hiding) for camera, (picture, hiding) in shot]
        points = np.concatenate([axis_points(view, task.cable.radius) for view in views])
        away = KDTree(polyline.resample(state.cable, 800)).query(points)[0] if len(points) else np.empty(0)
        track, seen = tracker.update(track, views, poses[row], state.time)
        off = np.linalg.norm(seen.keypoints - polyline.resample(state.cable, task.cable.keypoints), axis=1)
        yield Frame(len(points), int((away > FAR).sum()), seen.known, 1000 * float(off.mean()))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--first", type=int, default=6000)
    parser.add_argument("--count", type=int, default=6)
    parser.add_argument("--every", type=int, default=8)
    parser.add_argument("--out", type=Path, default=Path("out/masks"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    tasks = {seed: random_task(seed, "cell") for seed in range(given.first, given.first + given.count)}
    runs = {seed: rollout_of(task, seed, given.out) for seed, task in tasks.items()}
    print("| condition | mask | frames | points | strays | known [%] | error, mean, p95 [mm] |\n|" + " --- |" * 7)
    for condition in LOOKED_AT:
        for name, mask in MASKS.items():
            noted = [
                frame
                for seed, run in runs.items()
                if run is not None
                for frame in frames(tasks[seed], run, condition, seed, given.every, mask)
            ]
            points, strays, known, error = map(np.array, zip(*noted, strict=True))
            seen = f"{points.mean():.0f} | {strays.mean():.1f} | {100 * known.mean():.0f}"
            off = f"{np.nanmean(error):.2f}, {np.nanpercentile(error, 95):.2f}"
            print(f"| {condition} | {name} | {len(noted)} | {seen} | {off} |", flush=True)


if __name__ == "__main__":
    main()
