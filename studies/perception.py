"""How well the rod tracker finds an unmarked cable in pictures of a cell.

    .venv/bin/python studies/perception.py [--first 6000] [--count 5] [--every 2] [--out out/perception]

Runs random tasks of kind "cell" on the table plant, whose cables are of another length, curved, stiff in part and held
askew; renders each row of the rollouts by three cameras of 640 x 480 pixels, one straight above and two low ones at
front and back, with blur and noise; and finds the cable again from the pictures and the gripper poses that the joints
give. Two trackers without a rod get the same (`other_trackers`). "markers" is the rod tracker by markers and the pixels
between them: the same frames are rendered again with green bands at the inner keypoints, and its errors are those of
the markers that it sees;
"rod-by-markers" has those of all keypoints of the rod that it fits to them. "true curve" is no tracker: the cable's own
curve, its keypoints at equal distances between the grippers. What it is off is how far the cable was shoved into them,
which no picture of a cable without marks shows. Rollouts and errors are kept in the folder, so that an interrupted
study goes on. Prints Markdown.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from other_trackers import RegisteringTracker, SplineTracker, resampled
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter
from threadpoolctl import threadpool_limits

from cableway.core.errors import CablewayError
from cableway.figures.perspective import AMBIENT, LAMP, LOOK, way_of
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.markers import MarkerTracker
from cableway.perception.placement import camera_at
from cableway.perception.rod_tracker import RodTracker
from cableway.perception.segmentation import CableColor, view_of
from cableway.perception.views import axis_points
from cableway.records import Rollout
from cableway.rendering.cell import CellScene, Label
from cableway.rendering.picture import Light, labels, render
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tasks.generation import random_task
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

KINDS = ("table-uniform", "table-coiled", "table-stiff-third", "table-rough", "table-all")
ORANGE, GREEN = (0.85, 0.35, 0.05), (0.05, 0.55, 0.2)
SIZE = (640, 480)
BLUR, NOISE = 0.7, 5.0
"""Of the pictures: standard deviations of the blur [pixels] and of each pixel, of 255."""

PLACES = ("above", "front", "back")
SETUPS = {"one above": (0,), "one low": (1,), "two low": (1, 2), "above and low": (0, 2)}
FINE = 1500
"""Points of a curve from which the nearest one is sought: 0.2 mm apart."""

SMOOTH = 241
"""Points of a curve through keypoints."""

BEYOND = 0.02
"""How far [m] a gripper may be beyond an end of a curve."""

NINETY = 1.645
"""Standard deviations within which 90% of a normal distribution lie."""


def rollout_of(task: Task, seed: int, folder: Path) -> Rollout | None:
    """A run of the task with a perturbed cable; None where it ended before it began."""
    file = folder / f"rollout-{seed}.npz"
    if not file.exists():
        kind = KINDS[seed % len(KINDS)]
        try:
            run = solve(task, SolveOptions(perturbation=named_perturbation(kind, task, seed), seed=seed))
        except CablewayError as error:
            print(f"{seed}, {kind}: {error}", flush=True)
            return None
        if run.rollout is None:
            print(f"{seed}, {kind}: {run.report.failure}", flush=True)
            return None
        run.rollout.save(file)
    return Rollout.load(file)


def pictures(
    scene: CellScene, eyes: Sequence[CalibratedCamera], cable: np.ndarray, joints: np.ndarray, rng: np.random.Generator
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each camera the picture and what hides the table."""
    mesh, made = scene.mesh(cable, joints=joints), []
    light = Light(position=(LAMP[0] + 0.35, LAMP[1] + 0.35, LAMP[2]), ambient=AMBIENT, shadows=512)
    for eye in eyes:
        color = render(mesh, eye.pinhole, light, samples=3).color.astype(float)
        color = gaussian_filter(color, (BLUR, BLUR, 0)) + NOISE * rng.standard_normal(color.shape)
        hiding = labels(mesh.where(mesh.labels != Label.CABLE), eye.pinhole) > Label.TABLE
        made.append((np.clip(color, 0, 255).round().astype(np.uint8), hiding))
    return made


