"""Leading the rod by its grippers: its equilibrium is followed until the branch ends or becomes unstable.

There the rod snaps to another shape. At a fold the branch turns back, and nothing near by is left to go on with; at a
bifurcation it goes on, but the rod does not stay on it. Of both, the stability margin that falls to zero is the sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.core.time_limit import checkpoint
from cableway.rod.held_rod import HeldRod
from cableway.rod.inverse import SAME_SHAPE, meet_poses

LONGEST_MOVE = 0.02
"""Move of any point of the rod, in its lengths, that one predicted step may make."""

LARGEST_CORRECTION = 0.2
"""Part of such a move by which the corrector may change what was predicted; more is a jump to another branch."""

SHORTEST_STEP = 1e-5
"""Share of the way between two rows of poses at which a step that still fails is a snap."""


@dataclass(frozen=True)
class Led:
    """What the rod did.

    Attributes:
        q: (k, d) rod coordinates at each row of poses reached, the first one included.
        stability: (k,) stability margin there.
        snap: Fractional row of poses at which the rod snaps; None where it follows to the last.
    """

    q: Float[np.ndarray, "k d"]
    stability: Float[np.ndarray, "k"]
    snap: float | None


def lead(rod: HeldRod, q: Float[np.ndarray, "d"], poses: Float[np.ndarray, "t 2 pose"]) -> Led:
    """Lead a rod through gripper poses, straight and the short way round from row to row.

    Predictor and corrector: a step along the branch's tangent, dq = (d poses/dq)^-1 d poses, then Newton's method on
    the poses. A step that fails, jumps or ends at an unstable shape is halved.

    Args:
        rod: The rod.
        q: (d,) a stable equilibrium with its grippers at the first poses.
        poses: (t, 2, 3) left and right gripper (x, y, theta) [m, m, rad].

    Raises:
        InputError: The grippers of `q` are not at the first poses, or it is not stable.
    """
    gap, turn = rod.group.distance(rod.end_poses(q[None])[0], poses[0])
    if gap.max() > SAME_SHAPE * rod.length or turn.max() > SAME_SHAPE:
        raise InputError("the grippers of the rod's first shape are not at the first poses")
    margin = float(rod.stability(q[None])[0][0])
    if margin <= 0:
        raise InputError(f"the rod's first shape is not stable (margin {margin:.3g})")
    rows, margins = [q], [margin]
    for row, (pose, following) in enumerate(pairwise(poses)):
        reached, share = _lead_to(rod, rows[-1], pose, rod.group.minus(following, pose))
        if share < 1:
            return Led(np.array(rows), np.array(margins), row + share)
        rows.append(reached)
        margins.append(float(rod.stability(reached[None])[0][0]))
    return Led(np.array(rows), np.array(margins), None)


def _lead_to(rod: HeldRod, q: np.ndarray, pose: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, float]:
    """Follow from `pose` along `step`: the last stable q, and the share of the step at which that is."""
    share, width = 0.0, 1.0
    while share < 1:
        checkpoint()
        width = min(width, 1 - share)
        following = _next(rod, q, rod.group.plus(pose, (share + width) * step), width * step)
        if following is not None:
            q, share, width = following, share + width, 2 * width
        elif width < SHORTEST_STEP:
            break
        else:
            width /= 2
    return q, min(share, 1.0)


def _next(rod: HeldRod, q: np.ndarray, target: np.ndarray, step: np.ndarray) -> np.ndarray | None:
    """The stable equilibrium at `target` that continues q by `step`; None where the step is too long or there is none.

    Lengths are measured in those of the rod, so that the tangent does not depend on the unit.
    """
    units = rod.group.step_units(rod.length)
    before, _, _, dposes = rod.jacobians(q[None])
    slope = (dposes[0] / units[:, None]).reshape(-1, rod.dof)
    guess = rod.retract(q, np.linalg.lstsq(slope, (step / units).ravel(), rcond=1e-9)[0])
    predicted = rod.shapes(guess[None])[0]
    if np.abs(predicted - before).max() > LONGEST_MOVE * rod.length:
        return None
    met = meet_poses(rod, target, guess[None])
    if not len(met) or np.abs(rod.shapes(met)[0] - predicted).max() > LARGEST_CORRECTION * LONGEST_MOVE * rod.length:
        return None
    return met[0] if rod.stability(met)[0][0] > 0 else None
