"""Plans in a cell: their joints, who refuses what arms cannot do, and the judge of both."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from folding_arms import FOLDING
from recording_arms import RecordingArm

import cableway as cw
from cableway.cli.planning import CELL_NAMES
from cableway.core.errors import InputError, PlanningError, SimulationError, TaskError, UnknownNameError
from cableway.outcome import Outcome
from cableway.planning.projection import LIMIT_SHARE
from cableway.robot.branches import ArmMotion, NoMotion, arm_motion, end_fault
from cableway.robot.cell_kinematics import LEAST, CellKinematics
from cableway.robot.ur import URRobot
from cableway.scene.arm_models import ARM_MODELS
from cableway.scene.cell import CELLS, Cell, MountedArm, Way
from cableway.scene.files.loading import load_cell
from cableway.scene.obstacles import Disc
from cableway.scene.task import CONTROL_STEP
from cableway.simulation.perturbations.grasp import GraspConfig
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.table_plant import TableConfig
from cableway.tasks.generation import random_task_with_witness
from cableway.verdict import FINDINGS
from cableway.verification.arms import arm_checks
from cableway.verification.grasps import tool_poses
from cableway.workflow.follow import _recovery
from cableway.workflow.registry import Planner


@pytest.fixture(scope="module")
def planned() -> tuple[cw.Task, cw.Plan]:
    task = cw.random_task(0, "cell")
    return task, cw.plan(task, seed=0)


def failed(plan: cw.Plan, task: cw.Task) -> set[str]:
    return {check.name for check in cw.verify_plan(plan, task).failures()}


def test_a_plan_has_joints_that_run_on_and_the_judge_passes_them(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    assert plan.joints is not None
    assert plan.joints.shape == (plan.steps + 1, 2, 6)
    assert np.abs(np.diff(plan.joints, axis=0)).max() < 0.3
    assert cw.verify_plan(plan, task).passed
    names = {check.name for check in cw.verify_plan(plan, task).checks}
    assert {"tool distance", "joint speed", "arm clearance", "arm clearance from the table"} <= names <= set(FINDINGS)


def test_kinematics_of_the_cell_lead_back_and_forth(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    assert plan.joints is not None
    way = Way.of_record(plan.metadata)
    assert way is not None
    arms = CellKinematics(task, way)
    for row in (0, plan.steps // 2, plan.steps):
        at = arms.poses(plan.joints[row])
        np.testing.assert_allclose(at[:, :2], plan.poses[row][:, :2], atol=1e-9)
        turned = plan.joints[row] + 2 * np.pi * np.array([[0, 1, 0, 0, 0, -1]] * 2)
        np.testing.assert_allclose(arms.joints(plan.poses[row], turned), turned, atol=1e-9)
    with pytest.raises(SimulationError, match=r"the arm at the left gripper cannot reach"):
        arms.joints(plan.poses[0] + np.array([[9.0, 0, 0]] * 2), plan.joints[0])
    with pytest.raises(InputError, match="has no cell"):
        CellKinematics(cw.load_task("single-obstacle-1"), way)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda plan: replace(plan, joints=None), "arms"),
        (lambda plan: replace(plan, metadata={}), "arms"),
        (lambda plan: replace(plan, metadata={"arms": ["left"]}), "arms"),
        (lambda plan: replace(plan, metadata={"arms": {"holders": [1, 1], "turns": [0, 0]}}), "arms"),
        (lambda plan: replace(plan, joints=plan.joints + 0.01), "tool distance"),
        (lambda plan: replace(plan, joints=plan.joints[:, ::-1]), "tool distance"),
        (lambda plan: replace(plan, joints=plan.joints + np.eye(6)[5] * 0.1), "tool angle"),
        (lambda plan: replace(plan, joints=plan.joints + np.eye(6)[0] * 4 * np.pi), "joint position"),
        (lambda plan: replace(plan, joints=plan.joints + 2 * np.pi * (np.arange(len(plan.joints)) > 5)[:, None, None]),
         "joint speed"),
    ],
)  # fmt: skip
def test_the_judge_refuses_joints_that_are_not_those_of_the_plan(planned, change, name: str):
    task, plan = planned
    assert name in failed(change(plan), task)


def test_the_judge_finds_links_in_each_other_and_in_what_is_tall(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    cell = task.cell
    assert cell is not None
    left, right = cell.arms
    x, y, z = right.position
    near = replace(cell, arms=(left, replace(right, position=(x - 0.5, y, z))))
    assert "arm clearance" in failed(plan, replace(task, cell=near))
    deep = replace(cell, arms=(left, replace(right, position=(x, y, z - 0.3))))
    assert "arm clearance from the table" in failed(plan, replace(task, cell=deep))
    assert cell.furnished(task.scene) == task.scene
    tall = replace(task.scene, obstacles=tuple(replace(each, height=None) for each in task.scene.obstacles))
    assert "arm clearance from the table" in failed(plan, task.in_scene(tall))


def test_arms_that_do_not_reach_are_told_before_the_search():
    task = cw.random_task(0, "cell")
    assert task.cell is not None
    far = tuple(replace(arm, position=(2 * arm.position[0], 0.0, 0.15)) for arm in task.cell.arms)
    task = replace(task, cell=replace(task.cell, arms=far))
    with pytest.raises(PlanningError, match="there is no plan: at the start, no arm reaches the") as error:
        cw.plan(task)
    assert error.value.outcome == Outcome.INFEASIBLE
    assert error.value.attempt.at is not None


def test_a_witness_is_followed_and_in_no_other_way_where_the_cable_is_held():
    task, witness = random_task_with_witness(1, "cell")
    assert witness is not None
    assert task.cell is not None
    poses = task.cable.rod.shapes(witness.q)[1]
    motion = arm_motion(poses, task, task.cell)
    assert isinstance(motion, ArmMotion)
    assert end_fault(task, task.cell) is None
    held = task.held(motion.way).cell
    assert held is not None
    again = arm_motion(poses, task, held)
    assert isinstance(again, ArmMotion)
    np.testing.assert_array_equal(again.joints, motion.joints)
    swapped = motion.way._replace(holders=motion.way.holders[::-1], turns=motion.way.turns[::-1])
    other = arm_motion(poses, task, replace(task.cell, way=swapped))
    assert isinstance(other, NoMotion) or other.way == swapped
    assert Way.of_record({"arms": motion.way.described()}) == motion.way
    for forged in (None, 3, ["left"], {"holders": [0, 1]}, {"holders": [0, 0], "turns": [0, 0], "branches": [0, 0]}):
        assert Way.of_record({} if forged is None else {"arms": forged}) is None


ASKEW = GraspConfig(
    left=(0.004, -0.002, 0.1),
    left_after=(0.004, -0.002, 0.1),
    right=(-0.003, 0.003, -0.12),
    slip_time=3.0,
    right_after=(-0.001, 0.001, -0.08),
)


@pytest.mark.parametrize("arms", ["simulated", "exact"])
def test_a_run_in_a_cell_has_the_joints_of_the_plant_or_of_what_the_grippers_did(arms: Any):
    """Also where the cable is held askew: a rollout has the poses of its ends, and the tools are at the grippers."""
    task = cw.random_task(2, "cell")
    coarse = TableConfig(segments=12, time_step=0.005) if arms == "simulated" else None
    perturbation = Perturbation(arms=arms, grasp=ASKEW, table=coarse)
    run = cw.solve(task, cw.SolveOptions(time_limit=60.0, perturbation=perturbation))
    assert run.success, run.report.failure
    assert run.rollout is not None
    assert run.rollout.joints is not None
    assert run.plan is not None
    assert run.rollout.metadata["arms"] == run.plan.metadata["arms"]
    assert run.rollout.metadata["plant"]["arms"] == arms
    hands = run.rollout.metadata.get("hands", {})
    assert (hands.get("grasped"), hands.get("let_go")) == ((True, True) if arms == "simulated" else (None, None))
    assert any("let go of it at the goal" in note for note in run.report.notes) is (arms == "simulated")
    assert (run.rollout.metadata["plant"]["table"] is None) == (arms == "exact")
    assert run.report.rollout_verdict is not None
    assert "tool distance" in {check.name for check in run.report.rollout_verdict.checks}
    motion = arm_motion(
        tool_poses(run.rollout), task, replace(task.cell, way=Way.of_record(run.plan.metadata)), made=True
    )
    assert isinstance(motion, ArmMotion)
    off = np.abs(motion.joints - run.rollout.joints).max()
    assert off < (1e-9 if arms == "exact" else 5e-3)
    assert off > 0 or arms == "exact", "joints that servos hold are never just those"
    forged = {**run.rollout.metadata["plant"], "grasp": {"left": [0.0, 0.0, 0.0], "right": [9.0, "x", None]}}
    lying = replace(run.rollout, metadata={**run.rollout.metadata, "plant": forged})
    assert "tool distance" in {check.name for check in cw.verify_rollout(lying, task).failures()}


def test_a_named_task_in_a_cell_and_its_file(tmp_path: Path):
    task = cw.load_task("single-obstacle-1").in_cell(CELLS["dual-ur5e"])
    assert task.grippers.body == "2f-85"
    assert {each.height for each in task.scene.obstacles} == {0.05}
    path = tmp_path / "task.yaml"
    task.save(path)
    assert cw.load_task(path) == task
    text = path.read_text()
    path.write_text(text[: text.index("\ncell:")] + "\ncell: dual-ur5e\n")
    assert cw.load_task(path) == task


def test_a_cell_from_a_file(tmp_path: Path):
    path = tmp_path / "cell.yaml"
    path.write_text(
        "cableway: 1\nunits: mm\nangles: deg\nname: mine\ntool: 2f-85\nobstacle_height: 80\n"
        "arms:\n- {position: [-500, 0, 100]}\n- {position: [500, 0, 100], angle: 180}\n"
    )
    cell = load_cell(path)
    assert cell.arms[1] == MountedArm(position=(0.5, 0.0, 0.1), angle=np.pi)
    assert cell.obstacle_height == pytest.approx(0.08)
    path.write_text(path.read_text().replace("[500, 0, 100]", "[50000, 0, 100]"))
    with pytest.raises(TaskError, match=r"cell.yaml:\d+: arms\[1\].position"):
        load_cell(path)
    path.write_text("cableway: 1\nname: mine\ntool: pliers\narms: [{position: [0, 0, 0]}, {position: [1, 0, 0]}]\n")
    with pytest.raises(TaskError, match="tool must be one of 2f-85, 2f-85-long-fingers, hand-e, got 'pliers'"):
        load_cell(path)
    with pytest.raises(UnknownNameError, match="unknown cell 'tripod'; known: dual-ur10e, dual-ur5e, "):
        load_cell("tripod")


def test_the_help_names_the_cells():
    assert "{" + ",".join([*CELLS, "FILE.yaml"]) + "}" == CELL_NAMES


def test_what_is_no_cell():
    arm = MountedArm(position=(0.0, 0.0, 0.0))
    with pytest.raises(TaskError, match="must be 2 arms, got 1"):
        Cell(name="one", arms=(arm,))
    with pytest.raises(TaskError, match="model must be one of ur5e, ur10e, ur3e, got 'ur3'"):
        MountedArm(position=(0.0, 0.0, 0.0), model="ur3")
    task = cw.load_task("single-obstacle-1")
    with pytest.raises(TaskError, match="must be the cell's tool, 2f-85, got disc"):
        replace(task, cell=CELLS["dual-ur5e"], grippers=replace(task.grippers, body="disc"))


def test_a_post_that_appears_under_a_link_is_found_by_planner_and_judge_alike(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    way = Way.of_record(plan.metadata)
    assert task.cell is not None
    assert way is not None
    column = Disc(center=(0.06, task.scene.size[1] / 2), radius=0.02, height=0.6)  # before the base of arm 0
    blocked = task.in_scene(replace(task.scene, obstacles=(*task.scene.obstacles, column)))
    assert isinstance(arm_motion(plan.poses, blocked, replace(task.cell, way=way)), NoMotion)
    assert "arm clearance from the table" in failed(plan, blocked)


def test_what_the_grippers_did_has_joints_whether_it_kept_clearance_or_not(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    way = Way.of_record(plan.metadata)
    assert task.cell is not None
    assert way is not None
    column = Disc(center=(0.06, task.scene.size[1] / 2), radius=0.02, height=0.6)
    blocked = task.in_scene(replace(task.scene, obstacles=(*task.scene.obstacles, column)))
    made = arm_motion(plan.poses, blocked, replace(task.cell, way=way), made=True)
    assert isinstance(made, ArmMotion)
    assert plan.joints is not None
    np.testing.assert_allclose(made.joints, plan.joints, atol=1e-9)
    assert made.clearance < 0


def test_a_recovery_goes_on_with_the_arms_as_they_hold_the_cable(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    way, asked = Way.of_record(plan.metadata), []

    def find(task: cw.Task, **options: Any) -> cw.Plan:
        asked.append(task)
        return plan

    recovery = _recovery(cw.SolveOptions(planner=Planner(None, find)), plan)
    assert recovery is not None
    assert recovery.replan(task, plan) is plan
    assert asked[0].cell.way == way is not None
    assert task.cell is not None
    assert task.cell.way is None


@pytest.mark.parametrize("limits", [{"position_limit": (0.3,) * 6}, {"speed_limit": (0.05,) * 6}])
def test_joints_beyond_their_limits_are_no_motion(
    planned: tuple[cw.Task, cw.Plan], limits: dict[str, Any], monkeypatch
):
    task, plan = planned
    assert task.cell is not None
    assert isinstance(arm_motion(plan.poses, task, task.cell), ArmMotion)
    monkeypatch.setitem(ARM_MODELS, "ur5e", replace(ARM_MODELS["ur5e"], **limits))
    found = arm_motion(plan.poses, task, task.cell)
    assert isinstance(found, NoMotion)
    assert "no joints within their limits follow the left gripper" in found.reason


def test_a_plan_gives_joints_the_time_that_they_need_to_accelerate(
    planned: tuple[cw.Task, cw.Plan], monkeypatch: pytest.MonkeyPatch
):
    task, plan = planned
    monkeypatch.setitem(ARM_MODELS, "ur5e", replace(ARM_MODELS["ur5e"], acceleration_limit=(1.0,) * 6))
    slow = cw.plan(task, seed=0)
    for each, limit in ((plan, 5.0), (slow, 1.0)):
        assert each.joints is not None
        at_rest = np.concatenate([each.joints[:1], each.joints, each.joints[-1:]])
        accelerations = np.diff(at_rest, 2, axis=0) / CONTROL_STEP**2
        assert 0.4 * limit < np.abs(accelerations).max() <= LIMIT_SHARE * limit * (1 + 1e-6)
    assert slow.steps > 1.3 * plan.steps
    assert slow.metadata["arms"] == plan.metadata["arms"]


def test_ends_that_are_held_in_different_branches_are_told_before_the_search():
    task = cw.random_task(312, "posts")
    cell = next(cell for cell in CELLS.values() if cell.tool == task.grippers.body)
    fault = end_fault(task.in_cell(cell), cell)
    assert fault is not None
    said = "the arms cannot hold the cable at the goal, at ({:.3f}, {:.3f}) m and at ({:.3f}, {:.3f}) m, as they can"
    assert fault.reason.startswith(said.format(*task.gripper_poses("goal")[:, :2].ravel()))
    assert fault.reason.endswith((" m, in the same branches of their joints", ", and at the goal arm 1's"))


def test_arms_that_come_too_near_to_each_other_are_told_with_the_place():
    """Bases 0.55 m apart."""
    cell = CELLS["dual-ur5e"]
    near = replace(cell, arms=tuple(replace(arm, position=(arm.position[0] / 2, 0.0, 0.15)) for arm in cell.arms))
    fault = end_fault(cw.load_task("real-maze").in_cell(near), near)
    assert fault is not None
    assert fault.reason == "at the goal, the arms come within 4.7 mm of each other at (0.127, 0.595) m"


def test_the_judge_takes_off_what_links_may_come_nearer_between_its_looks(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    way = Way.of_record(plan.metadata)
    assert task.cell is not None
    assert way is not None
    on_rows = arm_motion(plan.poses, task, replace(task.cell, way=way))
    assert isinstance(on_rows, ArmMotion)
    found = [check.value for check in cw.verify_plan(plan, task).checks if check.name.startswith("arm clearance")]
    assert on_rows.clearance - 0.02 < min(found) < on_rows.clearance - 0.0005
    fast = replace(plan, joints=plan.joints[::12], poses=plan.poses[::12], shapes=plan.shapes[::12], q=None)
    swept = [check for check in arm_checks(fast, task) if check.name.startswith("arm clearance")]
    assert all(check.value > min(found) - 0.02 for check in swept), "looks are as near to each other where rows are not"
    assert any(check.row is not None and check.row % 1 for check in swept)


def test_an_exported_trajectory_says_which_arms_its_joints_are_of(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    trajectory = cw.Trajectory.of(replace(plan, approach=None, retreat=None), task, rate=125)
    assert trajectory.header["joints"]["arms"] == plan.metadata["arms"]
    assert trajectory.joints is not None
    np.testing.assert_allclose(trajectory.joints.positions[[0, -1]], plan.joints[[0, -1]], atol=1e-9)


def sent_along(plan: cw.Plan, task: cw.Task, kinematics: Any) -> tuple[list[RecordingArm], str]:
    """Arms that were sent along a plan, a hundredth of a second from command to command, and what ended that."""
    assert plan.joints is not None
    now = iter(np.arange(0.0, 1e3, 0.008))
    both = [RecordingArm(joints, 1 / 125) for joints in kinematics.joints(plan.poses[0], plan.joints[0])]
    arms = [each.arm(f"{side} arm") for side, each in zip(("left", "right"), both, strict=True)]
    robot = URRobot(task, arms, kinematics, Seen(), joint_speed=3.0, clock=lambda: float(next(now)))
    try:
        for row in np.arange(0.0, plan.steps, 0.05):
            share = row % 1
            robot.send((1 - share) * plan.poses[int(row)] + share * plan.poses[int(row) + 1])
    except SimulationError as error:
        return both, str(error)
    return both, ""


class Seen:
    """A camera that sees nothing."""

    def keypoints(self) -> np.ndarray:
        return np.full((13, 2), np.nan)


class Blind:
    """Kinematics of one's own, which knows of no links."""

    def __init__(self, known: CellKinematics) -> None:
        self.poses, self.joints = known.poses, known.joints


