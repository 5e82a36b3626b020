"""What the trackers ask of a rod, what they know between two frames, and what they make of one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from cableway.core.checks import Checked, NotNegative, Positive, Share
from cableway.estimation.deviation import DeviationField
from cableway.estimation.rod_filter import RodEstimate
from cableway.records import Observation


@dataclass(frozen=True, kw_only=True)
class TrackerConfig(Checked):
    """Settings of the rod tracker.

    Attributes:
        pixel: Standard deviation [m] of where the points over one hinge of the rod are seen.
        beside: Standard deviation [m] of how far a cable lies beside its rod.
        reach: How far along the cable that is alike, in lengths.
        fading: Time [s] in which it fades.
        sure: Standard deviation of a keypoint [m] at which its confidence is one half.
        patience: Time [s] from one look for another shape to the next one, where the rod does not explain what is seen.
        most_unexplained: Share of the points that may be something else's, from which on the rod explains too little;
            no more of them count than of the rod is not seen, for the rest of the cable is where it should be. None of
            them does where no part of the rod that is not seen could reach, and where the same was seen while the cable
            was known to be elsewhere.
        most_missing: Share of the rod that should be seen and is not, the same.
        most_residual: Root mean square distance [m] of the points from the rod, the same.
        most_askew: How far an end of the rod is from where its gripper would hold it, in standard deviations of the
            prior of that, the same; and how far turned, unless nearly all that is seen is the rod, and nearly all of it
            is seen.
        most_unsure: Standard deviation of a keypoint [m] from which on they cannot be relied on.

    Raises:
        InputError: A value is out of range.
    """

    pixel: Positive[float] = 0.0003
    beside: Positive[float] = 0.0007
    reach: Positive[float] = 0.12
    fading: Positive[float] = 2.0
    sure: Positive[float] = 0.004
    patience: NotNegative[float] = 0.1
    most_unexplained: Share = 0.3
    most_missing: Share = 0.2
    most_residual: NotNegative[float] = 0.004
    most_askew: Positive[float] = 4.0
    most_unsure: Positive[float] = 0.01


@dataclass(frozen=True, eq=False)
class Track:
    """What the tracker knows between two frames.

    Attributes:
        estimate: Of the rod.
        field: How far the cable lies beside it.
        poses: Of the grippers at the last frame [m, m, rad].
        others: (k, 2) where something else lies that looks like the cable [m].
        looked: When the cable was last looked for anew [s].
        found: Whether the rod has explained any frame.
    """

    estimate: RodEstimate
    field: DeviationField
    poses: Float[np.ndarray, "2 3"]
    others: Float[np.ndarray, "k 2"]
    looked: float = -math.inf
    found: bool = False


@dataclass(frozen=True, eq=False)
class Sighting:
    """What the tracker makes of one frame.

    Attributes:
        observation: Keypoints, hidden ones included, with confidence; the grippers as measured.
        keypoints: (n, 2) of the rod [m]: those of the observation, but for markers that are seen.
        covariance: (n, 2, 2) of these [m^2].
        marked: Which keypoints of the observation are where their markers are seen.
        unexplained: Share of the points seen, but for those of what can only be something else, that are not on the
            rod; 0 where none is seen.
        missing: Share of the rod in view, and hidden by nothing known, where no cable is seen.
        hidden: Share of the rod that no camera shows.
        residual: Root mean square distance [m] of the points on the rod from it; 0 where none is seen.
        explained: Whether some of the cable is seen, and the rod explains it.
        possible: Whether nothing speaks against the rod, though all of it may be hidden by what is known to stand
            before it; not of a cable that was never seen, which may lie otherwise than any rod expects.
        known: Whether the keypoints can be relied on: the rod is possible, and they are sure. Where not, a controller
            had better stop, unless it knows that the cable has room for that.
    """

    observation: Observation
    keypoints: Float[np.ndarray, "n 2"]
    covariance: Float[np.ndarray, "n 2 2"]
    marked: Bool[np.ndarray, "n"]
    unexplained: float
    missing: float
    hidden: float
    residual: float
    explained: bool
    possible: bool
    known: bool
