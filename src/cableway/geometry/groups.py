"""Groups of rigid motions: the one place where angles of poses are added, subtracted and compared.

A *step* from one pose to another, and so an action, has its translation and its rotation in the world frame, whatever
the pose. `plus` undoes `minus`, and angles run on: `plus(a, minus(b, a))` is the pose `b` with the angle nearest to
that of `a`. `compose` and `inverse` are those of the group: poses in the frame of a pose.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Float

from cableway.geometry import rotations
from cableway.geometry.se2 import wrap_angle


class Group(ABC):
    """A group of rigid motions; its elements are rows of arrays.

    Attributes:
        size: Numbers of a pose.
        dof: Numbers of a step.
        space: How many of them, the first ones, are a position [m].
    """

    size: int
    dof: int
    space: int

    @staticmethod
    @abstractmethod
    def compose(a: Float[np.ndarray, "... size"], b: Float[np.ndarray, "... size"]) -> Float[np.ndarray, "... size"]:
        """Poses in the world of what is at poses `b` in the frames at `a`."""

    @staticmethod
    @abstractmethod
    def inverse(a: Float[np.ndarray, "... size"]) -> Float[np.ndarray, "... size"]:
        """The world's poses in the frames at `a`."""

    @staticmethod
    @abstractmethod
    def plus(pose: Float[np.ndarray, "... size"], step: Float[np.ndarray, "... dof"]) -> Float[np.ndarray, "... size"]:
        """The poses after a step [m, rad]."""

    @staticmethod
    @abstractmethod
    def minus(
        after: Float[np.ndarray, "... size"], before: Float[np.ndarray, "... size"]
    ) -> Float[np.ndarray, "... dof"]:
        """The step [m, rad] from `before` to `after`, turning the short way."""

    @staticmethod
    @abstractmethod
    def continued(
        pose: Float[np.ndarray, "... size"], near: Float[np.ndarray, "... size"]
    ) -> Float[np.ndarray, "... size"]:
        """The same poses, written with the angles nearest to those of `near`."""

    @staticmethod
    @abstractmethod
    def to_world(pose: Float[np.ndarray, "... size"]) -> Float[np.ndarray, "... dof dof"]:
        """The matrices that turn small steps in the frames at `pose` into the same steps in the world."""

    @staticmethod
    @abstractmethod
    def distance(
        a: Float[np.ndarray, "... size"], b: Float[np.ndarray, "... size"]
    ) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
        """Distance [m] and turn [rad] between poses."""

    @staticmethod
    @abstractmethod
    def pulled_back(
        slope: Float[np.ndarray, "... space"],
        points: Float[np.ndarray, "... space"],
        pose: Float[np.ndarray, "... size"],
    ) -> Float[np.ndarray, "... dof"]:
        """The slope by a pose of what has this slope by points [m] that move with the pose."""

    @staticmethod
    @abstractmethod
    def step_units(length: float) -> Float[np.ndarray, "dof"]:
        """What a step is divided by to be in units of `length` [m] and radians."""

    @classmethod
    def position(cls, pose: Float[np.ndarray, "... size"]) -> Float[np.ndarray, "... space"]:
        """The positions [m] of poses, or the translations of steps."""
        return pose[..., : cls.space]

    @classmethod
    def between(
        cls, a: Float[np.ndarray, "... size"], b: Float[np.ndarray, "... size"], share: Float[np.ndarray, "..."] | float
    ) -> Float[np.ndarray, "... size"]:
        """The poses at a share of the step from `a` to `b`; `a` at 0, `b` at 1."""
        return cls.plus(a, np.asarray(share)[..., None] * cls.minus(b, a))


