"""How far apart the grippers may go before the cable is taut, from what is seen of it and from no model."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from jaxtyping import Float

from cableway.estimation.gating import LEAST_SHARE, connected, poses_usable
from cableway.estimation.parameter_filter import LONGEST
from cableway.geometry.groups import SE2
from cableway.motion.validity import gripper_spans
from cableway.records import Observation
from cableway.scene.cable import Cable

MEMORY = 5
"""Observations that count. A frame may be some of them late: the least gripper span among them is its own."""

RESERVE = 0.005
"""In nominal lengths, what is left of the slack seen. Noise of 2 mm on keypoints 25 mm apart adds as much to it."""

TAUT = 0.0025
"""Slack seen, in nominal lengths, from which on nothing is pulled farther apart."""


class Slack:
    """Watches how much longer the cable is than the distance between its ends.

    Ends that are hidden are where the grippers are, straight on from the rest: the cable has at least that slack.

    Args:
        cable: The nominal cable.
    """

    def __init__(self, cable: Cable) -> None:
        self._cable, self._length = cable, cable.length
        self._spans: deque[float] = deque(maxlen=MEMORY)
        self._slacks: deque[float] = deque(maxlen=MEMORY)
        self._grippers: deque[np.ndarray] = deque(maxlen=MEMORY)
        self._most, self._shown = cable.length, math.ceil(LEAST_SHARE * cable.keypoints)

    def most_span(self, observation: Observation) -> float:
        """Largest distance [m] of the grippers: the nominal length, or as much more as the cable is seen to be longer.

        A cable seen to be straight is not pulled farther, however long it should be. Without both gripper poses it is
        what it was, and so it is after a frame that lacks a keypoint between two that are seen, or shows less of the
        cable than one before.
        """
        if not poses_usable(observation):
            return self._most
        self._grippers.append(SE2.position(observation.poses))
        points = connected(observation.keypoints, self._cable)
        seen = np.flatnonzero(np.isfinite(points[:, 0]))
        if len(seen) < self._shown or len(seen) <= seen[-1] - seen[0]:
            return self._most
        self._shown = len(seen)
        self._slacks.append(min(_slack(points, grippers) for grippers in self._grippers))
        self._spans.append(float(gripper_spans(observation.poses[None])[0]))
        slack = float(np.median(self._slacks))
        apart = min(self._spans) + slack - RESERVE * self._length
        taut = slack < TAUT * self._length
        self._most = (
            min(self._length, self._spans[-1]) if taut else float(np.clip(apart, self._length, LONGEST * self._length))
        )
        return self._most


def _slack(points: Float[np.ndarray, "n 2"], grippers: Float[np.ndarray, "2 2"]) -> float:
    """By how much [m] a cable through keypoints is longer than the distance of its ends; see `Slack` on hidden ones."""
    points = points.copy()
    points[[0, -1]] = np.where(np.isfinite(points[[0, -1]]), points[[0, -1]], grippers)
    points = points[np.isfinite(points[:, 0])]
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum() - np.linalg.norm(points[-1] - points[0]))
