"""Laws of the free space of a held cable: each constraint alone forbids, and what it forbids is what it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from cableway.core.errors import InputError
from cableway.motion.limits import Margins
from cableway.motion.time_parametrization import at_equal_effort, gripper_effort
from cableway.motion.validity import FreeSpace, first_fault, task_ends
from cableway.scene.bodies import LEFT, RIGHT, Body
from cableway.scene.clearance import clearances
from cableway.scene.scene import Scene
from cableway.scene.task import Grippers
from tests import problems


@pytest.fixture(scope="module")
def shapes() -> np.ndarray:
    """Configurations about both ends of a task, some free and some not."""
    task = problems.beside_disc()
    ends = np.array(task_ends(task))
    rng = np.random.default_rng(3)
    return ends[np.arange(300) % 2] + rng.normal(size=(300, 6)) * [0.1, 0.1, 0.6, 6, 6, 1.5]


def test_free_shapes_keep_what_the_margins_ask_for(shapes: np.ndarray):
    task, margins = problems.beside_disc(), Margins()
    free = FreeSpace.of(task, margins).are_free(shapes)
    assert 20 < free.sum() < 280
    rod = task.cable.rod
    stations, poses = rod.shapes(shapes)
    assert (clearances(rod.at_keypoints(stations), poses, task)[free].min(axis=1) > 0.8 * margins.clearance).all()
    spans = np.linalg.norm(poses[:, 1, :2] - poses[:, 0, :2], axis=1)
    assert spans[free].max() <= margins.gripper_span * rod.length
    assert rod.stability(shapes[free])[0].min() >= margins.stability
    assert shapely.is_simple(shapely.linestrings(stations[free])).all()


@pytest.mark.parametrize(
    "margins", [Margins(clearance=0.05), Margins(stability=30.0), Margins(gripper_span=0.7), Margins(self_distance=0.1)]
)
def test_a_wider_margin_forbids_more_and_frees_nothing(shapes: np.ndarray, margins: Margins):
    task = problems.free()
    usual, wide = (FreeSpace.of(task, each).are_free(shapes) for each in (Margins(), margins))
    assert not (wide & ~usual).any()
    assert wide.sum() < usual.sum()


def test_a_body_forbids_what_it_touches(shapes: np.ndarray):
    """Thicker grippers forbid the shapes whose discs come too near, and no others."""
    task = problems.beside_disc()
    wide = replace(task, grippers=replace(task.grippers, radius=0.02))
    usual, fewer = (FreeSpace.of(each, Margins()).are_free(shapes) for each in (task, wide))
    ends = task.cable.rod.shapes(shapes)[1][:, :, :2]
    kept = (task.scene.signed_distance(ends) >= 0.02 + Margins().clearance).all(axis=1)
    np.testing.assert_array_equal(fewer, usual & kept)
    assert fewer.sum() < usual.sum()


def test_start_and_goal_are_always_free():
    task = problems.doorway()
    space = FreeSpace.of(task, Margins(clearance=0.2, stability=40.0, gripper_span=0.01, self_distance=0.5))
    assert space.are_free(np.array(task_ends(task))).all()


def test_bad_margins_are_refused():
    with pytest.raises(InputError, match=r"gripper_span must be from 0\.001 to 1, got 2"):
        Margins(gripper_span=2.0)


def test_a_fault_is_named():
    task = problems.free()
    rod, q = task.cable.rod, np.array(task_ends(task))[:1]
    asked = {"stability": 1.0, "most_span": rod.length}
    assert first_fault(rod, q, **asked) == ""
    assert first_fault(rod, q, **{**asked, "stability": 1e3}) == "unstable"
    assert first_fault(rod, q, **{**asked, "most_span": 0.01}) == "taut"
    assert first_fault(rod, q, **asked, least_span=rod.length) == "grippers meet"
    assert first_fault(rod, q, **asked, most_energy=1e-6) == "wound up"
    assert first_fault(rod, q, **asked, room=(Scene().world, 0.5)) == "touches a wall"
    loop = np.array([[0.3, 0.3, 0.0, 0.0, 0.0, 9.0]])
    assert first_fault(rod, loop, stability=-1e3, most_span=rod.length) == "crosses itself"


def test_rows_at_equal_effort_keep_the_limits():
    poses = np.cumsum(np.random.default_rng(0).normal(size=(40, 2, 3)) * [0.003, 0.003, 0.04], axis=0)
    limits = Grippers()
    effort = gripper_effort(poses, limits.max_step, limits.max_turn)
    at = at_equal_effort(np.arange(40.0), effort, 0.7)
    total = np.interp(at, np.arange(40), np.concatenate([[0], np.cumsum(effort)]))
    np.testing.assert_allclose(np.diff(total), np.diff(total)[0])
    assert np.diff(total)[0] <= 0.7
    assert (at[0], at[-1]) == (0, 39)


def test_a_placed_body_moves_with_its_gripper():
    box, pose = Body.box("plug", RIGHT, 0.04, 0.01), np.array([0.2, 0.1, np.pi / 2])
    np.testing.assert_allclose(box.placed(pose)[0], [0.205, 0.1], atol=1e-12)
    disc = Body.disc("left gripper", LEFT, 0.01)
    np.testing.assert_array_equal(disc.placed(pose), pose[None, :2])
