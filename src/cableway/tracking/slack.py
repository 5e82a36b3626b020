"""How far apart the grippers may go before the cable is taut, from what is seen of it and from no model."""

from __future__ import annotations

from collections import deque

import numpy as np

from cableway.estimation.gating import poses_usable
from cableway.estimation.rod_filter import LONGEST
from cableway.motion.validity import gripper_spans
from cableway.records import Observation

MEMORY = 5
"""Whole observations that count. A frame may be some of them late: the least gripper span among them is its own."""

RESERVE = 0.005
"""In nominal lengths, what is left of the slack seen. Noise of 2 mm on keypoints 25 mm apart adds as much to it."""

TAUT = 0.0025
"""Slack seen, in nominal lengths, from which on nothing is pulled farther apart."""


class Slack:
    """Watches how much longer the cable is than the distance between its ends.

    Args:
        length: Nominal length of the cable [m].
    """

    def __init__(self, length: float) -> None:
        self._length = length
        self._spans: deque[float] = deque(maxlen=MEMORY)
        self._slacks: deque[float] = deque(maxlen=MEMORY)
        self._most = length

    def most_span(self, observation: Observation) -> float:
        """Largest distance [m] of the grippers: the nominal length, or as much more as the cable is seen to be longer.

        A cable seen to be straight is not pulled farther, however long it should be. Without all keypoints and both
        gripper poses it is what it was.
        """
        points = observation.keypoints
        if not (poses_usable(observation) and np.isfinite(points).all()):
            return self._most
        along = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        self._slacks.append(along - float(np.linalg.norm(points[-1] - points[0])))
        self._spans.append(float(gripper_spans(observation.poses[None])[0]))
        slack = float(np.median(self._slacks))
        seen = min(self._spans) + slack - RESERVE * self._length
        taut = slack < TAUT * self._length
        self._most = (
            min(self._length, self._spans[-1]) if taut else float(np.clip(seen, self._length, LONGEST * self._length))
        )
        return self._most
