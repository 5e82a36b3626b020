"""What stands in a scene in space as triangles: the table, obstacles, cables and what holds them."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from cableway.geometry.spatial_convex import Solid
from cableway.geometry.spatial_convex_kernels import EXTRUDED, SPHERE
from cableway.rendering.mesh import Mesh, Surface, capsules, circle, flat_normals, prism, tube
from cableway.scene.spatial.grippers import SpatialBody
from cableway.scene.spatial.scene import SpatialScene

Color = tuple[float, float, float]

TABLE, OBSTACLE, CABLE, GRIPPER = 1, 2, 3, 4
"""Labels of what is seen."""

DIRECTION = (0.42, 0.8, -0.5)
"""In which a camera looks: over the front wall, from the left and from above."""

TOP = 0.01
"""Thickness of the table [m]."""


def scene_mesh(scene: SpatialScene, table: Color, obstacle: Color) -> Mesh:
    """The table as large as the workspace, and the obstacles; endless ones end at the ceiling."""
    x, y, z = scene.size
    top = prism(np.array([[0.0, 0.0], [x, 0.0], [x, y], [0.0, y]]), (-TOP, 0.0)).painted(table, TABLE)
    solids = [surface_of(solid, z).painted(obstacle, OBSTACLE) for solid in scene.world.solids]
    return Mesh.joined([top, *solids])


def cable_mesh(stations: Float[np.ndarray, "s 3"], radius: float, color: Color) -> Mesh:
    """A cable."""
    return tube(stations, radius).painted(color, CABLE)


def body_mesh(body: SpatialBody, pose: Float[np.ndarray, "7"], color: Color) -> Mesh:
    """A piece of a gripper at a pose; a hull without the radius by which it is grown."""
    return surface_of(body.solid(pose), math.inf).painted(color, GRIPPER)


def surface_of(solid: Solid, ceiling: float) -> Surface:
    """The surface of a solid; one of unlimited height from the table to the ceiling [m]."""
    if solid.kind == SPHERE:
        return capsules(np.stack([solid.centre, solid.centre])[None], np.array([solid.rounding]))
    if solid.kind != EXTRUDED:
        return Surface(solid.triangles, flat_normals(solid.triangles))
    round_one = len(solid.section) == 1
    outline = circle((0.0, 0.0), solid.rounding) + solid.section if round_one else _grown(solid.section, solid.rounding)
    endless = not math.isfinite(solid.half)
    heights = (0.0, ceiling) if endless else (-solid.half, solid.half)
    raised = prism(outline, heights, rounded=round_one)
    return Surface(raised.corners @ solid.axes + solid.centre, raised.normals @ solid.axes)


def _grown(section: Float[np.ndarray, "k 2"], rounding: float) -> Float[np.ndarray, "m 2"]:
    """A convex polygon grown with round corners, counter-clockwise."""
    if not rounding:
        return section
    from scipy.spatial import ConvexHull  # here, since pictures of the plane are drawn without it

    points = np.concatenate([circle((float(x), float(y)), rounding) for x, y in section])
    return points[ConvexHull(points).vertices]
