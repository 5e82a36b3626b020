"""Local replanning leaves only what is not free, and makes a plan of a trajectory that is all but one."""

from __future__ import annotations

import numpy as np
import problems
import pytest

from cableway.benchmark.suites import make_task
from cableway.core.errors import PlanningError
from cableway.motion.validity import FreeSpace
from cableway.planning.config import PlannerConfig
from cableway.planning.local_replanning import replan_locally
from cableway.planning.planner import plan
from cableway.planning.projection import ProjectionConfig
from cableway.planning.rrt_connect import MARGINS, RRTConnectConfig
from cableway.scene.obstacles import Disc
from cableway.scene.task import Task

CONFIG = RRTConnectConfig()


def grazing() -> Task:
    """A post that the straight line in q leads the cable over."""
    return problems.task_between(problems.LOW_ARC, problems.MOVED_ARC, (Disc(center=(0.3, 0.4), radius=0.01),))


def across(task) -> np.ndarray:
    """Straight from start to goal, whatever lies in between."""
    return problems.line_in_q(task.cable.rod, task.start_equilibrium, task.goal_equilibrium, 60)


def moves(task, q: np.ndarray) -> np.ndarray:
    """Largest move of a keypoint from row to row [m]."""
    return np.linalg.norm(np.diff(task.cable.rod.at_keypoints(task.cable.rod.shapes(q)[0]), axis=0), axis=2).max(1)


def test_leaves_the_sequence_only_where_it_is_not_free():
    task = grazing()
    given = across(task)
    blocked = np.flatnonzero(~FreeSpace.of(task, MARGINS).are_free(given))
    assert len(blocked) > 5
    q, places = replan_locally(given, task, CONFIG)
    assert FreeSpace.of(task, MARGINS).are_free(q).all()
    assert (places[0], places[-1]) == (0, len(given) - 1)
    assert (np.diff(places) > 0).all()
    far = (places < blocked[0] - 10) | (places > blocked[-1] + 10)
    assert 0.1 < far.mean() < 0.9
    on_line = given[0] + (places / (len(given) - 1))[:, None] * (given[-1] - given[0])
    np.testing.assert_allclose(q[far], on_line[far], atol=1e-9)
    assert np.abs(q - on_line).max() > 0.05
    assert moves(task, q).max() < 2 * CONFIG.step


def test_what_is_free_needs_no_repair():
    task = problems.moved()
    with pytest.raises(PlanningError, match="nothing to replan"):
        replan_locally(across(task), task, CONFIG)


def test_the_same_seed_gives_the_same_way():
    task = grazing()
    one, again, other = (replan_locally(across(task), task, CONFIG, seed=seed)[0] for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, again)
    assert one.shape != other.shape or not np.array_equal(one, other)


def test_a_wall_without_a_door_is_not_got_round():
    task = problems.sealed()
    with pytest.raises(PlanningError, match="no path was found around rows"):
        replan_locally(across(task), task, CONFIG)


def test_progress_can_stop_it():
    def stop(share: float) -> None:
        raise KeyboardInterrupt

    task = grazing()
    with pytest.raises(KeyboardInterrupt):
        replan_locally(across(task), task, CONFIG, progress=stop)


def test_a_corner_that_refinement_cannot_turn_is_repaired():
    task = make_task("maze-20067@0.07")
    optimized = PlannerConfig(initial_trajectories=("slide-head",), projection=ProjectionConfig(kind="optimize"))
    close = plan(task, config=optimized).metadata["planner"]["projection"]["optimization"]
    assert close["room"] == close["margin"]
    found = plan(task, config=PlannerConfig(initial_trajectories=("slide-head",)))
    assert found.metadata["planner"]["projection"]["optimization"]["room"] > close["margin"]
    assert found.metadata["initial_trajectory"] == "slide-head"
