"""What is sent to the grippers in a run, in figures that a person can compare with a robot before it moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cableway.geometry.groups import SE2
from cableway.records import Rollout


@dataclass(frozen=True, kw_only=True)
class Commands:
    """Figures of the commands of a run.

    Attributes:
        count: Number of control steps.
        duration: [s].
        speed: Greatest speed of a gripper [m/s].
        turn_rate: Greatest rate of turning [rad/s].
        box: Least and greatest x, least and greatest y of the grippers' centres [m].
        first: Poses (x, y, theta) [m, m, rad] of the left and the right gripper from which they begin.
        clearance: Least clearance of cable and grippers [m].
    """

    count: int
    duration: float
    speed: float
    turn_rate: float
    box: tuple[float, float, float, float]
    first: tuple[tuple[float, ...], tuple[float, ...]]
    clearance: float

    @staticmethod
    def of(rollout: Rollout) -> Commands:
        """Those of a rollout."""
        duration, first = float(rollout.times[-1] - rollout.times[0]), rollout.poses[0]
        poses = SE2.plus(first, np.cumsum(np.concatenate([np.zeros((1, 2, SE2.dof)), rollout.actions]), axis=0))
        step = duration / max(rollout.steps, 1) or 1.0
        moves, turns = SE2.distance(poses[:-1], poses[1:])
        x, y = SE2.position(poses).reshape(-1, 2).T
        left, right = (tuple(map(float, pose)) for pose in first)
        return Commands(
            count=rollout.steps, duration=duration,
            speed=float(moves.max(initial=0.0)) / step, turn_rate=float(turns.max(initial=0.0)) / step,
            box=(float(x.min()), float(x.max()), float(y.min()), float(y.max())), first=(left, right),
            clearance=rollout.least_clearance,
        )  # fmt: skip

    def rows(self) -> list[tuple[str, str]]:
        """Names and values as text with units."""
        left, right = (f"({x:.3f}, {y:.3f}) m, {np.degrees(turn):.1f} degrees" for x, y, turn in self.first)
        return [
            ("would be sent", f"{self.count} commands in {self.duration:.1f} s"),
            ("greatest speeds", f"{1000 * self.speed:.1f} mm/s, {np.degrees(self.turn_rate):.1f} degrees/s"),
            ("grippers stay in", "x {:.3f} to {:.3f} m, y {:.3f} to {:.3f} m".format(*self.box)),
            ("first pose, left", left),
            ("first pose, right", right),
        ]
