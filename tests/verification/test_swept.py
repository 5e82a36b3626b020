"""The least distance of a motion is that of dense sampling, with Shapely's distance one polyline at a time."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
import shapely

from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.tasks.generation import random_task
from cableway.verification.bodies import to_outline
from cableway.verification.swept import SWEEP_STEP, closest_approach, to_scene

PIECES = 64


def dense_distance(lines: np.ndarray, scene: Scene) -> float:
    """Least distance over `PIECES` in-betweens of each section, to what the motion does not cut."""
    frame = shapely.box(0, 0, *scene.size).exterior
    least = np.inf
    for before, after in pairwise(lines):
        for f in np.linspace(0, 1, PIECES + 1):
            line = shapely.LineString(before + f * (after - before))
            least = min(least, line.distance(frame), *(line.distance(solid) for solid in scene.solids))
    return least


@pytest.mark.parametrize("kind", ["clutter", "maze"])
def test_the_closest_approach_is_that_of_dense_sampling(kind: str):
    """Of motions that go straight from start to goal, as far as they touch nothing."""
    task = random_task(4, kind)
    rng = np.random.default_rng(0)
    compared = 0
    for _ in range(12):
        end = task.start + rng.normal(0, 0.02, 2) + rng.normal(0, 0.004, task.start.shape)
        lines = np.array([task.start, (task.start + end) / 2 + rng.normal(0, 0.003, end.shape), end])
        wanted = dense_distance(lines, task.scene)
        found = closest_approach(lines, to_scene(task.scene))
        if wanted > 0:
            compared += 1
            assert wanted - 1e-9 <= found.distance + SWEEP_STEP / 2
            assert found.distance <= wanted + SWEEP_STEP / 2
            at = np.interp(found.row, [0, 1, 2], [0, 1, 2])
            line = lines[int(at)] + (at - int(at)) * (lines[min(int(at) + 1, 2)] - lines[int(at)])
            if found.obstacle < len(task.scene.solids):
                there = shapely.LineString(line).distance(task.scene.solids[found.obstacle])
                assert there == pytest.approx(found.distance, abs=1e-9)
    assert compared >= 4


def test_the_depth_of_what_is_cut_is_negative():
    task = random_task(4, "clutter")
    solid = max(task.scene.solids, key=lambda solid: solid.area)
    (x, y), *_ = shapely.get_coordinates(solid.centroid)
    lines = np.array([[[x - 0.01, y], [x, y], [x + 0.01, y]]] * 2)
    found = closest_approach(lines, to_scene(task.scene))
    assert found.distance == pytest.approx(-solid.exterior.distance(shapely.Point(x, y)))
    assert task.scene.solids[found.obstacle].equals(solid)


def test_what_is_passed_between_two_rows_is_met():
    line = np.array([[0.3, 0.3], [0.3, 0.4]])
    post = Scene((0.7, 0.7), (Disc(center=(0.33, 0.35), radius=0.003),))
    found = closest_approach(np.array([line, line + [0.06, 0.0]]), to_scene(post))
    assert found.distance <= 0
    assert found.row == pytest.approx(0.5, abs=0.1)


def test_two_that_pass_each_other_between_two_rows_are_met():
    """Each moves half the way, so that they come nearer twice as fast as either moves."""
    square = np.array([[0.0, 0.0], [0.01, 0.0], [0.01, 0.01], [0.0, 0.01], [0.0, 0.0]])
    rows = np.array([[square + [x, 0.0], square + [0.1 - x, 0.0]] for x in (0.0, 0.1)]).reshape(2, 10, 2)
    found = closest_approach(rows, partial(to_outline, split=5), rate=2.0)
    assert found.distance <= 0
