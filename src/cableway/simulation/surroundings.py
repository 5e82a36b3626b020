"""What MuJoCo models have in common: obstacles, walls, grippers, turns about the vertical, and where warnings go."""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.geometry.convex import WALLS
from cableway.scene.obstacles import Box, Disc, Obstacle
from cableway.scene.scene import Scene

CABLE, SURROUNDINGS, SOLID, ARMS = 1, 2, 4, (8, 16)
"""Bits of the collision masks of models in space: the cable, what it meets, what arms meet besides, and each arm."""

CONTACT = {"solref": [0.005, 1.0], "solimp": [0.99, 0.999, 0.001, 0.5, 2.0]}
"""Stiffness of contacts in space: a time constant of two time steps. A cable pressed with 0.1 N gives way by less than
1 mm."""


def add_scene(
    spec: mujoco.MjSpec, scene: Scene, heights: Sequence[tuple[float, float]], disc: mujoco.mjtGeom, **surface: Any
) -> None:
    """Obstacles, each from the one of its heights [m] to the other, and walls, which are half spaces.

    Args:
        spec: The model.
        scene: Obstacles and workspace.
        heights: Of the lower and the upper face of each obstacle.
        disc: A disc is a sphere about the middle height or a cylinder.
        surface: How all of these meet the cable.
    """
    for index, (obstacle, faces) in enumerate(zip(scene.obstacles, heights, strict=True)):
        add_obstacle(spec, obstacle, faces, disc, name=f"obstacle {index}", **surface)
    corner = [*scene.size, 0.0]
    inward = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0])
    for name, point, normal in zip(WALLS, ([0.0] * 3, [0.0] * 3, corner, corner), inward, strict=True):
        add_plane(spec, point, normal, name=name, **surface)


def add_plane(spec: mujoco.MjSpec, point: list[float], normal: list[float], **surface: Any) -> None:
    """A half space."""
    kind, size = mujoco.mjtGeom.mjGEOM_PLANE, [1.0, 1.0, 1.0]
    spec.worldbody.add_geom(type=kind, pos=point, zaxis=normal, size=size, **surface)


def add_obstacle(
    spec: mujoco.MjSpec, obstacle: Obstacle, heights: tuple[float, float], disc: mujoco.mjtGeom, **surface: Any
) -> None:
    """An obstacle from one height [m] to another; see `add_scene`."""
    middle, half = (heights[0] + heights[1]) / 2, (heights[1] - heights[0]) / 2
    match obstacle:
        case Disc():
            size = [obstacle.radius, half, 0.0]
            spec.worldbody.add_geom(type=disc, pos=[*obstacle.center, middle], size=size, **surface)
        case Box():
            size, quat = [obstacle.size[0] / 2, obstacle.size[1] / 2, half], turned(np.array(obstacle.angle)).tolist()
            kind, at = mujoco.mjtGeom.mjGEOM_BOX, [*obstacle.center, middle]
            spec.worldbody.add_geom(type=kind, pos=at, quat=quat, size=size, **surface)
        case _:
            add_prism(spec, spec.worldbody, obstacle.vertices, heights, **surface)


def add_prism(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    outline: Float[np.ndarray, "k 2"],
    heights: tuple[float, float],
    **surface: Any,
) -> None:
    """A convex outline [m] between two heights [m], in the frame of a body."""
    add_hull(spec, body, np.array([[*vertex, height] for height in heights for vertex in outline]), **surface)


def add_hull(spec: mujoco.MjSpec, body: mujoco.MjsBody, points: Float[np.ndarray, "k 3"], **surface: Any) -> None:
    """The convex hull of points [m] in the frame of a body."""
    spec.add_mesh(name=surface["name"], uservert=np.ravel(points).tolist())
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=surface["name"], **surface)


def add_free_gripper(spec: mujoco.MjSpec, name: str) -> None:
    """A body without dynamics."""
    spec.worldbody.add_body(name=f"{name} gripper", mocap=True)


def hold(spec: mujoco.MjSpec, name: str, body: str, along: float, **weld: Any) -> None:
    """Weld a gripper to a point so far [m] along another body."""
    kind, bodies = mujoco.mjtEq.mjEQ_WELD, mujoco.mjtObj.mjOBJ_BODY
    held = spec.add_equality(name=name, type=kind, objtype=bodies, name1=body, name2=f"{name} gripper", **weld)
    # anchor in the gripper, then position and quaternion of the gripper in the body, torque scale
    held.data = [0.0, 0.0, 0.0, along, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]


def add_clip(spec: mujoco.MjSpec, name: str, body: str, **weld: Any) -> None:
    """What can hold a body to the table where it is; open at first."""
    kind, bodies = mujoco.mjtEq.mjEQ_WELD, mujoco.mjtObj.mjOBJ_BODY
    spec.add_equality(name=name, type=kind, objtype=bodies, name1=body, name2="world", active=False, **weld)


def close_clip(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> None:
    """Let a clip hold its body where it is now."""
    index = model.equality(name).id
    body, turn = model.eq_obj1id[index], np.empty(4)
    mujoco.mju_negQuat(turn, data.xquat[body])
    model.eq_data[index, :10] = [*data.xpos[body], 0.0, 0.0, 0.0, *turn]  # where in the world, in the body, turned
    data.eq_active[index] = True


def gripper_bodies(
    poses: Float[np.ndarray, "... 2 3"], height: float = 0.0
) -> tuple[Float[np.ndarray, "... 2 3"], Float[np.ndarray, "... 2 4"]]:
    """Positions [m] and quaternions of the grippers' bodies."""
    positions = np.array(poses, dtype=float)
    positions[..., 2] = height
    return positions, turned(poses[..., 2])


def turned(angles: Float[np.ndarray, "..."]) -> Float[np.ndarray, "... 4"]:
    """Quaternions of turns about the vertical."""
    half, zero = angles / 2, np.zeros_like(angles)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """MuJoCo's warnings as a list, where it would otherwise write them to a file in the working directory."""
    messages: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    try:
        yield messages
    finally:
        mujoco.set_mju_user_warning(before)
