"""Outlines of a drawing in SVG, as Inkscape and others write it.

Read are paths and basic shapes with the transforms of all groups about them, clones (`use`) of what is in the file, and
the size of the page. Lines have no width. What is hidden is not there; style sheets are not read. svgpathtools reads
path data and transforms.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import FileFormatError, InputError
from cableway.core.extras import require
from cableway.core.reading import one_line
from cableway.core.xml import read_xml
from cableway.drawings.records import (
    UNITS,
    Drawing,
    Found,
    LeftOut,
    Rectangle,
    circle_outline,
    closed_outline,
    framed,
    require_points,
    told_once,
)
from cableway.drawings.svg_shapes import lengths_of, runs_of

NAMESPACE = "{http://www.w3.org/2000/svg}"

SHAPES = ("path", "rect", "circle", "ellipse", "polygon", "polyline", "line")
GROUPS = ("svg", "g", "a", "switch", "symbol")
UNSEEN = ("defs", "metadata", "title", "desc", "namedview", "script", "marker", "linearGradient", "radialGradient",
          "pattern", "filter", "clipPath", "mask", "symbol")  # fmt: skip
"""Elements that draw nothing where they stand."""

STRANGE = {
    "text": "a text; turn it into paths if it stands there",
    "image": "a picture, which is not read",
    "foreignObject": "not SVG",
    "style": "a style sheet; what it hides is taken as drawn",
}

MOST_SHAPES = 10_000
"""Elements with all clones."""

PAGE_UNITS = {**{name: UNITS[name] for name in ("mm", "cm", "in")}, "pt": UNITS["in"] / 72, "pc": UNITS["in"] / 6}
"""Of a page's width; a pixel says nothing about a table."""

Matrix = Float[np.ndarray, "3 3"]


class Around(NamedTuple):
    """What groups hand down to what is in them.

    Attributes:
        matrix: From coordinates to the table [m].
        fill: The colour.
        using: The clones that it is in.
    """

    matrix: Matrix
    fill: str = ""
    using: tuple[str, ...] = ()

    def moved(self, matrix: Matrix) -> Around:
        """The same inside a transform."""
        return self._replace(matrix=self.matrix @ matrix)


def read_svg(path: Path, tolerance: float, unit: str | None = None, frame: str | None = None) -> Drawing:
    """The outlines of an SVG file.

    Args:
        path: The file.
        tolerance: How far chords are from curves at most [m].
        unit: One of `UNITS`, that of the drawing's own coordinates; by default, as the page says.
        frame: Id or label of the outline that is the edge of the table; by default, the page is the table.

    Raises:
        FileFormatError: It cannot be read, or it refers to something outside.
        InputError: Its unit is not known, an outline crosses itself or lies in another, or the frame is none.
        MissingExtraError: svgpathtools is not installed.
    """
    require("import", "reading SVG")
    root = read_xml(path)
    if root.tag not in (f"{NAMESPACE}svg", "svg"):
        raise FileFormatError(f"{path}: not SVG: its root is <{one_line(root.tag)}>")
    matrix, page, said = _page(root, unit, path)
    ids = {each.get("id", ""): each for each in root.iter()}
    reader = _Reader(path=path, tolerance=tolerance, ids=ids)
    reader.walk_children(root, Around(matrix, _style(root, "fill")))
    outlines = reader.outlines
    if frame is not None:
        outlines, page = framed(outlines, frame, path)
    outlines, twice = told_once(outlines, path)
    return Drawing(tuple(outlines), (*reader.left_out, *twice), page, said)


def _page(root: Element, unit: str | None, path: Path) -> tuple[Matrix, Rectangle | None, str]:
    """From coordinates to metres with y up, the page [m] from its lower left corner, and what the unit is."""
    try:
        box = lengths_of(root.get("viewBox", ""))
    except InputError as error:
        raise FileFormatError(f"{path}: viewBox: {error}") from None
    size = [_stated(root.get(name, "")) for name in ("width", "height")]
    if len(box) != 4:
        pixels = [re.match(r"\s*([0-9.]+)\s*(px)?\s*$", root.get(name, "")) for name in ("width", "height")]
        box = np.array([0.0, 0.0, *(float(each[1]) if each else 0.0 for each in pixels)])
        if size[0] and size[1]:  # coordinates are CSS pixels
            box[2:] = np.array([size[0], size[1]]) / (UNITS["in"] / 96)
    scale = None
    if unit is not None:
        scale = UNITS[unit]
    elif size[0] and size[1] and min(box[2:]) > 0:
        scale = min(size[0] / box[2], size[1] / box[3])
    elif size[0] and box[2] > 0:
        scale = size[0] / box[2]
    if scale is None:
        raise InputError(f"{path}: it does not say how long its unit is: give --unit, one of {', '.join(UNITS)}")
    said = f"{1000 * scale:g} mm, as {'the page says' if unit is None else 'told'}"
    x, y, width, height = box.tolist()
    page = (0.0, 0.0, round(scale * width, 6), round(scale * height, 6)) if min(width, height) > 0 else None
    down = y + height if page else 0.0
    matrix = np.array([[scale, 0.0, -scale * x], [0.0, -scale, scale * down], [0.0, 0.0, 1.0]])
    if page is None:
        matrix[:2, 2] = 0.0
    return matrix, page, said


def _stated(text: str) -> float | None:
    """A length with a unit that says how long it is [m]."""
    found = re.match(r"\s*\+?([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*([a-z]+)\s*$", text)
    if found is None or found[2] not in PAGE_UNITS:
        return None
    return float(found[1]) * PAGE_UNITS[found[2]] or None


