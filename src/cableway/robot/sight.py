"""How much of a cable two arms hide from cameras, by the capsules about their links and tools."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from cableway.core.compiled import kernel
from cableway.robot.branches import ArmMotion, PackedCell
from cableway.robot.links import segment_gap


@kernel
def _behind(eye, points, ends, radius, hidden):
    """Mark in `hidden` (t, m) which points (t, m, 3) capsules with ends (t, k, 2, 3) hide from an eye (3,)."""
    for t in range(len(points)):
        for i in range(points.shape[1]):
            for k in range(len(radius)):
                if hidden[t, i]:
                    break
                hidden[t, i] = segment_gap(eye, points[t, i], ends[t, k, 0], ends[t, k, 1]) < radius[k]


def hidden_from(
    eyes: Sequence[Float[np.ndarray, "3"]],
    shapes: Float[np.ndarray, "t m 2"],
    motion: ArmMotion,
    packed: PackedCell,
) -> Bool[np.ndarray, "t m"]:
    """Which points of a cable no camera sees, since an arm or its tool is before them.

    Args:
        eyes: Where the cameras are [m].
        shapes: (t, m, 2) points of the cable [m].
        motion: (t, 2, 6) of the arms meanwhile.
        packed: Their cell.
    """
    points = np.concatenate([shapes, np.full((*shapes.shape[:2], 1), packed.height)], axis=2)
    all_of_them = np.ones(shapes.shape[:2], bool)
    placed = [
        (packed.placed(arm, motion.joints[:, side])[0], packed.capsules[arm].radius)
        for side, arm in enumerate(motion.way.holders)
    ]
    for eye in eyes:
        hidden = np.zeros_like(all_of_them)
        for ends, radius in placed:
            _behind(np.asarray(eye, float), points, ends, radius, hidden)
        all_of_them &= hidden
    return all_of_them
