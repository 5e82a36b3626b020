"""How a run ends, and what counts as success: one enum of outcomes with a sentence each, and the limits behind them."""

from __future__ import annotations

import math
from enum import StrEnum

from cableway.core.errors import InputError

SUCCESS_ERROR = 0.03
"""Stacked error [m] of `KEYPOINTS` keypoints below which the goal counts as reached (Tang et al., Section VI)."""

START_ERROR = 0.02
"""Stacked distance [m] of as many keypoints from the task's start up to which a rollout begins there."""

KEYPOINTS = 13
"""Of the paper's cables."""


def stacked_limit(limit: float, keypoints: int) -> float:
    """A stacked limit [m] for another number of keypoints than `KEYPOINTS`: the same error of each is allowed.

    >>> stacked_limit(SUCCESS_ERROR, 13), stacked_limit(SUCCESS_ERROR, 52)
    (0.03, 0.06)
    """
    return limit * math.sqrt(keypoints / KEYPOINTS)


class Outcome(StrEnum):
    """How a run, or a part of it, ended; each member has a `sentence`.

    The value is what result files, reports and the metadata of a rollout hold. What was particular to one run is a
    separate text, its `detail`.

    >>> Outcome("left plan").sentence
    'The cable left its plan and could not be brought back.'
    """

    sentence: str

    def __new__(cls, value: str, sentence: str) -> Outcome:  # noqa: D102
        member = str.__new__(cls, value)
        member._value_, member.sentence = value, sentence
        return member

    SUCCESS = "success", "The goal is reached, nothing was touched, and where there is a port the plug is in it."
    SETTLED = "settled", "The cable came to rest where its plan ends."
    MISSED_GOAL = "missed goal", "The cable ended too far from its goal."
    CONTACT = "contact", "The cable, a gripper or the plug touched something."
    NOT_VERIFIED = "not verified", "The independent check found a fault that the run did not report."
    NOT_INSERTED = "not inserted", "The plug is not in its port."
    WRONG_SETUP = "wrong setup", "Nothing was moved: the first observation does not fit the start of the plan."
    LEFT_PLAN = "left plan", "The cable left its plan and could not be brought back."
    BLOCKED_WAY = "blocked way", "Something stood in the way, and no way round it was found."
    CONTROLLER_FAILED = "controller failed", "The controller missed too many steps in a row."
    NOT_HELD = "not held", "A gripper missed the end of the cable, or lost it."
    PLANT_FAILED = "plant failed", "The plant could not go on, or could not start."
    NO_PLAN = "no plan", "No plan was found, though there may be one."
    INFEASIBLE = "infeasible", "No plan exists: a gripper or the cable cannot pass."
    NOT_CERTIFIED = "not certified", "No plan exists, and the planner did not say so."
    TIMED_OUT = "timed out", "The time limit ran out."
    INTERRUPTED = "interrupted", "The run was interrupted or cancelled."
    CRASHED = "crashed", "The method raised an error or its process died."

    @property
    def finished(self) -> bool:
        """Whether the run was led to its end, whatever it came to there."""
        return self in (Outcome.SETTLED, Outcome.TIMED_OUT)

    @classmethod
    def read(cls, text: str) -> tuple[Outcome, str]:
        """The outcome and the detail in "outcome: detail", as files of version 0.1 have them in one text.

        Raises:
            InputError: There is no such outcome; the message lists them.
        """
        value, _, detail = str(text).partition(": ")
        value = _OUTCOMES_0_1.get(value, value)
        if value not in cls._value2member_map_:
            raise InputError(f"outcome must be one of {', '.join(map(str, cls))}, got {text!r}")
        return cls(value), detail


_OUTCOMES_0_1 = {
    "time ran out": "timed out",
    "the cable left its plan": "left plan",
    "something stands in the way": "blocked way",
}
"""Outcomes of rollouts that version 0.1 wrote, where they are called otherwise now."""

PORT_LATERAL = 0.002
"""Largest distance [m] of a plug's tip from the axis of its port with which it goes in."""

PORT_ANGLE = math.radians(3.0)
"""Largest turn [rad] from that axis."""

PORT_DEPTH = 0.001
"""By how much [m] a plug that is in may be short of the port's depth."""
