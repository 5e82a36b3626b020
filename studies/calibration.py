"""How well a first calibration by the docs finds a camera: drawn cameras, lenses and pictures of a board in hand.

    .venv/bin/python studies/calibration.py [--first 0] [--count 30] [--pictures 20] [--slid 0]

Each camera stands about where `--camera` puts one, off by some centimetres and degrees, with a lens that distorts. Its
pictures are of a board held before it, slanted to all sides, partly out of the picture, blurred and with noise; then of
the board flat on the table at a place that is known, and slid about there. Then how far off corners are found in such
pictures, as they are and enlarged before. What is seen of a board is computed ray by ray, by OpenCV's model of a lens.
Prints Markdown.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from unittest import mock

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from cableway.core.errors import InputError
from cableway.perception import charuco
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.charuco import SQUARE_PIXELS, Board
from cableway.perception.placement import camera_at
from cableway.perception.table_pose import calibrate
from cableway.rendering.camera import Camera

WORKSPACE, SIZE = (0.7, 0.7), (640, 480)
MARKER = 0.75
"""Width of a marker in squares."""

EDGE = 0.6
"""White paper about the squares, in squares."""

SAMPLES = 3
"""Rays of a pixel each way."""

FARTHEST = 1.1
"""Distance [m] at which somebody holds a board at most."""

FILLS = (0.4, 0.8)
"""Share of the picture's width that it fills where it is not farther."""

PLACED, SLID = (0.2, 0.4), (0.1, 0.6)
"""Where the first corner of a board on the table is, in x and in y [m]: at a place that is known, and slid about."""

CORNERS = 20
"""Pictures of each of eight cameras at each place in which corners are looked at."""

SPOTS = np.array([[x, y, 0.0] for x in (0.05, 0.35, 0.65) for y in (0.05, 0.35, 0.65)])
"""All over the table [m]."""


def drawn_camera(place: str, rng: np.random.Generator) -> CalibratedCamera:
    """A camera about a place."""
    pinhole, pose = camera_at(place, WORKSPACE, SIZE).pinhole, np.eye(4)
    pose[:3, :3] = pinhole.pose[:3, :3] @ cv2.Rodrigues(np.radians(3) * rng.standard_normal(3))[0]
    pose[:3, 3] = pinhole.pose[:3, 3] + 0.05 * rng.standard_normal(3)
    focal = pinhole.focal[0] * rng.uniform(0.85, 1.0)
    center = np.array(pinhole.center) + 8 * rng.standard_normal(2)
    lens = (rng.uniform(-0.2, 0.2), rng.uniform(-0.1, 0.1), *(0.001 * rng.standard_normal(2)).tolist(), 0.0)
    camera = Camera(size=SIZE, focal=(focal, focal), center=(float(center[0]), float(center[1])), pose=pose)
    return CalibratedCamera(pinhole=camera, distortion=lens)


def rays_of(camera: CalibratedCamera) -> np.ndarray:
    """(h, w, SAMPLES^2, 3) directions of the rays of each pixel, in the frame of the camera."""
    within = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    v, u, dv, du = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]), within, within, indexing="ij")
    pixels = np.stack([u + du, v + dv], axis=-1).reshape(-1, 1, 2)
    matrix = np.array([[camera.pinhole.focal[0], 0, camera.pinhole.center[0]],
                       [0, camera.pinhole.focal[1], camera.pinhole.center[1]], [0, 0, 1]])  # fmt: skip
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-10)
    found = cv2.undistortPoints(pixels, matrix, np.array(camera.distortion), None, None, None, stop).reshape(-1, 2)
    return np.pad(found, ((0, 0), (0, 1)), constant_values=1.0).reshape(SIZE[1], SIZE[0], -1, 3)


