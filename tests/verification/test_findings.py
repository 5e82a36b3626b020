"""What the checks found, in sentences for people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from problems import LOW_ARC, MOVED_ARC, line_in_q
from recorded import moved_plan, perfect_rollout

from cableway.scene.files.loading import load_task
from cableway.scene.task import CONTROL_STEP
from cableway.verdict import FINDINGS, Check, Verdict
from cableway.verification import verify_plan, verify_rollout
from cableway.verification.plan import verify_insertion_plan
from cableway.verification.plug import plug_clearance
from cableway.verification.rollout import verify_insertion

ARMS = {
    *("gripper body clearance", "gripper body from the cable", "gripper bodies apart", "arms", "tool distance"),
    *("tool angle", "joint position", "joint speed", "arm clearance", "arm clearance from the table"),
    *("joint acceleration", "open hands", "open hand clearance", "hand clearance from the table"),
    "joint position beyond its range",
}
"""Of tasks with gripper bodies or arms."""

RAMPS = {"max_acceleration": 0.5, "max_turn_acceleration": 5.0, "max_jerk": 5.0, "max_turn_jerk": 50.0}

SAID = [
    (Check("rod deviation", 0.004824, "m", 0.002, False, row=191),
     "the cable would stray 4.8 mm from the planned shape (limit 2 mm) at t = 19.1 s"),
    (Check("cable clearance", 0.0012, "m", 0.004, False, "the cable and the left wall", 4.0),
     "the cable and the left wall are 1.2 mm apart (limit 4 mm) at t = 0.4 s"),
    (Check("gripper clearance", -0.0031, "m", 0.004, False, "the left gripper and the left wall", 0),
     "the left gripper and the left wall overlap by 3.1 mm (least clearance 4 mm) at t = 0.0 s"),
    (Check("length error", 0.0312, "1", 0.02, False, row=10),
     "the length of the cable is off by 3.1% (limit 2%) at t = 1.0 s"),
    (Check("rows the rod does not reach", 45.0, "", 0.0, False, row=16),
     "the cable could not take 45 of the planned shapes, first that at t = 1.6 s"),
    (Check("failures recorded", 1.0, "", 0.0, False, "left plan"), "the record tells of a failure: left plan"),
    (Check("plug angle", float("nan"), "rad", 0.05, False, "never reached the port"),
     "plug angle: never reached the port"),
]  # fmt: skip


@pytest.mark.parametrize(("check", "said"), SAID, ids=lambda each: getattr(each, "name", ""))
def test_a_finding_is_a_sentence_in_millimetres_and_seconds(check: Check, said: str):
    verdict = Verdict.of([check], CONTROL_STEP * np.arange(300))
    assert str(verdict) == said


@pytest.mark.parametrize("value", [0.0020004, 0.00200001, 0.0019999])
def test_a_value_just_off_its_limit_is_told_from_it(value: float):
    said = str(Check("gripper step", value, "m", 0.002, False))
    assert "(limit 2 mm)" in said
    assert "moves 2.0 mm" not in said


def test_times_are_those_of_the_record():
    """Rows of a rollout come when its times say, not every 0.1 s."""
    task, plan = moved_plan()
    rollout = perfect_rollout(task, plan)
    slow = replace(rollout, times=2 * rollout.times + 5)
    for check in verify_rollout(slow, task).checks:
        assert check.time == (None if check.row is None else pytest.approx(5 + 2 * CONTROL_STEP * check.row))


def test_every_check_has_a_sentence():
    """Those of plans and rollouts, with and without what only some tasks ask for."""
    task, plan = moved_plan()
    rollout = perfect_rollout(task, plan)
    asked = replace(
        task, start_poses=plan.poses[0], goal_poses=plan.poses[-1], grippers=replace(task.grippers, **RAMPS),
        cable=replace(task.cable, min_bend_radius=0.01),
    )  # fmt: skip
    ported = load_task("insertion")
    inserting = replace(plan, shapes=np.stack([ported.goal] * 2), poses=plan.poses[:2], q=None, stages=None)
    checks = [
        *verify_plan(replace(plan, q=line_in_q(task.cable.rod, LOW_ARC, MOVED_ARC, len(plan.shapes))), asked).checks,
        *verify_rollout(rollout, asked).checks,
        *verify_insertion_plan(inserting, ported).checks,
        *verify_insertion(perfect_rollout(ported, inserting), ported).checks,
        *plug_clearance(np.array([[0.1, 0.3, 0.0], [0.2, 0.3, 0.0]]), ported, 0.0, inserting=True),
    ]
    found = {check.name for check in checks}
    assert found <= set(FINDINGS)
    assert set(FINDINGS) - found <= {"plug clearance before the port", "twist", *ARMS}  # twist: in space alone
