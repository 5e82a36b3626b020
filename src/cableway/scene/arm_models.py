"""Kinds of arms: six joints in the order and with the twists of those of Universal Robots, each with its lengths.

Lengths are the maker's (article "DH parameters for calculations of kinematics and dynamics"), limits and masses as in
its ROS 2 description (`config/*/joint_limits.yaml` and `physical_parameters.yaml`). The elbow's limit of position is
where links on either side of it, between which the judge alone measures a clearance, would come within 1 cm of each
other, those of a UR5e within 4 mm, as near as the judge lets any. The arms have limits of torque, none of acceleration
that are public: 5 rad/s² is what the maker's configuration of MoveIt takes for all of them (`joint_limits.yaml` of
`ur_moveit_config`). Plans do not know torques. `studies/arm_capsules.py` shows that capsules hold the links.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from cableway.core.errors import TaskError
from cableway.scene import checks
from cableway.scene.checks import Quantity

JOINT_NAMES = tuple(
    f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
)
"""From base to flange, as the maker's ROS driver calls them."""

ACCELERATION_LIMIT = (5.0,) * len(JOINT_NAMES)
"""The same [rad/s²]."""


PLACE = Quantity("m", -10.0, 10.0)
Metres = Annotated[float, "a number", PLACE]
Place = Annotated[tuple[Metres, Metres, Metres], "three numbers [x, y, z]"]
"""Three coordinates [m]."""


@dataclass(frozen=True)
class Capsule:
    """A segment with a radius, on a link of an arm.

    Attributes:
        frame: Of the link: 0 the base, which stands still, to 6 the flange.
        start: Of the segment in that frame [m].
        end: The other end.
        radius: [m].

    Raises:
        TaskError: There is no such frame, or a number is out of range.
    """

    frame: Annotated[int, "a whole number"]
    start: Place
    end: Place
    radius: Annotated[float, "a length", Quantity("m", 1e-3, 1.0)]

    def __post_init__(self) -> None:
        checks.check_quantities(self)
        checks.integer(self.frame, ("frame",), 0, len(JOINT_NAMES))
        for name in ("start", "end"):
            at = checks.rows([getattr(self, name)], (name,), (PLACE,) * 3)[0]
            object.__setattr__(self, name, tuple(at.tolist()))
        if self.start == self.end:
            raise TaskError("must be another point than start", ("end",))


class Mass(NamedTuple):
    """What a rigid part weighs, in the frame that it moves with.

    Attributes:
        mass: [kg].
        center: Of mass [m].
        inertia: About that: xx, yy, zz, xy, xz, yz [kg m²].
    """

    mass: float
    center: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class ArmModel:
    """A kind of arm.

    Attributes:
        name: As messages write it.
        lengths: d1, a2, a3, d4, d5, d6 of its Denavit-Hartenberg parameters [m].
        position_limit: Greatest angle of each joint to either side [rad].
        speed_limit: Of each joint [rad/s].
        torque_limit: Of each joint [N m].
        stiffness: With which the servo of each joint holds its position [N m/rad].
        links: Masses of the links that joints move, from shoulder to flange.
        capsules: That hold its links.
        acceleration_limit: Of each joint [rad/s²].
        joint_names: From base to flange.
    """

    name: str
    lengths: tuple[float, ...]
    position_limit: tuple[float, ...]
    speed_limit: tuple[float, ...]
    torque_limit: tuple[float, ...]
    stiffness: tuple[float, ...]
    links: tuple[Mass, ...]
    capsules: tuple[Capsule, ...]
    acceleration_limit: tuple[float, ...] = ACCELERATION_LIMIT
    joint_names: tuple[str, ...] = JOINT_NAMES


