"""Where cameras are put around a table, by name."""

from __future__ import annotations

import math

import numpy as np

from cableway.core.errors import UnknownNameError
from cableway.perception.calibration import CalibratedCamera
from cableway.rendering.camera import Camera

ABOVE = 1.7
"""Height [m] of a camera that looks straight down, over the middle of the workspace."""

AWAY, SLANT = 1.25, math.radians(40)
"""Distance [m] of the others from there, and their angle above the table: below fingers and hands, over posts."""

VIEWS = {"above": 0.62, "low": 0.68}
"""Angles of view across the picture [rad]: a workspace of 0.7 m fills it."""

SIDES = {"front": (0.0, -1.0), "back": (0.0, 1.0), "left": (-1.0, 0.0), "right": (1.0, 0.0)}
"""On which side of the table the others stand: in front is where y is low."""

PLACES = ("above", *SIDES)


def camera_at(
    place: str, workspace: tuple[float, float], picture: tuple[int, int] = (640, 480), height: float = 0.0
) -> CalibratedCamera:
    """A camera without distortion in one of `PLACES`.

    >>> camera_at("above", (0.7, 0.7)).pinhole.pose[:3, 3].tolist()
    [0.35, 0.35, 1.7]

    Args:
        place: Its name.
        workspace: Width and height [m]; what is larger than 0.7 m is looked at from farther off.
        picture: Width and height [pixels].
        height: Of the space over the table that is looked at [m].

    Raises:
        UnknownNameError: There is no such place; the message lists them.
    """
    if place not in PLACES:
        raise UnknownNameError("place of a camera", place, PLACES)
    width, depth = workspace
    middle, larger = np.array([width / 2, depth / 2, height / 2]), max(1.0, math.hypot(max(workspace), height) / 0.7)
    if place == "above":
        at, aim, view = np.array([0.0, 0.0, ABOVE]), np.array([0.0, 0.0, -1.0]), VIEWS["above"]
    else:
        x, y = SIDES[place]
        at = AWAY * np.array([x * math.cos(SLANT), y * math.cos(SLANT), math.sin(SLANT)])
        aim, view = -at, VIEWS["low"]
    return CalibratedCamera(pinhole=Camera.looking(middle + larger * at, aim, size=picture, view=view))
