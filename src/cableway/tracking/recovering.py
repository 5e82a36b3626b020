"""When the cable counts as having left its plan, and what happens then."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cableway.core.checks import Checked, NotNegative
from cableway.records import Plan
from cableway.scene.task import Task

BACK = 1.5
"""Time [s] for which the grippers go back from a contact that nobody expected: it is noticed within 1 s."""

ATTEMPTS = 3
"""Times that a plan is looked for, each time from farther back on the way."""


@dataclass(frozen=True, kw_only=True)
class Recovery(Checked):
    """What happens when the cable leaves its plan for good: it snapped to another shape, slipped, or is blocked.

    The same happens when the scene of the plant's task turns out to have something where the plan leads; controllers
    make room by themselves for what reaches into it by no more than `room`. The grippers stop and stand still; a new
    plan is made from where the cable is, and the run goes on with it. So it is, too, where the cable does not lie at
    the start of the plan, or comes to rest away from its end; a nearly straight one may even bend to the other side.
    Where that plan fails, the first one is followed, or the run ends. A cable that rests where its plan ends, to within
    `goal`, has arrived, though it was stopped.

    Plans of a run under way are made for the cable as the controller has estimated it, where it does, and its goal is
    then what that cable can come nearest to the task's. With that cable the controller's way along the rest of a plan
    is looked at every `foresight` seconds: where it would fold or touch something there, a plan is made at once.

    Where something unknown seems to hold the cable, as the controller has it or as the cable lies when the grippers
    stop because it may be held or has left its plan, they first take back their motions of the last `BACK`
    seconds, and farther where it still lies at the contact. So they do from what a gripper ran into. The new plan leads
    round discs that are supposed to stand wherever the contact may be. A cable that is then not where it had been on
    the way is held by friction; there are no discs for it, and what holds the cable less far off than that is taken for
    friction from then on. Where there is no plan from where the cable is, or it touches something there, the grippers
    go back in the same way and it is tried again, up to `ATTEMPTS` times.

    Attributes:
        replan: Plans a task that starts where the cable is, given the plan that was left. Raises `PlanningError` where
            there is no way.
        times: Recoveries in one run, after which it ends.
        start: Mean distance [m] of the keypoints from the plan's first shape from which the cable lies elsewhere.
        deviation: Mean distance [m] of the keypoints from their reference from which the cable is not on its plan; its
            swing comes on top.
        beside: The same where a keypoint is farther from its reference than anything is from an obstacle.
        patience: Time [s] for which that must be so.
        goal: Root mean square distance [m] of the keypoints from the plan's last shape from which a cable at rest has
            missed it; of success it is 8.3 mm.
        rest: Time [s] that the grippers stand still.
        foresight: Time [s] from one look ahead to the next.
        room: Depth [m] to which cable or gripper discs of the plan may be in an obstacle: 10 mm of a move less the 4 mm
            that plans keep.

    Raises:
        InputError: A value is out of range.
    """

    replan: Callable[[Task, Plan], Plan]
    times: NotNegative[int] = 8
    start: NotNegative[float] = 0.015
    deviation: NotNegative[float] = 0.018
    beside: NotNegative[float] = 0.01
    patience: NotNegative[float] = 0.2
    goal: NotNegative[float] = 0.0075
    rest: NotNegative[float] = 1.0
    foresight: NotNegative[float] = 0.5
    room: NotNegative[float] = 0.006
