"""Corners of meshes from STL files, binary or text."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from cableway.core.errors import FileFormatError
from cableway.core.reading import read_bytes

LARGEST_FILE = 20_000_000
"""Bytes: 400,000 triangles."""

HEADER, TRIANGLE = 84, 50
"""Bytes before the triangles of a binary file, the last four of which are their number, and of each."""

_VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.MULTILINE)


def read_stl(path: Path) -> Float[np.ndarray, "k 3"]:
    """The corners of all triangles of an STL file, each once, in the file's units.

    Raises:
        FileFormatError: It cannot be read, is no STL file, has no triangles, or a number is not finite.
    """
    content = read_bytes(path, LARGEST_FILE)
    count = int.from_bytes(content[HEADER - 4 : HEADER], "little") if len(content) >= HEADER else -1
    if len(content) == HEADER + TRIANGLE * count:
        rows = np.frombuffer(content, np.uint8, offset=HEADER).reshape(count, TRIANGLE)
        corners = np.ascontiguousarray(rows[:, 12:48]).view("<f4").reshape(-1, 3).astype(float)
    elif content.lstrip().startswith(b"solid"):
        try:
            corners = np.array(_VERTEX.findall(content), dtype="S40").astype(float).reshape(-1, 3)
        except ValueError:
            raise FileFormatError(f"{path}: not an STL file: a vertex is not three numbers") from None
    else:
        raise FileFormatError(f"{path}: not an STL file: neither text that begins with 'solid' nor whole triangles")
    if not len(corners) or len(corners) % 3:
        raise FileFormatError(f"{path}: an STL file with {len(corners)} corners, which make no triangles")
    if not np.isfinite(corners).all():
        raise FileFormatError(f"{path}: an STL file with a number that is not finite")
    return np.unique(corners, axis=0)
