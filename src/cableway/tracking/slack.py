"""How far apart the grippers may go before the cable is taut, from what is seen of it and from no model."""

from __future__ import annotations

from collections import deque

import numpy as np

from cableway.estimation.gating import poses_usable
from cableway.estimation.rod_filter import LONGEST
from cableway.motion.validity import gripper_spans
from cableway.records import Observation

MEMORY = 5
"""Observations that count. A frame may be some of them late: the least span of the grippers among them is its own."""

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

    def most_span(self, observation: Observation) -> float:
        """Largest distance [m] of the grippers: the nominal length, or as much more as the cable is seen to be longer.

        A cable seen to be straight is not pulled farther, however long it should be.
        """
        if not poses_usable(observation):
            return self._length
        self._spans.append(float(gripper_spans(observation.poses[None])[0]))
        points = observation.keypoints
        if np.isfinite(points).all():
            along = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
            self._slacks.append(along - float(np.linalg.norm(points[-1] - points[0])))
        if not self._slacks:
            return self._length
        slack = float(np.median(self._slacks))
        if slack < TAUT * self._length:
            return min(self._length, self._spans[-1])
        seen = min(self._spans) + slack - RESERVE * self._length
        return float(np.clip(seen, self._length, LONGEST * self._length))
