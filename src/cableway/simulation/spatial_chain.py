"""A cable in space as a chain of links in MuJoCo, which bends and twists with stiffnesses of their own.

The chain has as many links as are asked for, the first and the last half as long. Two hinges across the cable bend each
joint, one along it twists it. A joint with two hinges turns its frame by half the product of its bends about the
tangent, which a rod without twist does not: the two hinges change places from joint to joint, so that these turns
cancel.

Note:
    MuJoCo's ball joints have one stiffness, for bending and twisting alike.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.geometry import rotations
from cableway.scene.spatial.cable import SpatialCable

ACROSS = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Axes of the hinges that bend a joint, in the frame of its link; x is along the cable."""

ALONG = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class SpatialChain:
    """A chain as a model has it.

    Attributes:
        cable: Length, radius, stiffnesses, damping time and density.
        links: How many, the first and the last half as long.
        profile: Factors on both stiffnesses at places evenly along the cable.
    """

    cable: SpatialCable
    links: int
    profile: tuple[float, ...] = (1.0,)

    @property
    def joints(self) -> Float[np.ndarray, "v"]:
        """Where the ends and the joints are, from 0 to 1 along the cable."""
        inner = np.arange(self.links - 1) + 0.5
        return np.concatenate([[0.0], inner / (self.links - 1), [1.0]])

    @property
    def _factors(self) -> Float[np.ndarray, "j"]:
        """Factors on the stiffness of each joint."""
        return np.interp(self.joints[1:-1], np.linspace(0.0, 1.0, len(self.profile)), self.profile)

    @property
    def coordinates(self) -> int:
        """Numbers of the chain in MuJoCo's `qpos`: the pose of its first link and three hinges a joint."""
        return 7 + 3 * (self.links - 1)

    def add(self, spec: mujoco.MjSpec, **surface: Any) -> None:
        """Add the links as bodies and capsules "segment 0", "segment 1" and so on, the first one free.

        Args:
            spec: The model; the chain is to be the first in it.
            surface: How the capsules meet other things.
        """
        cable, body, before = self.cable, spec.worldbody, 0.0
        stiffness = cable.bending_stiffness * (self.links - 1) / cable.length * self._factors
        for index, share in enumerate(np.diff(self.joints) * cable.length):
            name = f"segment {index}"
            body, before = body.add_body(name=name, pos=[before, 0.0, 0.0]), float(share)
            if index == 0:
                body.add_freejoint()
            else:
                across = ACROSS if index % 2 else ACROSS[::-1]
                for axis, factor in (*((axis, 1.0) for axis in across), (ALONG, cable.twist_ratio)):
                    joint = body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
                    joint.stiffness[0] = factor * stiffness[index - 1]
                    joint.damping[0] = factor * stiffness[index - 1] * cable.damping_time
            body.add_geom(
                name=name,
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0.0, 0.0, 0.0, before, 0.0, 0.0],
                size=[cable.radius, 0.0, 0.0],
                mass=cable.linear_density * before,
                **surface,
            )

    def laid(
        self, stations: Float[np.ndarray, "s 3"], pose: Float[np.ndarray, "7"], twist: float
    ) -> Float[np.ndarray, "c"]:
        """Coordinates of the chain along a curve.

        Args:
            stations: Points of the curve [m] at equal arc length, from end to end.
            pose: Of its left end: position [m] and unit quaternion (w, x, y, z), x along the curve.
            twist: Angle [rad] by which the cable is twisted from end to end.
        """
        places = np.linspace(0.0, 1.0, len(stations))
        points = np.column_stack([np.interp(self.joints, places, column) for column in stations.T])
        tangents = np.diff(points, axis=0)
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        frames = np.empty((self.links, 4))
        frames[0] = carried(pose[3:], tangents[0])
        for index in range(1, self.links):
            frames[index] = carried(frames[index - 1], tangents[index])
        turn = twist * (np.arange(self.links) / (self.links - 1))
        frames = rotations.product(frames, rotations.from_vector(turn[:, None] * np.array(ALONG)))
        turns = rotations.product(rotations.conjugate(frames[:-1]), frames[1:])
        return np.concatenate([pose[:3], frames[0], hinge_angles(turns).ravel()])

    def line(self, data: mujoco.MjData) -> Float[np.ndarray, "v 3"]:
        """Both ends and all joints now [m]."""
        first = data.model.body("segment 0").id
        last = first + self.links - 1
        reach = self.cable.length / (2 * (self.links - 1))
        tip = data.xpos[last] + reach * data.xmat[last].reshape(3, 3)[:, 0]
        return np.vstack([data.xpos[first : last + 1], tip])

    def at(self, line: Float[np.ndarray, "v 3"], places: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
        """Points [m] of a line of this chain, from 0 to 1 along the cable."""
        return np.column_stack([np.interp(places, self.joints, column) for column in line.T])


def carried(frame: Float[np.ndarray, "4"], tangent: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4"]:
    """A frame turned the short way until its x axis is a unit tangent."""
    axis = rotations.rotate(frame, np.array(ALONG))
    between = np.concatenate([[1.0 + axis @ tangent], np.cross(axis, tangent)])
    return rotations.product(between / np.linalg.norm(between), frame)


def hinge_angles(turns: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 3"]:
    """Angles [rad] of the hinges of joints 1 to k, as `SpatialChain.add` orders them, that make these turns."""
    m = rotations.matrices(turns)
    first_y = np.arange(1, len(turns) + 1) % 2 == 1
    about_yz = np.arctan2(-m[:, 2, 0], m[:, 0, 0]), np.arcsin(m[:, 1, 0]), np.arctan2(-m[:, 1, 2], m[:, 1, 1])
    about_zy = np.arctan2(m[:, 1, 0], m[:, 0, 0]), np.arcsin(-m[:, 2, 0]), np.arctan2(m[:, 2, 1], m[:, 2, 2])
    return np.where(first_y[:, None], np.stack(about_yz, axis=1), np.stack(about_zy, axis=1))
