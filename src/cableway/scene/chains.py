"""An arm as plain numbers: its joints, its links and the solids on them, whatever file it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

Kind = Literal["sphere", "capsule", "cylinder", "box", "hull"]


@dataclass(frozen=True, kw_only=True)
class ChainJoint:
    """A hinge.

    Attributes:
        name: As the file has it.
        axis: Unit vector in the frame of the workspace, with all joints at zero.
        point: On the axis there [m].
        range: Least and greatest angle [rad].
    """

    name: str
    axis: Float[np.ndarray, "3"]
    point: Float[np.ndarray, "3"]
    range: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class ChainSolid:
    """A convex solid on a link.

    Attributes:
        name: For messages.
        link: How many joints move it.
        hand: Whether it is of the hand, which reaches down to the table.
        kind: Its shape.
        size: Radius [m] of a sphere; radius and half length along z of a capsule or cylinder; half lengths of a box.
        pose: (4, 4) in the frame of the workspace, with all joints at zero.
        vertices: (k, 3) [m] of a hull, in its frame; else none.
    """

    name: str
    link: int
    hand: bool
    kind: Kind
    size: Float[np.ndarray, "3"]
    pose: Float[np.ndarray, "4 4"]
    vertices: Float[np.ndarray, "k 3"]


@dataclass(frozen=True, kw_only=True)
class Chain:
    """An arm.

    Attributes:
        joints: From base to hand.
        solids: What may touch something.
        tip: (4, 4) pose of the frame at which the hand holds the cable, as theirs.
        speed_limit: Of each joint [rad/s].
    """

    joints: tuple[ChainJoint, ...]
    solids: tuple[ChainSolid, ...]
    tip: Float[np.ndarray, "4 4"]
    speed_limit: float
