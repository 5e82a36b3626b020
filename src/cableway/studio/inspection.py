"""What there is to know of a draft at once: clearance and stability of both ends, and all that is wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.core.errors import Point, SpacePoint, TaskError
from cableway.scene.files.loading import AnyDraft
from cableway.scene.spatial.task import SpatialDraft
from cableway.scene.task import End


@dataclass(frozen=True)
class EndFigures:
    """Of the cable at start or goal.

    Attributes:
        clearance: Of its surface from obstacles and walls [m], negative by the overlap.
        nearest: What that is from, such as "obstacles[2] (box at ...)".
        at: Where on the table, or in space [m].
        stability: Stability margin; the cable snaps away at 0.
    """

    clearance: float
    nearest: str
    at: Point | SpacePoint
    stability: float


@dataclass(frozen=True)
class Inspection:
    """A draft, looked at.

    Attributes:
        ends: What is known of start and goal.
        faults: Why no cable can do it; none for a task.
    """

    ends: Mapping[End, EndFigures]
    faults: tuple[TaskError, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The faults in words."""
        return tuple(fault.sentence for fault in self.faults)


def inspect(draft: AnyDraft, shapes: Mapping[End, Float[np.ndarray, "d"] | None]) -> Inspection:
    """Look at a draft.

    Args:
        draft: The draft.
        shapes: Rod coordinates of the cable at both ends, as far as they are known.
    """
    figures: dict[End, EndFigures] = {end: end_figures(draft, q) for end, q in shapes.items() if q is not None}
    return Inspection(figures, tuple(draft.faults()))


def end_figures(draft: AnyDraft, q: Float[np.ndarray, "d"]) -> EndFigures:
    """What is known of the cable q at an end."""
    rod = draft.cable.rod
    line = rod.shapes(q[None])[0][0]
    if isinstance(draft, SpatialDraft):
        distance, solid, at = draft.scene.nearest(line)
        depth = draft.cable.radius - distance
    else:
        depth, solid, at = draft.scene.overlap(line, draft.cable.radius)
    return EndFigures(-depth, draft.scene.name_of(solid), at, float(rod.stability(q[None])[0][0]))