def photograph(board: Board, rays: np.ndarray, pose: np.ndarray, blur: float, rng: np.random.Generator) -> np.ndarray:
    """A picture of a board, its frame at a pose (4, 4) in that of the camera, z into it."""
    fine = SQUARE_PIXELS
    drawn = np.pad(board.drawing(), round(EDGE * fine), constant_values=255).astype(float)
    normal, origin = pose[:3, 2], pose[:3, 3]
    far = (normal @ origin) / (rays @ normal)
    at = (far[..., None] * rays - origin) @ pose[:3, :2] / board.square * fine + round(EDGE * fine) - 0.5
    shade = map_coordinates(drawn, [at[..., 1], at[..., 0]], order=1, mode="constant", cval=-1.0)
    shade = np.where((shade < 0) | (far <= 0), 150.0, 15.0 + 0.9 * shade).mean(axis=2)
    picture = gaussian_filter(shade, blur) + 4.0 * rng.standard_normal(shade.shape)
    return np.repeat(np.clip(picture, 0, 255).round().astype(np.uint8)[..., None], 3, axis=2)


def in_hand(board: Board, camera: CalibratedCamera, rng: np.random.Generator) -> np.ndarray:
    """The pose (4, 4) of a board that is shown to the camera, in its frame."""
    way, tilt = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(15, 45))
    pose = np.eye(4)
    rolled = cv2.Rodrigues(np.array([0.0, 0.0, np.pi / 2 * rng.integers(4) + rng.normal(0.0, 0.2)]))[0]
    pose[:3, :3] = cv2.Rodrigues(tilt * np.array([np.cos(way), np.sin(way), 0.0]))[0] @ rolled
    u, v = (rng.uniform(0.2, 0.8, 2) * SIZE - camera.pinhole.center) / camera.pinhole.focal
    width = board.across * board.square
    far = min(width / rng.uniform(*FILLS) * camera.pinhole.focal[0] / SIZE[0], FARTHEST)
    pose[:3, 3] = far * np.array([u, v, 1.0]) - pose[:3, :3] @ middle_of(board)
    return pose


def on_table(
    rng: np.random.Generator, within: tuple[float, float] = PLACED
) -> tuple[tuple[float, float, float], np.ndarray]:
    """Where a board lies on the table, see `calibrate`, and its pose (4, 4) there."""
    x, y, angle = *rng.uniform(*within, 2).tolist(), float(rng.uniform(-np.pi, np.pi))
    c, s = np.cos(angle), np.sin(angle)
    return (x, y, angle), np.array([[c, s, 0, x], [s, -c, 0, y], [0, 0, -1, 0], [0, 0, 0, 1.0]])


def middle_of(board: Board) -> np.ndarray:
    """In the frame of a board [m]."""
    return np.array([board.across, board.down, 0]) * board.square / 2


def tried(place: str, board: Board, count: int, slid: int, rng: np.random.Generator) -> np.ndarray | None:
    """Of a camera how far off it is found to be: the table at the board [mm], its turn [degrees], the camera [mm], and
    spots all over the table [mm], the mean and the worst; None where the pictures are refused."""
    camera = drawn_camera(place, rng)
    rays = rays_of(camera)
    images = [photograph(board, rays, in_hand(board, camera, rng), rng.uniform(0.4, 1.2), rng) for _ in range(count)]
    spot, lying = on_table(rng)
    into = np.linalg.inv(camera.pinhole.pose)
    poses = [lying, *(on_table(rng, SLID)[1] for _ in range(slid))]
    try:
        found = calibrate(
            images, [photograph(board, rays, into @ pose, 0.7, rng) for pose in poses], board, spot
        ).camera
    except InputError as error:
        print(f"{place}: {error}", file=sys.stderr)
        return None
    again = np.linalg.inv(found.pinhole.pose)
    middle = lying @ np.append(middle_of(board), 1.0)
    turn = cv2.Rodrigues(found.pinhole.pose[:3, :3].T @ camera.pinhole.pose[:3, :3])[0]
    spots = np.linalg.norm(found.on_plane(camera.project(SPOTS)[0], 0.0) - SPOTS[:, :2], axis=1)
    off = np.linalg.norm((again - into) @ middle)
    moved = np.linalg.norm(found.pinhole.pose[:3, 3] - camera.pinhole.pose[:3, 3])
    return np.array([1e3 * off, np.degrees(np.linalg.norm(turn)), 1e3 * moved, 1e3 * spots.mean(), 1e3 * spots.max()])


