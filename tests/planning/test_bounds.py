"""No stage of planning takes time or memory without bound, however large the task or small the step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info

import cableway as cw
from cableway.core.errors import PlanningError
from cableway.core.time_limit import OutOfTime, time_limit
from cableway.motion import time_parametrization
from cableway.motion.banded_least_squares import squared_differences
from cableway.motion.interpolation import MOST_STATIONS, evenly_moved
from cableway.motion.time_parametrization import MOST_ROWS, require_rows, with_ramps
from cableway.outcome import Outcome
from cableway.planning import candidates, rrt_connect
from cableway.planning.config import PivotConfig
from cableway.planning.projection import USUAL_RAMPS, ProjectedTrajectory, ProjectionConfig, project
from cableway.planning.routes import pivot_grid
from cableway.planning.routes.infeasibility import find_blockage
from cableway.planning.routes.passages import find_passages
from cableway.planning.routes.pivot_grid import REFINEMENTS, WORK, WORK_OF_NODE, finest_spacing, grid_path
from cableway.rod.continuation import lead
from cableway.rod.inverse import fit_sequence
from cableway.scene.obstacles import Box, Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.verification import verify_plan

TASK = cw.load_task("single-obstacle-1")


@pytest.fixture(scope="module")
def plan() -> cw.Plan:
    return cw.plan(TASK)


def search(task: Task) -> object:
    config = rrt_connect.RRTConnectConfig()
    return rrt_connect.rrt_connect_path(task, rrt_connect.anywhere(task), config)


STAGES: dict[str, Callable[[cw.Plan], object]] = {
    "pivot path": lambda plan: grid_path(TASK.scene, TASK.start[6], TASK.goal[6], 0.004, PivotConfig()),
    "search": lambda plan: search(TASK),
    "passages": lambda plan: find_passages(TASK.scene),
    "infeasibility": lambda plan: find_blockage(cw.random_task(0, "blocked"), 0.004),
    "fit": lambda plan: fit_sequence(TASK.cable.rod, plan.shapes, TASK.start_equilibrium),
    "projection": lambda plan: project(plan.shapes, TASK, ProjectionConfig()),
    "time parametrisation": lambda plan: with_ramps(
        np.arange(9.0), np.ones(8), 1.0, lambda at: np.zeros((len(at), 2, 3)), replace(TASK.grippers, **USUAL_RAMPS)
    ),
    "leading": lambda plan: lead(TASK.cable.rod, plan.q[0], plan.poses),  # pyright: ignore[reportOptionalSubscript]
    "verification": lambda plan: verify_plan(plan, TASK),
}


@pytest.mark.parametrize("stage", STAGES)
def test_every_stage_looks_at_the_clock(plan: cw.Plan, stage: str):
    with pytest.raises(OutOfTime), time_limit(lambda: True):
        STAGES[stage](plan)


def test_verification_leaves_linear_algebra_to_one_thread(plan: cw.Plan):
    """Of many threads, all but one would only count as processor time, and wait."""
    found: list[int] = []

    def look() -> bool:
        found.extend(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")
        return False

    with time_limit(look):
        verify_plan(plan, TASK)
    assert set(found) == {1}


def test_a_search_ends_at_the_first_look_at_the_clock_that_finds_it_over():
    """No stage goes on after that, nor catches what says so."""
    asked, tick = [], count()

    def expired() -> bool:
        asked.append(next(tick) >= 300)
        return asked[-1]

    with pytest.raises(PlanningError) as late:
        cw.plan(TASK, expired=expired)
    assert late.value.outcome == Outcome.TIMED_OUT
    assert asked == [False] * 300 + [True]


@pytest.mark.parametrize("obstacles", [0, 20, 1000])
@pytest.mark.parametrize("size", [(0.02, 0.02), (0.7, 0.7), (50.0, 0.05), (50.0, 50.0)])
def test_the_finest_grid_is_bounded_whatever_the_size_of_the_scene(size: tuple[float, float], obstacles: int):
    discs = tuple(Disc(center=(0.4 * size[0], 0.4 * size[1]), radius=1e-3) for _ in range(obstacles))
    nodes = np.prod(size) / finest_spacing(Scene(size, discs)) ** 2
    assert nodes * (WORK_OF_NODE + obstacles) == pytest.approx(WORK)
    assert 8 * nodes < 20e6, "bytes of one array over the grid"


def test_tables_keep_the_spacing_that_is_asked_for():
    """Up to 1 m x 1 m with 50 obstacles, in every refinement."""
    discs = tuple(Disc(center=(0.5, 0.5), radius=0.01) for _ in range(50))
    assert finest_spacing(Scene((1.0, 1.0), discs)) < PivotConfig().resolution / 2**REFINEMENTS


@pytest.fixture
def little_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bound that a hall reaches sooner."""
    monkeypatch.setattr(pivot_grid, "WORK", 1e6)


