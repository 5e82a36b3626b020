"""Laws of moved ends: only what cannot be held is moved, by little, to where bodies and arms can be."""

from dataclasses import replace

import numpy as np
import pytest

import cableway as cw
from cableway.cli.planning import PlanOptions
from cableway.core.errors import TaskError
from cableway.planning.moved_ends import move_ends, set_up
from cableway.robot.branches import common_ways, end_fault
from cableway.scene.cell import CELLS
from cableway.scene.clearance import clearances
from cableway.scene.obstacles import Disc
from cableway.scene.task import Draft, End

CELL = CELLS["dual-ur5e"]


def with_post(end: End) -> Draft:
    """A task whose left hand is in a post at one end, which the cable does not touch."""
    task = cw.load_task("single-obstacle-2")
    x, y, angle = task.gripper_poses(end)[0]
    post = Disc(center=(x - 0.02 * np.sin(angle), y + 0.02 * np.cos(angle)), radius=0.005)
    return replace(task.unchecked(), scene=replace(task.scene, obstacles=(*task.scene.obstacles, post)))


def test_a_hand_in_an_obstacle_is_moved_out_of_it_and_nothing_else():
    with pytest.raises(TaskError, match=r"goal has its left gripper in obstacles\[0\]"):
        set_up("maze-1", "dual-ur5e")
    moved = set_up("maze-1", "dual-ur5e", move=True)
    designed, task = cw.load_task("maze-1"), moved.task
    off = np.linalg.norm(task.goal - designed.goal, axis=1).max()
    np.testing.assert_allclose(moved.moved["goal"], off, atol=1e-3)  # from the equilibrium nearest to the goal
    assert moved.moved["goal"] < 0.008
    np.testing.assert_array_equal(task.goal, task.goal.round(6))  # the same on processors whose last digits differ
    np.testing.assert_array_equal(task.start, designed.start)
    assert clearances(task.goal[None], task.gripper_poses("goal")[None], task).min() > 0.0045
    assert end_fault(task, CELL) is None
    (note,) = moved.notes()
    assert note.startswith("The goal was moved by 5")
    assert note.endswith("because it has its left gripper in obstacles[0] (box at (350, 550) mm) by 1.0 mm.")


def test_ends_that_can_be_held_stay_where_they_are():
    task = cw.load_task("single-obstacle-1").in_cell(CELL)
    assert not move_ends(task).moved
    assert move_ends(task).task == task


def test_an_end_out_of_reach_of_the_arms_is_moved_into_it():
    task = cw.load_task("single-obstacle-1").in_cell(CELL)
    apart = tuple(replace(arm, position=(1.85 * arm.position[0], 0.0, 0.15)) for arm in CELL.arms)
    task = replace(task, cell=replace(CELL, arms=apart))
    assert task.cell is not None
    fault = end_fault(task, task.cell)
    assert fault is not None
    moved = move_ends(task)
    assert moved.reasons == {"start": fault.reason.removeprefix("at the start, ")}
    assert 0 < moved.moved["start"] < 0.012
    assert end_fault(moved.task, task.cell) is None


def test_an_end_that_is_wrong_in_itself_is_refused():
    task = cw.load_task("single-obstacle-1").unchecked()
    with pytest.raises(TaskError, match="long, more than"):
        move_ends(replace(task, start=1.1 * np.asarray(task.start)))


def test_report_and_plan_say_what_was_moved():
    draft = with_post("start").in_cell(CELL)
    with pytest.raises(TaskError, match="start has its left gripper in"):
        draft.checked()
    moved = move_ends(draft)
    assert set(moved.moved) == {"start"}
    run = cw.solve(moved, cw.SolveOptions(track=False, time_limit=300.0))
    assert run.plan is not None
    assert run.plan.metadata["moved_ends"] == dict(moved.moved)
    assert moved.notes()[0] in run.report.notes


def test_the_option_of_the_command_moves_ends():
    options = PlanOptions(task="maze-1", cell="dual-ur5e", move_ends=True)
    assert options.load() is options.moved.task
    assert set(options.moved.moved) == {"goal"}


def test_both_ends_are_moved_into_the_way_in_which_arms_follow_a_slid_cable():
    moved = set_up("real-maze", "dual-ur5e-tilted-aside", move=True)
    assert 0.008 < moved.moved["start"] < 0.016
    assert 0.003 < moved.moved["goal"] < 0.01
    assert moved.task.cell is not None
    way = moved.task.cell.way
    assert way is not None
    assert (way.holders, way.branches) == ((0, 1), (5, 2))
    assert common_ways(moved.task, moved.task.cell) == (way,)


def test_a_goal_before_a_port_is_moved_and_the_plug_stays_before_it():
    moved = set_up("insertion", "dual-ur5e", move=True)
    assert moved.reasons["goal"].startswith("it has its left gripper in obstacles[2]")
    assert 0.004 < moved.moved["goal"] < 0.012
    assert end_fault(moved.task, CELL) is None
    with pytest.raises(TaskError, match="has its left gripper in"):
        set_up("insertion", "dual-ur5e")
