"""A rollout that is forged or damaged is refused for what is wrong with it; the true one is accepted."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cableway.control.open_loop import OpenLoop
from cableway.core.errors import InputError
from cableway.planning.planner import plan
from cableway.records import THEN_FAILED, Rollout, Verdict
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.plant import CableSimulator
from cableway.tracking import track
from cableway.verification import verify_record

Arrays = dict[str, Any]
ROW = ("times", "keypoints", "observed", "poses", "centreline", "reference", "clearance", "gripper_clearance")
STEP = ("actions", "solve_time", "status")
MIDDLE = 40


@pytest.fixture(scope="module")
def task() -> Task:
    return load_task("single-obstacle-2")


@pytest.fixture(scope="module")
def rollout(task: Task) -> Rollout:
    run = track(CableSimulator(task), OpenLoop(), plan(task, seed=0))
    return replace(run, metadata={**run.metadata, "plant": Perturbation().as_dict(task)})


def judged(arrays: Arrays, task: Task) -> Verdict:
    found = Rollout.from_arrays(arrays, "forged.npz")
    return verify_record(found, task)


def copied(rollout: Rollout) -> Arrays:
    return {name: np.array(value) for name, value in rollout.to_arrays().items()}


def kept(arrays: Arrays, rows: Any) -> None:
    """Only some rows, with the steps that lead from them."""
    rows = np.arange(len(arrays["times"]))[rows]
    arrays.update({name: arrays[name][rows] for name in ROW})
    arrays.update({name: arrays[name][rows[:-1]] for name in STEP})


def says(arrays: Arrays, **metadata: Any) -> None:
    arrays["metadata"] = np.array(json.dumps({**json.loads(str(arrays["metadata"])), **metadata}))


def laid(arrays: Arrays, rows: Any, lines: np.ndarray) -> None:
    """Another centreline in some rows, with keypoints and poses that fit it."""
    arrays["centreline"][rows] = lines
    arrays["keypoints"][rows] = along(lines, arrays["keypoints"].shape[1])
    first, last = lines[..., 1, :] - lines[..., 0, :], lines[..., -1, :] - lines[..., -2, :]
    for side, way in ((0, first), (-1, last)):
        arrays["poses"][rows, side, :2] = lines[..., side, :]
        arrays["poses"][rows, side, 2] = np.arctan2(way[..., 1], way[..., 0])


def along(lines: np.ndarray, count: int) -> np.ndarray:
    """Points at equal arc length, of one line or of several."""
    if lines.ndim == 3:
        return np.array([along(line, count) for line in lines])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(lines, axis=0), axis=1))])
    return np.column_stack([np.interp(np.linspace(0, arc[-1], count), arc, column) for column in lines.T])


def crumpled(line: np.ndarray) -> np.ndarray:
    """A wad as long as the line, with its ends."""
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, len(lengths) - 8)
    middle = lengths[4:-4, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    points = np.vstack([line[:5], line[4] + np.cumsum(middle, axis=0)])
    return np.vstack([points, line[-4:]])


def eighth_rows(arrays: Arrays, task: Task) -> None:
    kept(arrays, slice(None, None, 8))
    arrays["times"] = 1000.0 * np.arange(len(arrays["times"]))


def wad(arrays: Arrays, task: Task) -> None:
    arrays["centreline"][MIDDLE] = crumpled(arrays["centreline"][MIDDLE])
    arrays["keypoints"][MIDDLE] = along(arrays["centreline"][MIDDLE], task.cable.keypoints)


def two_metres(arrays: Arrays, task: Task) -> None:
    plant = json.loads(str(arrays["metadata"]))["plant"]
    says(arrays, plant={**plant, "cable": {**plant["cable"], "length": 2.0}})


def bunched(arrays: Arrays, task: Task) -> None:
    arrays["keypoints"][1:-1, 1:-1] = arrays["centreline"][1:-1, 3:14]


def swapped_ends(arrays: Arrays, task: Task) -> None:
    arrays["keypoints"][1:-1] = arrays["keypoints"][1:-1, ::-1]


def level(arrays: Arrays, task: Task) -> None:
    arrays["poses"][:, :, 2] = 0.0


def half_a_turn(arrays: Arrays, task: Task) -> None:
    arrays["poses"][:, :, 2] += np.pi


def spinning(arrays: Arrays, task: Task) -> None:
    turns = round(1000 * task.grippers.max_turn / (2 * np.pi))
    arrays["poses"][:, :, 2] += 2 * np.pi * turns * np.arange(len(arrays["times"]))[:, None]


def unsigned_falling(arrays: Arrays, task: Task) -> None:
    arrays["times"] = np.arange(len(arrays["times"]), 0, -1).astype(np.uint8)


def unsigned_wrapping(arrays: Arrays, task: Task) -> None:
    arrays["times"] = (250 + np.arange(len(arrays["times"]))).astype(np.uint8)


def ages(arrays: Arrays, task: Task) -> None:
    arrays["times"] *= 1e300


def endless_clearance(arrays: Arrays, task: Task) -> None:
    arrays["clearance"][:] = np.inf


def huge_clearance(arrays: Arrays, task: Task) -> None:
    arrays["clearance"][:] = 1e9


def wide_clearance(arrays: Arrays, task: Task) -> None:
    arrays["clearance"] += 0.001


def wide_grippers(arrays: Arrays, task: Task) -> None:
    arrays["gripper_clearance"][:] = np.inf


def failed(arrays: Arrays, task: Task) -> None:
    says(arrays, outcome="plant failed", detail="a gripper stopped")


def touched(arrays: Arrays, task: Task) -> None:
    says(arrays, outcome="settled", detail="contact with the box")


def touched_at_last(arrays: Arrays, task: Task) -> None:
    says(arrays, outcome="contact")


def jumped_to_goal(arrays: Arrays, task: Task) -> None:
    """A run that ends on the way, its last keypoints those of the goal."""
    kept(arrays, slice(0, MIDDLE))
    arrays["keypoints"][-1] = task.goal


def laid_to_goal(arrays: Arrays, task: Task) -> None:
    """The same with all of the last row."""
    last = {name: arrays[name][-1].copy() for name in ROW if name != "times"}
    kept(arrays, slice(0, -25))
    for name, value in last.items():
        arrays[name][-1] = value


def settled_at_once(arrays: Arrays, task: Task) -> None:
    """A cable that is up to 20 mm beside where it was, but in the last row."""
    for name in ("centreline", "keypoints"):
        beside = 0.02 * np.sin(np.linspace(0, np.pi, arrays[name].shape[1]))
        arrays[name][:-1, :, 1] += beside


def one_point(arrays: Arrays, task: Task) -> None:
    arrays["centreline"] = arrays["centreline"][:, :1]


def far_away(arrays: Arrays, task: Task) -> None:
    arrays["centreline"][MIDDLE] = 1e300


def longer_than_double(arrays: Arrays, task: Task) -> None:
    arrays["keypoints"] = arrays["keypoints"].astype(np.longdouble)
    arrays["keypoints"][MIDDLE] = np.longdouble("1e4000")


def reversed_rows(arrays: Arrays, task: Task) -> None:
    for name in ROW[1:]:
        arrays[name] = arrays[name][::-1]


def swapped_grippers(arrays: Arrays, task: Task) -> None:
    arrays["poses"] = arrays["poses"][:, ::-1]


def line_aside(arrays: Arrays, task: Task) -> None:
    arrays["centreline"][:, :, 0] += 0.005


def every_second(arrays: Arrays, task: Task) -> None:
    times = arrays["times"]
    kept(arrays, slice(None, None, 2))
    arrays["times"] = times[: len(arrays["times"])]


def gap(arrays: Arrays, task: Task) -> None:
    kept(arrays, np.r_[0:30, 60 : len(arrays["times"])])


def still_cable(arrays: Arrays, task: Task) -> None:
    for name in ("centreline", "keypoints"):
        arrays[name][30:MIDDLE] = arrays[name][30]


def coil(arrays: Arrays, task: Task) -> None:
    """Smooth, of two turns, and as long as the cable."""
    angles = np.interp(np.linspace(0, 1, 240), [0, 0.25, 0.75, 1], [0, 0, 12 * np.pi, 12 * np.pi])
    steps = task.cable.length / 240 * np.column_stack([np.cos(angles), np.sin(angles)])
    line = arrays["centreline"][MIDDLE, 0] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    laid(arrays, slice(20, 60), np.array([along(line, arrays["centreline"].shape[1])] * 40))


def looped(arrays: Arrays, task: Task) -> None:
    """On the way a loop is laid into the cable, slowly and smoothly, and taken out again: it crosses itself."""
    inserted(arrays, 2 * np.pi, rows=320)


def hairpin(arrays: Arrays, task: Task) -> None:
    """On the way one gripper is laid on the other, the cable in a wide arc between them."""
    line = along(arrays["centreline"][-1], 400)
    apart = {angle: np.linalg.norm(np.diff(bent(line, angle)[[0, -1]], axis=0)) for angle in np.linspace(3, 6, 200)}
    inserted(arrays, min(apart, key=lambda angle: apart[angle]), rows=320)


def bent(line: np.ndarray, angle: float) -> np.ndarray:
    """A line whose direction turns by so much more in its middle."""
    steps, turns = np.diff(line, axis=0), angle * np.clip(2.5 * np.linspace(0, 1, len(line) - 1) - 0.75, 0, 1)
    c, s = np.cos(turns), np.sin(turns)
    turned_steps = np.column_stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]])
    return line[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(turned_steps, axis=0)])


def inserted(arrays: Arrays, angle: float, rows: int) -> None:
    """Rows before the last ones, in which the cable is bent by so much, and back; all else as it should be."""
    first = len(arrays["times"]) - 3
    line = along(arrays["centreline"][first], 400)
    angles = angle * np.sin(np.linspace(0, np.pi, rows)) ** 2
    lines = np.array([bent(line, each) for each in angles])
    new = {name: along(lines, arrays[name].shape[1]) for name in ("centreline", "keypoints")}
    poses = np.repeat(arrays["poses"][first : first + 1], rows, axis=0)
    poses[:, 1, :2] += lines[:, -1] - line[-1]
    poses[:, 1, 2] += angles
    new |= {"poses": poses, "clearance": np.full(rows, 1e-4), "gripper_clearance": np.full(rows, 1e-4)}
    for name in ROW:
        if name != "times":
            rest = np.repeat(arrays[name][first : first + 1], rows, axis=0)
            arrays[name] = np.insert(arrays[name], first, new.get(name, rest), axis=0)
    for name in STEP:
        arrays[name] = np.insert(arrays[name], first, np.repeat(arrays[name][-1:], rows, axis=0), axis=0)
    arrays["times"] = 0.1 * np.arange(len(arrays["poses"]))
    arrays["actions"] = np.diff(arrays["poses"], axis=0)


def no_clearance(arrays: Arrays, task: Task) -> None:
    arrays["clearance"][MIDDLE] = np.nan


def noisy(arrays: Arrays, task: Task) -> None:
    arrays["keypoints"][1:-1] += np.random.default_rng(0).normal(0, 0.003, arrays["keypoints"][1:-1].shape)


def stretched(arrays: Arrays, task: Task) -> None:
    for name in ("centreline", "keypoints"):
        arrays[name] = arrays[name][:, :1] + 1.03 * (arrays[name] - arrays[name][:, :1])


def straight_on(arrays: Arrays, task: Task) -> None:
    """Through the box."""
    share = np.linspace(0, 1, len(arrays["times"]))[:, None, None]
    for name in ("centreline", "keypoints", "poses"):
        arrays[name] = (1 - share) * arrays[name][0] + share * arrays[name][-1]


def degrees(arrays: Arrays, task: Task) -> None:
    arrays["poses"][:, :, 2] = np.degrees(arrays["poses"][:, :, 2])


def exchanged(arrays: Arrays, task: Task) -> None:
    for name in ("centreline", "keypoints", "poses"):
        arrays[name][[MIDDLE, MIDDLE + 4]] = arrays[name][[MIDDLE + 4, MIDDLE]]


def without_commands(arrays: Arrays, task: Task) -> None:
    arrays["actions"][:] = 0.0


def one_turn(arrays: Arrays, task: Task) -> None:
    arrays["poses"][MIDDLE:, :, 2] += 2 * np.pi


def slow(arrays: Arrays, task: Task) -> None:
    says(arrays, control_step=1000.0)
    arrays["times"] *= 1e4


def failed_at_last(arrays: Arrays, task: Task) -> None:
    arrays["status"] = np.array([*arrays["status"][:-1], "tracking" + THEN_FAILED])


def shrunk(arrays: Arrays, task: Task) -> None:
    arrays["centreline"][MIDDLE] = arrays["centreline"][MIDDLE, :1]


def pushed(arrays: Arrays, task: Task) -> None:
    """Away from the grippers by half the cable's length."""
    for name in ("centreline", "keypoints"):
        bump = np.sin(np.linspace(0, np.pi, arrays[name].shape[1])) ** 2
        arrays[name][20:60, :, 1] += task.cable.length / 2 * bump


