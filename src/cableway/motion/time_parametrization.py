"""Time parametrisation: rows of a motion placed so that none asks more than one control step allows.

The effort of a section is the largest of what it asks for, each over its limit in one control step. Rows at equal
effort take the limits as far as they may, whatever the shape of the motion.

Note:
    Not in the paper (Tang et al.), whose reference has one row per step of the deformation optimisation.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from cableway.core.errors import PlanningError
from cableway.core.time_limit import checkpoint
from cableway.geometry.groups import SE2, SE3, Group
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.grippers import Grippers
from cableway.scene.task import CONTROL_STEP

GRID = 0.02
"""Spacing, in control steps at full speed, on which the profile of speed is computed."""

ROUNDS = 60
"""Most rounds in which the profile is made slower where a row is beyond a limit."""

NEAR = 1.5
"""How far, in control steps, from a row beyond a limit the motion is made slower."""

MOST_ROWS = 20_000
"""Largest number of control steps of a plan, half an hour, for a cable of 13 keypoints; see `require_rows`."""

ROUNDING = 1e-9

STRETCH = 1.05
"""Factor on the duration while rounds have not sufficed."""


def require_rows(steps: float, keypoints: int = 13) -> None:
    """Refuse a motion that would take more control steps than a plan may have.

    Raises:
        PlanningError: It would.
    """
    most = MOST_ROWS * 13 // max(13, keypoints)
    if not steps <= most:
        raise PlanningError(
            f"the motion takes {steps:.0f} control steps, {steps * CONTROL_STEP / 60:.0f} minutes, at the limits of "
            f"grippers.max_step and grippers.max_turn; a plan with {keypoints} keypoints has at most {most}"
        )


def gripper_effort(poses: Float[np.ndarray, "t 2 pose"], max_step: float, max_turn: float) -> Float[np.ndarray, "t-1"]:
    """Largest of the grippers' moves over `max_step` [m] and turns over `max_turn` [rad] between rows of poses."""
    move, turn = _group_of(poses).distance(poses[:-1], poses[1:])
    return np.maximum(move.max(1) / max_step, turn.max(1) / max_turn)


def at_equal_effort(
    fine: Float[np.ndarray, "f"], effort: Float[np.ndarray, "f-1"], share: float = 1.0
) -> Float[np.ndarray, "k"]:
    """Places among `fine`, increasing, with the same effort between any two of them, at most `share`.

    Args:
        fine: Places, first and last of which are kept.
        effort: Between one place and the next.
        share: Most effort of a step.
    """
    total = np.concatenate([[0.0], np.cumsum(np.maximum(effort, 1e-9))])
    count = max(1, int(np.ceil(total[-1] / share)))
    return np.interp(np.linspace(0, total[-1], count + 1), total, fine)


def ramp_effort(
    poses: Float[np.ndarray, "t 2 pose"], grippers: Grippers, arms: CellKinematics | None = None
) -> Float[np.ndarray, "t+3 2"]:
    """Acceleration and jerk over their limits, from rest before the first row to rest after the last.

    Args:
        poses: One row per control step, of the plane or of space.
        grippers: The limits.
        arms: What holds them all along, whose joints have limits of acceleration; None where nothing does.

    Returns:
        Columns: acceleration, whose entry i is centred on row i - 1, and jerk, centred on row i - 1.5; zero where
        there is no limit, and in the first row of acceleration, which has one entry fewer.
    """
    group, padded = _group_of(poses), _at_rest(poses)
    effort = np.zeros((len(poses) + 3, 2))
    limits = ((grippers.max_acceleration, grippers.max_turn_acceleration), (grippers.max_jerk, grippers.max_turn_jerk))
    for column, (order, (move, turn)) in enumerate(zip((2, 3), limits, strict=True)):
        # the differences before the motion and after it that are zero anyway are left out
        change = _differences(padded, order, group)[: len(effort)] / CONTROL_STEP**order
        moved = np.linalg.norm(group.position(change), axis=2).max(1) / (move or np.inf)
        turned = np.linalg.norm(change[..., group.space :], axis=2).max(1) / (turn or np.inf)
        effort[:, column] = np.maximum(moved, turned)
    if arms is not None:
        change = np.diff(_at_rest(arms.along(poses)), 2, axis=0)[: len(effort)] / CONTROL_STEP**2
        effort[:, 0] = np.maximum(effort[:, 0], (np.abs(change) / arms.acceleration_limit).max((1, 2)))
    return effort


def _group_of(poses: Float[np.ndarray, "t 2 pose"]) -> type[Group]:
    return SE3 if poses.shape[-1] == SE3.size else SE2


def _differences(rows: Float[np.ndarray, "t 2 pose"], order: int, group: type[Group]) -> Float[np.ndarray, "_ 2 step"]:
    """Second or third differences of poses; in space those of the steps from row to row, about the world's axes."""
    if group is SE3:
        return np.diff(group.minus(rows[1:], rows[:-1]), order - 1, axis=0)
    rows = rows.copy()
    rows[..., group.space :] = np.unwrap(rows[..., group.space :], axis=0)
    return np.diff(rows, order, axis=0)


