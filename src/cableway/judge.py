"""The one definition of success."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.core.quantities import limit_text, quantity, told_apart
from cableway.outcome import SUCCESS_ERROR, Outcome, stacked_limit
from cableway.records import Rollout, Verdict
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import Task


def judge(
    task: Task,
    rollout: Rollout | None,
    *,
    plan_verdict: Verdict | None = None,
    rollout_verdict: Verdict | None = None,
    insertion_plan_verdict: Verdict | None = None,
    insertion_verdict: Verdict | None = None,
) -> tuple[Outcome, str]:
    """What became of a task, and a sentence on why it did not succeed. This is the one definition of success.

    A run succeeded where it was led to its end, the final stacked error is below 3 cm (of 13 keypoints, see
    `outcome.stacked_limit`), the cable was observed at the end, most steps were the controller's own, and neither the
    simulator nor the independent check found a contact; where the task has a port, the plug is in it besides. A plan
    alone succeeded where it verified. What there is no figure for is no success.

    Args:
        task: As the plant has it.
        rollout: What happened; None where the plan was not tracked.
        plan_verdict: Checks of the plan.
        rollout_verdict: Checks of the rollout.
        insertion_plan_verdict: Checks of the plan of the insertion.
        insertion_verdict: Checks of the insertion.
    """
    if rollout is None:
        if plan_verdict is None or not plan_verdict.passed:
            return Outcome.NOT_VERIFIED, f"the plan does not verify: {plan_verdict}"
    elif (failed := _run_failure(task.goal, rollout, rollout_verdict)) is not None:
        return failed
    if task.port is None:
        return Outcome.SUCCESS, ""
    if insertion_plan_verdict is not None and not insertion_plan_verdict.passed:
        return Outcome.NOT_VERIFIED, f"the insertion plan does not verify: {insertion_plan_verdict}"
    if rollout is None or (insertion_verdict is not None and insertion_verdict.passed):
        return Outcome.SUCCESS, ""
    if insertion_verdict is None:
        return Outcome.NOT_INSERTED, "the plug was not inserted"
    return Outcome.NOT_INSERTED, f"the plug is not inserted: {insertion_verdict}"


def judge_in_space(task: SpatialTask, rollout: Rollout, verdict: Verdict) -> tuple[Outcome, str]:
    """The same of a run in space, by its rollout and the checks of it."""
    return _run_failure(task.keypoints("goal"), rollout, verdict) or (Outcome.SUCCESS, "")


LAST_LOOK = 1.0
"""Time [s] at the end of a run in which the cable must have been observed."""

MOST_REPLACED = 0.5
"""Share of the controller's steps that may come late or fail in a successful run."""


def _went_on_blindly(rollout: Rollout) -> str | None:
    """Why a run cannot count as controlled, if so: its end was not observed, or it was led by replacements."""
    last = rollout.times > rollout.times[-1] - LAST_LOOK
    if rollout.steps and not np.isfinite(rollout.observed[last]).any():
        return f"the cable was not observed during the last {LAST_LOOK:g} s"
    replaced = sum(str(status).startswith(("late", "failed", "solver failed")) for status in rollout.status)
    if replaced > MOST_REPLACED * max(rollout.steps, 1):
        return f"{replaced} of the controller's {rollout.steps} steps came late or failed"
    return None


def _run_failure(
    goal: Float[np.ndarray, "n space"], rollout: Rollout, verdict: Verdict | None
) -> tuple[Outcome, str] | None:
    """Why a run did not lead the keypoints to their goal; the worst outcome with all reasons, None where it did."""
    found: list[tuple[Outcome, str]] = []
    if not rollout.outcome.finished:
        found.append((rollout.outcome, f"{rollout.outcome}: {rollout.detail}" if rollout.detail else rollout.outcome))
    error = rollout.shape_error(goal)
    if not error < (most := stacked_limit(SUCCESS_ERROR, len(goal))):
        text = f"the final shape error is {told_apart(error, most)}, not below {limit_text(most)}"
        found.append((Outcome.MISSED_GOAL, text))
    if (blind := _went_on_blindly(rollout)) is not None:
        found.append((Outcome.CONTROLLER_FAILED, blind))
    for what, clearance in (("cable", rollout.clearance), ("grippers", rollout.gripper_clearance)):
        if not clearance.min() > 0:
            text = f"contact: the least clearance of the {what} is {quantity(float(clearance.min()))}"
            found.append((Outcome.CONTACT, text))
    if not found and (verdict is None or not verdict.passed):
        found.append((Outcome.NOT_VERIFIED, f"the rollout does not verify: {verdict}"))
    if not found:
        return None
    touched = any(outcome is Outcome.CONTACT for outcome, _ in found)
    return Outcome.CONTACT if touched else found[0][0], "; ".join(text for _, text in found)