def followed(task: Task, rollout: Rollout, seed: int, every: int) -> dict[str, np.ndarray]:
    """Errors and more of each setup and tracker, a row for each frame."""
    way = way_of(task, rollout)
    assert way is not None
    assert rollout.joints is not None
    look, eyes = LOOK._replace(cable=ORANGE), tuple(camera_at(place, task.scene.size, SIZE) for place in PLACES)
    scene, banded = CellScene(task, way, look), CellScene(task, way, look._replace(marker=GREEN))
    rng, rows = np.random.default_rng(seed), range(0, len(rollout.times), every)
    color, green = CableColor(color=(217, 89, 13)), CableColor(color=(13, 140, 51))
    start = task.cable.rod.shapes(task.start_equilibrium[None])[0][0]
    kinematics = CellKinematics(task, way)
    poses = np.array([kinematics.poses(np.ascontiguousarray(joints)) for joints in rollout.joints])
    tracker = RodTracker(task.cable, every * CONTROL_STEP)
    by_markers = MarkerTracker(task.cable, every * CONTROL_STEP)
    tracks = {name: tracker.start(poses[0], task.start_equilibrium) for name in SETUPS}
    marked = {name: by_markers.start(poses[0], task.start_equilibrium) for name in SETUPS}
    others = {(name, kind): make(start, poses[0]) for name in SETUPS for kind, make in zip(OTHERS, MAKERS, strict=True)}
    out: dict[str, list] = {}

    def note(name: str, **values: object) -> None:
        for what, value in values.items():
            out.setdefault(f"{name} {what}", []).append(value)

    for row in rows:
        state = (rollout.centreline[row], rollout.joints[row])
        true = (rollout.keypoints[row], rollout.centreline[row], poses[row])
        made, bands = (
            pictures(scene, eyes, *state, rng),
            pictures(banded, eyes, *state, np.random.default_rng([seed, row])),
        )
        for name, chosen in SETUPS.items():
            begun = time.process_time()
            views = [view_of(eyes[k], *made[k], color) for k in chosen]
            tracks[name], seen = tracker.update(tracks[name], views, poses[row], float(rollout.times[row]))
            spent = time.process_time() - begun
            found = seen.observation.keypoints
            note(f"{name} rod", **off(found, *true), **in_deviations(found, true[0], seen.covariance),
                 hidden=seen.hidden, explained=seen.explained, known=seen.known, spent=spent)  # fmt: skip
            begun = time.process_time()
            views = [view_of(eyes[k], *bands[k], color, green) for k in chosen]
            marked[name], marks = by_markers.update(marked[name], views, poses[row], float(rollout.times[row]))
            spent = time.process_time() - begun
            there = np.where(marks.marked[:, None], marks.observation.keypoints, np.nan)
            note(f"{name} markers", **off(there, *true), spent=spent)
            note(f"{name} rod-by-markers", **off(marks.keypoints, *true), spent=spent, explained=marks.explained,
                 **in_deviations(marks.keypoints, true[0], marks.covariance), known=marks.known)  # fmt: skip
            views = [view_of(eyes[k], *made[k], color) for k in chosen]
            points = np.concatenate([axis_points(view, task.cable.radius) for view in views])
            for kind in OTHERS:
                begun = time.process_time()
                found = others[name, kind].update(points, poses[row], len(true[0]))
                note(f"{name} {kind}", **off(found, *true), spent=time.process_time() - begun)
        note("- true curve", **off(between(rollout.centreline[row], poses[row], len(true[0])), *true))
    return {name: np.array(values) for name, values in out.items()}


OTHERS, MAKERS = ("spline", "registration"), (SplineTracker, RegisteringTracker)


def off(found: np.ndarray, truth: np.ndarray, curve: np.ndarray, poses: np.ndarray) -> dict[str, np.ndarray]:
    """How far keypoints are off [m]: from the true ones, across the cable, from the true curve, wherever on it, and
    were they, as the true ones, at equal distances between the grippers along their curves."""
    error, along = found - truth, np.gradient(truth, axis=0)
    across = np.abs(along[:, 0] * error[:, 1] - along[:, 1] * error[:, 0]) / np.linalg.norm(along, axis=1)
    away = np.linalg.norm(found[:, None] - resampled(curve, FINE), axis=2).min(axis=1)
    equal = np.full(len(found), np.nan)
    if np.isfinite(found).all():
        smooth = CubicSpline(np.arange(len(found)), found)(np.linspace(0, len(found) - 1, SMOOTH))
        equal = np.linalg.norm(between(smooth, poses, len(found)) - between(curve, poses, len(found)), axis=1)
    return {"error": np.linalg.norm(error, axis=1), "across": across, "curve": away, "equal": equal}