def outcome_list(arrays: Arrays, task: Task) -> None:
    says(arrays, outcome=["settled"])


def brackets(arrays: Arrays, task: Task) -> None:
    arrays["metadata"] = np.array("[" * 100_000)


def complex_numbers(arrays: Arrays, task: Task) -> None:
    arrays["poses"] = arrays["poses"] + 0j


def numbered(arrays: Arrays, task: Task) -> None:
    arrays["status"] = np.zeros(len(arrays["status"]))


def negative_length(arrays: Arrays, task: Task) -> None:
    says(arrays, plant={"cable": {"length": -(10**400)}})


Forgery = Callable[[Arrays, Task], None]
FORGED: list[tuple[Forgery, str]] = [
    (eighth_rows, "time between rows"),
    (wad, "row off the way between its neighbours"),
    (wad, "kink"),
    (two_metres, "difference to the task's cable"),
    (bunched, "keypoints off their places along the cable"),
    (swapped_ends, "keypoints off their places along the cable"),
    (level, "grasp angle"),
    (half_a_turn, "grasp angle"),
    (spinning, "gripper turn"),
    (unsigned_falling, "rows out of time"),
    (unsigned_wrapping, "rows out of time"),
    (endless_clearance, "recorded cable clearance above that of its row"),
    (wide_clearance, "recorded cable clearance above that of its row"),
    (wide_grippers, "recorded gripper clearance above that of its row"),
    (failed, "failures recorded"),
    (touched, "failures recorded"),
    (touched_at_last, "failures recorded"),
    (jumped_to_goal, "keypoints off their places along the cable"),
    (laid_to_goal, "gripper step"),
    (settled_at_once, "cable step to the last row"),
    (reversed_rows, "distance to start"),
    (swapped_grippers, "grasp error"),
    (line_aside, "keypoints off their places along the cable"),
    (every_second, "grippers away from their commands"),
    (gap, "rows out of time"),
    (still_cable, "grasp error"),
    (coil, "bending"),
    (looped, "self-crossings"),
    (hairpin, "gripper separation"),
    (no_clearance, "recorded cable clearance"),
    (noisy, "keypoints off their places along the cable"),
    (stretched, "length error"),
    (straight_on, "cable clearance"),
    (degrees, "gripper turn"),
    (exchanged, "gripper step"),
    (without_commands, "grippers away from their commands"),
    (one_turn, "gripper turn"),
    (slow, "time between rows"),
    (failed_at_last, "failures recorded"),
    (shrunk, "length error"),
    (pushed, "distance from the rod"),
]
UNREADABLE: list[tuple[Forgery, str]] = [
    (ages, "times holds 1e+299; numbers of a record are at most 1e+06"),
    (huge_clearance, "clearance holds 1000000000.0; numbers of a record are at most 1e+06"),
    (one_point, "a centreline needs 2 points, got 1"),
    (far_away, "centreline holds 1e+300; numbers of a record are at most 1e+06"),
    (longer_than_double, "keypoints holds 1e+4000; numbers of a record are at most 1e+06"),
    (outcome_list, "outcome must be one of success, settled"),
    (brackets, "metadata: not JSON: nested too deeply"),
    (complex_numbers, "poses is not an array of numbers"),
    (numbered, "status holds numbers, not short texts"),
    (negative_length, "plant.cable.length must be positive and at most 1e+06 m, got -1"),
]


