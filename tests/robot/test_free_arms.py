"""Laws of the arms that a search sees: their room is that of the cell's kinematics, and plans keep it."""

from dataclasses import replace

import numpy as np
import pytest

import cableway as cw
from cableway.core.errors import PlanningError
from cableway.motion.limits import Margins
from cableway.motion.validity import FreeSpace
from cableway.planning import candidates
from cableway.planning.candidates import Search
from cableway.planning.config import PlannerConfig
from cableway.robot.branches import common_ways
from cableway.robot.cell_kinematics import CellKinematics
from cableway.robot.free_arms import LEAST, ROOM, free_arms, room_shortfall, rooms
from cableway.scene.cell import CELLS, Way

CELL = CELLS["dual-ur5e"]
ELBOW = 2  # the one joint of a UR that turns by less than half a turn to either side
ALL = np.full(ROOM, 10.0)


@pytest.fixture(scope="module")
def narrow() -> cw.Task:
    """A task whose first plan for grippers alone has its arms in each other: bases 1 m apart and beside each other."""
    places = ((-0.5, -0.08, 0.15), (0.5, 0.08, 0.15))
    arms = tuple(replace(arm, position=place) for arm, place in zip(CELL.arms, places, strict=True))
    return cw.load_task("multi-obstacle-2").in_cell(replace(CELL, arms=arms))


def ends_of(task: cw.Task) -> np.ndarray:
    return task.cable.rod.shapes(np.array([task.start_equilibrium, task.goal_equilibrium]))[1]


def ways_of(task: cw.Task) -> tuple[Way, ...]:
    assert task.cell is not None
    ways = common_ways(task, task.cell)
    assert isinstance(ways, tuple)
    return ways


def test_room_is_what_the_kinematics_of_the_cell_leave(narrow: cw.Task):
    poses = ends_of(narrow)
    for way in ways_of(narrow)[:3]:
        arms = free_arms(narrow.held(way), poses[:0])
        assert arms is not None
        kinematics = CellKinematics(narrow, way)
        joints, away = kinematics.held(poses, np.zeros((2, 6)))
        found = rooms(poses, arms)
        clearances, turns = kinematics.room(joints)
        np.testing.assert_allclose(found[:, [0, 3]], away, atol=1e-12)
        np.testing.assert_allclose(found[:, [1, 4, 6]], clearances, atol=1e-12)
        np.testing.assert_allclose(found[:, [2, 5]], turns[:, :, ELBOW], atol=1e-12)
    assert free_arms(narrow, poses) is None, "how arms hold the cable is open"
    far = poses + np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert (rooms(far, arms) == -1).all()


def test_slopes_of_the_room_match_differences(narrow: cw.Task):
    poses = ends_of(narrow)
    arms = free_arms(narrow.held(ways_of(narrow)[0]), poses[:0])
    assert arms is not None
    slopes = room_shortfall(poses, arms, ALL)[1]
    for side in range(2):
        for k in range(3):
            step = np.zeros((2, 3))
            step[side, k] = 1e-5
            ahead, behind = (room_shortfall(poses + sign * step, arms, ALL)[0] for sign in (1, -1))
            np.testing.assert_allclose(slopes[:, :, side, k], (ahead - behind) / 2e-5, atol=2e-3)
    assert not room_shortfall(poses, arms, np.full(ROOM, -2.0))[1].any()


def test_a_shape_is_free_only_where_the_arms_can_be(narrow: cw.Task):
    way = ways_of(narrow)[0]
    q = narrow.start_equilibrium + np.linspace(0, np.pi, 60)[:, None] * np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    grippers, arms = (FreeSpace.of(task, Margins()).are_free(q) for task in (narrow, narrow.held(way)))
    held = free_arms(narrow.held(way), ends_of(narrow))
    assert held is not None
    kept = (rooms(narrow.cable.rod.shapes(q)[1], held) >= held[2]).all(axis=1)
    assert (arms == grippers & kept).all()
    assert arms[0]
    assert (grippers & ~arms).any()


def test_a_search_that_sees_the_arms_plans_what_they_cannot_follow_otherwise(
    narrow: cw.Task, monkeypatch: pytest.MonkeyPatch
):
    plan = cw.plan(narrow, config=PlannerConfig(initial_trajectories=("corridor", "anywhere")))
    way = Way.of_record(plan.metadata)
    assert way is not None
    arms = free_arms(narrow.held(way), plan.poses[:0])
    assert arms is not None
    assert (rooms(plan.poses, arms) >= LEAST - 1e-9).all()
    monkeypatch.setattr(Search, "_held", lambda *_: [])
    monkeypatch.setattr(candidates, "_in_its_way", lambda task: task)
    with pytest.raises(PlanningError, match="the arms come"):
        cw.plan(narrow, config=PlannerConfig(initial_trajectories=("corridor",)))
