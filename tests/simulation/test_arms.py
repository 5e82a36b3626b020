"""The arms of a cell in the table plant: kinematics, servos, limits, contact, and what they hold."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import cableway as cw
from cableway.core.errors import InputError, SimulationError
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.arm_models import ARM_MODELS, UR5E
from cableway.scene.cell import TOOLS, Way
from cableway.scene.obstacles import Disc
from cableway.simulation.arms import LAG
from cableway.simulation.perturbations.grasp import GraspConfig
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.table_plant import TablePlant

TASK = cw.random_task(0, "cell")
PLAN = cw.plan(TASK, seed=0)
STILL = np.zeros((2, 3))


def way() -> Way:
    found = Way.of_record(PLAN.metadata)
    assert found is not None
    return found


def plant_of(task: cw.Task = TASK, plan: cw.Plan = PLAN, **perturbed: object) -> TablePlant:
    plant = Perturbation(**perturbed).build(task, plan=plan).plant  # pyright: ignore[reportArgumentType]
    assert isinstance(plant, TablePlant)
    return plant


def with_post(*posts: Disc) -> cw.Task:
    return TASK.in_scene(replace(TASK.scene, obstacles=posts))


def led(plant: TablePlant, action: np.ndarray, steps: int) -> list:
    return [(plant.step(action), plant.measure())[1] for _ in range(steps)]


@pytest.fixture(scope="module")
def followed() -> tuple[TablePlant, np.ndarray, list]:
    """A plant led half along the plan without feedback, then waiting; every command and measurement."""
    plant, rows = plant_of(), []
    commands = np.concatenate([np.diff(PLAN.poses, axis=0)[: PLAN.steps // 2], np.zeros((8, 2, 3))])
    for action in commands:
        plant.step(action)
        rows.append(
            (plant._drive.state()[:, :6], plant.measure(), plant._data.qfrc_actuator[plant.model.nv - 12 :].copy())
        )
    return plant, commands, rows


def test_mujoco_has_the_grippers_where_the_kinematics_have_them():
    plant, arms, rng = plant_of(), CellKinematics(TASK, way()), np.random.default_rng(3)
    places = np.array(
        [[plant.model.joint(f"{side} joint {k}").qposadr[0] for k in range(6)] for side in ("left", "right")]
    )
    for _ in range(20):
        joints = rng.uniform(-3, 3, (2, 6))
        plant._data.qpos[places] = joints
        mujoco.mj_kinematics(plant.model, plant._data)
        found = [plant._data.body(f"{side} gripper") for side in ("left", "right")]
        np.testing.assert_allclose([each.xpos[:2] for each in found], arms.poses(joints)[:, :2], atol=1e-9)
        for (ends, _), side in zip(arms.links(joints[None]), ("left", "right"), strict=True):
            at = plant._data.body(f"{side} link 6")
            hand = TOOLS["2f-85"].capsules[0]
            np.testing.assert_allclose(
                ends[0, len(UR5E.capsules), 1], at.xpos + at.xmat.reshape(3, 3) @ hand.end, atol=1e-9
            )
    plant.reset()
    for pose, side in zip(plant._reached, ("left", "right"), strict=True):
        at = plant._data.body(f"{side} gripper")
        turned = [[np.cos(pose[2]), -np.sin(pose[2]), 0], [np.sin(pose[2]), np.cos(pose[2]), 0], [0, 0, 1]]
        np.testing.assert_allclose(at.xmat.reshape(3, 3), turned, atol=1e-3)
        assert at.xpos[2] == pytest.approx(TASK.cable.radius, abs=3e-4)


def test_masses_are_the_makers():
    model = plant_of().model
    links = sum(model.body(f"left link {k}").mass[0] for k in range(1, 7))
    assert links == pytest.approx(17.7)  # of the 20.6 kg of the arm, its base left out
    assert model.body("right tool").mass[0] == TOOLS["2f-85"].mass.mass
    np.testing.assert_allclose(model.body("left link 2").ipos, UR5E.links[1].center)


def test_tools_come_to_where_they_were_asked_once_the_servos_have_caught_up(followed):
    """Weight is compensated: what is left is what the cable pulls."""
    _, commands, rows = followed
    asked = PLAN.poses[0] + commands.sum(axis=0)
    for measured in (row[1] for row in rows[-2:]):
        assert np.abs(measured.poses - asked)[:, :2].max() < 1e-3
        assert np.abs(measured.poses - asked)[:, 2].max() < 5e-3
    moving = [
        np.linalg.norm((row[1].poses - PLAN.poses[k + 1])[:, :2], axis=1).max() for k, row in enumerate(rows[:-8])
    ]
    assert max(moving) > 0.004, "they lag while they move"


def test_every_joint_keeps_its_limits(followed):
    _, _, rows = followed
    joints = np.array([row[1].joints for row in rows])
    assert (np.abs(joints) < UR5E.position_limit).all()
    assert (np.abs(np.diff(joints, axis=0)) / 0.1 < UR5E.speed_limit).all()
    torques = np.array([row[2] for row in rows]).reshape(-1, 2, 6)
    assert (np.abs(torques) <= np.array(UR5E.torque_limit) + 1e-9).all()
    assert np.abs(torques).max() > 10, "the torque that carries the arm is among them"


def test_joints_follow_an_even_motion_late_by_the_lag_of_the_servos():
    plant = plant_of(with_post())
    led(plant, np.array([[0.0, 0.004, 0.0]] * 2), 8)
    before = plant._drive.state()[:, :6]
    plant.step(np.array([[0.0, 0.004, 0.0]] * 2))
    commanded, measured = np.split(plant._drive.state()[:, :12], 2, axis=1)
    speed = (commanded - before) / 0.1
    np.testing.assert_allclose(commanded - measured, LAG * speed, atol=0.1 * LAG * np.abs(speed).max())


@pytest.mark.parametrize(
    "grasp", [GraspConfig(), GraspConfig(left=(0.004, -0.003, 0.15), right=(-0.003, 0.004, -0.15))]
)
def test_the_welds_hold_the_cable_where_and_as_it_is_grasped(grasp: GraspConfig):
    plant = plant_of(with_post(), grasp=grasp)
    rows = led(plant, np.array([[0.0, 0.01, 0.05]] * 2), 6)
    for row in rows:
        np.testing.assert_allclose(row.centreline[[0, -1]], row.poses[:, :2], atol=6e-4)
        steps = np.diff(row.centreline[[0, 1, -2, -1]], axis=0)[[0, 2]]
        angles = np.arctan2(steps[:, 1], steps[:, 0]) - row.poses[:, 2]
        assert np.abs((angles + np.pi) % (2 * np.pi) - np.pi).max() < 0.01
    apart = np.linalg.norm(plant._reached[:, :2] - rows[-1].poses[:, :2], axis=1)
    np.testing.assert_allclose(apart, [np.hypot(*grasp.left[:2]), np.hypot(*grasp.right[:2])], atol=1e-9)


def test_a_hand_pressed_against_a_post_is_stopped_by_it_and_that_is_contact():
    left = PLAN.poses[0, 0]
    outward = -np.array([np.cos(left[2]), np.sin(left[2])])
    post = Disc(center=tuple((left[:2] + 0.05 * outward).tolist()), radius=0.015, height=0.05)
    plant = plant_of(with_post(post))
    assert plant.measure().gripper_clearance > 0.005
    rows = led(plant, np.array([[*0.008 * outward, 0.0]] * 2), 6)
    assert min(row.gripper_clearance for row in rows) <= 0
    way_made = (rows[-1].poses[0, :2] - left[:2]) @ outward
    assert 0.02 < way_made < 0.03, "asked for 48 mm, 22 mm before the post"
    torques = plant._data.qfrc_actuator[plant.model.nv - 12 :].reshape(2, 6)
    assert (np.abs(torques) <= np.array(UR5E.torque_limit) + 1e-9).all()


def test_a_link_pressed_against_a_column_is_stopped_by_it_and_that_is_contact():
    arms = CellKinematics(TASK, way())
    assert PLAN.joints is not None
    ends, radius = arms.links(PLAN.joints[:1])[0]
    forearm = next(k for k, each in enumerate(UR5E.capsules) if each.frame == 3)
    beside = ends[0, forearm].mean(axis=0)[:2] + [0.0, radius[forearm] + 0.03]
    plant = plant_of(with_post(Disc(center=tuple(beside.tolist()), radius=0.01, height=0.8)))
    assert plant.measure().gripper_clearance > 0.005
    rows = led(plant, np.array([[0.0, 0.008, 0.0]] * 2), 12)
    free = led(plant_of(with_post()), np.array([[0.0, 0.008, 0.0]] * 2), 12)
    assert min(row.gripper_clearance for row in rows) <= 0
    assert min(row.gripper_clearance for row in free) > 0
    assert rows[-1].poses[0, 1] < free[-1].poses[0, 1] - 0.01, "it stays behind"


def test_speeds_and_positions_beyond_the_limits_of_a_joint_are_never_commanded(monkeypatch):
    turning = np.array([[0.0, 0.01, 0.1]] * 2)
    monkeypatch.setitem(ARM_MODELS, "ur5e", replace(UR5E, speed_limit=(0.01,) * 6))
    plant = plant_of(with_post())
    with pytest.raises(SimulationError, match=r"would have to turn its \w+_joint at .*/s, limit 0.573 degrees/s"):
        plant.step(turning)
    assert PLAN.joints is not None
    limit = np.abs(PLAN.joints[0]).max(axis=0) + 0.25
    monkeypatch.setitem(ARM_MODELS, "ur5e", replace(UR5E, position_limit=tuple(limit.tolist())))
    plant = plant_of(with_post())
    led(plant, turning, 2)
    before = plant.state()
    with pytest.raises(SimulationError, match=r"would have to turn its \w+_joint to .* degrees, limit .* \(step"):
        led(plant, turning, 10)
    assert (np.abs(plant._drive.state()[:, :6]) <= limit).all()
    assert not np.array_equal(plant.state().drive, before.drive), "it went on until then"


def test_where_no_arm_reaches_nothing_is_commanded_and_the_plant_stays_as_it_was():
    plant = plant_of(with_post(), grasp=GraspConfig(hold=1000.0))  # hands that lag by different times pull hard
    led(plant, np.array([[0.0, 0.02, 0.0]] * 2), 17)
    with pytest.raises(SimulationError, match=r"the arm at the \w+ gripper cannot reach .* in its branch \(step"):
        led(plant, np.array([[0.0, 0.003, 0.0]] * 2), 30)
    state = plant.state()
    held = led(plant, STILL, 1)[0]
    plant.restore(state)
    np.testing.assert_array_equal(led(plant, STILL, 1)[0].keypoints, held.keypoints)


def test_the_same_run_is_the_same_and_a_branch_goes_on_bit_for_bit():
    plant, action = plant_of(), np.array([[0.002, 0.003, 0.01]] * 2)
    led(plant, action, 2)
    state = plant.state()
    first = led(plant, action, 3)[-1]
    plant.restore(state)
    np.testing.assert_array_equal(led(plant, action, 3)[-1].keypoints, first.keypoints)
    plant.reset()
    again = led(plant, action, 5)[-1]
    np.testing.assert_array_equal(again.keypoints, first.keypoints)
    np.testing.assert_array_equal(again.joints, first.joints)


def test_which_plant_a_task_in_a_cell_has():
    assert plant_of(arms="exact", table=Perturbation().resolved(TASK).table).measure().joints is None
    assert Perturbation(arms="exact").build(TASK, plan=PLAN).measure().joints is None
    assert Perturbation().build(TASK).measure().joints is None, "no plan says how the arms hold it"
    assert Perturbation().resolved(cw.load_task("maze-1")) == Perturbation()
    rough = replace(TASK.cable, friction=0.4)
    table = Perturbation(cable=rough).resolved(TASK).table
    assert table is not None
    assert table.friction == 0.4
    with pytest.raises(InputError, match="unknown arms 'stiff'; known: exact, simulated"):
        Perturbation(arms="stiff")  # pyright: ignore[reportArgumentType]
