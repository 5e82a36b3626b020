"""The verifier's rod against the planner's: two formulations of one rod, sharing no code."""

from __future__ import annotations

import numpy as np
import problems
import pytest

from cableway.records import Check, Plan
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.verification.follower import _Chain, follow
from cableway.verification.plan import verify_plan


@pytest.fixture(scope="module")
def motion():
    task = problems.moved()
    q = problems.line_in_q(task.cable.rod, problems.LOW_ARC, problems.MOVED_ARC, 60)
    return task.cable.rod, q


def test_takes_the_shapes_of_the_other_rod(motion):
    """Link angles (48 hinges) and centre coordinates (24 hinges) agree within the error of discretisation."""
    rod, q = motion
    stations, poses = rod.shapes(q)
    followed = follow(rod.at_keypoints(stations), poses, Cable(length=rod.length, keypoints=rod.keypoints))
    assert followed.lost_at is None
    assert followed.deviation.max() < 6e-4


def test_stability_agrees_with_the_other_rod(motion):
    """The margins of both rods are the same number up to discretisation."""
    rod, q = motion
    stations, poses = rod.shapes(q)
    followed = follow(rod.at_keypoints(stations), poses, Cable(length=rod.length, keypoints=rod.keypoints))
    assert followed.stability == pytest.approx(rod.stability(q)[0], rel=0.03)


def test_stability_is_judged_half_way_between_rows():
    """Both ends turned one way, then the other: an arc, least stable half-way."""
    rod, cable = PlanarRod(0.3), Cable(length=0.3)
    stations, poses = rod.shapes(np.array([[0.3, 0.3, 0.0, 0.0, 20.0, 0.0]]))
    turned = poses + 0.4 * np.array([[[0, 0, -1], [0, 0, 1]], [[0, 0, 1], [0, 0, -1]]])
    followed = follow(np.repeat(rod.at_keypoints(stations), 2, axis=0), turned, cable)
    halfway = rod.stability(np.array([[0.3, 0.3, 0.0, 0.0, 20.0, 0.0]]))[0][0]
    assert followed.stability[0] > 1.3 * halfway
    assert followed.stability[1] == pytest.approx(halfway, rel=0.03)


@pytest.fixture(scope="module")
def solved(motion):
    """A chain, the gripper poses and the link angles it takes between them."""
    rod, q = motion
    stations, poses = rod.shapes(q[20:21])
    chain = _Chain(Cable(length=rod.length), 48)
    angles = chain.solve(poses[0], chain.angles_of(rod.at_keypoints(stations)[0]))
    assert angles is not None
    return chain, poses[0], angles


def test_a_solution_is_stationary_and_closed(solved):
    """Moving links against each other along the closure does not lower the energy to first order."""
    chain, poses, angles = solved
    full = chain.full(poses, angles)
    rows = chain.links[1:-1] * np.array([-np.sin(angles), np.cos(angles)])
    null = np.linalg.svd(rows)[2][2:]
    assert np.abs(null @ np.diff(full, n=2)).max() < 1e-8
    np.testing.assert_allclose(chain.vertices(poses, angles)[-1], poses[1, :2], atol=1e-9)


def test_the_margin_is_the_least_energy_of_a_change_that_keeps_the_chain_closed(solved):
    """Against the second difference of the energy along every eigenvector of an explicit null space."""
    chain, poses, angles = solved
    full = chain.full(poses, angles)
    rows = chain.links[1:-1] * np.array([-np.sin(angles), np.cos(angles)])
    multipliers = np.linalg.lstsq(rows.T, np.diff(full, n=2), rcond=None)[0]
    free = len(angles)
    load = chain.links[1:-1] * (np.cos(angles) * multipliers[0] + np.sin(angles) * multipliers[1])
    hessian = 2 * np.eye(free) - np.eye(free, k=1) - np.eye(free, k=-1) - np.diag(load)
    null = np.linalg.svd(rows)[2][2:]
    wanted = np.linalg.eigvalsh(null @ hessian @ null.T)[0] * 48**2
    assert chain.stability(poses, angles) == pytest.approx(wanted, rel=1e-9)


def test_grippers_pulled_apart_lose_the_rod(motion):
    """Farther apart than the rod is long there is no shape."""
    rod, q = motion
    stations, poses = rod.shapes(np.repeat(q[:1], 20, axis=0))
    poses[:, 1, 0] += np.linspace(0, 0.2, 20)
    followed = follow(rod.at_keypoints(stations), poses, Cable(length=rod.length, keypoints=rod.keypoints))
    assert followed.lost_at is not None
    assert 0 < followed.lost_at < 20


def test_takes_the_shapes_of_a_cable_that_is_not_uniform(motion):
    """Stiffness and rest curvature, in both formulations; a uniform rod goes elsewhere."""
    q = motion[1]
    cable = Cable().estimated(0.31, (1.0, -0.8, 0.5, -0.3, 2.0, -1.8, 1.0, 0.6))
    stations, poses = cable.rod.shapes(q)
    followed = follow(cable.rod.at_keypoints(stations), poses, cable)
    assert followed.lost_at is None
    assert followed.deviation.max() < 1e-3
    assert followed.stability == pytest.approx(cable.rod.stability(q)[0], rel=0.03)
    uniform = follow(cable.rod.at_keypoints(stations), poses, Cable(length=0.31))
    assert uniform.lost_at is not None or uniform.deviation.max() > 5 * followed.deviation.max()


def test_the_length_of_a_sharply_bent_cable_is_that_of_its_rod():
    """The spline through its keypoints is 2.4% shorter than the cable; a stretched plan is found out all the same."""
    cable = Cable().estimated(0.3, (0.3, -0.1, 0.6, -0.4, 2.2, 0.1, -0.1, 0.0))
    q = np.array([[0.35, 0.35, 0.0, -2.0, 50.0, -6.0]]).repeat(2, 0)
    stations, poses = cable.rod.shapes(q)
    shapes = np.ascontiguousarray(cable.rod.at_keypoints(stations))
    task = problems.moved().in_scene(problems.moved().scene)
    object.__setattr__(task, "cable", cable)

    def error(plan: Plan) -> Check:
        return next(check for check in verify_plan(plan, task).checks if check.name == "length error")

    assert error(Plan(shapes, poses)).passed
    stretched = shapes[0, 0] + 1.05 * (shapes - shapes[0, 0])
    assert not error(Plan(stretched, poses)).passed
