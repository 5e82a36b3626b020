"""What stands in a cell as triangles: table, obstacles, cable, grippers and arms."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.geometry import polyline
from cableway.rendering.markers import bands
from cableway.rendering.mesh import Mesh, Surface, capsules, circle, prism, tube
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.arm_models import ArmModel
from cableway.scene.bodies import Body
from cableway.scene.cell import Cell, Way
from cableway.scene.obstacles import Disc, Obstacle
from cableway.scene.task import Draft, Task

Color = tuple[float, float, float]
"""sRGB from 0 to 1."""


class Capsules(NamedTuple):
    """Links of an arm.

    Attributes:
        ends: Of their segments [m].
        radii: By which these are grown [m].
    """

    ends: Float[np.ndarray, "k 2 3"]
    radii: Float[np.ndarray, "k"]


class Label(IntEnum):
    """What is seen at a pixel; pedestals belong to the table."""

    NOTHING = 0
    TABLE = 1
    WALL = 2
    OBSTACLE = 3
    CABLE = 4
    LEFT_GRIPPER = 5
    RIGHT_GRIPPER = 6
    LEFT_ARM = 7
    RIGHT_ARM = 8
    STRANGER = 9


GRIPPERS, ARMS = (Label.LEFT_GRIPPER, Label.RIGHT_GRIPPER), (Label.LEFT_ARM, Label.RIGHT_ARM)
"""By the end of the cable that they hold."""


class Look(NamedTuple):
    """Colours.

    Attributes:
        table: Of its top, and of the pedestals.
        wall: Of the edge of the workspace.
        obstacle: Of all.
        cable: The cable.
        grippers: That at the left end of the cable, and at its right one.
        joints: Of an arm, the same.
        links: Of both arms, the tubes between their joints.
        marker: Of bands about the inner keypoints of the cable; None where it has none.
    """

    table: Color
    wall: Color
    obstacle: Color
    cable: Color
    grippers: tuple[Color, Color]
    joints: tuple[Color, Color]
    links: Color
    marker: Color | None = None


TOP = 0.03
"""Thickness of the table [m]."""

AROUND = 0.08
"""Of the table beyond workspace and pedestals [m]."""

PEDESTAL = 0.009
"""By how much the radius of what an arm stands on is more than that of its base [m]."""

WALL = 0.006
"""Width of the walls [m], outside the workspace."""

STEEP = 0.85
"""How far a camera looks down for each metre ahead [m]: over the fingers, and not onto the arms."""

LONG = 0.2
"""Length of a capsule [m] from which on it is a tube between joints."""

UNLIMITED = 0.1
"""Height at which obstacles are shown that nothing passes above [m]."""

FLUSH = 0.004
"""The same of walls [m], which would hide what is within them."""

DISC = 0.03
"""Height of grippers and plugs that state none [m]."""


class CellScene:
    """A task as triangles: what stands still once, the rest for each state.

    The port of a task is not shown.

    Args:
        task: The task.
        way: How the arms of its cell hold the cable; None where there are no arms.
        look: Colours.

    Attributes:
        still: What does not move: table, walls, obstacles, pedestals.
    """

    def __init__(self, task: Task, way: Way | None, look: Look) -> None:
        self._task, self._look = task, look
        self._kinematics = None if way is None else CellKinematics(task, way)
        self.still = Mesh.joined(self._still())

    def mesh(
        self,
        cable: Float[np.ndarray, "m 2"],
        *,
        poses: Float[np.ndarray, "2 3"] | None = None,
        joints: Float[np.ndarray, "2 6"] | None = None,
    ) -> Mesh:
        """All of it in one state.

        Args:
            cable: Its centre line [m], which lies on the table.
            poses: Of the grippers [m, m, rad], where no arms carry them.
            joints: Of the arms at the left and the right end [rad], with which their grippers are shown.

        Raises:
            InputError: All points of the cable are in one place.
        """
        return Mesh.joined([self.still, *self._moving(cable, poses, joints)])

    def bounds(self, joints: Float[np.ndarray, "t 2 6"]) -> Float[np.ndarray, "k 3"]:
        """Points [m] between which all of it is while the arms are at joint positions [rad]."""
        points = [self.still.corners.reshape(-1, 3)]
        for ends, radii in [] if self._kinematics is None else self._kinematics.links(joints):
            reach = radii[None, :, None, None]
            points += [np.concatenate([ends - reach, ends + reach]).reshape(-1, 3)]
        return np.concatenate(points)

    def _moving(
        self,
        cable: Float[np.ndarray, "m 2"],
        poses: Float[np.ndarray, "2 3"] | None,
        joints: Float[np.ndarray, "2 6"] | None,
    ) -> Iterator[Mesh]:
        radius = self._task.cable.radius
        cable = polyline.remove_repeated(cable)
        if len(cable) < 2:
            raise InputError("the cable has no length")
        line = np.column_stack([cable, np.full(len(cable), radius)])
        yield tube(line, radius).painted(self._look.cable, Label.CABLE)
        if self._look.marker is not None:
            for band in bands(line, radius, self._task.cable.keypoints):
                yield band.painted(self._look.marker, Label.CABLE)
        if joints is not None and self._kinematics is not None:
            poses = self._kinematics.poses(joints)
            yield from self._arms(self._kinematics, joints)
        if poses is None:
            return
        for body in shown_bodies(self._task):
            yield body_surface(body, poses[body.side]).painted(self._look.grippers[body.side], GRIPPERS[body.side])

    def _arms(self, kinematics: CellKinematics, joints: Float[np.ndarray, "2 6"]) -> Iterator[Mesh]:
        for side, (tubes, others) in enumerate(arm_capsules(self._task, kinematics, joints)):
            yield capsules(*tubes).painted(self._look.links, ARMS[side])
            yield capsules(*others).painted(self._look.joints[side], ARMS[side])

    def _still(self) -> Iterator[Mesh]:
        scene, look = self._task.scene, self._look
        yield prism(self._table(), (-TOP, 0.0)).painted(look.table, Label.TABLE)
        wall = FLUSH if scene.wall_height is None else min(scene.wall_height, FLUSH)
        for outline in _frame(*scene.size):
            yield prism(outline, (0.0, wall)).painted(look.wall, Label.WALL)
        for obstacle in scene.obstacles:
            height = UNLIMITED if obstacle.height is None else obstacle.height
            yield _upright(obstacle, height).painted(look.obstacle, Label.OBSTACLE)
        for (x, y, z), radius in self._feet():
            if z > 0:
                foot = prism(circle((x, y), radius, 64), (0.0, z), rounded=True)
                yield foot.painted(look.table, Label.TABLE)

    def _feet(self) -> list[tuple[Float[np.ndarray, "3"], float]]:
        return [] if self._kinematics is None else feet(self._task)

    def _table(self) -> Float[np.ndarray, "4 2"]:
        """Corners of the table [m]."""
        feet = [at[:2] + side * radius for at, radius in self._feet() for side in (-1.0, 1.0)]
        points = np.vstack([np.zeros(2), self._task.scene.size, *feet])
        (left, low), (right, high) = points.min(axis=0) - AROUND, points.max(axis=0) + AROUND
        return _box(left, low, right, high)


def shown_bodies(task: Draft) -> list[Body]:
    """What is shown of grippers and plug: not the discs of hands that have more."""
    pieces = task.grippers.pieces
    return [body for body in task.bodies if not pieces or len(body.outline) > 1]


def body_surface(body: Body, pose: Float[np.ndarray, "3"]) -> Surface:
    """A body of a gripper at its pose [m, m, rad]."""
    low, high = body.heights
    heights = (low if math.isfinite(low) else 0.0, high if math.isfinite(high) else DISC)
    if len(body.outline) == 1:
        return prism(circle((float(pose[0]), float(pose[1])), body.rounding), heights, rounded=True)
    return prism(body.placed(pose)[:-1], heights)


def arm_capsules(
    task: Task, kinematics: CellKinematics, joints: Float[np.ndarray, "2 6"]
) -> list[tuple[Capsules, Capsules]]:
    """Tubes and other links of the arms at the left and the right end, without their tools, at joints [rad]."""
    assert task.cell is not None
    found = []
    for side, (ends, radii) in enumerate(kinematics.links(joints[None])):
        count = len(task.cell.models[kinematics.way.holders[side]].capsules)  # those of the tool come after
        ends, radii = ends[0, :count], radii[:count]
        tubes = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > LONG
        found.append((Capsules(ends[tubes], radii[tubes]), Capsules(ends[~tubes], radii[~tubes])))
    return found


def feet(task: Draft) -> list[tuple[Float[np.ndarray, "3"], float]]:
    """Where the arms of a task's cell stand, and the radius of what they stand on [m]."""
    if (cell := task.cell) is None:
        return []
    bases = (arm.base(task.scene)[:3, 3] for arm in cell.arms)
    return [(at, _base_radius(model) + PEDESTAL) for at, model in zip(bases, cell.models, strict=True)]


