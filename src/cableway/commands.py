"""What is sent to the grippers in a run, in figures that a person can compare with a robot, and how they stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.core.quantities import place, quantity
from cableway.geometry.groups import SE2
from cableway.records import Rollout
from cableway.tracking.loop import TRIAL, WAITING

STOP = 3
"""Control steps without a command from which on the grippers are taken to be stopped."""

RESTING = (5e-4, 5e-3)
"""Motion [m] and turn [rad] in a control step up to which a gripper is at rest."""


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
    def of(*rollouts: Rollout) -> Commands:
        """Those of a rollout, or of several one after the other, such as a run and its insertion."""
        sent = [_targets(rollout) for rollout in rollouts]
        moves, turns = (np.concatenate(parts) for parts in zip(*(_speeds(*part) for part in sent), strict=True))
        x, y = SE2.position(np.concatenate([poses for poses, _ in sent])).reshape(-1, SE2.space).T
        left, right = (tuple(map(float, pose)) for pose in rollouts[0].poses[0])
        return Commands(
            count=sum(rollout.steps for rollout in rollouts),
            duration=sum(float(rollout.times[-1] - rollout.times[0]) for rollout in rollouts),
            speed=float(moves.max(initial=0.0)), turn_rate=float(turns.max(initial=0.0)),
            box=(float(x.min()), float(x.max()), float(y.min()), float(y.max())), first=(left, right),
            clearance=min(rollout.least_clearance for rollout in rollouts),
        )  # fmt: skip

    def rows(self) -> list[tuple[str, str]]:
        """Names and values as text with units."""
        left, right = (f"{place(pose[:2])}, {quantity(pose[2], 'rad')}" for pose in self.first)
        return [
            ("would be sent", f"{self.count} commands in {self.duration:.1f} s"),
            ("greatest speeds", f"{quantity(self.speed, 'm/s')}, {quantity(self.turn_rate, 'rad/s')}"),
            ("grippers stay in", f"{place(self.box[::2])} to {place(self.box[1::2])}"),
            ("first pose, left", left),
            ("first pose, right", right),
        ]


def stopping_time(rollout: Rollout) -> float | None:
    """Longest time [s] from a stop until both grippers are at rest; None where they were never stopped.

    Where they only wait for a gripper that is late, it still carries out its command.
    """
    still = ~rollout.actions.any(axis=(1, 2)) & ~np.isin(rollout.status, (WAITING, TRIAL))
    moved, turned = SE2.distance(rollout.poses[:-1], rollout.poses[1:])
    moving = np.any((moved > RESTING[0]) | (turned > RESTING[1]), axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still, [0]])))
    longest = None
    for first, end in edges.reshape(-1, 2).tolist():
        if end - first >= STOP:
            last = first + int(np.flatnonzero(moving[first:end]).max(initial=-1)) + 1
            longest = max(longest or 0.0, float(rollout.times[last] - rollout.times[first]))
    return longest


def _targets(rollout: Rollout) -> tuple[Float[np.ndarray, "t 2 3"], Float[np.ndarray, "t-1"]]:
    """Gripper poses [m, m, rad] that were sent, and the times [s] between them."""
    still = np.zeros((1, 2, SE2.dof))
    poses = SE2.plus(rollout.poses[0], np.cumsum(np.concatenate([still, rollout.actions]), axis=0))
    return poses, np.diff(rollout.times)


def _speeds(
    poses: Float[np.ndarray, "t 2 3"], seconds: Float[np.ndarray, "t-1"]
) -> tuple[Float[np.ndarray, "t-1 2"], Float[np.ndarray, "t-1 2"]]:
    """Speeds [m/s] and rates of turning [rad/s] of both grippers between poses."""
    moves, turns = SE2.distance(poses[:-1], poses[1:])
    return moves / seconds[:, None], turns / seconds[:, None]