@dataclass(kw_only=True)
class _Reader(Found):
    """Outlines on the way through a tree."""

    tolerance: float
    ids: dict[str, Element]
    count: int = 0

    def walk_children(self, element: Element, around: Around) -> None:
        for child in element:
            tag = child.tag.removeprefix(NAMESPACE) if isinstance(child.tag, str) else "{"
            if not tag.startswith("{"):  # else another program's own
                self.walk(child, tag, around)

    def walk(self, element: Element, tag: str, around: Around) -> None:
        self.count += 1
        if self.count > MOST_SHAPES:
            raise FileFormatError(f"{self.path}: with all clones it has more than {MOST_SHAPES} elements")
        name = _name(element, tag)
        if tag in STRANGE:
            self.add(LeftOut(name, STRANGE[tag]))
        if (tag in UNSEEN and not (tag == "symbol" and around.using)) or tag in STRANGE or _hidden(element):
            return
        around = around.moved(self._transform(element, name))._replace(fill=_style(element, "fill") or around.fill)
        if element.get("clip-path", "none") != "none" or element.get("mask", "none") != "none":
            self.add(LeftOut(name, "clipped or masked; it is taken whole"))
        if tag in GROUPS:
            if tag in ("svg", "symbol") and element.get("viewBox"):
                raise InputError(f"{self.path}: {name} has a page of its own: ungroup it")
            self.walk_children(element, around.moved(_shift(element)) if tag == "svg" else around)
        elif tag == "use":
            self._clone(element, name, around)
        elif tag in SHAPES:
            self._shape(element, tag, name, around)
        else:
            self.add(LeftOut(name, f"<{one_line(tag)[:40]}> is not known"))

    def _transform(self, element: Element, name: str) -> Matrix:
        from svgpathtools import parse_transform

        try:
            return parse_transform(element.get("transform"), strict=True)
        except ValueError as error:
            raise FileFormatError(f"{self.path}: {name}: {one_line(error)}") from None

    def _clone(self, element: Element, name: str, around: Around) -> None:
        target = element.get("href", "")
        if not target.startswith("#"):
            raise FileFormatError(
                f"{self.path}: {name} is in another place, {one_line(target)[:80]!r}; nothing is fetched"
            )
        original = self.ids.get(target[1:])
        if original is None or target in around.using:
            raise FileFormatError(
                f"{self.path}: {name} is a clone of {one_line(target)[:80]}, which is not there or itself"
            )
        tag = str(original.tag).removeprefix(NAMESPACE)
        self.walk(original, tag, around.moved(_shift(element))._replace(using=(*around.using, target)))

    def _shape(self, element: Element, tag: str, name: str, around: Around) -> None:
        if not np.isfinite(around.matrix).all():
            raise FileFormatError(f"{self.path}: {name}: the transforms about it are not finite")
        scale = float(np.linalg.norm(around.matrix[:2, :2], 2))
        try:
            circle = _circle(element, tag, around.matrix)
            runs = [] if circle else runs_of(element, tag, self.tolerance / max(scale, 1e-300))
        except (InputError, ValueError, ZeroDivisionError, OverflowError, AssertionError, IndexError) as error:
            raise FileFormatError(f"{self.path}: {name}: not a shape: {one_line(error)}") from None
        if circle is not None:
            require_points(name, np.array([circle]), self.path)
            self.add(circle_outline(name, circle))
        filled = tag != "line" and around.fill not in ("none", "transparent")
        for k, (points, closed) in enumerate(runs):
            called = name if len(runs) == 1 else f"{name} ({k + 1})"
            at = points @ around.matrix[:2, :2].T + around.matrix[:2, 2]
            require_points(called, at, self.path)
            meets = len(at) > 3 and np.linalg.norm(at[0] - at[-1]) < self.tolerance
            if closed or meets or (filled and len(at) > 2):
                self.add(closed_outline(called, np.vstack([at, at[:1]]), self.path))
            else:
                line = shapely.LineString(at) if len(at) > 1 else None
                self.add(LeftOut(called, "an open line, not an outline", line))


def _name(element: Element, tag: str) -> str:
    label, own = element.get("label"), element.get("id")
    words = [tag, *([one_line(own)[:40]] if own else []), *([f"'{one_line(label)[:40]}'"] if label else [])]
    return " ".join(words)


def _shift(element: Element) -> Matrix:
    """Where a clone or a page within the page is put."""
    shift = np.identity(3)
    for axis, name in enumerate("xy"):
        found = re.match(r"\s*([-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*(px)?\s*$", element.get(name, "0"))
        shift[axis, 2] = float(found[1]) if found else 0.0
    return shift


def _style(element: Element, name: str) -> str:
    """A property, of the element's own; in `style` it is before the attribute."""
    found = re.search(rf"(?:^|;)\s*{name}\s*:\s*([^;]+)", element.get("style", ""))
    return (found[1] if found else element.get(name, "")).strip()


def _hidden(element: Element) -> bool:
    return _style(element, "display") == "none" or _style(element, "visibility") in ("hidden", "collapse")


def _circle(element: Element, tag: str, matrix: Matrix) -> tuple[float, float, float] | None:
    """Centre and radius [m] of a circle that is one on the table, too."""
    radii = ("r", "r") if tag == "circle" else ("rx", "ry")
    if tag not in ("circle", "ellipse"):
        return None
    values: list[Any] = [lengths_of(element.get(name, "0")) for name in ("cx", "cy", *radii)]
    if any(len(each) != 1 for each in values):
        return None
    x, y, a, b = (float(each[0]) for each in values)
    spread = np.linalg.svd(matrix[:2, :2] * [a, b], compute_uv=False)
    if not (np.isfinite(spread).all() and spread[1] > 0 and spread[0] - spread[1] <= 1e-9 + 1e-6 * spread[0]):
        return None
    at = matrix @ [x, y, 1.0]
    return float(at[0]), float(at[1]), float(spread[0])