@pytest.mark.usefixtures("little_work")
def test_a_hall_is_crossed_on_a_coarse_grid():
    scene = Scene((30.0, 30.0), (Disc(center=(15.0, 15.0), radius=4.0),))
    path = grid_path(scene, np.array([1.0, 15.0]), np.array([29.0, 15.0]), 0.004, PivotConfig())
    np.testing.assert_allclose(path[[0, -1]], [[1.0, 15.0], [29.0, 15.0]])
    assert scene.clearance(path[None], 0.004)[0] >= 0


@pytest.mark.usefixtures("little_work")
def test_a_gap_too_narrow_for_a_coarse_grid_is_said_to_be_so():
    """The gap, 14 mm wide, is between two rows of nodes."""
    wall = [Box(center=(15.0, (low + top) / 2), size=(1.0, top - low)) for low, top in ((0, 14.982), (14.996, 30))]
    with pytest.raises(PlanningError, match=r"on a grid of \d+ mm, the finest for so large a workspace"):
        grid_path(Scene((30.0, 30.0), tuple(wall)), np.array([1.0, 2.0]), np.array([29.0, 2.0]), 0.006, PivotConfig())


@pytest.mark.parametrize("keypoints", [13, 200])
def test_a_motion_is_resampled_to_a_bounded_number_of_points(keypoints: int):
    rod = cw.Cable(keypoints=keypoints).rod
    far = np.repeat(TASK.start_equilibrium[None], 3, axis=0)
    far[:, 0] += [0.0, 500.0, 1000.0]
    rows = evenly_moved(rod, far, 0.001)
    assert len(rows) * rod.shapes(far)[0].shape[1] <= 1.01 * MOST_STATIONS


def test_a_plan_with_too_many_rows_is_refused_in_a_sentence():
    """With the smallest step that a task may ask for."""
    slow = replace(TASK, grippers=replace(TASK.grippers, max_step=1e-5))
    with pytest.raises(PlanningError, match=rf"takes \d+ control steps, \d+ minutes.* has at most {MOST_ROWS}$"):
        cw.plan(slow)


def test_after_a_motion_with_too_many_rows_another_is_tried(plan: cw.Plan, monkeypatch: pytest.MonkeyPatch):
    """A trajectory that leads to no motion in time says nothing of the others."""
    calls = count()

    def first_too_long(*args: Any) -> ProjectedTrajectory:
        if next(calls) == 0:
            require_rows(MOST_ROWS + 1)
        return project(*args)

    monkeypatch.setattr(candidates, "project", first_too_long)
    found = cw.plan(TASK)
    assert found.verdict is not None
    assert found.verdict.passed
    assert found.metadata["initial_trajectory"] != plan.metadata["initial_trajectory"]


def test_an_insertion_with_too_many_rows_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch):
    """Fewer are allowed here: at the slowest pace that a task may ask for, this insertion takes only some thousands."""
    monkeypatch.setattr(time_parametrization, "MOST_ROWS", 1000)
    task = cw.load_task("insertion")
    with pytest.raises(PlanningError, match=r"takes \d+ control steps, \d+ minutes.* has at most 1000$"):
        cw.plan_insertion(replace(task, grippers=replace(task.grippers, max_turn=1e-4, max_step=1e-5)))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("rows", [3, 4, 9, 50])
def test_bands_of_squared_differences_are_those_of_the_matrix(rows: int, order: int):
    differences = np.diff(np.eye(rows), n=order, axis=0)
    for k, band in enumerate(squared_differences(rows, order)):
        np.testing.assert_array_equal(band, np.diagonal(differences.T @ differences, k))