def test_the_driver_sends_no_links_together(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    way = Way.of_record(plan.metadata)
    assert way is not None
    assert task.cell is not None
    both, said = sent_along(plan, task, CellKinematics(task, way))
    assert said == ""
    assert len(both[0].sent) == 20 * plan.steps
    column = Disc(center=(0.15, task.scene.size[1] / 2), radius=0.02, height=0.6)
    first, second = task.cell.arms
    x, y, z = second.position
    near = replace(task.cell, arms=(first, replace(second, position=(x - 0.4, y, z), model=FOLDING)))
    cases = {
        r"^links of the arm at the right gripper would come within [34]\.\d mm of table": task.in_scene(
            replace(task.scene, obstacles=(*task.scene.obstacles, column))
        ),
        r" would come within [34]\.\d mm of ": replace(task, cell=near),
    }
    for pattern, other in cases.items():
        kinematics = CellKinematics(other, way)
        both, said = sent_along(plan, other, kinematics)
        assert re.search(pattern, said), said
        joints = np.stack([[row for _, row in each.sent] for each in both], axis=1)
        assert 20 < len(joints) < 20 * plan.steps
        assert kinematics.room(joints)[0].min() >= LEAST - 1e-9
        blindly = sent_along(plan, other, Blind(kinematics))[1]
        assert blindly == "" or "its elbow_joint" in blindly, "it takes the arms for UR5e, and knows of no links"
        assert kinematics.fault(joints[-1], joints[-2]) == "", "back they may"
