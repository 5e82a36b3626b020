"""Outlines of a drawing in DXF.

Read are the closed lines of the model space, those in blocks as they are inserted, and lines and arcs that meet end to
end on one layer. Layers that are off or frozen are not there. ezdxf reads the file.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import FileFormatError, InputError
from cableway.core.extras import require
from cableway.core.reading import one_line, read_bytes
from cableway.core.xml import LARGEST_FILE
from cableway.drawings.curves import bezier
from cableway.drawings.records import (
    UNITS,
    Drawing,
    Found,
    LeftOut,
    circle_outline,
    closed_outline,
    framed,
    require_points,
    told_once,
)

LINES = ("LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE", "SOLID", "TRACE")
"""Kinds of entities that are read."""

SAID = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 13: "um", 14: "dm"}
"""Units by the number in the header, $INSUNITS."""

DEEPEST, MOST_ENTITIES = 16, 10_000
"""Blocks in blocks, and entities with those of all blocks as often as they are inserted."""

MEETING = 1e-5
"""Distance [m] within which ends of lines are one point."""


def read_dxf(path: Path, tolerance: float, unit: str | None = None, frame: str | None = None) -> Drawing:
    """The outlines of a DXF file.

    Args:
        path: The file.
        tolerance: How far chords are from curves at most [m].
        unit: One of `UNITS`; by default, as the file says.
        frame: Layer or handle of the outline that is the edge of the table; by default there is none.

    Raises:
        FileFormatError: It cannot be read, or it refers to something outside.
        InputError: Its unit is not known, an outline crosses itself or lies in another, or the frame is none.
        MissingExtraError: ezdxf is not installed.
    """
    require("import", "reading DXF")
    document = _document(path)
    if unit is None and document.units not in SAID:
        raise InputError(f"{path}: it does not say what its unit is: give --unit, one of {', '.join(UNITS)}")
    called = SAID[document.units] if unit is None else unit
    reader = _Reader(path=path, document=document, scale=UNITS[called], tolerance=tolerance)
    try:
        reader.read_all()
    except (FileFormatError, InputError):
        raise
    except Exception as error:  # what a damaged entity makes ezdxf raise is of a dozen kinds
        raise FileFormatError(f"{path}: a damaged DXF file ({one_line(error)})") from None
    outlines, page = reader.outlines, None
    if frame is not None:
        outlines, page = framed(outlines, frame, path)
    outlines, twice = told_once(outlines, path)
    said = f"{called}, as {'the file says' if unit is None else 'told'}"
    return Drawing(tuple(outlines), (*reader.left_out, *reader.strangers(), *twice), page, said)


def _document(path: Path) -> Any:
    import ezdxf

    if b"SECTION" not in read_bytes(path, LARGEST_FILE):
        raise FileFormatError(f"{path}: not a DXF file: it has no section")
    log = logging.getLogger("ezdxf")
    if not log.handlers:  # what it mends goes to no terminal
        log.addHandler(logging.NullHandler())
    try:
        return ezdxf.readfile(path)  # pyright: ignore[reportPrivateImportUsage]  # strict: a damaged number is an error
    except Exception as error:  # as above
        raise FileFormatError(f"{path}: not a DXF file that can be read ({one_line(error)})") from None


@dataclass(kw_only=True)
class _Reader(Found):
    """Outlines on the way through a file."""

    document: Any
    scale: float
    tolerance: float
    open: dict[str, list[np.ndarray]] = field(default_factory=dict)
    strange: Counter[str] = field(default_factory=Counter)
    count: int = 0

    def read_all(self) -> None:
        hidden = {layer.dxf.name.lower() for layer in self.document.layers if layer.is_off() or layer.is_frozen()}
        for entity in self._entities(self.document.modelspace(), 0):
            layer = entity.dxf.get("layer", "0")
            if layer.lower() in hidden or entity.dxf.get("invisible", 0):
                self.strange["on a hidden layer"] += 1
            elif entity.dxftype() in LINES:
                self._read(entity, one_line(layer)[:40])
            else:
                self.strange[f"{entity.dxftype()}, not read"] += 1
        for layer, lines in self.open.items():
            self._join(layer, lines)

    def strangers(self) -> Iterator[LeftOut]:
        """What is of other kinds."""
        for why, count in self.strange.items():
            yield LeftOut(f"{count} {'entity' if count == 1 else 'entities'}", why)

    def _entities(self, among: Any, depth: int) -> Iterator[Any]:
        """All entities, those of blocks where they are inserted."""
        for entity in among:
            self.count += 1
            if self.count > MOST_ENTITIES:
                raise FileFormatError(f"{self.path}: with all blocks it has more than {MOST_ENTITIES} entities")
            if entity.dxftype() != "INSERT":
                yield entity
                continue
            block = one_line(entity.dxf.get("name", ""))[:40]
            if entity.is_xref():
                raise FileFormatError(f"{self.path}: the block {block!r} is in another file, and nothing is fetched")
            if depth == DEEPEST:
                raise FileFormatError(f"{self.path}: the block {block!r} is nested deeper than {DEEPEST} levels")
            if entity.mcount > MOST_ENTITIES:
                raise FileFormatError(f"{self.path}: the block {block!r} is inserted {entity.mcount} times at once")
            for single in entity.multi_insert() if entity.mcount > 1 else [entity]:
                yield from self._entities(single.virtual_entities(skipped_entity_callback=self._skipped), depth + 1)

    def _skipped(self, entity: Any, reason: str) -> None:
        self.strange[f"{entity.dxftype()} in a block, {one_line(reason)[:60]}"] += 1

    def _read(self, entity: Any, layer: str) -> None:
        from ezdxf import path as paths

        kind, handle = entity.dxftype(), entity.dxf.get("handle")
        name = f"{kind}{f' {handle}' if handle else ''} on layer {layer}"
        if kind == "POLYLINE" and not entity.is_2d_polyline and not entity.is_3d_polyline:
            self.strange[f"{kind} that is a mesh, not read"] += 1
            return
        curve = paths.make_path(entity)
        controls = self.scale * np.array([(at.x, at.y) for at in curve.control_vertices()])
        if not len(controls):
            self.add(LeftOut(name, "no points"))
            return
        require_points(name, controls, self.path)
        if kind == "CIRCLE":
            low, high = controls.min(axis=0), controls.max(axis=0)
            radius = self.scale * abs(entity.dxf.radius)
            if radius > 0 and np.abs(high - low - 2 * radius).max() < 1e-6 * radius:  # not seen from aside
                x, y = ((low + high) / 2).tolist()
                self.add(circle_outline(name, (x, y, radius)))
                return
        points = self._flat(curve)
        require_points(name, points, self.path)
        if np.linalg.norm(points[0] - points[-1]) <= MEETING and len(points) > 3:
            self.add(closed_outline(name, np.vstack([points[:-1], points[:1]]), self.path))
        elif len(points) > 1:
            self.open.setdefault(layer, []).append(points)

    def _flat(self, curve: Any) -> Float[np.ndarray, "k 2"]:
        """Points along a path [m], chords no farther than the tolerance from it."""
        points, start = [np.array([(curve.start.x, curve.start.y)])], curve.start
        for command in curve.commands():
            controls = [getattr(command, name) for name in ("ctrl", "ctrl1", "ctrl2") if hasattr(command, name)]
            hull = np.array([(at.x, at.y) for at in (start, *controls, command.end)])
            points.append(bezier(self.scale * hull, self.tolerance))
            start = command.end
        return np.vstack([self.scale * points[0], *points[1:]])

    def _join(self, layer: str, lines: list[np.ndarray]) -> None:
        """Outlines of lines that meet end to end."""
        ends = shapely.multilinestrings([shapely.LineString(np.round(line / MEETING) * MEETING) for line in lines])
        for k, line in enumerate(shapely.get_parts(shapely.line_merge(ends))):
            name = f"lines {k + 1} on layer {layer}"
            if line.is_closed:
                self.add(closed_outline(name, shapely.get_coordinates(line), self.path))
            else:
                self.add(LeftOut(name, "open, not an outline", line))
