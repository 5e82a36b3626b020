"""Shapes of SVG as lines: path data and basic shapes, curves as chords."""

from __future__ import annotations

import math
import re
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.core.reading import one_line
from cableway.drawings.curves import MOST_POINTS, arc_steps, bezier

Run = tuple[Float[np.ndarray, "k 2"], bool]
"""Points of a line, and whether it is closed."""

NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"

PATH_DATA = re.compile(r"[MmZzLlHhVvCcSsQqTtAa0-9eE+.,\s-]*")
"""Letters of path data; others would be read over."""


def lengths_of(text: str) -> Float[np.ndarray, "k"]:
    """Numbers of an attribute, in the unit of the drawing.

    Raises:
        InputError: One is none, is not finite, or has a unit of its own.
    """
    words = text.replace(",", " ").split()
    wrong = [word for word in words if not re.fullmatch(rf"{NUMBER}(?:px)?", word)]
    numbers = np.array([] if wrong else [float(word.removesuffix("px")) for word in words])
    if wrong or not np.isfinite(numbers).all():
        shown = one_line(wrong[0] if wrong else text)[:60]
        raise InputError(f"{shown!r} is no number without a unit, as the drawing's coordinates must be")
    return numbers


def runs_of(element: Element, tag: str, tolerance: float) -> list[Run]:
    """The lines of a shape, in its own coordinates.

    Args:
        element: The shape.
        tag: Its kind.
        tolerance: How far chords are from curves at most.

    Raises:
        InputError: A number is none, or a curve is too long.
        ValueError: It is no such shape.
    """
    numbers = {name: lengths_of(element.get(name, "0")) for name in _LENGTHS.get(tag, ())}
    values = {name: float(each[0]) if len(each) else 0.0 for name, each in numbers.items()}
    match tag:
        case "polygon" | "polyline":
            points = lengths_of(element.get("points", ""))
            return [(points[: len(points) // 2 * 2].reshape(-1, 2), tag == "polygon")] if len(points) > 1 else []
        case "line":
            return [(np.array([[values["x1"], values["y1"]], [values["x2"], values["y2"]]]), False)]
        case "path":
            return _path(element.get("d", ""), tolerance)
        case "rect":
            return _path(_rounded(element, **values), tolerance)
        case _:
            rx, ry = (values["r"],) * 2 if tag == "circle" else (values["rx"], values["ry"])
            turns = np.linspace(0, 2 * np.pi, 4 * arc_steps(max(rx, ry), np.pi / 2, tolerance) + 1)[:-1]
            middle = np.array([values["cx"], values["cy"]])
            return [(middle + np.column_stack([rx * np.cos(turns), ry * np.sin(turns)]), True)]


_LENGTHS = {
    "line": ("x1", "y1", "x2", "y2"),
    "rect": ("x", "y", "width", "height", "rx", "ry"),
    "circle": ("cx", "cy", "r"),
    "ellipse": ("cx", "cy", "rx", "ry"),
}


def _rounded(element: Element, x: float, y: float, width: float, height: float, rx: float, ry: float) -> str:
    """Path data of a rectangle, its corners round where the one or the other radius says so."""
    rx, ry = (rx if "rx" in element.keys() else ry), (ry if "ry" in element.keys() else rx)  # noqa: SIM118 - an Element
    rx, ry = min(rx, width / 2), min(ry, height / 2)
    if width <= 0 or height <= 0:
        return ""
    if rx <= 0 or ry <= 0:
        return f"M{x} {y}h{width}v{height}h{-width}z"
    arcs = [f"a{rx} {ry} 0 0 1 {dx} {dy}" for dx, dy in ((rx, ry), (-rx, ry), (-rx, -ry), (rx, -ry))]
    across, down = width - 2 * rx, height - 2 * ry
    return f"M{x + rx} {y}h{across}{arcs[0]}v{down}{arcs[1]}h{-across}{arcs[2]}v{-down}{arcs[3]}z"


def _path(data: str, tolerance: float) -> list[Run]:
    """The lines of path data."""
    from svgpathtools import parse_path

    if not PATH_DATA.fullmatch(data):
        raise ValueError(f"path data {one_line(data)[:40]!r}")
    if not data.strip():
        return []
    if len(data) > 100 * MOST_POINTS:
        raise ValueError("too much path data")
    runs: list[Run] = []
    for run in parse_path(data).continuous_subpaths():
        line = np.vstack([_at(run[0].start), *(_chords(segment, tolerance) for segment in run)])
        runs.append((line, bool(np.abs(line[0] - line[-1]).max() < 1e-9 * (1 + np.abs(line).max()))))
    return runs


def _chords(segment: Any, tolerance: float) -> Float[np.ndarray, "m 2"]:
    """Ends of chords along a segment of a path, its own start left out."""
    from svgpathtools import Arc

    if not isinstance(segment, Arc):
        return bezier(_at(*segment.bpoints()), tolerance)
    steps = arc_steps(max(segment.radius.real, segment.radius.imag), math.radians(segment.delta), tolerance)
    return _at(*(segment.point(k / steps) for k in range(1, steps)), segment.end)


def _at(*points: complex) -> Float[np.ndarray, "m 2"]:
    return np.array([(point.real, point.imag) for point in points])