def in_deviations(found: np.ndarray, truth: np.ndarray, covariance: np.ndarray) -> dict[str, np.ndarray]:
    """How far keypoints are off in standard deviations of what is said of them: in x and y, along the cable, across."""
    error, along = found - truth, np.gradient(truth, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.column_stack([-along[:, 1], along[:, 0]])

    def over(way: np.ndarray) -> np.ndarray:
        return np.sum(error * way, axis=1) / np.sqrt(np.einsum("ni,nij,nj->n", way, covariance, way))

    either = error / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return {"deviations": either, "deviations-along": over(along), "deviations-across": over(across)}


def between(curve: np.ndarray, poses: np.ndarray, count: int) -> np.ndarray:
    """Keypoints [m] at equal distances along a curve from where one gripper is along it to where the other is, beyond
    its ends along straight lines."""
    fine = resampled(curve, 5000)
    ways = fine[[0, -1]] - fine[[1, -2]]
    beyond = np.linspace(0.0, BEYOND, 200)[1:, None] * (ways / np.linalg.norm(ways, axis=1, keepdims=True))[:, None]
    fine = np.vstack([fine[0] + beyond[0, ::-1], fine, fine[-1] + beyond[1]])
    half = len(fine) // 2
    first, last = (np.linalg.norm(fine - pose[:2], axis=1) for pose in poses)
    return resampled(fine[np.argmin(first[:half]) : half + np.argmin(last[half:]) + 1], count)


Following = Callable[[Task, Rollout, int, int], dict[str, np.ndarray]]
"""What came of a sequence, given its task, rollout and seed, and every how many rows there is a picture."""


def sequences(
    about: str | None, name: str, follow: Following, *, first: int, count: int, every: int
) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """Seeds of the sequences that the command line asks for, by default these, and what came of them, kept in files of
    this name."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=first)
    parser.add_argument("--count", type=int, default=count)
    parser.add_argument("--every", type=int, default=every)
    parser.add_argument("--out", type=Path, default=Path("out/perception"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for seed in range(given.first, given.first + given.count):
        file = given.out / f"{name}-{seed}-{given.every}.npz"
        if not file.exists():
            task = random_task(seed, "cell")
            rollout = rollout_of(task, seed, given.out)
            if rollout is None:
                continue
            with threadpool_limits(1):
                np.savez(file, **follow(task, rollout, seed, given.every))
        yield seed, dict(np.load(file))


def main() -> None:
    """Follow the sequences and print the table."""
    found: list[dict[str, np.ndarray]] = []
    for seed, errors in sequences(__doc__, "errors", followed, first=6000, count=5, every=2):
        found.append(errors)
        print(f"{seed}: " + ", ".join(f"{name} {1e3 * np.nanmean(errors[f'{name} rod error']):.2f} mm, worst "
              f"{1e3 * np.nanmax(errors[f'{name} rod error']):.1f}" for name in SETUPS), flush=True)  # fmt: skip
    show(found)


def show(found: list[dict[str, np.ndarray]]) -> None:
    """Print the tables."""
    print(f"\n{len(found)} sequences, {sum(len(each['two low rod hidden']) for each in found)} frames\n")

    def rows(name: str) -> np.ndarray:
        return np.concatenate([each[name] for each in found])

    table("cameras", "tracker", "error, mean, p99, worst [mm]", "at equal distances [mm]", "across the cable [mm]",
          "off the curve [mm]", "time, median, mean, p99 [ms]")  # fmt: skip
    kinds = ("rod", "markers", "rod-by-markers", *OTHERS)
    for name in ("- true curve", *(f"{setup} {kind}" for setup in SETUPS for kind in kinds)):
        setup, kind = ("-", "true curve") if name[0] == "-" else name.rsplit(" ", 1)
        spent = 1e3 * rows(f"{name} spent") if kind != "true curve" else np.full(1, np.nan)
        times = ", ".join(f"{each:.1f}" for each in (np.median(spent), spent.mean(), np.percentile(spent, 99)))
        times = times if np.isfinite(spent).all() else "-"
        spreads = (spread(rows(f"{name} {what}")) for what in ("error", "equal", "across", "curve"))
        table(setup, kind, *spreads, times, head=False)
    print()
    table("cameras", "tracker", "90% intervals cover, all, along, across [%]", "error over deviation, along, across",
          "explained [%]", "known [%]", "lost [frames]", "error where known, mean, p99, worst [mm]",
          "at equal distances [mm]")  # fmt: skip
    for setup, kind in itertools.product(SETUPS, ("rod", "rod-by-markers")):
        error, explained, known = (rows(f"{setup} {kind} {what}") for what in ("error", "explained", "known"))
        deviations = [rows(f"{setup} {kind} deviations{what}") for what in ("", "-along", "-across")]
        inside = (100 * np.mean(abs(each[np.isfinite(each)]) <= NINETY) for each in deviations)
        table(
            setup,
            kind,
            ", ".join(f"{share:.0f}" for share in inside),
            ", ".join(f"{np.sqrt(np.nanmean(each**2)):.2f}" for each in deviations[1:]),
            f"{100 * explained.mean():.0f}",
            f"{100 * known.mean():.1f}",
            f"{np.isnan(error).any(axis=1).sum()}",
            spread(error[known.astype(bool)]),
            spread(rows(f"{setup} {kind} equal")[known.astype(bool)]),
            head=False,
        )
    print()
    table("cameras", "hidden, mean, p90 [%]", "inner markers seen [%]")
    for setup in SETUPS:
        hidden, seen = rows(f"{setup} rod hidden"), np.isfinite(rows(f"{setup} markers error"))[:, 1:-1]
        table(
            setup,
            f"{100 * hidden.mean():.0f}, {100 * np.percentile(hidden, 90):.0f}",
            f"{100 * seen.mean():.0f}",
            head=False,
        )


def table(*cells: str, head: bool = True) -> None:
    """Print a row of a table, its first one with the line below."""
    print("| " + " | ".join(cells) + " |" + ("\n" + "|---" * len(cells) + "|" if head else ""))


def spread(error: np.ndarray) -> str:
    """Mean, 99th percentile and worst [mm] of the frames in which the cable was not lost; "-" where that is none."""
    error = error[np.isfinite(error)]
    if not len(error):
        return "-"
    return f"{1e3 * error.mean():.2f}, {1e3 * np.percentile(error, 99):.2f}, {1e3 * error.max():.1f}"


if __name__ == "__main__":
    main()
