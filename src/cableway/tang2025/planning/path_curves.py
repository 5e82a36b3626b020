"""Paths as smooth functions of progress sigma in [0, 1], with first and second derivatives.

"spline" is a C2 cubic spline through the waypoints. "sigmoid" is the paper's Gamma (Tang et al., eq. for x(sigma)):
each segment's straight line, weighted by a product of two sigmoids.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.special import expit

from cableway.tang2025.planning.config import DeformationConfig

NEGLIGIBLE = 40.0
"""Exponent, in size, at which a sigmoid is nothing beside one: segments that far from a point are left out."""


class PathCurves(ABC):
    """n paths; `__call__` gives points, first and second derivatives (t, n, 2) at progress (t, n)."""

    @abstractmethod
    def __call__(
        self, progress: Float[np.ndarray, "t n"]
    ) -> tuple[Float[np.ndarray, "t n 2"], Float[np.ndarray, "t n 2"], Float[np.ndarray, "t n 2"]]:
        """Points [m] and their derivatives by progress."""


def path_curves(paths: Float[np.ndarray, "n M 2"], config: DeformationConfig) -> PathCurves:
    """The curves that the config asks for."""
    if config.interpolation == "spline":
        return SplineCurves(paths)
    return SigmoidCurves(paths, config.sharpness)


class SplineCurves(PathCurves):
    """Cubic splines through the waypoints, at equal steps of progress."""

    def __init__(self, paths: Float[np.ndarray, "n M 2"]) -> None:
        self._segments = paths.shape[1] - 1
        knots = np.linspace(0.0, 1.0, self._segments + 1)
        self._coefficients = np.moveaxis(CubicSpline(knots, paths, axis=1).c, 2, 0)

    def __call__(
        self, progress: Float[np.ndarray, "t n"]
    ) -> tuple[Float[np.ndarray, "t n 2"], Float[np.ndarray, "t n 2"], Float[np.ndarray, "t n 2"]]:
        """Points [m] and their derivatives by progress."""
        segment = np.clip((progress * self._segments).astype(int), 0, self._segments - 1)
        s = (progress - segment / self._segments)[..., None]
        rows = np.broadcast_to(np.arange(progress.shape[-1]), progress.shape)
        a, b, c, d = np.moveaxis(self._coefficients[rows, :, segment], -2, 0)
        return ((a * s + b) * s + c) * s + d, (3 * a * s + 2 * b) * s + c, 6 * a * s + 2 * b


class SigmoidCurves(PathCurves):
    """The paper's weighted segments.

    Note:
        They miss the waypoints, ends included, by some 0.1 segments where the path bends.
    """

    def __init__(self, paths: Float[np.ndarray, "n M 2"], sharpness: float) -> None:
        self._segments = paths.shape[1] - 1
        self._starts, self._slopes = paths[:, :-1], np.diff(paths, axis=1) * self._segments
        self._sharpness = sharpness * self._segments
        self._reach = min(self._segments, 2 * math.ceil(NEGLIGIBLE / sharpness) + 3)

    def __call__(
        self, progress: Float[np.ndarray, "t n"]
    ) -> tuple[Float[np.ndarray, "t n 2"], Float[np.ndarray, "t n 2"], Float[np.ndarray, "t n 2"]]:
        """Points [m] and their derivatives by progress."""
        a, m, k = self._sharpness, self._segments, self._reach
        first = np.clip((progress * m).astype(int) - k // 2, 0, m - k)
        near = first[..., None] + np.arange(k)
        rows = np.arange(progress.shape[-1])[:, None]
        start, slope, past = self._starts[rows, near], self._slopes[rows, near], progress[..., None] - near / m
        rise, fall = expit(a * past), expit(a * (1 / m - past))
        w = rise * fall
        dw = a * w * (fall - rise)
        ddw = a * a * w * ((fall - rise) ** 2 - rise * (1 - rise) - fall * (1 - fall))
        line = start + slope * past[..., None]
        total, dtotal, ddtotal = (part.sum(axis=-1)[..., None] for part in (w, dw, ddw))

        def weighted(weight: np.ndarray, points: np.ndarray) -> np.ndarray:
            return np.einsum("tnk,tnkd->tnd", weight, points)

        x = weighted(w, line) / total
        dx = (weighted(dw, line) + weighted(w, slope) - x * dtotal) / total
        ddx = weighted(ddw, line) + 2 * weighted(dw, slope) - 2 * dx * dtotal - x * ddtotal
        return x, dx, ddx / total