def _at_rest(rows: Float[np.ndarray, "t ..."]) -> Float[np.ndarray, "t+6 ..."]:
    """Rows between two rests."""
    return np.concatenate([np.repeat(rows[:1], 3, axis=0), rows, np.repeat(rows[-1:], 3, axis=0)])


def with_ramps(
    fine: Float[np.ndarray, "f"],
    effort: Float[np.ndarray, "f-1"],
    share: float,
    poses_at: Callable[[Float[np.ndarray, "k"]], Float[np.ndarray, "k 2 pose"]],
    grippers: Grippers,
    keypoints: int = 13,
    arms: CellKinematics | None = None,
) -> Float[np.ndarray, "k"]:
    """Places among `fine` between which no step asks more than `share` of the limits, ramps from and to rest included.

    Speed along the path is the largest that a limit of speed and one of its slope allow, by a pass forward and one
    backward (Bobrow et al. 1985); where rows placed so are beyond a limit of acceleration or jerk, both are reduced
    and the passes are repeated. So the limits hold for the differences of the rows themselves.

    Args:
        fine: Places, first and last of which are kept.
        effort: Between one place and the next, from speed alone.
        share: Most of each limit that may be used.
        poses_at: Poses of the grippers at places, with angles that run on.
        grippers: The limits.
        keypoints: Of the cable; a plan with many has fewer rows.
        arms: What holds the grippers all along, see `ramp_effort`.

    Raises:
        PlanningError: The motion takes more control steps than a plan may have.

    Note:
        The result is not the fastest: docs/results/planning.md says how far from it.
    """
    total = np.concatenate([[0.0], np.cumsum(np.maximum(effort, 1e-9))]) / share
    require_rows(total[-1], keypoints)
    grid = np.linspace(0.0, total[-1], max(3, int(np.ceil(total[-1] / GRID)) + 1))
    slope, window = _slope(grippers)
    slower = np.ones(len(grid))
    times = grid
    for _ in range(ROUNDS):
        checkpoint()
        times = _times(grid, slower, slope)
        require_rows(times[-1], keypoints)
        at, when = _rows(grid, times, total, fine, window)
        beyond = ramp_effort(poses_at(at), grippers, arms) / share
        if beyond.max() <= 1 + ROUNDING:
            return at
        # a motion that is slower by a factor f accelerates f² times less and jerks f³ times less
        factor = np.maximum(beyond[:, 0] ** 0.5, np.r_[beyond[1:, 1], 0.0] ** (1 / 3))
        centre = np.clip(np.arange(len(factor)) - 1, 0, len(when) - 1)
        for row in np.flatnonzero(factor > 1):
            near = np.abs(times - when[centre[row]]) <= NEAR + window / 2
            slower[near] = np.minimum(slower[near] * min(factor[row], 1.2), 100.0)
    while True:
        checkpoint()
        times = STRETCH * times
        require_rows(times[-1], keypoints)
        at, _ = _rows(grid, times, total, fine, window)
        most = ramp_effort(poses_at(at), grippers, arms).max()
        if most <= share * (1 + ROUNDING) or times[-1] > 100 * total[-1] + 1000:
            return at


def _slope(grippers: Grippers) -> tuple[float, int]:
    """Change of speed in one control step, as a share of full speed, that the limits allow a straight motion.

    Returns:
        It, and the number of control steps over whose mean it changes no faster than the limit of jerk.
    """
    steps = grippers.max_step, grippers.max_turn
    acceleration, jerk = (
        min(CONTROL_STEP**order * (most or np.inf) / step for most, step in zip(limits, steps, strict=True))
        for order, limits in (
            (2, (grippers.max_acceleration, grippers.max_turn_acceleration)),
            (3, (grippers.max_jerk, grippers.max_turn_jerk)),
        )
    )
    slope = min(acceleration, jerk**0.5)
    return slope, max(1, int(np.ceil(slope / jerk)))


def _times(grid: Float[np.ndarray, "g"], slower: Float[np.ndarray, "g"], slope: float) -> Float[np.ndarray, "g"]:
    """When the motion is at each place of the grid, in control steps, from rest to rest."""
    most = slower**-2.0
    most[[0, -1]] = 0.0
    gained = np.concatenate([[0.0], np.cumsum(2 * slope * np.diff(grid) / slower[1:] ** 2)])
    forward = gained + np.minimum.accumulate(most - gained)
    left = gained[-1] - gained
    backward = (left + np.minimum.accumulate((forward - left)[::-1])[::-1]).clip(0.0)
    speed = np.sqrt(backward)
    return np.concatenate([[0.0], np.cumsum(2 * np.diff(grid) / np.maximum(speed[1:] + speed[:-1], 1e-9))])


def _rows(
    grid: Float[np.ndarray, "g"],
    times: Float[np.ndarray, "g"],
    total: Float[np.ndarray, "f"],
    fine: Float[np.ndarray, "f"],
    window: int,
) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Places at equal times, at most a control step apart, averaged over `window` rows; and those times."""
    when, step = np.linspace(0.0, times[-1], max(2, int(np.ceil(times[-1] - 1e-9)) + 1), retstep=True)
    places = np.pad(np.interp(when, times, grid), window - 1, mode="edge")
    places = np.convolve(places, np.full(window, 1 / window), mode="valid")
    when = step * (np.arange(len(places)) - (window - 1) / 2)
    return np.interp(places, total, fine), when
