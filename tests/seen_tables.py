"""A table with things on it, as cameras around it see it: small pictures, true depths."""

from __future__ import annotations

import numpy as np

from cableway.perception.calibration import CalibratedCamera
from cableway.perception.depth import DepthView
from cableway.perception.placement import camera_at
from cableway.perception.survey import depth_view
from cableway.rendering.cell import Label
from cableway.rendering.depth_sensor import DepthSensor, measured
from cableway.rendering.mesh import Mesh, circle, prism, tube
from cableway.rendering.picture import Light, Picture, render
from cableway.scene.obstacles import Disc, Obstacle

SIZE, PICTURE = (0.7, 0.7), (320, 240)
TABLE = prism(np.array([[-0.1, -0.1], [0.8, -0.1], [0.8, 0.8], [-0.1, 0.8]]), (-0.02, 0.0))
CABLE = np.column_stack([np.linspace(0.1, 0.4, 20), np.full(20, 0.1)])


def standing(*obstacles: Obstacle, color: tuple[float, float, float] = (0.4, 0.4, 0.5)) -> Mesh:
    """A table with a cable and obstacles as high as they say."""
    parts = [TABLE.painted((0.88, 0.88, 0.88), Label.TABLE)]
    parts.append(tube(np.column_stack([CABLE, np.full(20, 0.004)]), 0.004).painted((0.85, 0.35, 0.05), Label.CABLE))
    for each in obstacles:
        assert each.height is not None
        outline = circle(each.center, each.radius, 64) if isinstance(each, Disc) else each.vertices
        parts.append(prism(outline, (0.0, each.height)).painted(color, Label.OBSTACLE))
    return Mesh.joined(parts)


def pictured(mesh: Mesh, camera: CalibratedCamera) -> Picture:
    """Colours, depths and labels."""
    return render(mesh, camera.pinhole, Light(position=(0.35, 0.0, 3.0), shadows=0))


def seen(mesh: Mesh, *places: str, sensor: DepthSensor | None = None) -> list[DepthView]:
    """What cameras at some places show, by true depths or those of a sensor."""
    views, rng = [], np.random.default_rng(0)
    for place in places:
        camera = camera_at(place, SIZE, PICTURE)
        shown = pictured(mesh, camera)
        depth = np.where(np.isfinite(shown.depth), shown.depth, 0.0)
        if sensor is not None:
            depth = measured(shown.depth, camera.pinhole.focal[0], sensor, rng)
        views.append(depth_view(camera, depth, shown.label == Label.CABLE))
    return views
