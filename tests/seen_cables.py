"""A cable between two grippers, one that is not the nominal one, and a camera above them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cableway.perception.calibration import CalibratedCamera
from cableway.rendering.camera import Camera
from cableway.rod.inverse import meet_poses, shape_between
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable

CABLE = Cable()
POSES = np.array([[0.2, 0.3, 0.5], [0.42, 0.3, -0.5]])
NOMINAL = shape_between(CABLE.rod, POSES, "left")
ABOVE = CalibratedCamera(
    pinhole=Camera.looking(np.array([0.31, 0.35, 0.9]), np.array([0.0, 0.0, -1.0]), size=(640, 480), view=0.7)
)


def true_cable(modes: tuple[float, ...] = (0.4, -0.3, 0.0, 0.0, 0.5, -0.4, 0.0, 0.0)) -> tuple[PlanarRod, np.ndarray]:
    """Another cable between the same grippers, and its stations [m]."""
    rod = replace(CABLE.rod, length=1.01 * CABLE.length, modes=modes)
    q = meet_poses(rod, POSES, NOMINAL[None])[0]
    return rod, rod.shapes(q[None])[0][0]
