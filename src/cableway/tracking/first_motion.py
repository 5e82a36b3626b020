"""While the grippers move: do they go where they are sent, and if not, which mistake explains where they go?

An arm whose frame is mirrored or turned, an angle counted the other way round, and left and right exchanged do not show
at rest. Each is a hypothesis that predicts from the commands where a gripper is; it is compared with the commands
themselves, each at the delay that suits it best, until one of the two explains the reports and the other does not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.core.quantities import quantity
from cableway.estimation.delay import DELAYS, FORGETTING, DelayEstimator
from cableway.geometry.groups import SE2
from cableway.tracking.setup import FITS

APART = (0.004, 0.04)
"""Distance [m] and turn [rad] of a gripper from its command at every delay from which the two differ: encoders are
better than a tenth of it, and a plan begins with less in its first control step."""

Predicts = Callable[[Float[np.ndarray, "2 3"], Float[np.ndarray, "A 2 3"]], Float[np.ndarray, "A 2 3"]]
"""Gripper poses from those at the start and the motion sent since then [m, m, rad]."""


@dataclass(frozen=True)
class _Hypothesis:
    """What may be wrong.

    Attributes:
        text: In words.
        predicts: What the robot does then.
        turns: Whether the angles show it, not the positions.
        together: Whether it is a mistake of both grippers, not of one.
    """

    text: str
    predicts: Predicts
    turns: bool = False
    together: bool = False


def _framed(matrix: list[list[int]]) -> Predicts:
    """Motions in another frame than the world's."""
    frame = np.eye(SE2.dof)
    frame[: SE2.space, : SE2.space] = matrix
    return lambda start, way: start + way @ frame.T


_EXCHANGED: Predicts = lambda start, way: start + way[:, ::-1]  # noqa: E731

HYPOTHESES = (
    _Hypothesis("moves as if y pointed downwards", _framed([[1, 0], [0, -1]])),
    _Hypothesis("moves as if x pointed to the left", _framed([[-1, 0], [0, 1]])),
    _Hypothesis("moves as if its frame were turned by 180 degrees", _framed([[-1, 0], [0, -1]])),
    _Hypothesis("moves as if x and y were exchanged", _framed([[0, 1], [1, 0]])),
    _Hypothesis("moves as if its frame were turned by 90 degrees", _framed([[0, -1], [1, 0]])),
    _Hypothesis("moves as if its frame were turned by -90 degrees", _framed([[0, 1], [-1, 0]])),
    _Hypothesis("turns the other way round", lambda start, way: start + way * [1, 1, -1], turns=True),
    _Hypothesis("move as if left and right were exchanged", _EXCHANGED, together=True),
    _Hypothesis("turn as if left and right were exchanged", _EXCHANGED, turns=True, together=True),
    _Hypothesis("are reported as if left and right were exchanged", lambda start, way: (start + way)[:, ::-1],
                together=True),
)  # fmt: skip


class FirstMotion:
    """Watches where the grippers go until every mistake is ruled out.

    Args:
        poses: Where they stand [m, m, rad].
    """

    def __init__(self, poses: Float[np.ndarray, "2 3"]) -> None:
        self._start = np.array(poses, float)
        self._sent = DelayEstimator.constant(self._start)
        shape = (len(HYPOTHESES), len(DELAYS), 2)
        self._sums, self._plain = np.zeros(shape), np.zeros((2, *shape[1:]))
        self._open = np.ones((len(HYPOTHESES), 2), bool)

    def commanded(self, target: Float[np.ndarray, "2 3"]) -> None:
        """The grippers were sent there."""
        self._sent = self._sent.appended(target)

    def mistake(self, poses: Float[np.ndarray, "2 3"]) -> str:
        """A sentence on the mistake that explains the poses reported so far, these included; "" for none."""
        if not self._open.any():
            return ""
        way = SE2.minus(self._sent.at(DELAYS), self._start)
        plain = np.array(SE2.distance(self._start + way, poses))
        self._plain = FORGETTING * self._plain + plain**2
        found = []
        for index in np.flatnonzero(self._open.any(axis=1)):
            guess, aspect = HYPOTHESES[index], int(HYPOTHESES[index].turns)
            off = np.array(SE2.distance(guess.predicts(self._start, way), poses)[aspect])
            self._sums[index] = FORGETTING * self._sums[index] + off**2
            guilty = self._open[index] & _explains(self._sums[index], self._plain[aspect], plain[aspect], guess)
            if guilty.any():
                apart, left = plain[aspect].min(axis=0)[guilty].max(), self._sums[index].min(axis=0)[guilty].mean()
                found.append((left / APART[aspect] ** 2, _sentence(guess, guilty, apart)))
            self._open[index] &= ~_explains(self._plain[aspect], self._sums[index], off, guess)
        return min(found, default=(0.0, ""))[1]


def _explains(
    better: Float[np.ndarray, "A 2"], worse: Float[np.ndarray, "A 2"], now: Float[np.ndarray, "A 2"], guess: _Hypothesis
) -> np.ndarray:
    """Of which gripper one model explains the reports and the other does not.

    Args:
        better: Summed squared distances from the reports at each of `DELAYS`, by the first model.
        worse: By the second one.
        now: Distances of the newest report by the second one.
        guess: Which of the two it is about.
    """
    far = now.min(axis=0) > APART[guess.turns]
    left, taken = better.min(axis=0), worse.min(axis=0)
    if guess.together:
        far, left, taken = np.full(2, far.any()), np.full(2, left.sum()), np.full(2, taken.sum())
    return far & (left <= FITS**2 * taken)


def _sentence(guess: _Hypothesis, guilty: np.ndarray, apart: float) -> str:
    who = "the grippers" if guess.together else f"the {('left', 'right')[int(np.argmax(guilty))]} gripper"
    off = quantity(apart, "rad" if guess.turns else "m")
    return f"{who} {guess.text}: off by {off} from the commands"
