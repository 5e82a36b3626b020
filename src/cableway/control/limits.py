"""What may be sent to the grippers, whatever was computed."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.estimation.parameter_filter import MET
from cableway.geometry.groups import SE2
from cableway.motion.validity import gripper_spans
from cableway.robot.held_arms import HANDS, HeldArms
from cableway.rod.fitting import meet_ends
from cableway.rod.inverse import fit_keypoints
from cableway.scene.bodies import RIGHT, Body
from cableway.scene.clearance import bodies_gap, body_clearance, cable_gap
from cableway.scene.task import CONTROL_STEP, Grippers, Task

MARGIN = 1.0 - 1e-9
"""Factor on the limits, so that rounding in the sums of poses does not exceed them."""


SHARES = np.linspace(0.0, 1.0, 5)
"""Parts of an action that the last filter may let pass."""

ROUNDING = 1e-9
"""[m]."""

ASKEW = 0.2
"""Angle [rad] between gripper and port up to which a plug may still be aligned: what it may be held askew, twice."""


def within_limits(
    action: Float[np.ndarray, "2 3"],
    poses: Float[np.ndarray, "2 3"],
    grippers: Grippers,
    max_span: float,
) -> Float[np.ndarray, "2 3"]:
    """The action made safe: no step or turn beyond the grippers' limits, no pulling apart beyond `max_span`.

    Steps are shortened in their own direction. Where the grippers would come farther apart than `max_span`, what they
    do relative to each other is shortened and what they do together is kept; grippers that are already too far apart
    may not go farther.

    Args:
        action: (2, 3) gripper motion [m, m, rad]; one that is not finite becomes standing still.
        poses: (2, 3) gripper poses before it [m, m, rad].
        grippers: The limits.
        max_span: Largest distance [m] between the grippers.
    """
    action = np.asarray(action, float)
    if not np.isfinite(action).all():
        return np.zeros_like(action)
    moves, turns = np.hsplit(limited(action, MARGIN * grippers.max_step, MARGIN * grippers.max_turn), [SE2.space])
    left, right = SE2.position(poses)
    share = _separation_share(right - left, moves[1] - moves[0], max_span)
    together, apart = moves.mean(axis=0), (moves[1] - moves[0]) / 2
    return np.column_stack([np.stack([together - share * apart, together + share * apart]), turns])


def last_filter(
    action: Float[np.ndarray, "2 3"],
    poses: Float[np.ndarray, "2 3"],
    task: Task,
    max_span: float,
    before: Float[np.ndarray, "2 3"] | None = None,
    lies: Float[np.ndarray, "n 2"] | None = None,
    arms: HeldArms | None = None,
) -> Float[np.ndarray, "2 3"]:
    """What of an action may leave for the plant, whoever made it.

    No step or turn is beyond the grippers' limits, and neither of these becomes worse than it is, or is there at
    all where it is not: the grippers farther apart than `max_span`, or nearer to each other than
    `Grippers.least_span`; a body of theirs in an obstacle, a wall, a body of the other or the cable, but for a plug
    before its port, or nearer to one of the first three than `HANDS` where arms carry it; an arm that cannot
    follow, see `HeldArms.room`. An action that breaks one of the latter is made in part, in steps of a quarter.
    Where the cable will be is what its nominal rod says, led on from where it was seen.

    Where the task or an arm limits acceleration, the change from one action to the next is limited, too; but the
    grippers stop faster than that where they would otherwise come too far apart, too near to each other, or into an
    obstacle.

    Args:
        action: (2, 3) gripper motion [m, m, rad]; one that is not finite becomes standing still.
        poses: (2, 3) gripper poses before it, as commanded [m, m, rad].
        task: Limits, scene and bodies.
        max_span: Largest distance [m] of the grippers at which the cable is not taut.
        before: (2, 3) the action of the control step before [m, m, rad]; None where there is none to compare with.
        lies: (n, 2) keypoints of the cable as it was last seen whole [m]; None where it was not.
        arms: What holds the grippers, sent to `poses`; None where they move by themselves.
    """
    action = np.asarray(action, float)
    if not np.isfinite(action).all():
        action = np.zeros_like(action)
    if before is not None:
        action = _within_acceleration(action, before, task.grippers)
        action = action if arms is None else arms.eased(action, before, poses)
    if exceeds_limits(action, task.grippers) or _span(action, poses) > max_span:
        action = within_limits(action, poses, task.grippers, max_span)
    reached = SE2.plus(poses, SHARES[:, None, None] * action)
    kept = np.column_stack([_body_room(body, reached, task) for body in task.outer_bodies])
    if task.body_pairs:
        kept = np.column_stack([kept, bodies_gap(task.body_pairs, reached)])
    if arms is not None:
        kept -= HANDS
    kept = np.column_stack([kept, gripper_spans(reached) - task.grippers.least_span])
    if lies is not None and any(body.meets_cable(task.cable.radius) for body in task.bodies):
        kept = np.column_stack([kept, _cable_room(lies, reached, task)])
    if arms is not None:
        kept = np.column_stack([kept, arms.room(reached)])
    return allowed_part(action, kept)


def allowed_part(action: Float[np.ndarray, "2 step"], kept: Float[np.ndarray, "k rooms"]) -> np.ndarray:
    """As much of an action as makes no room worse than it is, or smaller than nothing where it is not.

    Args:
        action: (2, step) gripper motion.
        kept: (k, rooms) what is kept after each of `SHARES` of it, nothing of it first.
    """
    allowed = (kept >= np.minimum(kept[0], 0.0) - ROUNDING).all(axis=1)
    # the first share that is not allowed bounds those that are
    return action if allowed.all() else SHARES[int(np.argmin(allowed)) - 1] * action


def _body_room(body: Body, poses: Float[np.ndarray, "k 2 3"], task: Task) -> Float[np.ndarray, "k"]:
    """Clearance [m] of a body; infinite for a plug that goes into its port.

    Where that is, the gripper alone does not say: it may hold plug and cable askew. `InsertionController` estimates it.
    """
    room = body_clearance(body, poses, task.scene)
    if task.plug is None or task.port is None or body is not task.bodies[-1]:
        return room
    tip = task.port.alignment(task.plug, poses[:, RIGHT])
    entering = (tip.depth > -task.port.standoff) & (np.abs(tip.lateral) <= task.plug.width)
    return np.where(entering & (np.abs(tip.angle) <= ASKEW), np.inf, room)


def _cable_room(
    lies: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "k 2 3"], task: Task
) -> Float[np.ndarray, "k"]:
    """Least clearance [m] of bodies from a cable that lay along keypoints, led to gripper `poses` one after the other.

    Infinite where its nominal rod cannot be held so.
    """
    rod, room = task.cable.rod, np.full(len(poses), np.inf)
    q = rod.continued(fit_keypoints(rod, lies)[0], poses[0])
    for k, ends in enumerate(poses):
        if meet_ends(q, ends, *rod.arrays) > MET:
            break
        room[k] = cable_gap(task.bodies, rod.shapes(q[None])[0], ends[None], task.cable)[0]
    return room


def _within_acceleration(
    action: Float[np.ndarray, "2 3"], before: Float[np.ndarray, "2 3"], grippers: Grippers
) -> Float[np.ndarray, "2 3"]:
    """The action, changed no more from the one before it than the grippers' limits of acceleration allow."""
    most, most_turn = (
        np.inf if limit is None else MARGIN * limit * CONTROL_STEP**2
        for limit in (grippers.max_acceleration, grippers.max_turn_acceleration)
    )
    change = action - before
    moves, turns = SE2.position(change), change[:, SE2.space :]
    if np.linalg.norm(moves, axis=1).max() <= most and np.abs(turns).max() <= most_turn:
        return action
    return before + limited(change, most, most_turn)


