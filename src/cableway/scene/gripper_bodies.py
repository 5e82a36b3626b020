"""What grippers look like from above: convex outlines between two heights, by name or of one's own.

The named ones are made for a tool that points straight down with its tips 2 mm above the table, closed on a cable of
8 mm, the fingers to either side of it. The 2F-85's extents are those of its meshes in MuJoCo Menagerie (BSD-2-Clause),
by `studies/gripper_outlines.py`, rounded up to millimetres; those of the layer above the knuckles, 103 x 74, hold its
flange of 75 x 75 as well. The same study has those of the open hand. The Hand-E's are those of meshes that were made
of Robotiq's drawings, see `_HAND_E`. A *tilted* hand leans outward, away from the cable along its tangent, turned about
the axis of that cable, and is lifted along its own axis where an edge would come too near to the table.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.scene import checks
from cableway.scene.bodies import RIGHT, Body
from cableway.scene.checks import Quantity
from cableway.scene.obstacles import check_convex, counter_clockwise

TIP = 0.002
"""Height [m] of the tips above the table."""

AXIS = 0.004
"""Height [m] above the table of the axis about which hands are tilted: that of a cable of 8 mm."""

ABOVE_TABLE = 0.001
"""Height [m] that no edge of a tilted hand is below."""

MOST_LIFT = 0.001
"""By which a tilted hand is lifted at most [m]; pads then hold little more than the upper half of a cable of 8 mm."""

SLICE = 0.03
"""Of a tilted hand, most of the height [m] over which one outline holds it."""

MOST_PIECES = 12
"""Of a gripper; all pairs of two grippers are compared."""

MOST_CORNERS = 40
"""Of a piece."""

Height = Annotated[float, "a height", Quantity("m", 0.0, 50.0)]
Tilt = Annotated[float, "an angle", Quantity("rad", 0.0, 0.5)]


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyPart:
    """A convex piece of a gripper.

    Attributes:
        outline: (k, 2) vertices [m] in the gripper's frame, whose x axis points along the cable's tangent and whose
            origin is the end of the cable; kept counter-clockwise.
        heights: Lowest and highest point above the table [m].

    Raises:
        TaskError: The outline is not convex or has too many corners, or the heights are not in order.
    """

    outline: Annotated[Float[np.ndarray, "k 2"], "a list of at least 3 points [x, y]"]
    heights: Annotated[tuple[Height, Height], "[lowest, highest]"]

    def __post_init__(self) -> None:
        outline = checks.rows(self.outline, ("outline",), checks.XY)
        if len(outline) > MOST_CORNERS:
            raise TaskError(f"must be at most {MOST_CORNERS} points, got {len(outline)}", ("outline",))
        check_convex(outline, "outline")
        object.__setattr__(self, "outline", counter_clockwise(outline))
        low, high = checks.pair(self.heights, ("heights",), Quantity("m", 0.0, 50.0))
        if low >= high:
            raise TaskError(f"must be in order, got [{low:g}, {high:g}]", ("heights",))
        object.__setattr__(self, "heights", (low, high))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, BodyPart):
            return NotImplemented
        return self.heights == other.heights and np.array_equal(self.outline, other.outline)

    def __hash__(self) -> int:
        return hash((self.heights, self.outline.tobytes()))

    def bodies(self, name: str, side: int, tilt: float = 0.0, lift: float = 0.0) -> Iterator[Body]:
        """The piece as bodies of one of the grippers, several where it is high and leans outward by `tilt` [rad].

        Each outline holds the part of the piece between two planes across the tool, seen from above. The hand is
        lifted along its own axis by `lift` [m].

        >>> (body,) = _layer(20, 10, 0, 20).bodies("left gripper", 0, tilt=0.1)
        >>> body.outline[:, 0].min().round(4).item(), body.outline[:, 0].max().round(4).item()
        (-0.0068, 0.0052)
        """
        if not tilt:
            yield Body(name, side, self.outline, heights=self.heights)
            return
        lean = outward(side, tilt)
        (low, high), cosine, sine = self.heights, math.cos(lean), math.sin(lean)
        levels = np.linspace(low, high, math.ceil((high - low) / SLICE - 1e-9) + 1) - AXIS + lift
        for bottom, top in pairwise(levels.tolist()):
            x, y, z = np.array([(*vertex, level) for level in (bottom, top) for vertex in self.outline]).T
            seen = shapely.MultiPoint(np.column_stack([cosine * x + sine * z, y])).convex_hull
            heights = AXIS + cosine * z - sine * x
            outline = counter_clockwise(shapely.get_coordinates(seen)[:-1])
            yield Body(name, side, outline, heights=(float(heights.min()), float(heights.max())))


def lift_of(parts: Iterable[BodyPart], tilt: float) -> float:
    """How far [m] a hand of such pieces is lifted along its own axis if it leans outward by `tilt` [rad].

    >>> lift_of(GRIPPER_BODIES["2f-85"], 0.0), round(lift_of(GRIPPER_BODIES["2f-85"], 0.17), 5)
    (0.0, 0.00084)
    """
    if not tilt:
        return 0.0
    cosine, sine = math.cos(tilt), math.sin(tilt)
    heights = (
        AXIS + cosine * (part.heights[0] - AXIS) - sine * float(np.abs(part.outline[:, 0]).max()) for part in parts
    )
    return max(0.0, (ABOVE_TABLE - min(heights, default=ABOVE_TABLE)) / cosine)


def outward(side: int, tilt: float) -> float:
    """Turn [rad] about the y axis of a gripper's frame that tilts its hand outward: its x axis points along the cable's
    tangent, into the cable at the left end and out of it at the right one."""
    return tilt if side == RIGHT else -tilt


def _layer(across: float, along: float, low: float, high: float, aside: float = 0.0) -> BodyPart:
    """A box so far to the left of the end of the cable, from figures in millimetres above the tips."""
    x, y, middle = along / 2000, across / 2000, aside / 1000
    return BodyPart(
        outline=np.array([[-x, middle - y], [x, middle - y], [x, middle + y], [-x, middle + y]]),
        heights=(TIP + low / 1000, TIP + high / 1000),
    )


_HAND = ((89, 27, 20), (115, 34, 20), (127, 39, 20), (103, 75, 30), (75, 75, 40))
"""The 2F-85 above its fingers: extent across and along the cable, and height, of each layer [mm]."""


def _hand(low: float, across: tuple[float, ...] = tuple(layer[0] for layer in _HAND)) -> tuple[BodyPart, ...]:
    """The layers of `_HAND` from `low` [mm] above the tips, as wide as `across` [mm]."""
    bottoms = low + np.cumsum([0, *(layer[2] for layer in _HAND)])
    return tuple(
        _layer(width, along, bottom, bottom + height)
        for width, (_, along, height), bottom in zip(across, _HAND, bottoms.tolist(), strict=False)
    )


class _Finger(NamedTuple):
    """A layer of a finger that moves aside as it is: figures in millimetres.

    Attributes:
        inner: Its inner side, outward from the face of the pad.
        outer: Its outer side.
        along: Extent along the cable.
        low: Above the tips.
        high: Above the tips.
    """

    inner: float
    outer: float
    along: float
    low: float
    high: float

    def pair(self, gap: float) -> tuple[BodyPart, ...]:
        """The layers of both fingers with their pads `gap` [mm] apart, as one where they meet."""
        inner, outer = gap / 2 + self.inner, gap / 2 + self.outer
        if inner <= gap / 2 <= CLOSED / 2:
            return (_layer(2 * outer, self.along, self.low, self.high),)
        width, aside = outer - inner, (outer + inner) / 2
        return tuple(_layer(width, self.along, self.low, self.high, side * aside) for side in (1, -1))


CLOSED = 8
"""Distance of the pads of a closed hand [mm]."""

_HAND_E = (_Finger(0, 6, 22, 0, 21), _Finger(0, 11, 22, 21, 38), _Finger(-7, 11, 38, 38, 47))
"""Robotiq's basic fingers of the Hand-E: tips, shanks, and the carriages with their screws. Extents of
`meshes/hande/finger_1-collision.dae` of `cambel/robotiq` (GitHub, commit 754a8130), rounded up; its gripper is 50 mm
open, its z axis begins at the hand's face."""

