"""Compiled passes over pictures: pixels of a colour, the middles of a band, and where a curve should be seen."""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel

FAR = 6
"""Pixels looked at along a band, in widths of the run across it: what is longer has no end."""

BESIDE = 2
"""Pixels [1] beside a run among which one of what hides the band tells that the run was cut."""

ASKEW = 0.25
"""Share of the run along a band by which the parts of it on either side of the middle of the run across may differ, and
two pixels: where they differ by more, as at the crest of an arc, that is not the middle of the band."""

HIDDEN, SEEN, MISSING = 0, 1, 2
"""Of a place where the cable should be: outside the picture or behind something, in the mask, or not there."""


@kernel
def of_color(image, reference, least_cosine, least, most, mask):
    """Write which pixels of an image (h, w, 3) have the direction of `reference` (3,) and a brightness in a range.

    Args:
        image: 0 to 255.
        reference: Of length 1.
        least_cosine: Of the angle between a pixel and the reference.
        least: Length of a pixel from which on it counts.
        most: And up to which.
        mask: Where to (h, w).
    """
    red, green, blue = reference[0], reference[1], reference[2]
    low, high, cosine = least * least, most * most, least_cosine * least_cosine
    for row in range(mask.shape[0]):
        for column in range(mask.shape[1]):
            r, g, b = float(image[row, column, 0]), float(image[row, column, 1]), float(image[row, column, 2])
            square, along = r * r + g * g + b * b, red * r + green * g + blue * b
            mask[row, column] = low <= square <= high and along * along >= cosine * square


@inlined
def _run(mask, row, column, down, right, most):
    """Pixels of the mask in a line before and after one of it, each at most about `most`."""
    height, width = mask.shape
    after, r, c = 0, row + down, column + right
    while after < most and r < height and c < width and mask[r, c]:
        after, r, c = after + 1, r + down, c + right
    before, r, c = 0, row - down, column - right
    while before < most and r >= 0 and c >= 0 and mask[r, c]:
        before, r, c = before + 1, r - down, c - right
    return before, after


@inlined
def _cut(hiding, row, column, first, last, down, right):
    """Whether something that hides the band begins beside a run, from `first` to `last` along its line."""
    height, width = hiding.shape
    for k in range(1, BESIDE + 1):
        r, c = row + down * (first - k), column + right * (first - k)
        if r >= 0 and c >= 0 and hiding[r, c]:
            return True
        r, c = row + down * (last + k), column + right * (last + k)
        if r < height and c < width and hiding[r, c]:
            return True
    return False


@inlined
def _kept(mask, hiding, row, column, first, last, down, right):
    """Width of the band by a run from `first` to `last` along its line, through row or column; 0 if it is left out."""
    length, middle = last - first + 1, (first + last) // 2
    at_row, at_column = row + down * middle, column + right * middle
    before, after = _run(mask, at_row, at_column, right, down, FAR * length)
    other = before + 1 + after
    off = other < FAR * length and abs(after - before) > ASKEW * other + 2.0
    if first == 0 or length > other or off or (hiding.size > 0 and _cut(hiding, row, column, first, last, down, right)):
        return 0.0
    return 1.0 / math.sqrt(1.0 / length**2 + 1.0 / other**2)


@kernel
def middles(mask, hiding, out):
    """Write (u, v, width) of the middles of runs across a band into `out` (m, 3); how many there are.

    The middle of a horizontal run of a straight band is on its centre line whatever the angle between them, and so is
    that of a vertical one. Of the two through a pixel the shorter one counts. From their lengths a and b follows the
    width of the band, 1/w^2 = 1/a^2 + 1/b^2. Runs that the edge of the picture cuts are left out, those beside
    something that hides the band, and those at the crest of an arc.

    Args:
        mask: (h, w) of the band.
        hiding: (h, w) of what is before it; (0, 0) where nothing is known of that.
        out: Where to; what has no room is left out.
    """
    height, width = mask.shape
    begun, count = np.full(width, -1), 0
    for row in range(height):
        left = -1
        for column in range(width):
            inside = mask[row, column]
            if inside and begun[column] < 0:
                begun[column] = row
            if inside and left < 0:
                left = column
            if begun[column] >= 0 and not inside:  # a vertical run ended above
                wide = _kept(mask, hiding, 0, column, begun[column], row - 1, 1, 0)
                if wide > 0.0 and count < len(out):
                    out[count, 0], out[count, 1], out[count, 2] = column, (begun[column] + row - 1) / 2.0, wide
                    count += 1
                begun[column] = -1
            if left >= 0 and not inside:  # a horizontal run ended before
                wide = _kept(mask, hiding, row, 0, left, column - 1, 0, 1)
                if wide > 0.0 and count < len(out):
                    out[count, 0], out[count, 1], out[count, 2] = (left + column - 1) / 2.0, row, wide
                    count += 1
                left = -1
    return count


@kernel
def claims(pixels, reach, mask, hiding, out):
    """Write into `out` (m,) whether places of the cable are hidden, seen or missing.

    Args:
        pixels: (m, 2) where they should be seen, NaN where nowhere.
        reach: (m,) distance [pixels] within which one of the mask is it, and one of what hides it may hide it.
        mask: (h, w) of the cable.
        hiding: (h, w) of what is before it.
        out: Where to.
    """
    height, width = mask.shape
    for i in range(len(pixels)):
        out[i] = HIDDEN
        u, v, far = pixels[i, 0], pixels[i, 1], reach[i]
        if not (far <= u < width - far and far <= v < height - far):
            continue
        found, hidden = False, False
        for row in range(math.ceil(v - far), math.floor(v + far) + 1):
            for column in range(math.ceil(u - far), math.floor(u + far) + 1):
                if (row - v) ** 2 + (column - u) ** 2 <= far * far:
                    found = found or mask[row, column]
                    hidden = hidden or hiding[row, column]
        out[i] = SEEN if found else HIDDEN if hidden else MISSING
