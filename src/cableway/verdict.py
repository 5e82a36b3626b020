"""What an independent check found, as numbers for programs and in sentences for people."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.brief import Brief
from cableway.core.errors import Point
from cableway.core.quantities import limit_text, quantity, told_apart

FINDINGS = {
    "cable clearance": "{gap}",
    "gripper clearance": "{gap}",
    "plug clearance": "{gap}",
    "plug clearance before the port": "before the port, {gap}",
    "rod clearance": "where the cable would really go, {gap}",
    "self-clearance": "{gap}",
    "self-crossings": "the cable crosses itself",
    "twist": "the cable is twisted by {value}",
    "length error": "the length of the cable is off by {value}",
    "grasp error": "a gripper is {value} from the end that it holds",
    "grasp angle": "a gripper is turned by {value} from the end that it holds",
    "gripper separation": "the grippers are {value} apart",
    "gripper step": "a gripper moves {value} in a control step",
    "gripper turn": "a gripper turns by {value} in a control step",
    "gripper acceleration": "a gripper accelerates at {value}",
    "gripper turn acceleration": "the turn of a gripper accelerates at {value}",
    "gripper jerk": "a gripper moves with a jerk of {value}",
    "gripper turn jerk": "a gripper turns with a jerk of {value}",
    "rows the rod does not reach": "the cable could not take {value} of the planned shapes, first that at {when}",
    "rod deviation": "the cable would stray {value} from the planned shape",
    "error of the rod coordinates": "the plan's rod coordinates are {value} from its shapes",
    "rod stability": "the cable is about to snap, with a stability margin of {value}",
    "gripper body clearance": "{gap}",
    "gripper body from the cable": "{gap}",
    "gripper bodies apart": "{gap}",
    "arms": "{where}",
    "tool distance": "a tool is {value} from its gripper's pose",
    "tool angle": "a tool is turned by {value} from its gripper's pose",
    "joint position": "a joint turns {value} times as far as it may",
    "joint position beyond its range": "a joint turns {value} beyond its range",
    "joint speed": "a joint turns {value} times as fast as it may",
    "joint acceleration": "a joint accelerates {value} times as fast as it may",
    "arm clearance": "{gap}",
    "arm clearance from the table": "{gap}",
    "hand clearance from the table": "{gap}",
    "open hands": "{where}",
    "open hand clearance": "{gap}",
    "bend radius": "the cable bends to a radius of {value}",
    "sharpest bend": "the cable bends {value} times as sharply as it may",
    "distance to start": "the motion begins {value} from the task's start",
    "distance to goal": "the motion ends {value} from the task's goal",
    "distance to goal before the insertion": "the insertion begins {value} from the task's goal",
    "gripper distance to start": "a gripper begins {value} from where the task has it",
    "gripper distance to goal": "a gripper ends {value} from where the task has it",
    "gripper angle to start": "a gripper begins turned by {value} from how the task has it",
    "gripper angle to goal": "a gripper ends turned by {value} from how the task has it",
    "inserted depth": "the plug is {value} deep in its port",
    "plug misalignment": "the plug is {value} off the port's axis",
    "plug angle": "the plug is turned by {value} from the port's axis",
    "shape error at the end": "the shape error at the end is {value}",
    "shape error before the insertion": "the shape error before the insertion is {value}",
    "failures recorded": "the record tells of a failure: {where}",
    "recorded cable clearance": "the clearance recorded of the cable is {value}",
    "recorded gripper clearance": "the clearance recorded of the grippers is {value}",
    "recorded cable clearance above that of its row": "the clearance recorded of the cable is {value} too large",
    "recorded gripper clearance above that of its row": "the clearance recorded of the grippers is {value} too large",
    "difference to the task's cable": "the length of the plant's cable differs by {value} from the task's",
    "keypoints off their places along the cable": "a keypoint is {value} from its place along the cable",
    "rows out of time": "{value} rows of the record come out of time, first that at {when}",
    "time between rows": "the rows of the record are {value} apart",
    "grippers away from their commands": "a gripper is {value} from where it was sent",
    "cable step beyond the grippers'": "the cable moves {value} farther in a control step than the grippers lead it",
    "cable step to the last row": "the cable has not come to rest: it moves {value} farther than the grippers lead it",
    "row off the way between its neighbours": "the cable jumps aside by {value} and back",
    "bending": "the cable is wound up: the root mean square of its curvature, times its length, is {value}",
    "kink": "the cable has a kink, where its curvature, times its length, changes by {value}",
    "distance from the rod": "the cable is {value} from an elastic rod between the same grippers",
}
"""What each check found where it did not pass; the gap is that between the two things that `where` names. Where and
when follow, unless they stand in the sentence."""


@dataclass(frozen=True)
class Check:
    """One requirement that was tested.

    Attributes:
        name: What was measured; one of `FINDINGS`.
        value: The worst value found.
        unit: Of `value`, "" for a count.
        limit: What it is compared with.
        passed: Whether it holds.
        where: What it was found of, in words: "the cable and the left wall".
        row: Row of the motion in which it is worst, or where it fails first, a fraction between rows; None where it is
            of no row.
        time: The same [s].
        at: Where on the table that is [m]; None where it is at no place in particular.
    """

    name: str
    value: float
    unit: str
    limit: float
    passed: bool
    where: str = ""
    row: float | None = None
    time: float | None = None
    at: Point | None = None

    @property
    def when(self) -> str:
        """The time, in words; "" where there is none."""
        return "" if self.time is None else f"t = {self.time:.1f} s"

    @property
    def place(self) -> str:
        """Where and when, in words."""
        return ", ".join(filter(None, (self.where, self.when)))

    def __str__(self) -> str:
        if not math.isfinite(self.value):
            return f"{self.name}: {self.where or 'could not be measured'}"
        words = FINDINGS.get(self.name, f"{self.name}: {{value}}")
        value = told_apart(self.value, self.limit, self.unit)
        said = words.format(value=value, gap=self._gap(value), where=self.where, when=self.when)
        counts = not self.unit and not self.limit
        least = "least clearance" if "{gap}" in words and self.value < 0 else "limit"
        limit = "" if counts else f" ({least} {limit_text(self.limit, self.unit)})"
        where = f", {self.where}" if self.where and not ("{where}" in words or "{gap}" in words) else ""
        return said + limit + where + (f" at {self.when}" if self.when and "{when}" not in words else "")

    def _gap(self, value: str) -> str:
        if self.value < 0:
            return f"{self.where} overlap by {quantity(-self.value)}"
        return f"{self.where} are {value} apart"


@dataclass(frozen=True, repr=False)
class Verdict(Brief):
    """All checks of a plan or a rollout."""

    checks: tuple[Check, ...]

    @classmethod
    def of(cls, checks: Iterable[Check], times: Float[np.ndarray, "t"]) -> Verdict:
        """Checks of a motion whose rows are at so many seconds."""
        rows = np.arange(len(times))
        return cls(
            tuple(
                check if check.row is None else replace(check, time=float(np.interp(check.row, rows, times)))
                for check in checks
            )
        )

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    def failures(self) -> tuple[Check, ...]:
        """The checks that did not pass."""
        return tuple(check for check in self.checks if not check.passed)

    def _facts(self) -> Iterator[str]:
        failures = self.failures()
        yield f"{len(self.checks) - len(failures)} of {len(self.checks)} checks passed"
        yield from map(str, failures[:1])

    def __str__(self) -> str:
        return "; ".join(map(str, self.failures())) or "all checks passed"

    def as_dict(self) -> list[dict[str, Any]]:
        """Plain data for JSON, in SI units; a value that is not finite becomes null."""
        rows = [asdict(check) for check in self.checks]
        for row in rows:
            if not math.isfinite(row["value"]):
                row["value"] = None
        return rows
