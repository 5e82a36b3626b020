"""How many markers a cable needs: keypoints found by markers at some of them, and the pixels between.

    .venv/bin/python studies/marker_counts.py [--first 9200] [--count 12] [--every 6] [--out out/perception]

Runs and pictures are those of `perception.py`. A marker that a cable is not to have is erased from the mask of the
markers, and is the cable's own colour then. Prints Markdown.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from perception import GREEN, NINETY, ORANGE, PLACES, SIZE, in_deviations, off, pictures, sequences, spread, table

from cableway.figures.perspective import LOOK, way_of
from cableway.perception.markers import MarkerTracker
from cableway.perception.placement import camera_at
from cableway.perception.segmentation import CableColor, view_of
from cableway.perception.views import View
from cableway.records import Rollout
from cableway.rendering.cell import CellScene
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.task import CONTROL_STEP, Task

MARKED = {"none": (), "1": (6,), "2": (4, 8), "3": (3, 6, 9), "5": (2, 4, 6, 8, 10), "11": tuple(range(1, 12))}
"""Keypoints with a marker, of 13."""

SETUPS = {"one above": (0,), "above and low": (0, 2)}

NEAR = 0.012
"""Distance [m] from a keypoint within which a marker's pixels are that keypoint's: half of the way to the next one."""


def erased(view: View, keypoints: np.ndarray, kept: tuple[int, ...], radius: float) -> View:
    """A view without the markers at all but some keypoints [m]."""
    assert view.marks is not None
    pixels, depth = view.camera.project(np.column_stack([keypoints, np.full(len(keypoints), radius)]))
    v, u = np.nonzero(view.marks)
    if not len(u):
        return view
    away = np.linalg.norm(np.column_stack([u, v])[:, None] - pixels, axis=2)
    nearest = away.argmin(axis=1)
    reach = NEAR * view.camera.pinhole.focal[0] / depth[nearest]
    gone = ~np.isin(nearest, kept) & (away.min(axis=1) <= reach)
    marks, mask = view.marks.copy(), view.mask | view.marks
    marks[v[gone], u[gone]] = False
    return replace(view, mask=mask, marks=marks)


def followed(task: Task, rollout: Rollout, seed: int, every: int) -> dict[str, np.ndarray]:
    """Errors and more by setup and number of markers."""
    way = way_of(task, rollout)
    assert way is not None
    assert rollout.joints is not None
    scene = CellScene(task, way, LOOK._replace(cable=ORANGE, marker=GREEN))
    eyes = tuple(camera_at(place, task.scene.size, SIZE) for place in PLACES)
    color, green = CableColor(color=(217, 89, 13)), CableColor(color=(13, 140, 51))
    kinematics, tracker = CellKinematics(task, way), MarkerTracker(task.cable, every * CONTROL_STEP)
    poses = np.array([kinematics.poses(np.ascontiguousarray(joints)) for joints in rollout.joints])
    cases = [(name, many) for name in SETUPS for many in MARKED]
    tracks = {case: tracker.start(poses[0], task.start_equilibrium) for case in cases}
    out: dict[str, list] = {}
    for row in range(0, len(rollout.times), every):
        true = rollout.keypoints[row]
        shots = pictures(scene, eyes, rollout.centreline[row], rollout.joints[row], np.random.default_rng([seed, row]))
        views = [view_of(eye, *shot, color, green) for eye, shot in zip(eyes, shots, strict=True)]
        for name, many in cases:
            shown = [erased(views[k], true, MARKED[many], task.cable.radius) for k in SETUPS[name]]
            tracks[name, many], seen = tracker.update(tracks[name, many], shown, poses[row], float(rollout.times[row]))
            errors = off(seen.keypoints, true, rollout.centreline[row], poses[row])
            deviations = in_deviations(seen.keypoints, true, seen.covariance)["deviations"]
            for what, values in (("error", errors["error"]), ("across", errors["across"]), ("known", seen.known),
                                 ("deviations", deviations)):  # fmt: skip
                out.setdefault(f"{name} {many} {what}", []).append(values)
    return {what: np.array(rows) for what, rows in out.items()}


def main() -> None:
    """Print the table."""
    found: list[dict[str, np.ndarray]] = []
    for seed, errors in sequences(__doc__, "counts", followed, first=9200, count=12, every=6):
        found.append(errors)
        print(seed, flush=True)
    print(f"\n{len(found)} sequences, {sum(len(each[f'{next(iter(SETUPS))} none known']) for each in found)} frames\n")
    table("cameras", "markers", "error, mean, p99, worst [mm]", "across the cable [mm]", "90% intervals cover [%]",
          "known [%]")  # fmt: skip
    for name in SETUPS:
        for many in MARKED:
            error, across, known, deviations = (
                np.concatenate([each[f"{name} {many} {what}"] for each in found])
                for what in ("error", "across", "known", "deviations")
            )
            covered = np.mean(abs(deviations[np.isfinite(deviations)]) <= NINETY)
            table(
                name,
                many,
                spread(error),
                spread(across),
                f"{100 * covered:.0f}",
                f"{100 * known.mean():.1f}",
                head=False,
            )


if __name__ == "__main__":
    main()