def view_direction(task: Draft, cell: Cell) -> Float[np.ndarray, "3"]:
    """Across the line from one arm to the other and down, from the side of the lower edge of the workspace."""
    first, second = (arm.base(task.scene)[:2, 3] for arm in cell.arms)
    along = second - first
    length = float(np.linalg.norm(along))
    ahead = np.array([-along[1], along[0]]) / length if length > 0 else np.array([0.0, 1.0])
    return np.append(ahead if ahead[1] >= 0 else -ahead, -STEEP)


def _base_radius(model: ArmModel) -> float:
    """Of what holds the base of an arm [m]."""
    return max(capsule.radius for capsule in model.capsules if capsule.frame == 0)


def _box(left: float, low: float, right: float, high: float) -> Float[np.ndarray, "4 2"]:
    return np.array([[left, low], [right, low], [right, high], [left, high]])


def _frame(width: float, height: float) -> list[Float[np.ndarray, "4 2"]]:
    """The walls of a workspace."""
    return [
        _box(-WALL, -WALL, width + WALL, 0.0),
        _box(-WALL, height, width + WALL, height + WALL),
        _box(-WALL, 0.0, 0.0, height),
        _box(width, 0.0, width + WALL, height),
    ]


def _upright(obstacle: Obstacle, height: float) -> Surface:
    if isinstance(obstacle, Disc):
        return prism(circle(obstacle.center, obstacle.radius, 64), (0.0, height), rounded=True)
    return prism(obstacle.vertices, (0.0, height))
