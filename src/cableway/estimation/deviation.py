"""How far a cable lies beside its rod: what no parameter of the rod explains, as a random field along the cable.

The distance across the cable at the keypoints has zero mean, a covariance that falls with the distance along the cable,
and fades in time as an Ornstein-Uhlenbeck process. It is nothing at the ends, which the grasps explain. A Kalman filter
corrects it by what is seen; where nothing is, its deviation says how far off the rod may be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class DeviationField:
    """The field at n keypoints.

    Attributes:
        mean: (n,) distances [m] to the left of the rod.
        covariance: (n, n) of them [m^2].
        prior: (n, n) the same where nothing was seen for long.
    """

    mean: Float[np.ndarray, "n"]
    covariance: Float[np.ndarray, "n n"]
    prior: Float[np.ndarray, "n n"]

    @classmethod
    def unknown(cls, count: int, deviation: float, reach: float) -> DeviationField:
        """Before anything was seen: a standard deviation [m], and how far along the cable it is alike, in lengths."""
        along = np.linspace(0.0, 1.0, count)
        fading = np.minimum(1.0, np.minimum(along, 1.0 - along) / reach)
        alike = np.exp(-0.5 * ((along[:, None] - along) / reach) ** 2)
        prior = deviation**2 * fading[:, None] * alike * fading
        return cls(np.zeros(count), prior, prior)

    def later(self, kept: float) -> DeviationField:
        """After some time, of which a share is kept."""
        return replace(self, mean=kept * self.mean, covariance=kept**2 * self.covariance + (1 - kept**2) * self.prior)

    def updated(self, along: Float[np.ndarray, "m"], distances: Float[np.ndarray, "m"], noise: float) -> DeviationField:
        """After distances [m] were measured at shares of the length, each with a standard deviation [m]."""
        if not len(along):
            return self
        rows = hats(along, len(self.mean))
        spread = rows @ self.covariance
        gain = np.linalg.solve(spread @ rows.T + noise**2 * np.eye(len(along)), spread).T
        mean = self.mean + gain @ (distances - rows @ self.mean)
        covariance = self.covariance - gain @ spread
        return replace(self, mean=mean, covariance=(covariance + covariance.T) / 2)


def hats(along: Float[np.ndarray, "m"], count: int) -> Float[np.ndarray, "m n"]:
    """Weights of n keypoints at shares of the length, linear between two of them.

    >>> hats(np.array([0.0, 0.75]), 3).tolist()
    [[1.0, 0.0, 0.0], [0.0, 0.5, 0.5]]
    """
    return np.maximum(0.0, 1.0 - np.abs(along[:, None] * (count - 1) - np.arange(count)))
