"""What holds the cable on the table: hands, plug, and the arms of a cell."""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
from jaxtyping import Float, Int

from cableway.figures import palette
from cableway.geometry import se2
from cableway.records import Plan, Rollout
from cableway.rendering.cell import Capsules, arm_capsules, body_surface, feet, shown_bodies
from cableway.rendering.mesh import capsules
from cableway.robot.cell_kinematics import CellKinematics
from cableway.robot.spatial_arms import SpatialArms, SpatialWay
from cableway.scene.bodies import Body
from cableway.scene.cell import Way
from cableway.scene.spatial.task import SpatialDraft, SpatialTask
from cableway.scene.task import Draft, Task
from cableway.studio.view.canvas import Canvas
from cableway.studio.view.look import mixed
from cableway.studio.view.meshes import Mesh, circle, faceted, prism, shared, together

SIDES = (palette.LEFT, palette.RIGHT)

ROUND, RINGS = 14, 3
"""Sides of an arm's link, and rings of each of its round ends."""

OPACITY = 0.6
"""Of hands and arms: the cable shows below them."""

LEAST = 0.006
"""Radius [m] at which a gripper's disc is drawn at least."""


class Arms:
    """The arms of a plan or a rollout.

    Args:
        task: Its task.
        way: How they hold the cable.
    """

    def __init__(self, task: Task, way: Way) -> None:
        self._task, self._kinematics = task, CellKinematics(task, way)

    @classmethod
    def of(cls, task: Draft, record: Plan | Rollout | None) -> Arms | None:
        """Those of a record; None where it has none."""
        if record is None or record.joints is None or task.cell is None:
            return None
        way = Way.of_record(record.metadata)
        return None if way is None else cls(task.checked(), way)

    def draw(self, canvas: Canvas, name: str, joints: Float[np.ndarray, "2 6"]) -> None:
        """Draw them at joints [rad]."""
        both = arm_capsules(self._task, self._kinematics, joints)
        canvas.solid(f"{name}/tubes", together([links_mesh(tubes) for tubes, _ in both]), LINK, opacity=OPACITY)
        for side, (_, others) in enumerate(both):
            canvas.solid(f"{name}/arm{side}", links_mesh(others), SIDES[side], opacity=OPACITY)


class SpaceArms:
    """The same in space.

    Args:
        task: Its task.
        holders: Which of the cell's arms hold the left and the right end.
    """

    def __init__(self, task: SpatialTask, holders: tuple[int, int]) -> None:
        self._arms, self._holders = SpatialArms(task), holders

    @classmethod
    def of(cls, task: SpatialDraft, plan: Plan | None) -> SpaceArms | None:
        """Those of a plan; None where it has none."""
        if plan is None or plan.joints is None or task.cell is None:
            return None
        way = SpatialWay.of_record(plan.metadata)
        return None if way is None else cls(task.checked(), way.holders)

    def draw(self, canvas: Canvas, name: str, joints: Float[np.ndarray, "2 6"]) -> None:
        """Draw them at joints [rad]."""
        for side, links in enumerate(self._arms.links(joints, self._holders)):
            canvas.solid(f"{name}/arm{side}", links_mesh(Capsules(*links)), SIDES[side], opacity=OPACITY)


LINK = mixed(palette.OBSTACLE, 0.2)
"""Of the tubes between the joints of arms."""


def draw_feet(canvas: Canvas, draft: Draft) -> None:
    """What the arms stand on."""
    for number, ((x, y, z), radius) in enumerate(feet(draft)):
        if z > 0:
            canvas.solid(f"/feet/{number}", prism(circle(radius), 0.0, z), LINK, at=(float(x), float(y)))
    canvas.sweep("/feet")


def draw_hands(canvas: Canvas, name: str, draft: Draft, poses: Float[np.ndarray, "2 3"], top: float) -> None:
    """Hands and plug at gripper poses [m, m, rad]; a gripper that is a disc alone goes up to a height [m]."""
    for side, color in enumerate(SIDES):
        x, y, angle = (float(each) for each in poses[side])
        solid = [body for body in shown_bodies(draft) if body.side == side and len(body.outline) > 1]
        if len(solid) < len([body for body in shown_bodies(draft) if body.side == side]):
            disc = prism(circle(max(draft.grippers.radius, LEAST)), 0.0, top)
            canvas.solid(f"{name}/{side}", disc, color, at=(x, y))
        if solid:
            bodies = _bodies(tuple(solid))
            canvas.solid(f"{name}/hand{side}", bodies, color, at=(x, y), angle=angle, opacity=OPACITY)


def outlines(draft: Draft, poses: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "k 2 3"]:
    """Outlines [m] on the table of hands and plug at gripper poses [m, m, rad]."""
    found = [np.zeros((0, 2, 3))]
    for body in draft.outer_bodies:
        if len(body.outline) > 1:
            corners = se2.transform(body.outline, poses[body.side, :2], float(poses[body.side, 2]))
            flat = np.column_stack([corners, np.full(len(corners), 0.002)])
            found.append(np.stack([flat, np.roll(flat, -1, axis=0)], axis=1))
    return np.concatenate(found)


@lru_cache(maxsize=16)
def _bodies(bodies: tuple[Body, ...]) -> Mesh:
    """Bodies in their frame."""
    return together([faceted(body_surface(body, np.zeros(3))) for body in bodies])


def links_mesh(links: Capsules) -> Mesh:
    """Links of arms; as many have the same triangles."""
    first, faces = _link_faces(len(links.ends))
    return Mesh(capsules(*links, ROUND, RINGS).corners.reshape(-1, 3)[first], faces)


@cache
def _link_faces(count: int) -> tuple[Int[np.ndarray, "v"], Int[np.ndarray, "f 3"]]:
    """Which corners of so many capsules are the first in their place, and the triangles by these."""
    one = capsules(np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]), np.array([0.1]), ROUND, RINGS)
    first, faces = shared(one.corners.reshape(-1, 3))
    each = np.arange(count)
    return (
        (first + 3 * len(faces) * each[:, None]).ravel(),
        (faces + len(first) * each[:, None, None]).reshape(-1, 3),
    )
