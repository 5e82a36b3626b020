"""Time parametrisation: rows of a motion placed so that none asks more than one control step allows.

The effort of a section is the largest of what it asks for, each over its limit in one control step. Rows at equal
effort take the limits as far as they may, whatever the shape of the motion.

Note:
    Not in the paper (Tang et al.), whose reference has one row per step of the deformation optimisation.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry.groups import SE2


def gripper_effort(poses: Float[np.ndarray, "t 2 3"], max_step: float, max_turn: float) -> Float[np.ndarray, "t-1"]:
    """Largest of the grippers' moves over `max_step` [m] and turns over `max_turn` [rad] between rows of poses."""
    move, turn = SE2.distance(poses[:-1], poses[1:])
    return np.maximum(move.max(1) / max_step, turn.max(1) / max_turn)


def at_equal_effort(
    fine: Float[np.ndarray, "f"], effort: Float[np.ndarray, "f-1"], share: float = 1.0
) -> Float[np.ndarray, "k"]:
    """Places among `fine`, increasing, with the same effort between any two of them, at most `share`.

    Args:
        fine: Places, first and last of which are kept.
        effort: Between one place and the next.
        share: Most effort of a step.
    """
    total = np.concatenate([[0.0], np.cumsum(np.maximum(effort, 1e-9))])
    count = max(1, int(np.ceil(total[-1] / share)))
    return np.interp(np.linspace(0, total[-1], count + 1), total, fine)
