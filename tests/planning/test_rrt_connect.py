"""The search among equilibria: what it returns is free, and it is the same for the same seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import problems
import pytest
import shapely

from cableway.core.errors import InputError, PlanningError
from cableway.motion import kernels
from cableway.planning.planner import plan
from cableway.planning.rrt_connect import (
    CORRIDOR,
    LOAD_SPREAD,
    MARGINS,
    TUBE,
    RRTConnectConfig,
    about_path,
    about_shapes,
    anywhere,
    rrt_connect_path,
)

CONFIG = RRTConnectConfig()


@pytest.mark.parametrize("name", problems.SOLVABLE)
def test_every_shape_on_the_way_is_free_and_stable(name):
    """Clearance judged with Shapely, between the rows too; ends at start and goal."""
    task = problems.SOLVABLE[name]()
    q = rrt_connect_path(task, anywhere(task), CONFIG)
    rod = task.cable.rod
    np.testing.assert_allclose(q[0], task.start_equilibrium)
    np.testing.assert_allclose(rod.shapes(q[-1:])[0], rod.shapes(task.goal_equilibrium[None])[0], atol=1e-9)
    between = 0.5 * (q[:-1] + q[1:])
    for rows in (q, between):
        stations, poses = rod.shapes(rows)
        lines = shapely.linestrings(stations)
        gaps = [np.asarray(shapely.distance(lines, solid)).min() for solid in task.scene.solids]
        assert min(gaps, default=1.0) > task.cable.radius + 0.8 * MARGINS.clearance
        assert rod.stability(rows)[0].min() > 0.8 * MARGINS.stability
        assert shapely.is_simple(lines).all()
        assert (np.linalg.norm(poses[:, 1, :2] - poses[:, 0, :2], axis=1) < 0.99 * rod.length).all()


def test_keeps_the_grippers_apart_and_the_bends_wide():
    """Limits that only some tasks have: without them the search breaks both here."""
    free = problems.doorway()
    rod = free.cable.rod

    def extremes(task):
        q = rrt_connect_path(task, anywhere(task), CONFIG, seed=1)
        stations, poses = rod.shapes(q)
        turns = [kernels.sharpest_turn(row, rod.length) for row in stations]
        return np.linalg.norm(poses[:, 1, :2] - poses[:, 0, :2], axis=1).min(), max(turns) * rod.hinges / rod.length

    apart, sharpest = extremes(free)
    assert apart < 0.26
    assert sharpest > 1 / 0.08
    cable, grippers = replace(free.cable, min_bend_radius=0.08), replace(free.grippers, separation=0.26)
    apart, sharpest = extremes(replace(free, cable=cable, grippers=grippers))
    assert apart >= 0.26
    assert sharpest <= 1 / 0.08 + 0.1  # the sine of a turn is a little less than the turn


def test_rows_are_near_each_other():
    task = problems.doorway()
    q = rrt_connect_path(task, anywhere(task), CONFIG)
    moves = np.linalg.norm(np.diff(task.cable.rod.shapes(q)[0], axis=0), axis=2).max(1)
    assert moves.max() < 2 * CONFIG.step


def test_same_seed_same_way_and_another_seed_another():
    task = problems.doorway()
    first, again, other = (rrt_connect_path(task, anywhere(task), CONFIG, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_behind_a_wall_the_samples_are_used_up():
    task = problems.sealed()
    config = RRTConnectConfig(samples=400)
    with pytest.raises(PlanningError, match="400 samples"):
        rrt_connect_path(task, anywhere(task), config)


def test_samples_lie_where_they_are_asked_for():
    """About a path the centres do, about shapes all coordinates do; loads spread at least as configured."""
    task, rng = problems.free(), np.random.default_rng(0)
    path = np.array([[0.2, 0.3], [0.4, 0.3]])
    rows = about_path(task, path)(rng, 4000)
    off = rows[:, None, :2] - path
    assert np.sqrt(np.mean(np.min(np.sum(off**2, axis=2), axis=1) / 2)) == pytest.approx(CORRIDOR, rel=0.15)
    assert (rows[:, 3:].std(0) > 0.9 * np.array(LOAD_SPREAD)).all()
    near = about_shapes(task.start_equilibrium[None])(rng, 4000) - task.start_equilibrium
    np.testing.assert_allclose(near.std(0), np.array(TUBE) * np.sqrt(4 / 3), rtol=0.1)


def test_self_crossing_agrees_with_shapely():
    rod = problems.free().cable.rod
    rng = np.random.default_rng(0)
    stations = rod.shapes(np.column_stack([np.zeros((300, 3)), rng.normal(0, [30, 30, 8], (300, 3))]))[0]
    crossed = np.array([kernels.crosses_itself(row) for row in stations])
    simple = shapely.is_simple(shapely.linestrings(stations[:, ::2]))
    assert np.array_equal(crossed, ~simple)
    assert 20 < crossed.sum() < 280


def test_the_plan_names_the_guide_and_shows_its_paths():
    found = plan(problems.doorway())
    assert found.metadata["initial_trajectory"] == "corridor"
    np.testing.assert_allclose(found.shapes[0], problems.doorway().start, atol=1e-3)
    np.testing.assert_allclose(found.shapes[-1], problems.doorway().goal, atol=1e-3)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"samples": 0}, r"rrt_connect\.samples must be from 1 to 1e\+07, got 0"),
        ({"step": float("nan")}, r"rrt_connect\.step must be from"),
        ({"step": 1.1}, r"rrt_connect\.step must be from"),
    ],
)
def test_a_bad_configuration_is_refused(values, message):
    with pytest.raises(InputError, match=message):
        RRTConnectConfig(**values)
