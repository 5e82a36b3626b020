"""Laws of calibration: a rendered board, on the table or in a gripper, says where a camera of an unknown lens is."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cableway.cli import main
from cableway.core.errors import InputError, UnknownNameError
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.calibration_file import load_camera
from cableway.perception.capture import sharpest
from cableway.perception.charuco import Board, Corners, Lens, corners_of, pose_of
from cableway.perception.hand_eye import hand_eye
from cableway.perception.lying import first_of_plane
from cableway.perception.table_pose import calibrate
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


def photographs() -> tuple[Camera, list[np.ndarray], np.ndarray, np.ndarray]:
    """The camera, pictures of the board in the air, the one on the table, and where the board was in the air."""
    camera = Camera.looking(np.array([0.3, -0.35, 0.75]), np.array([0.0, 0.75, -0.75]), size=(640, 480), view=0.6)
    light, rng, images = Light(position=(0.3, -0.2, 3.0), ambient=0.7, shadows=0), np.random.default_rng(0), []
    poses, middle = [], np.array([BOARD.across, BOARD.down, 0]) * BOARD.square / 2
    for k in range(9):
        pose = lying()
        if k < 8:  # shown to the camera, slanted to all sides, a part of the way to it
            tilt = cv2.Rodrigues(0.5 * np.array([np.cos(k * 0.8), np.sin(k * 0.8), 0.3]))[0]
            pose[:3, :3] = camera.pose[:3, :3] @ tilt
            pose[:3, 3] = camera.pose[:3, 3] + camera.pose[:3, :3] @ np.array(
                [0.06 * np.sin(2.1 * k), 0.05 * np.cos(1.7 * k), 0.42 + 0.03 * k]
            ) - pose[:3, :3] @ middle  # fmt: skip
        poses.append(pose)
        image = render(board_mesh(pose), camera, light, samples=3, background=(0.6, 0.6, 0.6)).color.astype(float)
        image = cv2.GaussianBlur(image, (0, 0), 0.7) + 2.0 * rng.standard_normal(image.shape)
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    return camera, images[:8], images[8], np.array(poses[:8])


@pytest.fixture(scope="module")
def taken():
    return photographs()


def test_a_camera_is_found_to_a_millimetre_and_a_fifth_of_a_degree(taken):
    camera, images, on_table, _ = taken
    found = calibrate(images, [on_table], BOARD, PLACE)
    assert found.pictures >= 7
    assert max(found.lens_residual, found.table_residual) < 0.3
    assert_found(found.camera, camera)


def by_itself(lens: Lens, corners: Corners) -> np.ndarray:
    """The pose of a board by one picture alone."""
    _, turn, at = cv2.solvePnP(*corners, lens.matrix, lens.distortion)
    return pose_of(turn.ravel(), at.ravel())


def tilted(found: np.ndarray, true: np.ndarray) -> float:
    """Angle between the normals of two planes [rad]."""
    return float(np.arccos(np.clip(found[:3, 2] @ true[:3, 2], -1.0, 1.0)))


def test_boards_slid_about_on_a_table_tell_how_it_is_tilted_and_the_first_where_it_is():
    """Corners are off by 0.1 pixels, and one of them, on each board, by 5."""
    rng, points = np.random.default_rng(0), np.array([[x, y, 0.0] for x in range(1, 7) for y in range(1, 5)]) * 0.03
    lens = Lens(
        np.array([[900.0, 0.0, 320.0], [0.0, 900.0, 240.0], [0.0, 0.0, 1.0]]), np.zeros(5), 0.0, np.eye(4)[None]
    )
    first = np.eye(4)
    first[:3, :3], first[:3, 3] = cv2.Rodrigues(np.array([0.1, -0.05, 0.4]))[0], [-0.1, -0.1, 1.5]

    def seen(x: float, y: float, angle: float) -> Corners:
        within = np.eye(4)
        within[:3, :3], within[:3, 3] = cv2.Rodrigues(np.array([0.0, 0.0, angle]))[0], [x, y, 0.0]
        pixels = lens.shown(points, first @ within) + 0.1 * rng.standard_normal((len(points), 2))
        pixels[int(rng.integers(len(points)))] += 5.0
        return Corners(points.astype(np.float32), pixels.astype(np.float32))

    lying = [seen(0.0, 0.0, 0.0), *(seen(*rng.uniform(-0.3, 0.3, 2), rng.uniform(-3, 3)) for _ in range(8))]
    begun = np.array([by_itself(lens, corners) for corners in lying])
    alone, residual = first_of_plane(lens, lying[:1], begun[:1])
    found, _ = first_of_plane(lens, lying, begun)
    assert tilted(found, first) < np.radians(0.1)
    assert tilted(found, first) < tilted(alone, first) / 3
    assert np.linalg.norm(found[:3, 3] - first[:3, 3]) < 0.001
    assert residual == pytest.approx(np.sqrt(2 * 0.1**2 + 2 * 5.0**2 / len(points)), rel=0.1)


@pytest.mark.parametrize(("share", "most"), [(1.0, 0.06), (0.3, 0.12)])
def test_corners_are_found_where_they_are_also_small_ones(taken, share, most):
    camera, images, _, boards = taken
    off = []
    for image, pose in zip(images, boards, strict=True):
        small = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        (found,), _ = corners_of(BOARD, [small])
        assert found is not None
        pixels = camera.project(found.points @ pose[:3, :3].T + pose[:3, 3])[0]
        off.append(found.pixels - ((pixels + 0.5) * share - 0.5))
    off = np.concatenate(off)
    assert np.abs(off.mean(axis=0)).max() < 0.03
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < most


def off_on_table(found: CalibratedCamera, camera: Camera) -> float:
    """How far spots on the table seem to be from where they are [m], the worst."""
    spots = np.array([[x, y, 0.0] for x in (0.15, 0.3, 0.45) for y in (0.25, 0.4, 0.55)])
    return float(np.linalg.norm(found.on_plane(camera.project(spots)[0], 0.0) - spots[:, :2], axis=1).max())


def assert_found(found: CalibratedCamera, camera: Camera) -> None:
    """Within a fifth of a degree, and spots on the table within a millimetre."""
    turn = found.pinhole.pose[:3, :3].T @ camera.pose[:3, :3]
    assert np.degrees(np.linalg.norm(cv2.Rodrigues(turn)[0])) < 0.2
    assert off_on_table(found, camera) < 0.001


def test_of_a_film_the_sharpest_pictures_count(taken, tmp_path, capsys):
    """Each picture is followed by two that are blurred; the film is compressed."""
    camera, images, on_table, _ = taken
    film = cv2.VideoWriter(str(tmp_path / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (640, 480))  # type: ignore[attr-defined]
    for image in images:
        for blur in (0.01, 4.0, 8.0):
            film.write(cv2.GaussianBlur(image[..., ::-1], (0, 0), blur))
    film.release()
    assert len(sharpest(str(tmp_path / "film.avi"), 100)) == 3 * len(images)
    found = sharpest(str(tmp_path / "film.avi"), len(images))
    assert max(np.abs(a.astype(float) - b).mean() for a, b in zip(found, images, strict=True)) < 3.0
    cv2.imwrite(str(tmp_path / "table.png"), cv2.cvtColor(on_table, cv2.COLOR_RGB2BGR))
    given = ["--table", str(tmp_path / "table.png"), "--place", ",".join(map(str, PLACE))]
    out = ["--out", str(tmp_path / "camera.json")]
    assert main(["calibrate", str(tmp_path / "film.avi"), *given, *out]) == 0
    assert_found(load_camera(tmp_path / "camera.json"), camera)
    for nothing in ("0", str(tmp_path / "no-film.avi")):
        assert main(["calibrate", nothing, *given, *out]) == 2
        assert f"{nothing}: no such folder of pictures, film or recording" in capsys.readouterr().err


def test_the_board_is_slid_about_in_a_folder_or_a_film_that_begins_at_its_place(taken, tmp_path):
    camera, images, on_table, _ = taken
    light, slid = Light(position=(0.3, -0.2, 3.0), ambient=0.7, shadows=0), tmp_path / "slid"
    for folder in (tmp_path / "hand", slid):
        folder.mkdir()
    poses = [lying(), lying()]
    poses[0][:2, 3], poses[1][:2, 3] = [0.12, 0.55], [0.3, 0.4]
    others = [render(board_mesh(pose), camera, light, samples=3, background=(0.6, 0.6, 0.6)).color for pose in poses]
    film = cv2.VideoWriter(str(tmp_path / "slid.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (640, 480))  # type: ignore[attr-defined]
    for k, image in enumerate([on_table, *others]):
        cv2.imwrite(str(slid / f"{k}.png"), image[..., ::-1])
        film.write(np.ascontiguousarray(image[..., ::-1]))
    film.release()
    for k, image in enumerate(images):
        cv2.imwrite(str(tmp_path / "hand" / f"{k}.png"), image[..., ::-1])
    given = ["--place", ",".join(map(str, PLACE)), "--out", str(tmp_path / "camera.json")]
    for source in (slid, tmp_path / "slid.avi"):
        assert main(["calibrate", str(tmp_path / "hand"), "--table", str(source), *given]) == 0
        assert_found(load_camera(tmp_path / "camera.json"), camera)
        assert json.loads((tmp_path / "camera.json").read_text())["pictures"] == len(images) + 3


HELD = np.eye(4)
"""The board in the gripper."""
HELD[:3, :3], HELD[:3, 3] = cv2.Rodrigues(np.array([0.3, 2.8, 0.4]))[0], [-0.1, -0.07, 0.12]


def test_a_board_in_a_gripper_tells_the_same(taken):
    """Whatever the gripper's frame; one picture without the board is left out."""
    camera, images, on_table, boards = taken
    poses = boards @ np.linalg.inv(HELD)
    found = hand_eye([*images, np.full_like(on_table, 128)], np.concatenate([poses, poses[:1]]), BOARD)
    assert_found(found.camera, camera)
    assert np.abs(found.held - HELD).max() < 0.001
    assert (found.pictures, found.residual < 0.3, found.apart < 0.0005) == (8, True, True)


