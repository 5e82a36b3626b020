"""What stands on a table, by an image of heights."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import FileFormatError
from cableway.core.extras import require
from cableway.core.reading import MOST_NUMBERS, read_bytes
from cableway.drawings.records import Drawing, LeftOut, Outline
from cableway.perception.outlines import convex_parts, hull, things

SIGNATURE = b"\x89PNG\r\n\x1a\n"

SMALLEST = 4
"""Pixels of the smallest thing that is not a speck."""


def height_image(path: Path, step: float) -> Float[np.ndarray, "h w"]:
    """Heights [m] of the pixels of a grey picture in PNG of 8 or 16 bits.

    Args:
        path: The file.
        step: Height [m] of a grey level.

    Raises:
        FileFormatError: It is no such picture, or too large.
        MissingExtraError: OpenCV is not installed.
    """
    require("vision", "reading a height image")
    import cv2

    content = read_bytes(path)
    if not content.startswith(SIGNATURE) or len(content) < 33:
        raise FileFormatError(f"{path}: not a PNG picture")
    width, height = struct.unpack(">II", content[16:24])
    if width * height > MOST_NUMBERS:
        raise FileFormatError(f"{path}: {width} x {height} pixels are too many; at most {MOST_NUMBERS:,} are read")
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
        raise FileFormatError(f"{path}: not a grey PNG picture of 8 or 16 bits, as a height image is")
    return image * step


def standing(heights: Float[np.ndarray, "h w"], pixel: float, thresholds: Sequence[float], tolerance: float) -> Drawing:
    """The outlines of what stands there.

    From each threshold to the next, what is that high is one layer; its outlines are as high as its highest pixel.

    Args:
        heights: [m], the first row the farthest, y up.
        pixel: Side of a pixel [m].
        thresholds: Ascending heights [m]; what is lower than the first is table.
        tolerance: How deep a notch is covered at most [m]; at least a pixel is.
    """
    image, outlines, left_out = heights[::-1], list[Outline](), list[LeftOut]()
    depth = max(tolerance / pixel, 1.0)
    for low, high in zip(thresholds, [*thresholds[1:], np.inf], strict=True):
        layer, free = (image >= low) & (image < high), image < low
        found = things(layer, 1)
        specks = sum(1 for thing in found if thing.sum() < SMALLEST)
        if specks:
            left_out.append(
                LeftOut(
                    f"{specks} speck{'s' if specks > 1 else ''}",
                    f"fewer than {SMALLEST} pixels, from {1000 * low:g} mm on",
                )
            )
        for number, thing in enumerate(each for each in found if each.sum() >= SMALLEST):
            for part in convex_parts(thing, free, depth):
                at = np.argwhere(part)[:, ::-1]
                corners = pixel * np.concatenate([at, at + (0, 1), at + (1, 0), at + (1, 1)])
                region = hull(corners)
                assert isinstance(region, shapely.Polygon)
                top = round(float(image[part].max()), 6)
                outlines.append(Outline(f"thing {number + 1} from {1000 * low:g} mm on", region, height=top))
    rows, columns = heights.shape
    return Drawing(tuple(outlines), tuple(left_out), (0.0, 0.0, round(pixel * columns, 6), round(pixel * rows, 6)),
                   f"pixels of {1000 * pixel:g} mm, as told")  # fmt: skip