_HAND_E_RADIUS, _HAND_E_HEIGHT = 0.0375, 0.110
"""Of the Hand-E above its fingers, a cylinder [m]: 99 mm, and 11 mm of its coupling, as `robotiq_hande_gripper.xacro`
of `AGH-CEAI/robotiq_hande_description` has them (GitHub, commit 13ed8636, after Robotiq's drawings)."""


def _hand_e(gap: float) -> tuple[BodyPart, ...]:
    """The Hand-E with its pads `gap` [mm] apart; its body is a prism of 12 sides about the cylinder."""
    angles = np.arange(12) * math.pi / 6
    outline = _HAND_E_RADIUS / math.cos(math.pi / 12) * np.column_stack([np.cos(angles), np.sin(angles)])
    low = TIP + _HAND_E[-1].high / 1000
    body = BodyPart(outline=outline, heights=(low, low + _HAND_E_HEIGHT))
    return (*(part for finger in _HAND_E for part in finger.pair(gap)), body)


GRIPPER_BODIES: dict[str, tuple[BodyPart, ...]] = {
    "disc": (),
    "2f-85": (_layer(37, 22, 0, 20), _layer(42, 24, 20, 40), *_hand(40)),
    "2f-85-long-fingers": (_layer(24, 12, 0, 120), *_hand(120)),
    "hand-e": _hand_e(CLOSED),
}
"""By name: nothing beyond the disc; Robotiq's 2F-85; the same with fingers lengthened to bars of 24 x 12 mm; Robotiq's
Hand-E with its basic fingers."""


