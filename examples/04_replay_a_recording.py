"""Replay a recorded run to other controllers, and compare their actions.

A plant need not be a simulator: this one is a recording. It returns the recorded observations step by step, whatever
the actions. The result is the action that a controller would have taken in each situation, but not how the cable
would have responded. The controller that made the recording takes the same actions again, bit for bit.

    python 04_replay_a_recording.py [FOLDER]     # of `cableway run`; without it, the script makes a run first
"""

import sys
from pathlib import Path

import numpy as np

import cableway as cw
from cableway.core.errors import SimulationError
from cableway.records import Measurement, Observation


class Recording:
    """A plant that goes through the rows of a rollout."""

    control_step = 0.1

    def __init__(self, task: cw.Task, rollout: cw.Rollout) -> None:
        self.task, self._rollout, self._row = task, rollout, 0

    def reset(self) -> Observation:
        """Back to the first row."""
        self._row = 0
        return self._seen()

    def step(self, action: np.ndarray) -> Observation:
        """On to the next row; the action moves nothing."""
        if self._row == self._rollout.steps:
            raise SimulationError("the recording is over")
        self._row += 1
        return self._seen()

    def measure(self) -> Measurement:
        """What was true in this row."""
        row, run = self._row, self._rollout
        return Measurement(
            run.keypoints[row],
            run.poses[row],
            run.centreline[row],
            float(run.clearance[row]),
            float(run.gripper_clearance[row]),
        )

    def _seen(self) -> Observation:
        run = self._rollout
        return Observation(float(run.times[self._row]), run.observed[self._row], run.poses[self._row])


def record(folder: Path) -> None:
    """A run of a cable that is 1% longer than nominal, measured with 1 mm of noise."""
    task = cw.load_task("single-obstacle-2")
    plan = cw.plan(task, seed=0)
    cable = cw.Cable(length=1.01 * task.cable.length)
    plant = cw.SensedPlant(cw.CableSimulator(task, cable=cable), cw.SensingConfig(keypoint_noise=0.001), seed=0)
    plan.save(folder / "plan.npz")
    cw.track(plant, cw.RodMPC(), plan).save(folder / "rollout.npz")


given = [Path(name) for name in sys.argv[1:]]
folder = given[0] if given else Path("out")
if not given:
    record(folder)
task = cw.load_task(folder / "task.yaml" if given else "single-obstacle-2")
plan, recorded = cw.Plan.load(folder / "plan.npz"), cw.Rollout.load(folder / "rollout.npz")
print(f"recorded with {recorded.metadata['controller']['name']}: {recorded.steps} steps")
for controller in (cw.RodMPC(), cw.JacobianFeedback(), cw.OpenLoop()):
    replayed = cw.track(Recording(task, recorded), controller, plan)
    steps = min(replayed.steps, recorded.steps)
    differs = np.linalg.norm((replayed.actions[:steps] - recorded.actions[:steps])[..., :2], axis=-1).max(axis=1)
    print(
        f"  {type(controller).__name__:16} would have moved a gripper otherwise by {1000 * np.median(differs):.2f} mm "
        f"(median), {1000 * differs.max():.2f} mm (most) in a step"
    )
