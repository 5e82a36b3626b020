"""Colours and letters of pictures and pages, which need no Matplotlib: it takes half a second to import."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np

_MATPLOTLIB = find_spec("matplotlib")
assert _MATPLOTLIB is not None
assert _MATPLOTLIB.origin is not None

FONT_FILE = Path(_MATPLOTLIB.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
"""Of the letters."""

INK = "#1d2733"
MUTED = "#6b7683"
GRID = "#e6e9ed"
OBSTACLE = "#c5cad1"
OBSTACLE_EDGE = "#868f9b"
BAD = "#c1272d"

BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#56b4e9", "#cc79a7"
"""The palette of Okabe and Ito, whose colours those who see red and green alike tell apart, too."""

START, GOAL = BLUE, VERMILION
PIVOT, PASSAGE, PATHS = GREEN, ORANGE, OBSTACLE_EDGE
LEFT, RIGHT = SKY, PURPLE
REFERENCE = ORANGE

SERIES = (INK, BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE)
DASHES = ("-", (0, (4, 2)), (0, (1, 1.5)))

TIME_COLORS = (START, "#6f5fae", "#b8558c", GOAL)
"""Between which the colour of time runs, from the start to the goal."""


def rgb(color: str) -> tuple[int, int, int]:
    """Red, green and blue, from 0 to 255, of a colour such as "#0072b2"."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def color_of_time(share: float) -> str:
    """The colour of a share of the time, from that of the start at 0 to that of the goal at 1."""
    places = np.linspace(0.0, 1.0, len(TIME_COLORS))
    channels = np.array([rgb(color) for color in TIME_COLORS]).T
    return "#" + "".join(f"{round(float(np.interp(share, places, channel))):02x}" for channel in channels)