class SE2(Group):
    """Motions of the plane: poses (x, y, theta) and steps (dx, dy, dtheta) [m, m, rad].

    >>> SE2.compose(np.array([1.0, 0.0, np.pi / 2]), np.array([0.1, 0.0, 0.2])).round(3).tolist()
    [1.0, 0.1, 1.771]
    """

    size = 3
    dof = 3
    space = 2

    @staticmethod
    def compose(a: Float[np.ndarray, "... 3"], b: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """See `Group.compose`."""
        a, b = np.asarray(a, float), np.asarray(b, float)
        c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
        out = np.empty(a.shape if a.shape == b.shape else np.broadcast_shapes(a.shape, b.shape))
        out[..., 0] = a[..., 0] + (c * b[..., 0] - s * b[..., 1])
        out[..., 1] = a[..., 1] + (s * b[..., 0] + c * b[..., 1])
        out[..., 2] = a[..., 2] + b[..., 2]
        return out

    @staticmethod
    def inverse(a: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """See `Group.inverse`."""
        a = np.asarray(a, float)
        c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
        out = np.empty(a.shape)
        out[..., 0] = -(c * a[..., 0] + s * a[..., 1])
        out[..., 1] = -(c * a[..., 1] - s * a[..., 0])
        out[..., 2] = -a[..., 2]
        return out

    @staticmethod
    def plus(pose: Float[np.ndarray, "... 3"], step: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """See `Group.plus`."""
        return np.asarray(pose, float) + step

    @staticmethod
    def minus(after: Float[np.ndarray, "... 3"], before: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """See `Group.minus`."""
        step = np.asarray(after, float) - before
        step[..., 2] = wrap_angle(step[..., 2])
        return step

    @staticmethod
    def continued(pose: Float[np.ndarray, "... 3"], near: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """See `Group.continued`."""
        out = np.array(pose, float)
        out[..., 2] += 2 * np.pi * np.round((near[..., 2] - out[..., 2]) / (2 * np.pi))
        return out

    @staticmethod
    def to_world(pose: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3 3"]:
        """See `Group.to_world`."""
        out = np.zeros((*pose.shape, 3))
        out[..., 0, 0] = out[..., 1, 1] = np.cos(pose[..., 2])
        out[..., 1, 0] = np.sin(pose[..., 2])
        out[..., 0, 1], out[..., 2, 2] = -out[..., 1, 0], 1.0
        return out

    @staticmethod
    def distance(
        a: Float[np.ndarray, "... 3"], b: Float[np.ndarray, "... 3"]
    ) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
        """See `Group.distance`."""
        step = SE2.minus(b, a)
        return np.linalg.norm(step[..., :2], axis=-1), np.abs(step[..., 2])

    @staticmethod
    def pulled_back(
        slope: Float[np.ndarray, "... 2"], points: Float[np.ndarray, "... 2"], pose: Float[np.ndarray, "... 3"]
    ) -> Float[np.ndarray, "... 3"]:
        """See `Group.pulled_back`: (g, g . R'(theta) l) with the slope g by a point x + R(theta) l."""
        lever = points - pose[..., :2]
        out = np.empty((*np.broadcast_shapes(slope.shape, lever.shape)[:-1], 3))
        out[..., :2] = slope
        out[..., 2] = slope[..., 1] * lever[..., 0] - slope[..., 0] * lever[..., 1]
        return out

    @staticmethod
    def step_units(length: float) -> Float[np.ndarray, "3"]:
        """See `Group.step_units`."""
        return np.array([length, length, 1.0])


class SE3(Group):
    """Motions of space: poses (x, y, z, qw, qx, qy, qz) [m, 1] and steps (dx, dy, dz, rx, ry, rz) [m, rad].

    A step turns about the world's axes by its rotation vector; q and -q are the same rotation.

    >>> SE3.compose(np.array([1.0, 0, 0, 0, 0, 0, 1]), np.array([0.1, 0, 0.2, 1, 0, 0, 0])).tolist()
    [0.9, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0]
    """

    size = 7
    dof = 6
    space = 3
    identity = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    """The pose of a frame in itself."""

    @staticmethod
    def compose(a: Float[np.ndarray, "... 7"], b: Float[np.ndarray, "... 7"]) -> Float[np.ndarray, "... 7"]:
        """See `Group.compose`."""
        place = a[..., :3] + rotations.rotate(a[..., 3:], b[..., :3])
        return np.concatenate([place, rotations.product(a[..., 3:], b[..., 3:])], axis=-1)

    @staticmethod
    def inverse(a: Float[np.ndarray, "... 7"]) -> Float[np.ndarray, "... 7"]:
        """See `Group.inverse`."""
        back = rotations.conjugate(a[..., 3:])
        return np.concatenate([-rotations.rotate(back, a[..., :3]), back], axis=-1)

    @staticmethod
    def plus(pose: Float[np.ndarray, "... 7"], step: Float[np.ndarray, "... 6"]) -> Float[np.ndarray, "... 7"]:
        """See `Group.plus`."""
        turned = rotations.product(rotations.from_vector(step[..., 3:]), pose[..., 3:])
        turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
        return np.concatenate([pose[..., :3] + step[..., :3], turned], axis=-1)

    @staticmethod
    def minus(after: Float[np.ndarray, "... 7"], before: Float[np.ndarray, "... 7"]) -> Float[np.ndarray, "... 6"]:
        """See `Group.minus`."""
        turn = rotations.product(after[..., 3:], rotations.conjugate(before[..., 3:]))
        return np.concatenate([after[..., :3] - before[..., :3], rotations.to_vector(turn)], axis=-1)

    @staticmethod
    def continued(pose: Float[np.ndarray, "... 7"], near: Float[np.ndarray, "... 7"]) -> Float[np.ndarray, "... 7"]:
        """See `Group.continued`: with the quaternion's sign that is nearer."""
        out = np.array(pose, float)
        same = np.sum(out[..., 3:] * near[..., 3:], axis=-1, keepdims=True)
        out[..., 3:] *= np.where(same < 0, -1.0, 1.0)
        return out

    @staticmethod
    def to_world(pose: Float[np.ndarray, "... 7"]) -> Float[np.ndarray, "... 6 6"]:
        """See `Group.to_world`."""
        out = np.zeros((*pose.shape[:-1], 6, 6))
        out[..., :3, :3] = out[..., 3:, 3:] = rotations.matrices(pose[..., 3:])
        return out

    @staticmethod
    def distance(
        a: Float[np.ndarray, "... 7"], b: Float[np.ndarray, "... 7"]
    ) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
        """See `Group.distance`."""
        step = SE3.minus(b, a)
        return np.linalg.norm(step[..., :3], axis=-1), np.linalg.norm(step[..., 3:], axis=-1)

    @staticmethod
    def pulled_back(
        slope: Float[np.ndarray, "... 3"], points: Float[np.ndarray, "... 3"], pose: Float[np.ndarray, "... 7"]
    ) -> Float[np.ndarray, "... 6"]:
        """See `Group.pulled_back`: (g, l x g) with the slope g by a point at x + l."""
        lever = points - pose[..., :3]
        return np.concatenate(np.broadcast_arrays(slope, np.cross(lever, slope)), axis=-1)

    @staticmethod
    def step_units(length: float) -> Float[np.ndarray, "6"]:
        """See `Group.step_units`."""
        return np.array([length, length, length, 1.0, 1.0, 1.0])
