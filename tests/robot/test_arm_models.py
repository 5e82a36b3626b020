"""Laws of every kind of arm: kinematics, the folded elbow, limits; and of a cell with arms of two kinds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from folding_arms import FOLDING
from recording_arms import LinearArms, RecordingArm

import cableway as cw
from cableway.core.errors import InputError, SimulationError
from cableway.robot.cell_kinematics import LEAST, CellKinematics
from cableway.robot.kinematics import BRANCHES, branch_joints, link_frames
from cableway.robot.ur import URRobot
from cableway.scene.arm_models import ARM_MODELS, UR5E, UR10E, ArmModel
from cableway.scene.cell import CELLS, MountedArm, Way
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.table_plant import TablePlant
from cableway.verification.arms import _exponentials, _homes, arm_checks
from cableway.workflow.trajectory import Trajectory

LIFT = 1
"""A joint of the shoulder, which turns faster in a UR5e than in a UR10e."""

MIXED = replace(
    CELLS["dual-ur5e"],
    arms=(MountedArm(position=(-0.8, 0.0, 0.0), model="ur10e"), CELLS["dual-ur5e"].arms[1]),
)


def frames_of(model: ArmModel, joints: np.ndarray) -> np.ndarray:
    frames = np.empty((7, 3, 4))
    link_frames(np.array(model.lengths), np.eye(4), joints, frames)
    return frames


@pytest.fixture(scope="module")
def planned() -> tuple[cw.Task, cw.Plan]:
    task = cw.load_task("single-obstacle-1").in_cell(MIXED)
    return task, cw.plan(task, seed=0)


def way_of(plan: cw.Plan) -> Way:
    way = Way.of_record(plan.metadata)
    assert way is not None
    return way


@pytest.mark.parametrize("model", ARM_MODELS.values(), ids=list(ARM_MODELS))
def test_inverse_and_forward_kinematics_and_the_judges_agree(model: ArmModel):
    joints, found = np.random.default_rng(0).uniform(-np.pi, np.pi, (50, 6)), np.empty(6)
    moves, reached = [np.tile(np.eye(4), (50, 1, 1)), *_exponentials(model, joints)], 0
    for row, each in enumerate(joints):
        frames = frames_of(model, each)
        for frame, home in enumerate(_homes(model)):
            np.testing.assert_allclose((moves[frame][row] @ home)[:3], frames[frame], atol=1e-12)
        for branch in range(BRANCHES):
            if branch_joints(np.array(model.lengths), frames[6], branch, found) > 0.01:
                np.testing.assert_allclose(frames_of(model, found)[6], frames[6], atol=1e-9)
                reached += 1
    assert reached > 100


@pytest.mark.parametrize("model", ARM_MODELS.values(), ids=list(ARM_MODELS))
def test_links_on_either_side_of_a_folded_elbow_do_not_meet(model: ArmModel):
    """Those of shoulder and forearm, and of upper arm and first wrist, which planner and filter do not compare."""
    limit = model.position_limit[2]
    assert folded(model, limit) >= LEAST
    assert folded(model, limit + 0.06) < 0.004, "it bends no less than it must"


def test_the_judge_sees_links_meet_where_an_elbow_folds(planned: tuple[cw.Task, cw.Plan]):
    """Also of an arm whose limits let it."""
    task, plan = planned
    assert task.cell is not None
    assert plan.joints is not None
    cell = replace(task.cell, arms=tuple(replace(arm, model=FOLDING) for arm in task.cell.arms))
    for elbow, apart in ((2.6, True), (2.8, False)):
        joints = np.tile([np.pi / 2, -1.5, elbow, -2.25, 1.5, 0.0], (2, 2, 1))
        bent = replace(plan, shapes=plan.shapes[:2], poses=plan.poses[:2], joints=joints, q=None)
        (check,) = (each for each in arm_checks(bent, replace(task, cell=cell)) if each.name == "arm clearance")
        assert check.passed is apart, check


def folded(model: ArmModel, elbow: float) -> float:
    """Least distance [m] of such links, whatever the joints about them are."""
    least = np.inf
    for joint, (inner, outer) in ((1, (1, 3)), (3, (2, 4))):
        for turn in np.linspace(-np.pi, np.pi, 24, endpoint=False):
            joints = np.zeros(6)
            joints[2], joints[joint] = elbow, turn
            one, other = (points_of(model, frames_of(model, joints), frame) for frame in (inner, outer))
            gaps = np.linalg.norm(one[0][:, None] - other[0], axis=2) - one[1][:, None] - other[1]
            least = min(least, float(gaps.min()))
    return least


def points_of(model: ArmModel, frames: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Points along the capsules of a link, with their radii."""
    share, points, radii = np.linspace(0, 1, 80)[:, None], [], []
    for each in (each for each in model.capsules if each.frame == frame):
        line = (1 - share) * np.array(each.start) + share * np.array(each.end)
        points.append(line @ frames[frame, :, :3].T + frames[frame, :, 3])
        radii.append(np.full(len(line), each.radius))
    return np.concatenate(points), np.concatenate(radii)


