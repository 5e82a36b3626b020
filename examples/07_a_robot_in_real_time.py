"""A robot led in real time: what `track_in_real_time` asks of a driver, with a simulated cable in place of hardware."""

import threading
import time

import numpy as np

import cableway as cw
from cableway.records import Observation


class MyRobot:
    """In place of drivers and a camera: a simulated cable, led ten times a second to what was sent last."""

    def __init__(self, task):
        self.task, self._stopped = task, False
        self._cable = cw.CableSimulator(task)
        self._message = self._cable.reset()
        self._target = self._reached = self._message.poses
        threading.Thread(target=self._work).start()

    def send(self, poses):
        self._target = poses

    def observe(self) -> Observation:
        return self._message

    def stop(self):
        self._stopped = True

    def _work(self):
        due = time.monotonic()
        while not self._stopped:
            most, motion = self.task.grippers, self._target - self._reached
            motion[:, :2] *= min(1.0, most.max_step / max(np.hypot(*motion[:, :2].T).max(), 1e-9))
            motion[:, 2] = motion[:, 2].clip(-most.max_turn, most.max_turn)
            self._message = self._cable.step(motion)
            self._reached = self._reached + motion
            due += 0.1
            time.sleep(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    task = cw.load_task("single-obstacle-2")
    plan = cw.plan(task)
    rollout = cw.track_in_real_time(MyRobot(task), cw.RodMPC(), plan, rate=50, deadline=0.05)
    report = cw.summarize(task, plan, rollout)
    print(f"{rollout.outcome}, {1000 * report.shape_error:.1f} mm")
    print(*(f"{name}: {value}" for name, value in report.rows() if "command" in name or "control" in name), sep="\n")
