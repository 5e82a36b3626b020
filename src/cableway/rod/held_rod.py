"""What a rod held at both ends is to everything that plans, controls and estimates: a value with its coordinates.

A row q of coordinates holds an equilibrium and the gripper poses that make it. Planner, controllers and estimator
take all sizes from this value: `dof` coordinates, gripper poses of `group`, positions with as many components as
`shapes` has. `PlanarRod` is the first such value, `SpatialRod` the second.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from cableway.geometry.groups import Group


class HeldRod(ABC):
    """A rod held by two grippers.

    Attributes:
        length: L [m].
        keypoints: n, both ends included.
        group: What the poses of its grippers are.
    """

    length: float
    keypoints: int
    group: ClassVar[type[Group]]

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number d of coordinates."""

    @property
    @abstractmethod
    def units(self) -> Float[np.ndarray, "d"]:
        """Usual size of each coordinate's change, in which steps are measured."""

    @property
    @abstractmethod
    def loads(self) -> slice:
        """The coordinates that say how the rod is loaded; the others say where it is."""

    @property
    @abstractmethod
    def hinges(self) -> int:
        """N, the number of places at which the rod bends."""

    @property
    @abstractmethod
    def stride(self) -> int:
        """Stations from one keypoint to the next."""

    @property
    def end_shape(self) -> tuple[int, int]:
        """Shape of an array with the poses of both grippers."""
        return 2, self.group.size

    @property
    def step_shape(self) -> tuple[int, int]:
        """Shape of an array with a motion of both grippers."""
        return 2, self.group.dof

    @abstractmethod
    def shapes(
        self, q: Float[np.ndarray, "t d"]
    ) -> tuple[Float[np.ndarray, "t s space"], Float[np.ndarray, "t 2 pose"]]:
        """Stations [m] at equal arc length and gripper poses [m, rad] of each row of q. Angles run on with q."""

    @abstractmethod
    def jacobians(
        self, q: Float[np.ndarray, "t d"]
    ) -> tuple[
        Float[np.ndarray, "t s space"],
        Float[np.ndarray, "t s space d"],
        Float[np.ndarray, "t 2 pose"],
        Float[np.ndarray, "t 2 step d"],
    ]:
        """Stations and gripper poses of each row of q, each followed by its derivative by steps of q (`retract`)."""

    @abstractmethod
    def stability(
        self, q: Float[np.ndarray, "t d"], ceiling: float = 1e9
    ) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t d"]]:
        """Stability margin of each row of q, and its derivative by q; above `ceiling`, that with derivative zero."""

    @abstractmethod
    def energy(self, q: Float[np.ndarray, "t d"]) -> Float[np.ndarray, "t"]:
        """Energy in units of EI/L."""

    @abstractmethod
    def passes_through_itself(self, stations: Float[np.ndarray, "s space"]) -> bool:
        """Whether the line through stations [m] meets itself, as none of a cable does."""

    @abstractmethod
    def retract(self, q: Float[np.ndarray, "... d"], step: Float[np.ndarray, "... d"]) -> Float[np.ndarray, "... d"]:
        """The coordinates after a step of them."""

    @abstractmethod
    def difference(self, a: Float[np.ndarray, "... d"], b: Float[np.ndarray, "... d"]) -> Float[np.ndarray, "... d"]:
        """The step from `a` to `b`: `retract(a, difference(a, b))` is `b`."""

    @abstractmethod
    def guesses(self, keypoints: Float[np.ndarray, "t n space"]) -> Float[np.ndarray, "t d"]:
        """Coordinates near the shapes with these keypoints [m], from which a fit can start."""

    @abstractmethod
    def guesses_between(self, poses: Float[np.ndarray, "2 pose"], count: int) -> Float[np.ndarray, "k d"]:
        """Coordinates spread over the loads, at least `count`, with ends about `poses`: starts of a search."""

    @abstractmethod
    def continued(self, q: Float[np.ndarray, "d"], poses: Float[np.ndarray, "2 pose"]) -> Float[np.ndarray, "d"]:
        """The same shape in the coordinates whose gripper poses are written most like `poses`."""

    @abstractmethod
    def written_near(self, q: Float[np.ndarray, "d"], near: Float[np.ndarray, "d"]) -> Float[np.ndarray, "d"]:
        """The same configuration in the coordinates nearest to `near`: angles do not jump by full turns."""

    def between(
        self, a: Float[np.ndarray, "... d"], b: Float[np.ndarray, "... d"], share: Float[np.ndarray, "..."] | float
    ) -> Float[np.ndarray, "... d"]:
        """The equilibria at a share of the way from `a` to `b`; `a` at 0, `b` at 1."""
        return self.retract(a, np.asarray(share)[..., None] * self.difference(a, b))

    def end_poses(self, q: Float[np.ndarray, "t d"]) -> Float[np.ndarray, "t 2 pose"]:
        """Gripper poses [m, rad] of each row of q."""
        return self.shapes(q)[1]

    def at_stations(self, values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "s k"]:
        """Values of the keypoints at all stations, linear between them."""
        stations = np.arange((len(values) - 1) * self.stride + 1) / self.stride
        return np.column_stack([np.interp(stations, np.arange(len(values)), column) for column in values.T])

    def at_keypoints(self, stations: Float[np.ndarray, "t s ..."]) -> Float[np.ndarray, "t n ..."]:
        """The rows of `stations` (axis 1) that are keypoints."""
        return stations[:, :: self.stride]
