"""A camera's place by a board in a gripper: hand-eye calibration of a camera that stands beside the table.

The board moves with the gripper, whose pose G_k in the frame of the workspace the joints tell. How the board is held,
X, and where the camera stands, C, follow from where the camera sees it, B_k: in closed form from G_k X = C B_k (Li,
Wang and Wu 2010, "Simultaneous robot-world and hand-eye calibration using dual-quaternions and Kronecker product"), and
from there by least squares over the pixels of all corners; by SciPy, for the lens is OpenCV's and compiles with no
kernel of ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cableway.core.errors import InputError
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.charuco import LEAST_PICTURES, Board, Corners, Lens, corners_of, fitted_lens, pose_of

LEAST_TURN = math.radians(10)
"""How far the gripper must turn about a second axis: by turns about one alone the camera's height does not show."""


@dataclass(frozen=True, eq=False)
class HandEye:
    """What pictures of a board in a gripper say.

    Attributes:
        camera: The camera, in the frame of the workspace.
        held: (4, 4) pose of the board in the gripper.
        lens_residual: Root mean square distance [pixels] of corners from where the lens would show them, were the board
            free in each picture.
        residual: The same with the board where the gripper has it.
        apart: Root mean square distance [m] between where the camera sees the middle of the corners and where the
            gripper has it: that of the robot's poses, for most of it.
        pictures: Pictures that counted.
        corners: Corners in all of them.
    """

    camera: CalibratedCamera
    held: Float[np.ndarray, "4 4"]
    lens_residual: float
    residual: float
    apart: float
    pictures: int
    corners: int


def hand_eye(images: Sequence[UInt8[np.ndarray, "h w 3"]], poses: Float[np.ndarray, "k 4 4"], board: Board) -> HandEye:
    """The camera that took pictures of a board in a gripper, held the same way in all.

    Args:
        images: Of the board, near and slanted to all sides; (red, green, blue).
        poses: Of the gripper in the frame of the workspace when each was taken.
        board: What it is.

    Raises:
        InputError: There is not one rigid pose for each picture, the pictures differ in size, too few of them show
            enough corners, or the gripper turns about one axis only.
        MissingExtraError: OpenCV is not installed.
    """
    poses = np.asarray(poses, float)
    if poses.shape != (len(images), 4, 4):
        raise InputError(f"poses must be 4 x 4 for each of {len(images)} pictures, got shape {poses.shape}")
    if not np.allclose(poses[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1), np.eye(3), atol=1e-6):
        raise InputError("poses of the gripper must be rigid: one has a rotation that is none")
    seen, size = corners_of(board, images)
    there = [k for k, corners in enumerate(seen) if corners is not None]
    found, poses = [corners for corners in seen if corners is not None], poses[there]
    if len(found) < LEAST_PICTURES:
        raise InputError(f"{len(found)} of {len(images)} pictures show enough of the board; {LEAST_PICTURES} must")
    lens = fitted_lens(found, size)
    _require_turns(poses)
    x = _refined(_closed_form(poses, lens.boards), poses, found, lens)
    camera, held = pose_of(x[:3], x[3:6]), pose_of(x[6:9], x[9:])
    off = _off(x, poses, found, lens).reshape(-1, 2)
    middles = [np.append(corners.points.mean(axis=0), 1.0) for corners in found]
    apart = [
        (camera @ seen @ middle - pose @ held @ middle)[:3]
        for seen, pose, middle in zip(lens.boards, poses, middles, strict=True)
    ]
    inward = np.linalg.inv(camera)
    placed = lens.camera(size, inward[:3, :3], inward[:3, 3])
    residual, apart = (math.sqrt(float(np.sum(np.square(each), axis=1).mean())) for each in (off, apart))
    return HandEye(placed, held, lens.residual, residual, apart, len(found), len(off))


def _require_turns(poses: Float[np.ndarray, "k 4 4"]) -> None:
    """Raise where the gripper turns about one axis only."""
    turns = poses[:, :3, :3] @ poses[0, :3, :3].T
    vectors = Rotation.from_matrix(turns).as_rotvec()
    second = float(np.linalg.svd(vectors, compute_uv=False)[1])  # root of the sum of squares about a second axis
    if second < LEAST_TURN:
        raise InputError(
            f"the gripper must turn about two axes between pictures by {math.degrees(LEAST_TURN):.0f} degrees or more; "
            f"about the second one it turns by {math.degrees(second):.1f}"
        )


def _closed_form(poses: Float[np.ndarray, "k 4 4"], boards: Float[np.ndarray, "k 4 4"]) -> Float[np.ndarray, "12"]:
    """Camera and board in gripper from G X = C B: linear in both rotations, and then in both places."""
    eye = np.eye(3)
    rows = [
        np.hstack([np.kron(pose[:3, :3], eye), -np.kron(eye, board[:3, :3].T)])
        for pose, board in zip(poses, boards, strict=True)
    ]
    either = np.linalg.svd(np.vstack(rows))[2][-1].reshape(2, 3, 3)  # X and C, row by row, up to a factor
    either = either * np.sign(np.linalg.det(either[0]))
    left, _, right = np.linalg.svd(either)
    held, camera = left @ right
    rows = np.vstack([np.hstack([pose[:3, :3], -eye]) for pose in poses])
    rest = np.concatenate([camera @ board[:3, 3] - pose[:3, 3] for pose, board in zip(poses, boards, strict=True)])
    at = np.linalg.lstsq(rows, rest, rcond=None)[0]
    turns = Rotation.from_matrix(np.stack([camera, held])).as_rotvec()
    return np.concatenate([turns[0], at[3:], turns[1], at[:3]])


def _refined(
    x: Float[np.ndarray, "12"], poses: Float[np.ndarray, "k 4 4"], found: Sequence[Corners], lens: Lens
) -> Float[np.ndarray, "12"]:
    """The least sum of squares of the pixels from there on."""
    return least_squares(_off, x, method="lm", x_scale="jac", args=(poses, found, lens)).x


def _off(
    x: Float[np.ndarray, "12"], poses: Float[np.ndarray, "k 4 4"], found: Sequence[Corners], lens: Lens
) -> Float[np.ndarray, "m"]:
    """How far corners are seen from where camera and gripper have them [pixels]."""
    inward, held = np.linalg.inv(pose_of(x[:3], x[3:6])), pose_of(x[6:9], x[9:])
    return lens.off(found, [inward @ pose @ held for pose in poses]).ravel()
