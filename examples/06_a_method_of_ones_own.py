"""Your own controller in the benchmark: one file, one row in the table.

Each gripper gets feedback of the mean error of its half of the cable, on top of the plan's motion. `METHOD` is all
that the benchmark needs; run it on a suite with
`cableway bench clutter --methods examples/06_a_method_of_ones_own.py:METHOD,open-loop`.
"""

import types

import numpy as np

from cableway.benchmark.methods import Method
from cableway.cli import main
from cableway.control.base import Controller, Status
from cableway.control.following import FollowerState


class HalfByHalf(Controller[FollowerState]):
    """Feedforward, and a share of the mean error of the keypoints nearer to each gripper."""

    config = types.MappingProxyType({"gain": 0.3, "hold": 1.5})

    def init(self, task, plan):
        return FollowerState(**FollowerState.beginning(task, plan, hold=self.config["hold"]))

    def step(self, state, observation):
        state = state.looking(observation)
        action = state.plan.actions(state.index, 1)[0].copy()
        error = state.plan.shape(state.index) - state.tracker.keypoints
        if np.isfinite(error).all():
            action[:, :2] += self.config["gain"] * np.array([half.mean(axis=0) for half in np.array_split(error, 2)])
        return state.sending(action, Status.TRACKING, state.task.cable.length)


METHOD = Method(name="half-by-half", description="feedback of each half's mean error", controller=HalfByHalf)

if __name__ == "__main__":
    few = "open-near-20000,open-near-20002,open-far-20003"
    main(["bench", "unconstrained", "--methods", f"{__file__}:METHOD,open-loop", "--episodes", few, "--out", "out"])
