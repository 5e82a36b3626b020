"""Laws of calibrated cameras: undistortion undoes the lens, and points of the table come back."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.perception.calibration import CalibratedCamera
from cableway.rendering.camera import Camera

LENS = (-0.28, 0.09, 0.0012, -0.0008, -0.01)
"""Of a common wide lens."""

SLANTED = Camera.looking(np.array([0.2, -0.6, 0.9]), np.array([0.1, 1.0, -0.9]), size=(640, 480), view=0.9)


def pixels(camera: Camera, count: int = 23) -> np.ndarray:
    """A grid over the picture, to its edges."""
    width, height = camera.size
    grid = np.meshgrid(np.linspace(-0.5, width - 0.5, count), np.linspace(-0.5, height - 0.5, count))
    return np.stack(grid, axis=-1)


@pytest.mark.parametrize("distortion", [(0.0,) * 5, LENS, (0.2, -0.1, -0.002, 0.001, 0.02)])
def test_what_lies_on_a_plane_is_seen_where_it_was_looked_for(distortion: tuple):
    camera = CalibratedCamera(pinhole=SLANTED, distortion=distortion)
    wanted = pixels(SLANTED)
    points = camera.on_plane(wanted, 0.004)
    found, depth = camera.project(np.concatenate([points, np.full((*points.shape[:2], 1), 0.004)], axis=-1))
    assert (depth > 0).all()
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_distortion_is_that_of_its_definition():
    """Each coefficient by itself, at one ray."""
    plain = Camera(size=(640, 480), focal=(1.0, 1.0), center=(0.0, 0.0), pose=np.eye(4))
    x, y = 0.3, -0.2
    square = x * x + y * y
    expected = [
        (x * (1 + square), y * (1 + square)),
        (x * (1 + square**2), y * (1 + square**2)),
        (x + 2 * x * y, y + square + 2 * y * y),
        (x + square + 2 * x * x, y + 2 * x * y),
        (x * (1 + square**3), y * (1 + square**3)),
    ]
    for k, seen in enumerate(expected):
        camera = CalibratedCamera(pinhole=plain, distortion=tuple(np.eye(5)[k]))
        np.testing.assert_allclose(camera.project(np.array([x, y, 1.0]))[0], seen, rtol=1e-12)


def test_a_pixel_that_no_ray_reaches_has_none():
    """A lens with k1 < 0 sees nothing beyond the radius where its equation turns back."""
    camera = CalibratedCamera(pinhole=SLANTED, distortion=(-0.5, 0.0, 0.0, 0.0, 0.0))
    far = np.array([SLANTED.center[0] + 2.0 * SLANTED.focal[0], SLANTED.center[1]])
    assert np.isnan(camera.rays(far)).all()


def test_the_sky_is_on_no_table():
    level = Camera.looking(np.array([0.0, 0.0, 0.5]), np.array([0.0, 1.0, 0.0]), size=(64, 48), view=0.9)
    points = CalibratedCamera(pinhole=level).on_plane(
        np.array([[32.0, 5.0], [32.0, 23.5], [32.0, 24.5], [32.0, 43.0]]), 0.0
    )
    assert np.isfinite(points[:, 0]).tolist() == [False, False, False, True], "nor what is near the horizon"


def test_what_opencv_found_is_the_same_camera():
    """matrix [R | t] maps the world into the camera's frame."""
    camera = CalibratedCamera(pinhole=SLANTED, distortion=LENS)
    turn = SLANTED.pose[:3, :3].T
    (fx, fy), (cx, cy) = SLANTED.focal, SLANTED.center
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    found = CalibratedCamera.from_opencv(
        size=SLANTED.size,
        matrix=matrix,
        distortion=np.array(LENS),
        rotation=turn,
        translation=-turn @ SLANTED.pose[:3, 3],
    )
    point = np.array([0.3, 0.2, 0.01])
    np.testing.assert_allclose(found.project(point)[0], camera.project(point)[0], atol=1e-9)
    matrix[0, 1] = 2.0
    with pytest.raises(InputError, match="matrix of a camera"):
        CalibratedCamera.from_opencv(
            size=SLANTED.size, matrix=matrix, distortion=np.zeros(5), rotation=turn, translation=np.zeros(3)
        )


@pytest.mark.parametrize("distortion", [(0.1,) * 4, (np.nan, 0.0, 0.0, 0.0, 0.0)])
@pytest.mark.wrong_types
def test_other_coefficients_are_refused(distortion: tuple):
    with pytest.raises(InputError, match="distortion of a camera must be five finite numbers"):
        CalibratedCamera(pinhole=SLANTED, distortion=distortion)
