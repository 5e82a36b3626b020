"""The judge of plans in space finds what is wrong, and measures as the planner's geometry does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from spatial_problems import ball_plan, ball_task

from cableway.core.errors import InputError
from cableway.geometry.spatial_convex import chain_distance
from cableway.records import Plan
from cableway.scene.obstacles import Box, Disc
from cableway.scene.spatial.grippers import GripperPiece
from cableway.scene.spatial.obstacles import ConvexMesh, Cuboid, Cylinder, Prism, Sphere
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import SpatialTask
from cableway.verification import spatial_bodies, verify_plan, verify_record
from cableway.verification.spatial_distance import FAR, Shape, ToScene
from cableway.verification.spatial_plan import verify_spatial_plan

TASK = ball_task()


def failed(plan: Plan, task=TASK) -> set[str]:
    return {check.name for check in verify_plan(plan, task).failures()}


def altered(**changes: np.ndarray) -> Plan:
    return replace(ball_plan(), q=None, **changes)


def test_the_plan_passes_and_its_verdict_is_that_of_the_search():
    plan = ball_plan()
    assert verify_record(plan, TASK) == plan.verdict


def test_a_larger_obstacle_is_touched_by_the_cable_and_a_wall_by_a_gripper():
    larger = replace(TASK, scene=SpatialScene((0.8, 0.8, 0.8), (Sphere(center=(0.4, 0.4, 0.38), radius=0.11),)))
    assert {"cable clearance", "rod clearance"} <= failed(ball_plan(), larger)
    x, y, z = (ball_plan().poses[24, 0, :3] - [0.0, 0.035, 0.0]).tolist()
    post = replace(TASK, scene=SpatialScene((0.8, 0.8, 0.8), (Sphere(center=(x, y, z), radius=0.02),)))
    assert "gripper clearance" in failed(ball_plan(), post)


def with_pieces(*pieces: GripperPiece, scene: SpatialScene | None = None) -> SpatialTask:
    """The task with more on its grippers than balls."""
    return replace(TASK, grippers=replace(TASK.grippers, body=pieces), scene=scene or TASK.scene)


PIECES = {
    "ball": GripperPiece(points=[[0.08, 0.0, 0.0]], radius=0.015),
    "hull": GripperPiece(
        points=[[0.06, -0.01, -0.01], [0.08, -0.01, -0.01], [0.07, 0.01, 0.0], [0.07, 0.0, 0.01]], radius=0.012
    ),
}


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("kind", PIECES)
def test_pieces_of_grippers_are_kept_off_obstacles_by_their_radius(kind: str, side: int):
    """A ball above the highest corner of a piece in the middle of the way, 60 mm off, then 2 mm inside."""
    piece, room = PIECES[kind], (0.8, 0.8, 0.8)
    corners = with_pieces(piece).bodies[2 + side].placed(ball_plan().poses[24, side])
    top = corners[int(np.argmax(corners[:, 2]))]
    for gap, passes in ((0.06, True), (-0.002, False)):
        at = tuple((top + [0.0, 0.0, piece.radius + 0.03 + gap]).tolist())
        task = with_pieces(piece, scene=SpatialScene(room, (Sphere(center=at, radius=0.03),)))
        assert ("gripper body clearance" not in failed(ball_plan(), task)) is passes


@pytest.mark.parametrize("reach", [0.05, 0.11])
def test_pieces_of_either_gripper_are_kept_off_the_other_gripper(reach: float):
    """Balls that reach inward from both, above the cable."""
    task = with_pieces(GripperPiece(points=[[-reach, 0.0, 0.06]], radius=0.005))
    left, right = ([body for body in task.bodies if body.side == side] for side in (0, 1))
    gaps = [
        np.linalg.norm(
            a.placed(ball_plan().poses[:, 0])[:, 0] - b.placed(ball_plan().poses[:, 1])[:, 0], axis=1
        ).min() - a.radius - b.radius
        for a in left for b in right if a.points.any() or b.points.any()
    ]  # fmt: skip
    (apart,) = (each for each in verify_plan(ball_plan(), task).checks if each.name == "gripper bodies apart")
    assert apart.value == pytest.approx(min(gaps), abs=0.002)


def test_a_cable_against_its_own_gripper_is_found():
    shapes = ball_plan().shapes.copy()
    shapes[20, 6] = ball_plan().poses[20, 0, :3] + [0.0, 0.0, 0.01]
    assert "gripper body from the cable" in failed(altered(shapes=shapes))


def test_a_piece_of_a_gripper_in_the_way_of_the_cable_is_found():
    """A plate that reaches from the left gripper to the middle of the cable as it is in one row, and one above that."""
    plan = ball_plan()
    pose, middle = plan.poses[24, 0], plan.shapes[24, 6]
    turn = Rotation.from_quat(pose[3:], scalar_first=True)
    for above, passes in ((0.0, False), (0.04, True)):
        at = turn.inv().apply(middle + [0, 0, above] - pose[:3]) * (-1, 1, 1)
        piece = GripperPiece(points=at + 0.004 * (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5))
        assert ("gripper body from the cable" not in failed(plan, with_pieces(piece))) is passes


def test_the_least_distances_of_hands_are_those_of_all_rows():
    """Few are measured."""
    task = replace(TASK, grippers=replace(TASK.grippers, body="2f-85"))
    poses, _ = spatial_bodies._fine_poses(ball_plan().poses, task.bodies)
    moving = [spatial_bodies._Moving(body, poses) for body in task.bodies]
    scene = ToScene(task.scene, task.grippers.radius)
    for gaps, rate in (
        ([a.to_other(b) for a, b in spatial_bodies._facing(moving)][-9:], 2 * spatial_bodies.STEP),
        ([body.to_scene(scene, 0.1) for body in moving[-4:]], spatial_bodies.STEP),
    ):
        rows = range(len(poses))
        everywhere = np.array([[gap._measure(row) for row in rows] for gap in gaps])
        assert all((everywhere[k] >= gap.bound - 1e-9).all() for k, gap in enumerate(gaps))
        least, row, kept = spatial_bodies._least(gaps, rate, 0.1)
        assert least == pytest.approx(everywhere.min(), abs=1e-5)
        assert everywhere[:, row].min() == pytest.approx(least)
        assert kept == pytest.approx(min(everywhere[:, [0, -1]].min(), 0.1 + spatial_bodies.STEP))
        assert sum(len(gap._known) for gap in gaps) < everywhere.size / 4


def test_between_rows_things_are_met_too():
    """A thin plate, moved so that two rows are on either side of it."""
    at = ball_plan().shapes[:, :, 0]
    row = int(np.argmax(np.diff(at, axis=0).mean(1)))
    x = float(at[row : row + 2, 6].mean())
    tip = ball_plan().shapes[row, 6]
    plate = Cuboid(center=(x, float(tip[1]), float(tip[2])), size=(0.0002, 0.004, 0.004))
    assert "cable clearance" in failed(ball_plan(), replace(TASK, scene=SpatialScene((0.8, 0.8, 0.8), (plate,))))


def test_poses_that_shapes_do_not_have_are_found():
    poses = ball_plan().poses.copy()
    poses[10:, 1, :3] += [0.0, 0.0, 0.03]
    assert {"grasp error", "gripper step", "rod deviation", "gripper distance to goal"} <= failed(altered(poses=poses))
    turned = ball_plan().poses.copy()
    turned[:, 0, 3:] = np.roll(turned[:, 0, 3:], 1, axis=1)
    assert "gripper angle to start" in failed(altered(poses=turned))


def test_a_cable_that_is_led_too_far_is_lost_or_snaps():
    poses = ball_plan().poses.copy()
    away = np.linspace(0, 0.2, len(poses))[:, None] * np.array([0.0, 1.0, 0.0])
    side = 1.0 if poses[0, 1, 1] > poses[0, 0, 1] else -1.0
    poses[:, 1, :3] += side * away
    assert "rows the rod does not reach" in failed(altered(poses=poses))


def test_twist_beyond_the_limit_is_found():
    plan = ball_plan()
    turns = np.linspace(0, 3.0, len(plan.poses))
    half = np.stack([np.cos(turns / 2), np.sin(turns / 2), 0 * turns, 0 * turns], axis=1)
    w, x, y, z = plan.poses[:, 1, 3:].T
    c, s = half[:, 0], half[:, 1]
    poses = plan.poses.copy()
    poses[:, 1, 3:] = np.stack([w * c - x * s, w * s + x * c, y * c + z * s, z * c - y * s], axis=1)
    tender = replace(TASK, cable=replace(TASK.cable, max_twist=1.0))
    assert "twist" not in failed(plan, tender)
    assert "twist" in failed(altered(poses=poses), tender)


def test_plans_of_the_plane_and_of_space_are_told_apart():
    flat = Plan(np.zeros((3, 13, 2)), np.zeros((3, 2, 3)))
    with pytest.raises(InputError, match="is in space, the plan is not"):
        verify_spatial_plan(flat, TASK)
    with pytest.raises(InputError, match="the plan is in space, the task"):
        verify_plan(ball_plan(), "single-obstacle-1")
    with pytest.raises(InputError, match="points of 3 numbers do not go with poses of 3"):
        Plan(np.zeros((3, 13, 3)), np.zeros((3, 2, 3)))


def many_kinds(rng: np.random.Generator) -> SpatialScene:
    """An obstacle of every kind."""
    return SpatialScene(
        (1.0, 1.0, 1.0),
        (
            Cuboid(center=(0.3, 0.3, 0.3), size=(0.1, 0.2, 0.3), orientation=(0.8, 0.6, 0.0, 0.0)),
            Cylinder(center=(0.7, 0.3, 0.5), radius=0.06, height=0.3, axis=(0.6, 0.0, 0.8)),
            Sphere(center=(0.3, 0.7, 0.6), radius=0.1),
            ConvexMesh(points=np.array([0.7, 0.7, 0.3]) + 0.1 * rng.normal(size=(8, 3))),
            Prism(section=Box(center=(0.5, 0.1), size=(0.1, 0.05), angle=0.3)),
            Prism(section=Disc(center=(0.5, 0.9), radius=0.05, height=0.4)),
        ),
    )


def bent_lines(count: int, points: int) -> np.ndarray:
    """Lines (count, points, 3) of 30 cm or so that bend, in `many_kinds`."""
    rng, along = np.random.default_rng(5), np.linspace(0, 1, points)[:, None]
    begin, bend = rng.uniform(0.15, 0.85, (count, 1, 3)), 0.2 * rng.normal(size=(2, count, 1, 3))
    return np.clip(begin + along * bend[0] + np.sin(np.pi * along) * bend[1], 0.001, 0.999)


def test_a_line_is_as_far_as_its_nearest_piece_and_few_pieces_are_measured(monkeypatch: pytest.MonkeyPatch):
    """The nearest one is found whatever planes the search begins with."""
    scene, lines, radius = many_kinds(np.random.default_rng(4)), bent_lines(40, 31), 0.004
    measure, count = ToScene(scene, radius), 0
    ends = np.stack([lines[:, :-1], lines[:, 1:]], axis=2)
    each = np.array(
        [[[measure._measured(piece, shape)[0] for piece in row] for row in ends] for shape in measure._shapes]
    )
    walls = np.minimum(lines.min((1, 2)), (1.0 - lines).min((1, 2)))
    expected = np.minimum(np.minimum(each.min((0, 2)), walls), FAR + radius)
    assert (expected < 0).sum() > 3
    assert (np.abs(expected - FAR / 2) < FAR / 2).sum() > 3
    measured = measure._measured

    def counted(piece: np.ndarray, shape: Shape) -> tuple[float, np.ndarray]:
        nonlocal count
        count += 1
        return measured(piece, shape)

    monkeypatch.setattr(measure, "_measured", counted)
    np.testing.assert_allclose(measure(lines)[0], expected, atol=2e-6)
    near = np.sum(each.min(2) < FAR + radius)
    assert near <= count < 8 * near


def test_planes_that_touch_an_obstacle_are_never_farther_from_a_line_than_the_obstacle():
    measure, lines = ToScene(many_kinds(np.random.default_rng(4)), 0.004), bent_lines(20, 8)
    normals = np.random.default_rng(6).normal(size=(30, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for shape in measure._shapes:
        for line in lines:
            true = [measure._measured(piece, shape)[0] for piece in np.stack([line[:-1], line[1:]], axis=1)]
            assert np.all(shape.beyond(line, normals) <= np.array(true) + 2e-6)


def test_coal_measures_as_the_planner_does():
    rng = np.random.default_rng(4)
    scene = many_kinds(rng)
    lines = rng.uniform(0.1, 0.9, (150, 1, 3)) + np.linspace(0, 0.1, 4)[:, None] * rng.normal(size=(150, 1, 3))
    expected, index = chain_distance(lines, scene.world)
    found, which = ToScene(scene, 0.004)(lines)
    near = (expected < FAR) & (expected > -0.003)
    assert set(index[near]) >= {0, 1, 2, 3, 4}
    np.testing.assert_allclose(found[near], expected[near], atol=1e-4)
    assert (which[near] == index[near]).mean() > 0.95
    far = expected > FAR + 0.004
    np.testing.assert_allclose(found[far], FAR + 0.004)