def corner_errors(place: str, board: Board, count: int, rng: np.random.Generator, finer: int, lies: bool) -> np.ndarray:
    """How far off [pixels] corners of a board in hand, or on the table, are found where pictures are enlarged."""
    camera, errors = drawn_camera(place, rng), [np.empty((0, 2))]
    rays, focal, center = rays_of(camera), camera.pinhole.focal, camera.pinhole.center
    matrix = np.array([[focal[0], 0, center[0]], [0, focal[1], center[1]], [0, 0, 1]])
    for _ in range(count):
        pose = np.linalg.inv(camera.pinhole.pose) @ on_table(rng)[1] if lies else in_hand(board, camera, rng)
        image = photograph(board, rays, pose, rng.uniform(0.4, 1.2), rng)
        with mock.patch.object(charuco, "FINER", finer):
            ((found,), _) = charuco.corners_of(board, [image])
        if found is not None:
            turn = cv2.Rodrigues(pose[:3, :3])[0]
            shown = cv2.projectPoints(found.points, turn, pose[:3, 3], matrix, np.array(camera.distortion))[0]
            errors.append(found.pixels - shown.reshape(-1, 2))
    return np.linalg.norm(np.concatenate(errors), axis=1)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--first", type=int, default=0, help="seed of the first camera of each place")
    parser.add_argument("--count", type=int, default=30, help="cameras of each place")
    parser.add_argument("--pictures", type=int, default=20, help="of the board in hand; 160 are those of a film")
    parser.add_argument("--slid", type=int, default=0, help="further pictures of the board on the table, slid about")
    parser.add_argument("--board", default="9x6", help="squares in a row, and rows")
    parser.add_argument("--square", type=float, default=0.042, help="side of a square [m]")
    given = parser.parse_args()
    across, down = map(int, given.board.split("x"))
    board = Board(across=across, down=down, square=given.square, marker=MARKER * given.square)
    columns = (
        "camera, n, refused, table at the board [mm], turn [degrees], camera [mm], spots mean [mm], spots worst [mm]"
    )
    names = columns.split(", ")
    print(f"| {' | '.join(names)} |\n|{' --- |' * len(names)}")
    for place in ("above", "front"):
        found = [
            tried(place, board, given.pictures, given.slid, np.random.default_rng([given.first + k, len(place)]))
            for k in range(given.count)
        ]
        rows = np.array([each for each in found if each is not None])
        told = [f"{np.median(row):.2f}, {np.percentile(row, 95):.2f}, {row.max():.2f}" for row in rows.T]
        print(f"| {place} | {len(rows)} | {len(found) - len(rows)} | {' | '.join(told)} |", flush=True)
    print("\n| board | enlarged | corners | root mean square error [pixels] | p95 | worst |\n|" + " --- |" * 6)
    for lies, finer in itertools.product((False, True), (1, 2, 3)):
        rngs = [(place, np.random.default_rng([given.first + k, 7])) for place in ("above", "front") for k in range(8)]
        off = np.concatenate([corner_errors(place, board, CORNERS, rng, finer, lies) for place, rng in rngs])
        told = f"{np.sqrt(np.mean(off**2)):.3f} | {np.percentile(off, 95):.3f} | {off.max():.3f}"
        print(f"| {'on the table' if lies else 'in hand'} | {finer} | {len(off)} | {told} |", flush=True)


if __name__ == "__main__":
    main()
