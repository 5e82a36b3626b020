"""A cell in perspective: what a plan or a rollout looks like from beside the table."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import UInt8
from matplotlib.colors import to_rgb

from cableway.core.errors import InputError
from cableway.figures import palette, scene
from cableway.records import Plan, Rollout
from cableway.rendering.camera import Camera
from cableway.rendering.cell import CellScene, Color, Label, Look, view_direction
from cableway.rendering.mesh import Mesh, tube
from cableway.rendering.picture import Light, render
from cableway.scene.cell import Way
from cableway.scene.task import Task

ARMS = (palette.BLUE, palette.ORANGE)
"""Of the arms that hold the left and the right end."""

VIEW = math.radians(32)
"""Angle of view across a picture."""

LAMP, AMBIENT = (-0.4, -0.9, 3.2), 0.62
"""Where the lamp is from the middle of the workspace [m], and the share of light from everywhere."""

WITHIN = 0.8
"""Radius of the goal over that of the cable, which so covers it where it has arrived."""


def pale(color: str, share: float) -> Color:
    """A share of a colour on white."""
    red, green, blue = (1 - share * (1 - part) for part in to_rgb(color))
    return red, green, blue


LOOK = Look(
    table=pale(palette.OBSTACLE, 0.3),
    wall=pale(palette.INK, 1.0),
    obstacle=pale(palette.OBSTACLE_EDGE, 0.85),
    cable=pale(palette.INK, 1.0),
    grippers=(pale(palette.MUTED, 0.9), pale(palette.MUTED, 0.9)),
    joints=(pale(ARMS[0], 0.7), pale(ARMS[1], 0.8)),
    links=pale(palette.OBSTACLE, 0.6),
)


class CellView:
    """Pictures of the rows of a record with joints, all by the same camera, which has both arms in view throughout.

    Args:
        task: The task, in a cell.
        record: Of it.
        size: Width and height [pixels].

    Raises:
        InputError: The task has no cell, or the record no joints.
    """

    def __init__(self, task: Task, record: Plan | Rollout, size: tuple[int, int]) -> None:
        way = way_of(task, record)
        if way is None or task.cell is None or record.joints is None:
            raise InputError(f"the task {task.name!r} has no cell, or the record has no joints of its arms")
        self._record, self._joints = record, record.joints
        self._scene = CellScene(task.as_recorded(record.metadata), way, LOOK)
        points = self._scene.bounds(self._joints)
        self._camera = Camera.framing(points, view_direction(task, task.cell), size=size, view=VIEW, margin=0.01)
        x, y, z = LAMP
        self._light = Light(position=(task.scene.size[0] / 2 + x, task.scene.size[1] / 2 + y, z), ambient=AMBIENT)
        goal, radius = scene.smooth(task.goal), WITHIN * task.cable.radius
        lying = np.column_stack([goal, np.full(len(goal), radius)])
        self._goal = tube(lying, radius).painted(pale(palette.GOAL, 0.9), Label.TABLE)

    def image(self, row: int) -> UInt8[np.ndarray, "h w 3"]:
        """The picture of a row, with the goal of the cable on the table."""
        record = self._record
        cable = scene.smooth(record.shapes[row]) if isinstance(record, Plan) else record.centreline[row]
        mesh = self._scene.mesh(cable, joints=self._joints[row])
        return render(Mesh.joined([mesh, self._goal]), self._camera, self._light, samples=3).color


def way_of(task: Task, record: Plan | Rollout) -> Way | None:
    """How the arms hold the cable in a record with their joints; None where there is no cell, or no joints.

    Raises:
        InputError: It has another number of keypoints than the task, or of joints than the cell's arms.
    """
    way = Way.of_record(record.metadata)
    if task.cell is None or record.joints is None or way is None:
        return None
    keypoints = (record.shapes if isinstance(record, Plan) else record.keypoints).shape[1]
    if keypoints != task.cable.keypoints:
        raise InputError(f"the record has {keypoints} keypoints, the task {task.cable.keypoints}")
    for arm in way.holders:
        joints = len(task.cell.models[arm].joint_names)
        if record.joints.shape[2] != joints:
            raise InputError(f"the record has {record.joints.shape[2]} joints of each arm, the arms have {joints}")
    return way
