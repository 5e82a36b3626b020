"""Tools that lean away from the cable: their outlines, the poses of their flanges, plans, the judge, and MuJoCo."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import shapely

import cableway as cw
from cableway.core.errors import TaskError
from cableway.robot.branches import ArmMotion, arm_motion
from cableway.robot.cell_kinematics import CellKinematics
from cableway.robot.free_arms import free_arms, rooms
from cableway.robot.kinematics import flange_poses, gripper_poses
from cableway.scene import cell
from cableway.scene.bodies import Body
from cableway.scene.cell import CELLS, TOOLS, Way
from cableway.scene.gripper_bodies import ABOVE_TABLE, AXIS, GRIPPER_BODIES, TIP, gripper_body
from cableway.scene.grippers import Grippers
from cableway.simulation.arms import ArmDrive
from cableway.simulation.drives import NAMES
from cableway.simulation.surroundings import hold
from cableway.verification.arms import arm_checks
from cableway.verification.bodies import hand_pieces

TILT = 0.17
CELL = replace(CELLS["dual-ur5e"], tilt=TILT)
TASK = cw.random_task(10, "cell").in_cell(CELL)
PLAN = cw.plan(TASK, seed=0)


def way() -> Way:
    found = Way.of_record(PLAN.metadata)
    assert found is not None
    return found


def inside(tool: str, side: int, count: int = 60) -> np.ndarray:
    """Points within the pieces of a hand, turned by the tilt about the cable's axis."""
    rng, points = np.random.default_rng(0), []
    for part in GRIPPER_BODIES[tool]:
        shares = rng.dirichlet(np.ones(len(part.outline)), count)
        points.append(np.column_stack([shares @ part.outline, rng.uniform(*part.heights, count) - AXIS]))
    x, y, z = np.vstack(points).T
    edge = max(np.abs(part.outline[:, 0]).max() for part in GRIPPER_BODIES[tool][:1])
    z += max(0.0, (ABOVE_TABLE - AXIS + np.sin(TILT) * edge) / np.cos(TILT) + AXIS - TIP)
    ahead = TILT if side else -TILT  # out of the cable at its right end, and at its left one
    return np.column_stack([np.cos(ahead) * x + np.sin(ahead) * z, y, AXIS + np.cos(ahead) * z - np.sin(ahead) * x])


def holds(bodies: list[Body], point: np.ndarray) -> bool:
    """Whether one of the bodies holds a point."""
    return any(
        body.heights[0] - 1e-9 <= point[2] <= body.heights[1] + 1e-9
        and shapely.Polygon(body.outline).buffer(1e-9).contains(shapely.Point(point[:2]))
        for body in bodies
    )


@pytest.mark.parametrize("tool", [*TOOLS])
def test_planner_and_judge_have_all_of_a_tilted_hand_and_the_judge_no_more_than_the_planner(tool: str):
    task = TASK.in_cell(replace(CELL, tool=tool))
    judged = hand_pieces(gripper_body(tool), task)
    for side in (0, 1):
        planned = [body for body in task.grippers.pieces if body.side == side]
        own = [body for body in judged if body.side == side]
        for point in inside(tool, side):
            assert holds(planned, point)
            assert holds(own, point)
        top = max(body.heights[1] for body in planned)
        leans = np.mean([body.outline[:, 0].mean() for body in planned if body.heights[1] == top])
        assert np.sign(leans) == (1 if side else -1), "away from the cable"
        seen = shapely.union_all([shapely.Polygon(body.outline) for body in planned])
        assert shapely.union_all([shapely.Polygon(body.outline) for body in own]).within(seen.buffer(1e-9))


