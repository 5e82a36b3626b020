"""The judge of a record, whichever it is: of a plan or a rollout, to the goal or into the port."""

from __future__ import annotations

from cableway.core.errors import InputError
from cableway.records import INSERTION, Plan, Rollout, Verdict
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import Task
from cableway.verification.plan import VerificationLimits, verify_insertion_plan, verify_plan
from cableway.verification.recording import plant_length
from cableway.verification.rollout import verify_insertion, verify_rollout


def kind_of(record: Plan | Rollout) -> str:
    """Which of "plan", "insertion plan", "rollout" and "insertion" a record is."""
    inserting = record.metadata.get("part") == INSERTION
    if isinstance(record, Plan):
        return "insertion plan" if inserting else "plan"
    return "insertion" if inserting else "rollout"


def verify_record(
    record: Plan | Rollout, task: Task | SpatialTask, limits: VerificationLimits | None = None
) -> Verdict:
    """Judge a record as what it is.

    Args:
        record: The record; of a rollout, the length of the plant's cable and where its obstacles were are what the
            record says.
        task: The task that it is for.
        limits: What a plan must keep.

    Raises:
        InputError: It has another number of keypoints than the task, states a length that is none, or inserts and the
            task has no port.
    """
    inserts = kind_of(record).startswith("insertion")
    if isinstance(task, SpatialTask):
        if inserts:
            raise InputError(f"a task in space has no port for an {kind_of(record)}")
        if isinstance(record, Plan):
            return verify_plan(record, task)
        from cableway.verification.spatial_rollout import verify_spatial_rollout  # which most tasks do without

        same_start = not record.metadata.get("another_start", False)
        return verify_spatial_rollout(record, task.as_recorded(record.metadata), same_start=same_start)
    if isinstance(record, Plan):
        return (verify_insertion_plan if inserts else verify_plan)(record, task, limits)
    judge = verify_insertion if inserts else verify_rollout
    return judge(record, task.as_recorded(record.metadata), length=plant_length(record, task))


def require_verified(
    record: Plan | Rollout, task: Task | SpatialTask, source: str, limits: VerificationLimits | None = None
) -> Verdict:
    """The verdict on a record, which must pass; `source` names the record in the error, the others are as above.

    Raises:
        InputError: It does not pass; the message has the first check that fails.
    """
    wrong = f"{source}: not a verified {kind_of(record)} of the task {task.name!r}"
    try:
        verdict = verify_record(record, task, limits)
    except InputError as error:
        raise InputError(f"{wrong}: {error}") from None
    if not verdict.passed:
        raise InputError(f"{wrong}: {verdict.failures()[0]}")
    return verdict
