"""Markers on a cable as surfaces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline
from cableway.rendering.mesh import Surface, tube

BAND = 1.04
"""Radius of a marker over that of the cable; it is as long as the cable is wide."""


def bands(line: Float[np.ndarray, "m 3"], radius: float, keypoints: int) -> Iterator[Surface]:
    """The markers at the inner ones of so many keypoints, at equal distances along a cable of this radius [m]."""
    for at in np.linspace(0.0, float(polyline.length(line)), keypoints)[1:-1]:
        yield tube(polyline.point_at(line, at + radius * np.array([-1.0, 0.0, 1.0])), BAND * radius)