def gripper_body(body: str | tuple[BodyPart, ...] | None) -> tuple[BodyPart, ...]:
    """The pieces of a gripper beyond its disc; none where there is no `body`.

    Raises:
        TaskError: There is no gripper of that name, or too many pieces.
    """
    if body is None:
        return ()
    if not isinstance(body, str):
        if len(body) > MOST_PIECES:
            raise TaskError(f"must be at most {MOST_PIECES} pieces, got {len(body)}", ("body",))
        return tuple(body)
    if body not in GRIPPER_BODIES:
        raise TaskError(f"must be one of {', '.join(GRIPPER_BODIES)}, or a list of pieces, got {body!r}", ("body",))
    return GRIPPER_BODIES[body]


_OPEN = {
    50: (78, 79, 118, 127, 136, 136, 75),
    30: (59, 62, 104, 120, 132, 129, 75),
    20: (49, 54, 97, 118, 130, 112, 75),
}
"""The 2F-85 with its pads so far apart [mm]: extent across the cable of two layers of 20 mm of its fingers, and of
those of `_HAND`. Its tips are then up to 4 mm higher, which is left out."""

_THICKNESS = 8
"""Of a long finger across the cable [mm]."""

OPENINGS = tuple(opening / 1000 for opening in _OPEN)
"""Distances [m] of the fingers of an open hand that are known, widest first."""


def open_hand(tool: str, opening: float) -> tuple[BodyPart, ...]:
    """The pieces of a gripper with its fingers `opening` [m] apart, one of `OPENINGS`, beside the end of the cable.

    >>> [part.outline[:, 1].min().round(4).item() for part in open_hand("2f-85", 0.02)[:2]]
    [0.01, -0.0245]
    """
    gap = round(1000 * opening)
    if tool == "hand-e":
        return _hand_e(gap)
    low, high, *hand = _OPEN[gap]
    if tool == "2f-85-long-fingers":
        fingers = [(gap + 2 * _THICKNESS, 12, 0, 120)]
    else:
        fingers = [(low, 22, 0, 20), (high, 24, 20, 40)]
    pairs = [
        _layer((outer - gap) / 2, along, bottom, top, side * (outer + gap) / 4)
        for outer, along, bottom, top in fingers
        for side in (1, -1)
    ]
    return (*pairs, *_hand(fingers[-1][-1], tuple(hand)))