UR5E = ArmModel(
    name="UR5e",
    lengths=(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    position_limit=(2 * math.pi, 2 * math.pi, 2.74, 2 * math.pi, 2 * math.pi, 2 * math.pi),
    speed_limit=(math.pi,) * 6,
    torque_limit=(150.0, 150.0, 150.0, 28.0, 28.0, 28.0),
    stiffness=(2000.0, 2000.0, 2000.0, 500.0, 500.0, 500.0),
    links=(
        Mass(3.761, (0, -0.02561, 0.00193), (0.00700210, 0.00648091, 0.00657286, 7.3e-7, -1.053e-5, 0.00049994)),
        Mass(8.058, (0.2125, 0, 0.11336), (0.01505885, 0.33388086, 0.33247207, -5.4e-5, 5.63e-6, -1.81e-6)),
        Mass(2.846, (0.15, 0, 0.0265), (0.00399632, 0.07879254, 0.07848510, -1.365e-5, 0.00137272, -6.6e-6)),
        Mass(1.37, (0, -0.0018, 0.01634), (0.00165491, 0.00135962, 0.00126279, -2.82e-6, -4.38e-6, 0.00010157)),
        Mass(1.3, (0, 0.0018, 0.01634), (0.00135617, 0.00127827, 0.00096614, -2.74e-6, 4.44e-6, -5.048e-5)),
        Mass(0.365, (0, 0, -0.001159), (0.00018694, 0.00018908, 0.00025756, 6e-8, -1.7e-7, -9.2e-7)),
    ),
    capsules=(
        Capsule(0, (0, 0, 0), (0, 0, 0.06), 0.076),
        Capsule(1, (0, -0.02, 0), (0, 0.03, 0), 0.073),
        Capsule(1, (0, 0, 0), (0, 0, 0.03), 0.074),
        Capsule(2, (0.425, 0, 0.138), (0, 0, 0.138), 0.059),
        Capsule(2, (0.425, 0, 0.105), (0.425, 0, 0.165), 0.079),
        Capsule(2, (0, 0, 0.105), (0, 0, 0.165), 0.074),
        Capsule(3, (0.392, 0, 0.007), (0, 0, 0.007), 0.049),
        Capsule(3, (0.392, 0, -0.015), (0.392, 0, 0.015), 0.074),
        Capsule(3, (0, 0, -0.015), (0, 0, 0.015), 0.059),
        Capsule(4, (0, -0.055, 0), (0, 0.01, 0), 0.043),
        Capsule(4, (0, 0, -0.04), (0, 0, 0.04), 0.041),
        Capsule(5, (0, 0.005, 0), (0, 0.02, 0), 0.047),
        Capsule(5, (0, 0, -0.02), (0, 0, 0.015), 0.054),
        Capsule(6, (0, 0, -0.035), (0, 0, -0.01), 0.044),
    ),
)
"""The stiffness is that of MuJoCo Menagerie's model (BSD-3-Clause)."""

UR10E = ArmModel(
    name="UR10e",
    lengths=(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    position_limit=(2 * math.pi, 2 * math.pi, 2.8, 2 * math.pi, 2 * math.pi, 2 * math.pi),
    speed_limit=(2 * math.pi / 3, 2 * math.pi / 3, math.pi, math.pi, math.pi, math.pi),
    torque_limit=(330.0, 330.0, 150.0, 56.0, 56.0, 56.0),
    stiffness=(4000.0, 4000.0, 3500.0, 3200.0, 3200.0, 3200.0),
    links=(
        Mass(7.369, (0.021, 0, 0.027), (0.03408, 0.03529, 0.02156, 2e-5, -0.00425, 8e-5)),
        Mass(13.051, (0.38, 0, 0.158), (0.02814, 0.77068, 0.76943, 5e-5, -0.01561, 2e-5)),
        Mass(3.989, (0.24, 0, 0.068), (0.01014, 0.30928, 0.30646, 8e-5, 0.00916, 0)),
        Mass(2.1, (0, 0.007, 0.018), (0.00296, 0.00222, 0.00258, -1e-5, 0, -0.00024)),
        Mass(1.98, (0, 0.007, 0.018), (0.00296, 0.00222, 0.00258, -1e-5, 0, -0.00024)),
        Mass(0.615, (0, 0, -0.026), (0.0004, 0.00041, 0.00034, 0, 0, 0)),
    ),
    capsules=(
        Capsule(0, (0, 0, 0.02), (0, 0, 0.045), 0.099),
        Capsule(1, (0, -0.03, 0), (0, 0.042, 0), 0.094),
        Capsule(1, (0, 0, 0), (0, 0, 0.042), 0.094),
        Capsule(2, (0.613, 0, 0.176), (0, 0, 0.176), 0.077),
        Capsule(2, (0.613, 0, 0.149), (0.613, 0, 0.21), 0.094),
        Capsule(2, (0, 0, 0.142), (0, 0, 0.202), 0.074),
        Capsule(3, (0.572, 0, 0.04), (0, 0, 0.04), 0.06),
        Capsule(3, (0.572, 0, 0.022), (0.572, 0, 0.06), 0.072),
        Capsule(3, (0, 0, 0.017), (0, 0, 0.075), 0.057),
        Capsule(4, (0, -0.052, 0), (0, -0.047, 0), 0.05),
        Capsule(4, (0, 0, -0.03), (0, 0, 0.042), 0.053),
        Capsule(5, (0, 0.038, 0), (0, 0.041, 0), 0.05),
        Capsule(5, (0, 0, -0.041), (0, 0, 0.05), 0.05),
        Capsule(6, (0, 0, -0.032), (0, 0, -0.022), 0.053),
    ),
)
"""The same of its stiffness."""

UR3E = ArmModel(
    name="UR3e",
    lengths=(0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    position_limit=(2 * math.pi, 2 * math.pi, 2.5, 2 * math.pi, 2 * math.pi, 2 * math.pi),
    speed_limit=(math.pi, math.pi, math.pi, 2 * math.pi, 2 * math.pi, 2 * math.pi),
    torque_limit=(56.0, 56.0, 28.0, 12.0, 12.0, 12.0),
    stiffness=(1000.0, 1000.0, 500.0, 214.0, 214.0, 214.0),
    links=(
        Mass(1.98, (0, -0.02, 0), (0.0027657, 0.0021501, 0.0025626, 9.6e-6, -1.49e-5, 0.0001873)),
        Mass(3.4445, (0.13, 0, 0.1157), (0.0042623, 0.0460284, 0.0448947, -4.09e-5, -0.001496, -1.29e-5)),
        Mass(1.437, (0.05, 0, 0.0238), (0.0010511, 0.0113396, 0.0110895, 0, -3.31e-5, 2.2e-6)),
        Mass(0.871, (0, 0, 0.01), (0.0008174, 0.0006844, 0.0005497, -5e-7, 2.1e-6, 6.17e-5)),
        Mass(0.805, (0, 0, 0.01), (0.0006059, 0.0005837, 0.0003831, -6e-7, -6e-7, -2.71e-5)),
        Mass(0.261, (0, 0, -0.02), (0.000108, 0.0001086, 0.0001371, -1e-7, -1e-7, -2e-7)),
    ),
    capsules=(
        Capsule(0, (0, 0, 0.01), (0, 0, 0.045), 0.068),
        Capsule(1, (0, -0.022, 0), (0, 0.023, 0), 0.059),
        Capsule(1, (0, 0, 0), (0, 0, 0.029), 0.058),
        Capsule(2, (0.244, 0, 0.12), (0, 0, 0.12), 0.046),
        Capsule(2, (0.244, 0, 0.098), (0.244, 0, 0.14), 0.058),
        Capsule(2, (0, 0, 0.096), (0, 0, 0.142), 0.049),
        Capsule(3, (0.213, 0, 0.028), (0, 0, 0.028), 0.035),
        Capsule(3, (0.213, 0, 0.022), (0.213, 0, 0.041), 0.047),
        Capsule(3, (0, 0, 0.01), (0, 0, 0.055), 0.04),
        Capsule(4, (0, -0.043, 0), (0, -0.035, 0), 0.036),
        Capsule(4, (0, 0, -0.024), (0, 0, 0.035), 0.037),
        Capsule(5, (0, 0.026, 0), (0, 0.03, 0), 0.035),
        Capsule(5, (0, 0, -0.029), (0, 0, 0.037), 0.036),
        Capsule(6, (0, 0, -0.026), (0, 0, -0.02), 0.04),
    ),
)
"""Menagerie has no such arm. Its stiffness is a guess: over the torque limit it is that of a UR5e's wrist."""

ARM_MODELS: dict[str, ArmModel] = {"ur5e": UR5E, "ur10e": UR10E, "ur3e": UR3E}
"""By name."""