def test_the_true_rollout_is_accepted(rollout: Rollout, task: Task):
    assert judged(copied(rollout), task).passed


@pytest.mark.parametrize(("share", "passed"), [(1.3, True), (1.8, False)])
def test_a_cable_bends_no_more_sharply_than_it_may(rollout: Rollout, task: Task, share: float, passed: bool):
    """Within half as much again, for a true cable is not the one that the plan is for."""
    ways = np.diff(rollout.centreline, axis=1)
    angles = np.unwrap(np.arctan2(ways[..., 1], ways[..., 0]), axis=1)
    sharpest = np.abs(np.diff(angles, axis=1)).max() / np.linalg.norm(ways, axis=2).mean()
    cable = replace(task.cable, min_bend_radius=float(share / sharpest))
    object.__setattr__(bending := replace(task), "cable", cable)
    failures = {check.name for check in judged(copied(rollout), bending).failures()}
    assert failures == (set() if passed else {"sharpest bend"})


@pytest.mark.parametrize("kind", [np.float32, np.longdouble])
def test_so_it_is_in_numbers_of_another_kind(rollout: Rollout, task: Task, kind: type):
    arrays = copied(rollout)
    assert judged({n: a.astype(kind) if a.dtype.kind == "f" else a for n, a in arrays.items()}, task).passed


@pytest.mark.parametrize(("forge", "why"), FORGED)
def test_a_forgery_is_refused(rollout: Rollout, task: Task, forge: Forgery, why: str):
    arrays = copied(rollout)
    forge(arrays, task)
    assert why in {check.name for check in judged(arrays, task).failures()}


@pytest.mark.parametrize(("damage", "sentence"), UNREADABLE)
def test_what_cannot_be_a_record_is_not_read(rollout: Rollout, task: Task, damage: Forgery, sentence: str):
    arrays = copied(rollout)
    damage(arrays, task)
    with pytest.raises(InputError) as error:
        judged(arrays, task)
    assert str(error.value).removeprefix("forged.npz: ").startswith(sentence)
