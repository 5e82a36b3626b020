"""How far the plug at the right end is short of its clearance, for the refinement.

The plug is represented by points p_k = x + R(theta) l_k on its outline, x and theta the right end's pose; with the
distance d and its slope g at p_k, the slope of the shortfall margin - d is -(g, g . R'(theta) l_k) by the pose. Where
a corner comes between two of them, at clearance d, it is nearer by at most `SPACING`^2 / (8 d): 0.8 mm at 10 mm.

Note:
    Not in the paper (Tang et al.), whose plans leave the plug out.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import convex
from cableway.scene.task import Task

SPACING = 0.008
"""Distance [m] between the points."""


def plug_shortfall(
    task: Task, poses: Float[np.ndarray, "t 2 3"], margin: float
) -> tuple[Float[np.ndarray, "t k"], Float[np.ndarray, "t k 3"]]:
    """Shortfall [m] of the clearance of k points round the plug, and its slope by the pose of the right end.

    Args:
        task: The task; without a plug, k is 0.
        poses: (t, 2, 3) gripper poses [m, m, rad].
        margin: Clearance asked for [m].
    """
    if task.plug is None:
        return np.empty((len(poses), 0)), np.empty((len(poses), 0, 3))
    ends = poses[:, 1]
    points = task.plug.body.placed(ends, SPACING)[:, :-1]
    distance, slope, _ = convex.signed_distance(points, task.scene.world, margin)
    short = np.maximum(0.0, margin - distance)
    slope = -slope * (short > 0)[..., None]
    lever = points - ends[:, None, :2]
    turned = slope[..., 1] * lever[..., 0] - slope[..., 0] * lever[..., 1]
    return short, np.concatenate([slope, turned[..., None]], axis=2)
