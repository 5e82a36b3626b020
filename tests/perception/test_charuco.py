"""Laws of calibration: a rendered board says where a camera is, with a lens that is not known."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.core.errors import InputError, UnknownNameError
from cableway.perception.charuco import Board, calibrate
from cableway.rendering.camera import Camera
from cableway.rendering.mesh import Mesh
from cableway.rendering.picture import Light, render

cv2 = pytest.importorskip("cv2")

BOARD = Board()
PLACE = (0.22, 0.43, 0.2)
CELLS = 6
"""Of a marker and its border, each way."""


def board_mesh(pose: np.ndarray) -> Mesh:
    """The board as squares of black and white, its frame at a pose (4, 4)."""
    drawn, fine = BOARD.in_opencv(), 30  # pixels of a square
    picture = drawn.generateImage((BOARD.across * fine, BOARD.down * fine), marginSize=0, borderBits=1)
    corners, colors = [], []
    step = BOARD.square / fine

    def rectangle(x, y, width, height, z, color):
        points = np.array([[x, y, z], [x + width, y, z], [x + width, y + height, z], [x, y + height, z]])
        points = points @ pose[:3, :3].T + pose[:3, 3]
        for triangle in ((0, 2, 1), (0, 3, 2)):  # seen from where the board's z axis comes from
            corners.append(points[list(triangle)])
            colors.append([color] * 3)

    edge = 0.6 * BOARD.square
    width, height = BOARD.across * BOARD.square, BOARD.down * BOARD.square
    rectangle(-edge, -edge, width + 2 * edge, height + 2 * edge, 2e-4, 1.0)
    for row, line in enumerate(picture):
        ends = np.flatnonzero(np.diff(np.concatenate([[0], (line < 128).astype(int), [0]])))
        for left, right in ends.reshape(-1, 2):
            rectangle(left * step, row * step, (right - left) * step, step, 0.0, 0.05)
    corners = np.array(corners)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.repeat((normals / np.linalg.norm(normals, axis=1, keepdims=True))[:, None], 3, axis=1)
    return Mesh(corners, normals, np.array(colors), np.ones(len(corners), np.int32))


def lying() -> np.ndarray:
    """The board's frame on the table, z into it."""
    x, y, angle = PLACE
    c, s = np.cos(angle), np.sin(angle)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = [[c, s, 0], [s, -c, 0], [0, 0, -1]], [x, y, 0]
    return pose


def photographs() -> tuple[Camera, list[np.ndarray], np.ndarray]:
    camera = Camera.looking(np.array([0.3, -0.35, 0.75]), np.array([0.0, 0.75, -0.75]), size=(640, 480), view=0.6)
    light, rng, images = Light(position=(0.3, -0.2, 3.0), ambient=0.7, shadows=0), np.random.default_rng(0), []
    middle = np.array([BOARD.across, BOARD.down, 0]) * BOARD.square / 2
    for k in range(9):
        pose = lying()
        if k < 8:  # shown to the camera, slanted to all sides, a part of the way to it
            tilt = cv2.Rodrigues(0.5 * np.array([np.cos(k * 0.8), np.sin(k * 0.8), 0.3]))[0]
            pose[:3, :3] = camera.pose[:3, :3] @ tilt
            pose[:3, 3] = camera.pose[:3, 3] + camera.pose[:3, :3] @ np.array(
                [0.06 * np.sin(2.1 * k), 0.05 * np.cos(1.7 * k), 0.42 + 0.03 * k]
            ) - pose[:3, :3] @ middle  # fmt: skip
        image = render(board_mesh(pose), camera, light, samples=3, background=(0.6, 0.6, 0.6)).color.astype(float)
        image = cv2.GaussianBlur(image, (0, 0), 0.7) + 2.0 * rng.standard_normal(image.shape)
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    return camera, images[:8], images[8]


@pytest.fixture(scope="module")
def taken():
    return photographs()


def test_a_camera_is_found_to_a_millimetre_and_a_fifth_of_a_degree(taken):
    camera, images, on_table = taken
    found = calibrate(images, on_table, BOARD, PLACE)
    assert found.pictures >= 7
    assert max(found.lens_residual, found.table_residual) < 0.3
    turn = found.camera.pinhole.pose[:3, :3].T @ camera.pose[:3, :3]
    assert np.degrees(np.linalg.norm(cv2.Rodrigues(turn)[0])) < 0.2
    spots = np.array([[x, y, 0.0] for x in (0.15, 0.3, 0.45) for y in (0.25, 0.4, 0.55)])
    on_it = found.camera.on_plane(camera.project(spots)[0], 0.0)
    assert np.linalg.norm(on_it - spots[:, :2], axis=1).max() < 0.001


def test_pictures_without_a_board_are_refused(taken):
    _, images, on_table = taken
    empty = np.full_like(on_table, 128)
    with pytest.raises(InputError, match="on the table shows fewer"):
        calibrate(images, empty, BOARD, PLACE)
    with pytest.raises(InputError, match="1 of 3 pictures"):
        calibrate([empty, empty], on_table, BOARD, PLACE)
    with pytest.raises(InputError, match="one size"):
        calibrate(images, on_table[:-1], BOARD, PLACE)


def test_boards_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="smaller than a square"):
        Board(marker=0.04)
    with pytest.raises(UnknownNameError, match="DICT_4X4_50"):
        Board(dictionary="DICT_5").in_opencv()
