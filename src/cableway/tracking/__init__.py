"""The closed loop, and what a plant must offer to be led by it."""

from cableway.core.deprecation import renamed
from cableway.tracking.closed_loop import Progress, track
from cableway.tracking.insertion import insert_plug, may_insert
from cableway.tracking.logbook import Row
from cableway.tracking.loop import BLOCKED, LOST
from cableway.tracking.plant import Plant
from cableway.tracking.real_time import RealTimePlant, track_in_real_time
from cableway.tracking.recovering import Recovery
from cableway.tracking.sender import Robot
from cableway.tracking.stopping import TrackConfig
from cableway.tracking.watchdog import Watchdog

__all__ = [
    "BLOCKED",
    "LOST",
    "Plant",
    "Progress",
    "RealTimePlant",
    "Recovery",
    "Robot",
    "Row",
    "TrackConfig",
    "Watchdog",
    "insert_plug",
    "may_insert",
    "track",
    "track_in_real_time",
]


__getattr__ = renamed(__name__, {"may_push": "may_insert", "push_in": "insert_plug"})
