"""A UR5e whose elbow folds as far as it goes, although links on either side of it may meet there: for narrow cells."""

from __future__ import annotations

import math

from cableway.scene.arm_models import UR5E
from cableway.scene.own_arms import OwnArm

D1, A2, A3, D4, D5, D6 = UR5E.lengths
FOLDING = OwnArm(
    name="folding",
    like="ur5e",
    dh=(
        (0.0, D1, math.pi / 2), (A2, 0.0, 0.0), (A3, 0.0, 0.0), (0.0, D4, math.pi / 2), (0.0, D5, -math.pi / 2),
        (0.0, D6, 0.0),
    ),
    capsules=UR5E.capsules,
    position_limit=(*UR5E.position_limit[:2], math.pi, *UR5E.position_limit[3:]),
)  # fmt: skip
