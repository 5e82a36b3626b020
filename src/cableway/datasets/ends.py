"""The ends of a recorded cable and the grippers that hold them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.core.errors import FileFormatError
from cableway.core.quantities import quantity
from cableway.datasets.steps import Poses, Shapes

FARTHEST = 0.25
"""Distance of a gripper from its end of the cable, over the cable's length, from which on they are not in one frame."""

SIDES = ("left", "right")


def held_at_ends(shapes: Shapes) -> Poses:
    """Gripper poses (k, 2, 3) as the cable's ends have them; an approximation.

    The place is that of the outermost keypoint, the angle that of the tangent there of the parabola through the three
    outermost ones. Noise of the keypoints goes into the angle in full.

    >>> held_at_ends(np.array([[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]]))[0, :, 2]
    array([0.78539816, 0.78539816])

    Raises:
        FileFormatError: Keypoints coincide where the tangent is to be.
    """
    tangents = np.stack([_tangent(shapes[:, :3]), -_tangent(shapes[:, :-4:-1])], axis=1)
    if not np.isfinite(tangents).all() or not np.abs(tangents).sum(axis=2).all():
        raise FileFormatError("the outermost keypoints coincide, so that the cable's end has no direction")
    angles = np.unwrap(np.arctan2(tangents[..., 1], tangents[..., 0]), axis=0)
    return np.concatenate([shapes[:, [0, -1]], angles[..., None]], axis=2)


def _tangent(points: Float[np.ndarray, "k 3 2"]) -> Float[np.ndarray, "k 2"]:
    """Derivative at the first of three points, along their polyline, of the parabola through them."""
    a, b = np.linalg.norm(np.diff(points, axis=1), axis=2).T[:, :, None]
    first, second, third = points[:, 0], points[:, 1], points[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return (second - first) * (a + b) / (a * b) - (third - first) * a / (b * (a + b))


def require_at_ends(shapes: Shapes, poses: Poses, length: float) -> None:
    """Check that each gripper is at its end of a cable of this length [m], and its angle along it, in the median.

    Raises:
        FileFormatError: It is not; the message says which and what may be the reason.
    """
    off, exchanged = (
        np.median(np.linalg.norm(shapes[:, ends] - poses[..., :2], axis=2), axis=0) for ends in ([0, -1], [-1, 0])
    )
    if off.max() > FARTHEST * length:
        why = "are left and right exchanged?" if exchanged.max() < off.max() else "are both in one frame and unit?"
        far = f"{quantity(float(off.max()))} from its end of the cable"
        raise FileFormatError(f"the {SIDES[off.argmax()]} gripper is {far}, in the median: {why}")
    along = np.stack([shapes[:, 1] - shapes[:, 0], shapes[:, -1] - shapes[:, -2]], axis=1)
    ahead = np.sum(along * np.stack([np.cos(poses[..., 2]), np.sin(poses[..., 2])], axis=2), axis=2)
    for side in np.flatnonzero(np.median(ahead, axis=0) < 0)[:1]:
        raise FileFormatError(
            f"theta of the {SIDES[side]} gripper points against the cable, in the median; it must be the direction of "
            "the cable's tangent, from the left end to the right one"
        )