def test_flanges_lean_about_the_axis_of_the_cable_and_lead_back_to_their_grippers():
    poses = np.random.default_rng(1).uniform([-1, -1, -3], [1, 1, 3], (20, 3))
    for turn in (0, 1):
        flanges = flange_poses(poses, 0.161, AXIS, turn, TILT)
        np.testing.assert_allclose(gripper_poses(flanges, 0.161, turn), poses, atol=1e-12)
        np.testing.assert_allclose(flanges[:, :3, :3] @ flanges[:, :3, :3].swapaxes(1, 2), [np.eye(3)] * 20, atol=1e-12)
        np.testing.assert_allclose(np.linalg.det(flanges[:, :3, :3]), 1.0)
        ahead = np.einsum("ti,ti->t", flanges[:, :2, 3] - poses[:, :2], np.c_[np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        np.testing.assert_allclose(ahead, 0.161 * np.sin(TILT), atol=1e-12)


def test_what_a_search_sees_of_tilted_arms_is_what_the_kinematics_of_the_cell_leave():
    poses = PLAN.poses[::10]
    arms, kinematics = free_arms(TASK.held(way()), poses[:0]), CellKinematics(TASK, way())
    assert arms is not None
    joints, away = kinematics.held(poses, np.zeros((2, 6)))
    found = rooms(poses, arms)
    np.testing.assert_allclose(found[:, [0, 3]], away, atol=1e-12)
    np.testing.assert_allclose(found[:, [1, 4, 6]], kinematics.room(joints)[0], atol=1e-12)


def test_a_plan_with_tilted_tools_passes_the_judge_and_one_with_straight_tools_does_not():
    assert cw.verify_plan(PLAN, TASK).passed
    assert PLAN.approach is not None
    straight = arm_motion(PLAN.poses, TASK, replace(CELL, tilt=0.0, way=way()))
    assert isinstance(straight, ArmMotion)
    failed = {check.name for check in arm_checks(replace(PLAN, joints=straight.joints), TASK) if not check.passed}
    assert failed == {"tool angle"}


def test_fingers_that_are_not_lifted_off_the_table_fail(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cell, "lift_of", lambda parts, tilt: 0.0)
    found = arm_motion(PLAN.poses, TASK, replace(CELL, way=way()))
    assert isinstance(found, ArmMotion)
    (failed,) = [check for check in arm_checks(replace(PLAN, joints=found.joints), TASK) if not check.passed]
    assert failed.name == "hand clearance from the table"
    assert 0.0001 < failed.value < 0.0002


def test_mujoco_has_tilted_hands_upright_frames_at_the_ends_of_the_cable():
    assert PLAN.joints is not None
    spec, drive = mujoco.MjSpec(), ArmDrive(TASK, way(), PLAN.joints[0], 0.0025)
    drive.add(spec)
    for name in NAMES:
        spec.worldbody.add_body(name=f"{name} end")
        hold(spec, name, f"{name} end", 0.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    drive.begin(model, data, PLAN.poses[0])
    mujoco.mj_kinematics(model, data)
    for side, (name, pose) in enumerate(zip(NAMES, PLAN.poses[0], strict=True)):
        found, flange = data.body(f"{name} gripper"), data.body(f"{name} link 6")
        c, s = np.cos(pose[2]), np.sin(pose[2])
        np.testing.assert_allclose(found.xpos, [*pose[:2], TASK.cable.radius], atol=1e-6)
        np.testing.assert_allclose(found.xmat.reshape(3, 3), [[c, -s, 0], [s, c, 0], [0, 0, 1]], atol=1e-6)
        up = -flange.xmat.reshape(3, 3)[:, 2]
        ahead = np.sin(TILT) * (1 if side else -1)
        np.testing.assert_allclose(up, [ahead * c, ahead * s, np.cos(TILT)], atol=1e-6)


def test_the_tilt_is_written_and_read_and_one_that_brings_fingers_into_the_table_is_refused(tmp_path: Path):
    TASK.save(tmp_path / "task.yaml")
    assert cw.load_task(tmp_path / "task.yaml") == TASK
    straight = TASK.in_cell(CELLS["dual-ur5e"])
    straight.save(tmp_path / "straight.yaml")
    assert "tilt" not in (tmp_path / "straight.yaml").read_text()
    with pytest.raises(TaskError, match=r"of 2f-85 keep off the table only 2\.3 mm higher, limit 1\.0 mm, got 0\.3"):
        Grippers(body="2f-85", tilt=0.3)
    with pytest.raises(TaskError, match=r"must be the cell's, 0\.17, got 0"):
        replace(TASK, grippers=replace(TASK.grippers, tilt=0.0))