def test_arms_of_two_kinds_plan_together_each_within_its_own_limits(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    assert task.cell is not None
    assert plan.joints is not None
    models = task.cell.models_of(way_of(plan))
    assert set(models) == {UR5E, UR10E}
    arms, exact = CellKinematics(task, way_of(plan)), plan.poses[len(plan.poses) // 2]
    np.testing.assert_allclose(arms.poses(plan.joints[len(plan.poses) // 2])[:, :2], exact[:, :2], atol=1e-9)
    np.testing.assert_array_equal(arms.speed_limit, [model.speed_limit for model in models])
    few = replace(plan, **{name: getattr(plan, name)[:3] for name in ("shapes", "poses", "joints")}, q=None)
    other = replace(MIXED, arms=tuple(replace(arm, model="ur5e") for arm in MIXED.arms))
    assert all(check.passed for check in arm_checks(few, task))
    assert not all(check.passed for check in arm_checks(few, replace(task, cell=other)))


def test_mujoco_has_both_kinds_where_the_kinematics_have_them(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    plant = Perturbation().build(task, plan=plan).plant
    assert isinstance(plant, TablePlant)
    np.testing.assert_allclose(plant.measure().poses, plan.poses[0], atol=2e-3)
    for side, model in zip(("left", "right"), CellKinematics(task, way_of(plan)).models, strict=True):
        masses = [plant.model.body(f"{side} link {k}").mass[0] for k in range(1, 7)]
        np.testing.assert_allclose(masses, [link.mass for link in model.links])
        gains = [plant.model.actuator(f"{side} joint {k}").gainprm[0] for k in range(6)]
        np.testing.assert_allclose(gains, model.stiffness)


def test_a_program_in_urscript_has_the_speeds_of_its_arm(planned: tuple[cw.Task, cw.Plan], tmp_path):
    task, plan = planned
    assert plan.joints is not None
    slow, fast = UR10E.speed_limit[LIFT], UR5E.speed_limit[LIFT]
    ramp = np.clip(np.arange(len(plan.joints)) - 30, 0, 5)[:, None] * np.eye(6)[LIFT]
    for side, model in enumerate(CellKinematics(task, way_of(plan)).models):
        joints = plan.joints.copy()
        joints[:, side] = joints[0, side] + 0.1 * (slow + fast) / 2 * ramp
        record = replace(plan, joints=joints, approach=None, retreat=None)
        trajectory = Trajectory.of(record, task, rate=125, unverified=True)
        assert trajectory.joints is not None
        greatest = np.abs(np.diff(trajectory.joints.positions[:, side, LIFT])).max() * 125
        assert slow < greatest < fast
        assert trajectory.header["joints"]["models"][side] == model.name
        if model is UR5E:
            assert trajectory.write(tmp_path / "a.script")
        else:
            with pytest.raises(InputError, match="and that of a UR10e reaches 120 degrees/s"):
                trajectory.write(tmp_path / "a.script")


@pytest.mark.parametrize("models", [("ur10e", "ur5e"), ("ur5e", "ur10e")])
def test_the_driver_keeps_the_speed_of_each_arm(models: tuple[str, str]):
    robot, sent = driver(models)
    turned = LinearArms().joints(np.array([[0.2, 0.3, 0.0], [0.5, 0.3, 0.0]]), np.zeros((2, 6)))
    robot.send(LinearArms().poses(turned))
    turned[:, LIFT] += 0.008 * 2.5
    slow = ("left", "right")[models.index("ur10e")]
    said = f"shoulder_lift_joint of the {slow} arm would have to turn at 143 degrees/s, limit 120 degrees/s"
    with pytest.raises(SimulationError, match=said):
        robot.send(LinearArms().poses(turned))
    assert [len(each.sent) for each in sent] == [1, 1]


def driver(models: Any) -> tuple[URRobot, list[RecordingArm]]:
    class Seen:
        def keypoints(self) -> np.ndarray:
            return np.full((13, 2), np.nan)

    now = iter(np.arange(0.0, 1.0, 0.008))
    sent = [RecordingArm(np.zeros(6), 1 / 125) for _ in range(2)]
    arms = [each.arm(f"{side} arm") for side, each in zip(("left", "right"), sent, strict=True)]
    task = cw.load_task("single-obstacle-1")
    clock = lambda: float(next(now))  # noqa: E731
    return URRobot(task, arms, LinearArms(), Seen(), joint_speed=3.0, models=models, clock=clock), sent


@pytest.mark.parametrize(
    ("models", "said"), [(("ur5e", "ur7"), "unknown model 'ur7'; known: ur10e, ur3e, ur5e"), (("ur5e",), "got 1")]
)
def test_models_that_the_driver_does_not_know(models: Any, said: str):
    with pytest.raises(InputError, match=said):
        driver(models)


def test_the_driver_takes_models_from_the_kinematics_of_a_cell(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    kinematics = CellKinematics(task, way_of(plan))
    arms = [RecordingArm(np.zeros(6), 1 / 125).arm(side) for side in ("left", "right")]
    robot = URRobot(task, arms, kinematics, None, joint_speed=3.0)  # pyright: ignore[reportArgumentType]
    np.testing.assert_allclose(robot._speeds, np.minimum(3.0, kinematics.speed_limit))
