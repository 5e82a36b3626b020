"""Slopes of the costs of bodies: as differences have them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cableway.motion import terms
from cableway.motion.limits import Margins
from cableway.motion.validity import FreeSpace, task_ends
from cableway.scene.clearance import bodies_gap, body_clearance, cable_gap
from cableway.scene.gripper_bodies import BodyPart
from cableway.scene.obstacles import Box, Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.tasks.generation import random_task

STEP = 1e-7


@pytest.fixture(scope="module")
def task() -> Task:
    """One with a 2F-85."""
    return next(task for seed in range(9) if (task := random_task(seed, "posts")).grippers.body == "2f-85")


@pytest.fixture(scope="module")
def shapes(task: Task) -> np.ndarray:
    """Shapes whose grippers come near to each other and to the cable."""
    start, rng = task_ends(task)[0], np.random.default_rng(1)
    q = start + rng.normal(size=(4000, 6)) * [0.0, 0.0, 0.3, 12, 12, 3]
    stations, poses = task.cable.rod.shapes(q)
    gaps = bodies_gap(task.body_pairs, poses), cable_gap(task.bodies, stations, poses, task.cable, 0.02)
    return np.concatenate([q[np.abs(gap) < 0.015][:12] for gap in gaps])


def test_bodies_push_each_other_apart(task: Task, shapes: np.ndarray):
    poses = task.cable.rod.shapes(shapes)[1]
    short, slope = terms.bodies_shortfall(task.body_pairs, poses, 0.02)
    assert (short > 0).any()
    for side in range(2):
        for k in range(3):
            moved = [poses.copy(), poses.copy()]
            moved[0][:, side, k] -= STEP
            moved[1][:, side, k] += STEP
            low, high = (
                0.5 * (terms.bodies_shortfall(task.body_pairs, each, 0.02)[0] ** 2).sum(axis=1) for each in moved
            )
            np.testing.assert_allclose((high - low) / (2 * STEP), (slope[:, :, side, k] * short).sum(1), atol=2e-5)


def test_the_cable_is_pushed_from_under_a_body(task: Task, shapes: np.ndarray):
    rod = task.cable.rod
    stations, dstations, poses, dposes = rod.jacobians(shapes)
    short, which, by_points, by_poses = terms.cable_shortfall(stations, poses, task, 0.02)
    assert (short > 0).any()
    slope = np.einsum("tsk,tski->tsi", by_points, dstations[:, which]) + np.einsum("tckj,tkji->tci", by_poses, dposes)
    for k in range(6):
        costs = []
        for sign in (-1, 1):
            q = shapes.copy()
            q[:, k] += sign * STEP
            costs.append(0.5 * (terms.cable_shortfall(*rod.shapes(q), task, 0.02)[0] ** 2).sum(axis=1))
        np.testing.assert_allclose((costs[1] - costs[0]) / (2 * STEP), (slope[:, :, k] * short).sum(1), atol=2e-5)


def test_a_body_over_the_cable_alone_forbids(task: Task):
    """Shapes that are free for discs, with a low bar across each end: free where the cable keeps off the bars."""
    bar = BodyPart(
        outline=np.array([[-0.01, -0.06], [0.01, -0.06], [0.01, 0.06], [-0.01, 0.06]]), heights=(0.002, 0.01)
    )
    empty = Scene((0.8, 0.8), (), 0.001)
    discs, bars = (replace(task, scene=empty, grippers=replace(task.grippers, body=body)) for body in (None, (bar,)))
    margins, rng = Margins(stability=0.0), np.random.default_rng(2)
    q = task_ends(task)[0] + rng.normal(size=(20000, 6)) * [0, 0, 0.3, 20, 20, 6]
    q = q[FreeSpace.of(discs, margins).are_free(q)]
    stations, poses = task.cable.rod.shapes(q)
    q, stations, poses = (each[bodies_gap(bars.body_pairs, poses) > 0.01] for each in (q, stations, poses))
    off, free = (
        cable_gap(bars.bodies, stations, poses, task.cable, margins.clearance),
        FreeSpace.of(bars, margins).are_free(q),
    )
    assert (off < margins.clearance - 1e-3).sum() > 5
    assert not free[off < margins.clearance - 1e-3].any()
    assert free[off > margins.clearance + 1e-3].all()


@pytest.mark.parametrize(
    "post",
    [
        Disc(center=(0.4, 0.46), radius=0.002, height=0.2),  # fits into an outline
        Box(center=(0.4, 0.3), size=(0.01, 0.58), height=0.2),  # its first vertex is far away
    ],
)
def test_a_post_that_a_hand_touches_alone_forbids(task: Task, post: Disc | Box):
    """Shapes that are free for discs: free for hands where those keep off the post."""
    start = task_ends(task)[0]
    moved, rng = start.copy(), np.random.default_rng(3)
    moved[:2] = 0.4, 0.6
    discs, hands = (replace(task, grippers=replace(task.grippers, body=body)) for body in (None, "2f-85"))
    discs, hands = (each.in_scene(Scene((0.8, 0.8), (post,), 0.001)) for each in (discs, hands))
    margins = Margins(stability=0.0)
    q = moved + rng.normal(size=(20000, 6)) * [0.1, 0.1, 1.5, 6, 6, 2]
    q = q[FreeSpace.of(discs, margins).are_free(q)]
    stations, poses = task.cable.rod.shapes(q)
    off = cable_gap(hands.bodies, stations, poses, task.cable, margins.clearance)
    clear = np.minimum(bodies_gap(hands.body_pairs, poses), off) > margins.clearance + 1e-3
    room = np.min([body_clearance(body, poses, hands.scene) for body in hands.outer_bodies], axis=0)
    free, near = FreeSpace.of(hands, margins).are_free(q), room < margins.clearance - 1e-4
    assert (clear & near).sum() > 50
    assert not free[near].any()
    assert free[clear & (room > margins.clearance + 1e-4)].all()


def test_free_shapes_keep_bodies_from_each_other_and_from_the_cable(task: Task, shapes: np.ndarray):
    margins = Margins(stability=0.0)
    free = FreeSpace.of(task, margins).are_free(shapes)
    stations, poses = task.cable.rod.shapes(shapes)
    apart = bodies_gap(task.body_pairs, poses)
    off = cable_gap(task.bodies, stations, poses, task.cable, margins.clearance)
    assert np.minimum(apart, off)[free].min(initial=np.inf) > margins.clearance - 5e-4
    assert (~free & (np.minimum(apart, off) < 0)).any()
