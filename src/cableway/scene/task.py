"""A task: where a cable lies, where it shall lie, and what stands between."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from cableway.errors import TaskError
from cableway.geometry import convex, polyline
from cableway.rod.inverse import fit_keypoints
from cableway.scene.cable import Cable
from cableway.scene.scene import Scene

CONTROL_STEP = 0.1
"""Time [s] of one control step, to which the gripper limits refer."""

LENGTH_TOLERANCE = 0.02
"""Relative error of length above which a start or goal shape is refused."""

SPLINE_PIECES = 6
"""Vertices between two keypoints where the cable is drawn through them: 4 mm apart on 0.3 m."""


@dataclass(frozen=True, kw_only=True)
class Grippers:
    """Footprint and limits of both grippers.

    Attributes:
        radius: Of the disc each gripper covers [m].
        max_step: Largest move in one control step [m].
        max_turn: Largest turn in one control step [rad].
        separation: Least distance between the two grippers' centres [m]; 0 for none.
    """

    radius: float = 0.004
    max_step: float = 0.0133
    max_turn: float = 0.133
    separation: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radius", "max_step", "max_turn"):
            if not 0 < getattr(self, name) < math.inf:
                raise TaskError(f"grippers.{name} must be positive and finite, got {getattr(self, name)!r}")
        if not 0 <= self.separation < math.inf:
            raise TaskError(f"grippers.separation must be finite and not negative, got {self.separation!r}")


@dataclass(frozen=True, kw_only=True)
class Plug:
    """A rigid plug ahead of the right gripper, along its tangent: length and width [m]."""

    length: float
    width: float


@dataclass(frozen=True, kw_only=True)
class Port:
    """Where the plug goes.

    Attributes:
        position: Mouth of the port (x, y) [m].
        angle: Direction of insertion [rad].
        standoff: Distance [m] of the plug's tip before the mouth at the goal.
        depth: How far [m] the plug goes in.
    """

    position: tuple[float, float]
    angle: float
    standoff: float
    depth: float


@dataclass(frozen=True, kw_only=True)
class Task:
    """A start shape, a goal shape, the cable and the scene.

    Attributes:
        name: For folders and reports.
        description: One sentence.
        scene: Workspace and obstacles.
        cable: The cable.
        grippers: Footprint and limits.
        start: (n, 2) keypoints [m], left gripper first, at equal arc length.
        goal: (n, 2) keypoints [m].
        start_poses: (2, 3) gripper poses [m, m, rad] where the task states them; else the rod gives them.
        goal_poses: The same for the goal.
        plug: Optional plug held by the right gripper.
        port: Optional place the plug goes to.

    Raises:
        TaskError: A shape has the wrong number of keypoints or length, lies outside the workspace or touches an
            obstacle.
    """

    name: str
    scene: Scene
    cable: Cable
    start: Float[np.ndarray, "n 2"]
    goal: Float[np.ndarray, "n 2"]
    grippers: Grippers = field(default_factory=Grippers)
    start_poses: Float[np.ndarray, "2 3"] | None = None
    goal_poses: Float[np.ndarray, "2 3"] | None = None
    description: str = ""
    plug: Plug | None = None
    port: Port | None = None

    def __post_init__(self) -> None:
        for end in ("start", "goal"):
            object.__setattr__(self, end, np.array(getattr(self, end), dtype=float))
            self._check_shape(end)

    def _check_shape(self, end: str) -> None:
        shape, n = getattr(self, end), self.cable.keypoints
        if shape.ndim != 2 or shape.shape[1] != 2 or len(shape) != n:
            raise TaskError(f"{end} has shape {shape.shape}, but cable.keypoints asks for ({n}, 2)")
        if not np.isfinite(shape).all():
            raise TaskError(f"{end} holds a number that is not finite")
        long = float(polyline.length(polyline.spline(shape, SPLINE_PIECES)))
        if abs(long / self.cable.length - 1) > LENGTH_TOLERANCE:
            raise TaskError(
                f"{end} is {long:.4f} m long, more than {LENGTH_TOLERANCE:.0%} off cable.length {self.cable.length} m"
            )
        width, height = self.scene.size
        outside = (shape < 0).any(1) | (shape > [width, height]).any(1)
        if outside.any():
            i = int(np.argmax(outside))
            raise TaskError(
                f"{end} keypoint {i} at ({shape[i, 0]:.3f}, {shape[i, 1]:.3f}) lies outside the workspace "
                f"{width} m x {height} m"
            )
        distance, index = convex.polyline_distance(polyline.spline(shape, SPLINE_PIECES)[None], self.scene.world)
        depth = self.cable.radius - float(distance[0])
        if depth > 0:
            raise TaskError(f"{end} overlaps {self.scene.name_of(int(index[0]))} by {1000 * depth:.1f} mm")
        distance, _, index = convex.signed_distance(shape[[0, -1]], self.scene.world)
        depth = self.grippers.radius - distance
        if depth.max() > 0:
            side = int(np.argmax(depth))
            raise TaskError(
                f"the {('left', 'right')[side]} gripper at the {end} overlaps "
                f"{self.scene.name_of(int(index[side]))} by {1000 * depth[side]:.1f} mm"
            )

    @cached_property
    def start_fit(self) -> tuple[Float[np.ndarray, "6"], float]:
        """The equilibrium nearest to the start and its stacked distance [m]."""
        return fit_keypoints(self.cable.rod, self.start)

    @cached_property
    def goal_fit(self) -> tuple[Float[np.ndarray, "6"], float]:
        """The equilibrium nearest to the goal and its stacked distance [m]."""
        return fit_keypoints(self.cable.rod, self.goal)
