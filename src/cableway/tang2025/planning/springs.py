"""Energy of springs between keypoints, by positions and by progress along paths.

    E(s) = 1/2 sum_i k1 (|x_i+1 - x_i| - l)^2 + 1/2 sum_i k2 (|x_i+2 - x_i| - 2 l)^2,      l = L/(n - 1)

(Tang et al., the mass-spring model), with the rest lengths of the straight cable. By progress, with p = dx/dsigma
and c = d2x/dsigma2 of each keypoint: dE/dsigma_i = g_i . p_i and d2E/dsigma_i dsigma_j = p_i . H_ij p_j, plus
g_i . c_i for i = j.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cableway.tang2025.planning.path_curves import PathCurves

ROUNDING = 1e-6
"""Length [m] under which the distance of two keypoints is rounded off, so that it has derivatives at zero."""


@dataclass(frozen=True)
class Springs:
    """All springs of a sequence of shapes.

    Attributes:
        rest: l, rest length between neighbouring keypoints [m].
        stiffness: (k1, k2) of springs to the next keypoint and to the next but one [N/m].
        step_stiffness: k3 [N/m] of the springs from a keypoint to itself one step later, at rest when it stands still.
        travel: Length [m] that turns a change of progress into a distance, for k3.
    """

    rest: float
    stiffness: tuple[float, float]
    step_stiffness: float
    travel: float

    def shape_energy(self, shapes: Float[np.ndarray, "t n 2"]) -> Float[np.ndarray, "t"]:
        """E of each shape [J]."""
        total = np.zeros(len(shapes))
        for stride, k in enumerate(self.stiffness, start=1):
            _, d = _spans(shapes, stride)
            total += 0.5 * k * np.sum((d - stride * self.rest) ** 2, axis=1)
        return total

    def value(self, sigma: Float[np.ndarray, "t n"], curves: PathCurves) -> float:
        """The sum of E over all shapes and of the springs between them, over l^2 [N/m]."""
        steps = 0.5 * self._step_weight * np.sum(np.diff(sigma, axis=0) ** 2)
        return float(np.sum(self.shape_energy(curves(sigma)[0])) + steps) / self.rest**2

    def gradient(self, sigma: Float[np.ndarray, "t n"], curves: PathCurves) -> Float[np.ndarray, "t n"]:
        """Derivative of `value`."""
        x, p, _ = curves(sigma)
        out = np.sum(self._forces(x) * p, axis=2)
        pull = self._step_weight * np.diff(sigma, axis=0)
        out[1:] += pull
        out[:-1] -= pull
        return out / self.rest**2

    def hessian(self, sigma: Float[np.ndarray, "t n"], curves: PathCurves) -> Float[np.ndarray, "h"]:
        """Second derivatives of `value` by the inner rows of sigma, the entries that `pattern` lists."""
        x, p, c = (part[1:-1] for part in curves(sigma))
        diagonal = np.sum(self._forces(x) * c, axis=2) + 2 * self._step_weight
        beside = []
        for stride, k in enumerate(self.stiffness, start=1):
            v, d = _spans(x, stride)
            ratio = stride * self.rest / d
            near, far = p[:, :-stride], p[:, stride:]

            def product(a: np.ndarray, b: np.ndarray, v=v, d=d, ratio=ratio, k=k) -> np.ndarray:
                along = np.sum(a * v, axis=2) * np.sum(b * v, axis=2) / d**2
                return k * ((1 - ratio) * np.sum(a * b, axis=2) + ratio * along)

            diagonal[:, :-stride] += product(near, near)
            diagonal[:, stride:] += product(far, far)
            beside.append(-product(near, far).ravel())
        steps = np.full((len(x) - 1) * x.shape[1], -self._step_weight)
        return np.concatenate([diagonal.ravel(), *beside, steps]) / self.rest**2

    @property
    def _step_weight(self) -> float:
        return self.step_stiffness * self.travel**2

    def _forces(self, x: Float[np.ndarray, "t n 2"]) -> Float[np.ndarray, "t n 2"]:
        """dE/dx."""
        out = np.zeros_like(x)
        for stride, k in enumerate(self.stiffness, start=1):
            v, d = _spans(x, stride)
            pull = (k * (1 - stride * self.rest / d))[..., None] * v
            out[:, stride:] += pull
            out[:, :-stride] -= pull
        return out


def pattern(rows: int, n: int) -> tuple[Int[np.ndarray, "h"], Int[np.ndarray, "h"]]:
    """Row and column of each entry of `Springs.hessian` for `rows` inner rows of n keypoints, upper triangle."""
    index = np.arange(rows * n).reshape(rows, n)
    first = [index, index[:, :-1], index[:, :-2], index[:-1]]
    second = [index, index[:, 1:], index[:, 2:], index[1:]]
    return np.concatenate([a.ravel() for a in first]), np.concatenate([b.ravel() for b in second])


def _spans(x: Float[np.ndarray, "t n 2"], stride: int) -> tuple[Float[np.ndarray, "t m 2"], Float[np.ndarray, "t m"]]:
    v = x[:, stride:] - x[:, :-stride]
    return v, np.sqrt(np.sum(v**2, axis=2) + ROUNDING**2)