@pytest.mark.parametrize("seed", range(3))
def test_a_gripper_that_is_not_where_it_says_shows_in_the_residuals(taken, seed: int):
    """By half a millimetre and a thirtieth of a degree: what is far below the board is off by more than the board."""
    camera, images, _, boards = taken
    poses, rng = boards @ np.linalg.inv(HELD), np.random.default_rng(seed)
    for pose in poses:
        pose[:3, 3] += 0.0005 * rng.standard_normal(3)
        pose[:3, :3] = cv2.Rodrigues(0.0005 * rng.standard_normal(3))[0] @ pose[:3, :3]
    found = hand_eye(images, poses, BOARD)
    assert found.lens_residual < 0.3
    assert found.residual > 0.5
    assert 0.001 < found.apart < 0.002
    assert found.apart < off_on_table(found.camera, camera) < 0.008


def test_poses_that_tell_too_little_are_refused(taken):
    _, images, on_table, boards = taken
    upright = np.tile(np.eye(4), (8, 1, 1))
    for k in range(8):
        upright[k, :3, :3] = cv2.Rodrigues(np.array([0.0, 0.0, 0.3 * k]))[0]
    with pytest.raises(InputError, match="about two axes"):
        hand_eye(images, upright, BOARD)
    with pytest.raises(InputError, match="each of 8 pictures"):
        hand_eye(images, boards[:7], BOARD)
    with pytest.raises(InputError, match="must be rigid"):
        hand_eye(images, 2 * boards, BOARD)
    with pytest.raises(InputError, match="0 of 1 pictures"):
        hand_eye([np.full_like(on_table, 128)], boards[:1], BOARD)


