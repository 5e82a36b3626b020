"""Projection: shapes in, equilibria at steps within limits out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import problems
import pytest

from cableway.core.errors import PlanningError
from cableway.geometry.groups import SE2
from cableway.motion.interpolation import rows_at
from cableway.planning.projection import (
    LEAST_PACE,
    LIMIT_SHARE,
    USUAL_RAMPS,
    ProjectionConfig,
    end_equilibria,
    fit_sequence,
    project,
    step_evenly,
)
from cableway.rod.lag import lag
from cableway.scene.task import CONTROL_STEP, Grippers


@pytest.fixture(scope="module")
def line():
    task = problems.free()
    return task, problems.line_in_q(task.cable.rod, problems.LOW_ARC, problems.HIGH_ARC, 30)


def test_shapes_of_equilibria_are_fitted_exactly(line):
    """Keypoints that come from equilibria lead back to them."""
    task, q = line
    rod = task.cable.rod
    shapes = rod.at_keypoints(rod.shapes(q)[0])
    fitted, rows = fit_sequence(rod, shapes, q[0], q[-1], row_step=0.012)
    wanted = rod.shapes(rows_at(q, rows))[0]
    assert np.abs(rod.shapes(fitted)[0] - wanted).max() < 2e-4
    assert rows[0] == 0
    assert rows[-1] == len(q) - 1
    assert (np.diff(rows) > 0).all()


def test_only_what_is_to_be_optimized_is_optimized(line):
    """ "fit" leaves the nearest equilibria as they are; "optimize" moves them, but not the ends."""
    task, q = line
    rod = task.cable.rod
    q = q + np.sin(np.linspace(0, np.pi, len(q)))[:, None] * [0.03, 0, 0, 0, 0, 0]
    shapes = rod.at_keypoints(rod.shapes(q)[0])
    fitted, optimized = (project(shapes, task, ProjectionConfig(kind=kind)) for kind in ("fit", "optimize"))
    ends = end_equilibria(task, ProjectionConfig())
    stepped, _ = step_evenly(fit_sequence(rod, shapes, *ends, 0.012)[0], task, ProjectionConfig())
    assert project(shapes, task, ProjectionConfig(kind="none")).q is None, "these are no equilibria"
    assert np.array_equal(fitted.shapes, rod.at_keypoints(rod.shapes(stepped)[0]))
    assert np.abs(optimized.shapes[len(optimized.shapes) // 2] - fitted.shapes[len(fitted.shapes) // 2]).max() > 0.005
    np.testing.assert_allclose(optimized.shapes[[0, -1]], fitted.shapes[[0, -1]], atol=1e-9)


def test_angles_run_on_through_a_full_turn(line):
    """A cable that turns once about itself ends a full turn from where it began, not at the same angle."""
    task, q = line
    turning = np.repeat(q[:1], 41, axis=0)
    turning[:, 2] += np.linspace(0, 2 * np.pi, 41)
    turning[:, :2] = 0.35
    shapes = task.cable.rod.at_keypoints(task.cable.rod.shapes(turning)[0])
    goal = turning[-1] - [0, 0, 2 * np.pi, 0, 0, 0]
    fitted, _ = fit_sequence(task.cable.rod, shapes, turning[0], goal, row_step=0.012)
    assert fitted[-1, 2] - fitted[0, 2] == pytest.approx(2 * np.pi, abs=1e-6)


@pytest.mark.parametrize("limits", [Grippers(), Grippers(max_step=0.004), Grippers(max_turn=0.01)])
def test_no_step_exceeds_its_share_of_the_limits(line, limits):
    """Whatever the limits, every row keeps to 70% of them, and the ends are kept."""
    task, q = line
    limited = replace(task, grippers=limits)
    stepped, at = step_evenly(q, limited, ProjectionConfig())
    poses = task.cable.rod.shapes(stepped)[1]
    move, turn = SE2.distance(poses[:-1], poses[1:])
    assert move.max() <= 0.7 * limits.max_step * (1 + 1e-6)
    assert turn.max() <= 0.7 * limits.max_turn * (1 + 1e-6)
    assert max(move.max() / limits.max_step, turn.max() / limits.max_turn) > 0.4
    assert np.allclose(stepped[[0, -1]], q[[0, -1]])
    assert (np.diff(at) > 0).all()


RAMPED = [
    {"max_acceleration": 0.5, "max_turn_acceleration": 5.0},
    {"max_acceleration": 0.5, "max_turn_acceleration": 5.0, "max_jerk": 5.0, "max_turn_jerk": 50.0},
    {"max_acceleration": 0.25, "max_turn_acceleration": 2.5, "max_jerk": 1.0, "max_turn_jerk": 10.0},
    {"max_jerk": 0.3},
    {"max_turn_acceleration": 0.5},
]


def test_without_limits_of_acceleration_a_motion_has_the_usual_ramps(line):
    """From rest to rest, as with those limits; shapes that are kept as they are go at equal effort."""
    task, q = line
    usual = replace(task, grippers=replace(task.grippers, **USUAL_RAMPS))
    np.testing.assert_array_equal(
        step_evenly(q, task, ProjectionConfig())[0], step_evenly(q, usual, ProjectionConfig())[0]
    )
    poses = project(task.cable.rod.at_keypoints(task.cable.rod.shapes(q)[0]), task, ProjectionConfig(kind="none")).poses
    moves = SE2.distance(poses[:-1], poses[1:])[0].max(axis=1)
    assert moves[0] > 0.9 * moves.max()


@pytest.mark.parametrize("limits", RAMPED)
@pytest.mark.parametrize("kind", ["rod", "none"])
def test_motion_starts_and_ends_at_rest_within_limits_of_acceleration_and_jerk(line, limits, kind):
    """Differences of the rows themselves keep 70% of every limit, from rest to rest, and little time is lost."""
    task, q = line
    # a corner in the middle, where the path itself asks for acceleration
    q = q + np.maximum(0.0, np.linspace(-1, 1, len(q)))[:, None] * [-0.1, 0.1, 0.5, 0, 0, 0]
    ramped = replace(task, grippers=Grippers(**limits))
    stepped, at = step_evenly(q, ramped, ProjectionConfig())
    poses = task.cable.rod.shapes(stepped)[1]
    if kind == "none":
        shapes = task.cable.rod.at_keypoints(task.cable.rod.shapes(q)[0])
        poses = project(shapes, ramped, ProjectionConfig(kind="none")).poses
    padded = np.pad(poses, ((3, 3), (0, 0), (0, 0)), mode="edge")
    largest = {}
    for order, name in ((2, "acceleration"), (3, "jerk")):
        change = np.diff(padded, order, axis=0) / CONTROL_STEP**order
        largest[f"max_{name}"] = np.linalg.norm(change[..., :2], axis=2).max()
        largest[f"max_turn_{name}"] = np.abs(change[..., 2]).max()
    shares = {name: largest[name] / most for name, most in limits.items()}
    assert max(shares.values()) <= LIMIT_SHARE * (1 + 1e-6)
    assert max(shares.values()) > 0.8 * LIMIT_SHARE
    move, turn = SE2.distance(poses[:-1], poses[1:])
    assert max(move.max() / Grippers().max_step, turn.max() / Grippers().max_turn) <= LIMIT_SHARE * (1 + 1e-6)
    assert np.allclose(stepped[[0, -1]], q[[0, -1]])
    assert (np.diff(at) > 0).all()


def test_ramps_on_a_straight_way_take_as_long_as_the_limits_ask(line):
    """One path, with limits of a cobot: a ramp at either end, and full speed in between."""
    task, q = line
    plain = step_evenly(q, replace(task, grippers=Grippers(max_acceleration=1e3)), ProjectionConfig())[1]
    limits = Grippers(max_acceleration=0.5, max_turn_acceleration=5.0)
    ramped = step_evenly(q, replace(task, grippers=limits), ProjectionConfig())[1]
    # from 0 to 93 mm/s and back at 350 mm/s²: half of 2 x 0.27 s longer, and a row for the last part of a step
    assert len(plain) < len(ramped) <= len(plain) + 4


def test_a_sluggish_cable_is_not_left_behind():
    """With quick grippers the lag sets the pace; a cable that does not lag goes as fast as they do."""
    task = replace(problems.free(), grippers=Grippers(max_step=0.04, max_turn=0.4))
    q = np.linspace([0.3, 0.3, 0.2, 3.0, 9.0, -1.5], [0.4, 0.35, -0.4, -24.0, 9.0, 1.5], 31)
    config = ProjectionConfig()
    stepped, _ = step_evenly(q, task, config)
    trailing = lag(task.cable.rod, stepped) * config.damping_time / CONTROL_STEP
    assert trailing.max() == pytest.approx(LIMIT_SHARE * config.lag, rel=0.1)
    brisk, _ = step_evenly(q, task, replace(config, damping_time=0.0))
    assert len(brisk) < len(stepped)


def test_an_end_that_is_no_shape_of_the_cable_is_refused():
    """Three bends of one side, other side, one side, unevenly spaced: no equilibrium has them."""
    task = problems.free()
    fine = np.linspace(0, task.cable.length, 1201)
    angle = 1.2 * np.sin(2 * np.pi * (fine / fine[-1]) ** 2 * 1.75)
    curve = np.cumsum(np.column_stack([np.cos(angle), np.sin(angle)]), axis=0) * (fine[1] - fine[0])
    odd = replace(task, goal=curve[::100] + [0.2, 0.4])
    with pytest.raises(PlanningError, match="the goal is not an equilibrium of the cable"):
        end_equilibria(odd, ProjectionConfig())


def test_a_cable_with_little_slack_is_drawn_along_slowly():
    """In no step more than 70% of its slack, so that a gripper that stalls does not pull it out."""
    task = problems.free()
    taut = np.linspace([0.1, 0.3, 0.0, 0.0, 5.0, 0.0], [0.3, 0.3, 0.0, 0.0, 5.0, 0.0], 31)
    limp = np.linspace([0.1, 0.3, 0.0, 0.0, 60.0, 0.0], [0.3, 0.3, 0.0, 0.0, 60.0, 0.0], 31)
    paces = []
    for q in (taut, limp):
        stepped, _ = step_evenly(q, task, ProjectionConfig())
        poses = task.cable.rod.shapes(stepped)[1]
        slack = task.cable.length - np.linalg.norm(poses[:, 1, :2] - poses[:, 0, :2], axis=1).max()
        move = SE2.distance(poses[:-1], poses[1:])[0].max()
        assert move <= 1.05 * LIMIT_SHARE * max(slack, LEAST_PACE * task.grippers.max_step)
        paces.append(move / task.grippers.max_step)
    assert paces[0] < 0.5 * paces[1]
