"""Two arms of any kind, each described by a file of MuJoCo's format or a URDF, at the table.

What is here are facts that such a file does not have. `cableway.simulation.differential_ik` leads the arms along plans.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.scene import checks
from cableway.scene.arm_models import PLACE, Place
from cableway.scene.cell import ARMS, base_pose
from cableway.scene.checks import Quantity
from cableway.scene.obstacles import Height
from cableway.scene.scene import Scene

SPEED = Quantity("rad/s", 1e-3, 30.0)
CLEARANCE = Quantity("m", 0.005, 0.04)


@dataclass(frozen=True, kw_only=True)
class DescribedArm:
    """An arm where it stands.

    Attributes:
        model: File of MuJoCo's format (MJCF) or URDF, of one arm with its hand closed about a cable. Relative to the
            file that names it.
        frame: Site, body or link of that model: where the fingers hold the axis of the cable, z along them away from
            the arm, y along which they close.
        position: Of its base (x, y, z) [m] from the middle of the workspace, at the height of the table.
        angle: Of the base's x axis from that of the workspace [rad].
        speed_limit: Of each joint [rad/s].

    Raises:
        TaskError: A number is out of range.
    """

    model: Annotated[str, "the name of a file"]
    frame: Annotated[str, "the name of a site, body or link"]
    position: Place
    angle: checks.Radians = 0.0
    speed_limit: Annotated[float, "a number", SPEED]

    def __post_init__(self) -> None:
        checks.check_quantities(self)
        position = checks.rows([self.position], ("position",), (PLACE,) * 3)[0]
        object.__setattr__(self, "position", tuple(position.tolist()))

    def base(self, scene: Scene) -> Float[np.ndarray, "4 4"]:
        """Pose of the base in the frame of the workspace, see `cell.base_pose`."""
        return base_pose(self.position, self.angle, scene)


@dataclass(frozen=True, kw_only=True)
class DescribedArms:
    """The two.

    Attributes:
        name: For reports.
        arms: Either may hold either end of the cable, and its hand either way round.
        clearance: That links keep from the table, obstacles and each other [m].
        obstacle_height: Of obstacles without a height [m]; None where nothing passes above them.

    Raises:
        TaskError: There are not two arms, or a number is out of range.
    """

    name: Annotated[str, "a short text"]
    arms: Annotated[tuple[DescribedArm, ...], "a list of two arms"]
    clearance: Annotated[float, "a length", CLEARANCE] = 0.01
    obstacle_height: Height = None

    def __post_init__(self) -> None:
        checks.check_quantities(self)
        object.__setattr__(self, "arms", tuple(self.arms))
        if len(self.arms) != ARMS:
            raise TaskError(f"must be {ARMS} arms, got {len(self.arms)}", ("arms",))
