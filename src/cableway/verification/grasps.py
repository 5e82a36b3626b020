"""How grippers hold the cable's ends, as far as a record states it."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.records import Plan, Rollout
from cableway.scene.task import CONTROL_STEP

GRASP_OFFSET = 0.02
"""Largest distance [m] of a cable's end from where its gripper should hold it; recorded poses may be those of either.
Measured: 5 mm."""

ASKEW = 0.5
"""Angle [rad] by which an end is held askew at most, where that is stated."""


def stated(rollout: Plan | Rollout, *keys: str) -> Any:
    """What the metadata say under nested keys; None where they say nothing."""
    found: Any = rollout.metadata
    for key in keys:
        found = found.get(key) if isinstance(found, dict) else None
    return found


def tool_poses(record: Plan | Rollout) -> Float[np.ndarray, "t 2 3"]:
    """Poses [m, m, rad] of the grippers, whose record has those of the cable's ends and may state how they are held."""
    grasp, poses = stated(record, "plant", "grasp"), np.array(record.poses)
    if not isinstance(grasp, dict) or not isinstance(record, Rollout):
        return poses
    slip = grasp.get("slip_time")
    middles = record.times - CONTROL_STEP / 2  # of the steps that led to the rows: in one of them the cable slips
    slipped = middles >= slip if isinstance(slip, int | float) else np.zeros(len(poses), bool)
    for side, name in enumerate(("left", "right")):
        for rows, stage in ((~slipped, name), (slipped, f"{name}_after")):
            dx, dy, angle = _offset(grasp.get(stage))
            poses[rows, side, 2] -= angle
            cosine, sine = np.cos(poses[rows, side, 2]), np.sin(poses[rows, side, 2])
            poses[rows, side, 0] -= cosine * dx - sine * dy
            poses[rows, side, 1] -= sine * dx + cosine * dy
    return poses


def _offset(given: Any) -> tuple[float, float, float]:
    """The pose [m, m, rad] of an end in its gripper; none where what is stated is no such pose."""
    if isinstance(given, list) and len(given) == 3 and all(isinstance(each, int | float) for each in given):
        dx, dy, angle = (float(each) for each in given)
        if np.hypot(dx, dy) <= GRASP_OFFSET and abs(angle) <= ASKEW:
            return dx, dy, angle
    return 0.0, 0.0, 0.0