def _span(action: Float[np.ndarray, "2 3"], poses: Float[np.ndarray, "2 3"]) -> float:
    """Distance [m] of the grippers after an action."""
    return float(gripper_spans(SE2.plus(poses, action)[None])[0])


def exceeds_limits(action: Float[np.ndarray, "2 3"], grippers: Grippers) -> bool:
    """Whether a step or a turn [m, m, rad] is beyond the grippers' limits."""
    steps, turns = np.linalg.norm(SE2.position(action), axis=1), np.abs(action[:, SE2.space :])
    return bool(steps.max() > grippers.max_step or turns.max() > grippers.max_turn)


def span_limit(poses: Float[np.ndarray, "H 2 3"], length: float, share: float) -> Float[np.ndarray, "H"]:
    """Largest distance [m] allowed between the grippers: `share` of the cable's length [m], or the plan's if longer.

    A plan that pulls the grippers farther apart than the cable is long is not followed there.
    """
    planned = gripper_spans(poses)
    return np.where(planned <= length, np.maximum(planned, share * length), share * length)


def limited(step: Float[np.ndarray, "2 3"], most: float, most_turn: float) -> Float[np.ndarray, "2 3"]:
    """Gripper steps [m, m, rad] no longer than `most` [m], in their own direction, and turns of at most `most_turn`."""
    norms = np.linalg.norm(SE2.position(step), axis=1, keepdims=True)
    share = np.minimum(1.0, most / np.maximum(norms, 1e-300))
    return np.column_stack([share * SE2.position(step), np.clip(step[:, SE2.space :], -most_turn, most_turn)])


def _separation_share(gap: np.ndarray, change: np.ndarray, max_span: float) -> float:
    """Largest share of `change` in [0, 1] for which |gap + share change| <= max(max_span, |gap|)."""
    squared, along = float(change @ change), float(gap @ change)
    room = max(max_span**2 - float(gap @ gap), 0.0)
    if squared == 0.0 or squared + 2 * along <= room:
        return 1.0
    root = np.sqrt(max(along**2 + squared * room, 0.0))
    return float(np.clip((root - along) / squared, 0.0, 1.0))
