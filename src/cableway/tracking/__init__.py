"""The closed loop, and what a plant must offer to be led by it."""

from cableway.tracking.closed_loop import Progress, track
from cableway.tracking.insertion import may_push, push_in
from cableway.tracking.loop import BLOCKED, LOST
from cableway.tracking.plant import Plant
from cableway.tracking.recovery import Recovery
from cableway.tracking.stopping import TrackConfig
from cableway.tracking.watchdog import Watchdog

__all__ = [
    "BLOCKED",
    "LOST",
    "Plant",
    "Progress",
    "Recovery",
    "TrackConfig",
    "Watchdog",
    "may_push",
    "push_in",
    "track",
]