def test_calibrate_reads_poses_and_the_base_they_are_from(taken, tmp_path, capsys):
    """The arm's base stands askew; its controller shows rotation vectors."""
    camera, images, _, boards = taken
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = cv2.Rodrigues(np.array([0.0, 0.0, 0.7]))[0], [-0.2, 0.1, 0.05]
    lines = ["picture,x,y,z,rx,ry,rz"]
    for k, (image, board) in enumerate(zip(images, boards, strict=True)):
        pose = np.linalg.inv(base) @ board @ np.linalg.inv(HELD)
        numbers = [*pose[:3, 3], *cv2.Rodrigues(pose[:3, :3])[0].ravel()]
        lines.append(",".join([f"{k}.png", *map(str, numbers)]))
        cv2.imwrite(str(tmp_path / f"{k}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    (tmp_path / "poses.csv").write_text("\n".join(lines))
    given = [str(tmp_path), "--poses", str(tmp_path / "poses.csv"), "--out", str(tmp_path / "camera.json")]
    assert main(["calibrate", *given, "--base", "-0.2,0.1,0.05,0.7"]) == 0
    assert "apart" in capsys.readouterr().out
    assert_found(load_camera(tmp_path / "camera.json"), camera)
    assert json.loads((tmp_path / "camera.json").read_text())["residual"] < 0.3
    (tmp_path / "poses.csv").write_text("\n".join([lines[0], "0.png,0,0,0,0,0"]))
    assert main(["calibrate", *given]) == 2
    assert "line 2 has no 'rz'" in capsys.readouterr().err
    assert main(["calibrate", str(tmp_path)]) == 2
    assert "one of --table and --poses" in capsys.readouterr().err
    assert main(["calibrate", *given, "--place", "0.1,0,0"]) == 2
    assert "--place: only goes with --table, got '0.1,0,0'" in capsys.readouterr().err


@pytest.mark.parametrize(("ending", "inch"), [("png", 150), ("svg", 72)])
def test_a_board_is_drawn_in_its_true_size_and_found_in_the_drawing(ending, inch, tmp_path, capsys):
    file = tmp_path / f"board.{ending}"
    given = ["--board", "6x4", "--square", "0.04", "--marker", "0.03"]
    assert main(["calibrate", "--print-board", str(file), *given]) == 0
    if ending == "svg":
        width = float(file.read_text().split('width="')[1].split("pt")[0])
        assert width == pytest.approx((6 * 0.04 + 0.024) / 0.0254 * inch, abs=0.1)
    else:
        (found,), _ = corners_of(Board(across=6, down=4, square=0.04, marker=0.03), [cv2.imread(str(file))])
        assert found is not None
        assert len(found.points) == 15
        apart = np.ptp(found.pixels, axis=0) / np.ptp(found.points[:, :2], axis=0)
        pixels = cv2.imread(str(file)).shape[1] / (6 * 0.04 + 0.024)
        np.testing.assert_allclose(apart, pixels, rtol=0.005)
    assert main(["calibrate", str(tmp_path), "--print-board", str(file)]) == 2
    assert "--print-board draws a board, and takes no pictures" in capsys.readouterr().err
    assert main(["calibrate"]) == 2
    assert "needs a folder with pictures of the board" in capsys.readouterr().err


def test_pictures_without_a_board_are_refused(taken):
    _, images, on_table, _ = taken
    empty = np.full_like(on_table, 128)
    with pytest.raises(InputError, match="on the table shows fewer"):
        calibrate(images, [empty], BOARD, PLACE)
    with pytest.raises(InputError, match="1 of 3 pictures"):
        calibrate([empty, empty], [on_table], BOARD, PLACE)
    with pytest.raises(InputError, match="one size"):
        calibrate(images, [on_table[:-1]], BOARD, PLACE)


def test_boards_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="smaller than a square"):
        Board(marker=0.04)
    with pytest.raises(UnknownNameError, match="DICT_4X4_50"):
        Board(dictionary="DICT_5").in_opencv()
