"""A cell: two arms beside the table, each with a gripper that holds an end of the cable from above.

What is here are facts: lengths, limits, shapes and places. Kinematics and distances are in `cableway.robot`, and for
the judge in `cableway.verification`, which shares no code with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.scene import checks
from cableway.scene.arm_models import ARM_MODELS, PLACE, ArmModel, Capsule, Mass, Place
from cableway.scene.gripper_bodies import Tilt, gripper_body, lift_of
from cableway.scene.obstacles import Height
from cableway.scene.own_arms import OwnArm
from cableway.scene.scene import Scene
from cableway.scene.spatial.scene import SpatialScene

ARMS = 2
"""Arms of a cell; arm 0 holds the left end of the cable, or the right one."""


@dataclass(frozen=True)
class Tool:
    """A gripper on a flange.

    Attributes:
        reach: From the flange to the axis of the cable between the fingers [m].
        mass: Of all of it, in the frame of the flange.
        capsules: That hold it but for its fingertips, which `cableway.scene.gripper_bodies` describes.
        spread: That hold what open fingers spread besides.
    """

    reach: float
    mass: Mass
    capsules: tuple[Capsule, ...]
    spread: tuple[Capsule, ...] = ()

    def opened(self, opening: float) -> Tool:
        """The same with capsules about its fingers, `opening` [m] apart, and what they spread."""
        aside, low, high = opening / 2 + FINGER / 2, 0.12, self.reach - FINGER
        fingers = (Capsule(6, (0, y, low), (0, y, high), FINGER) for y in (-aside, aside))
        return replace(self, capsules=(*self.capsules, *fingers, *self.spread))


FINGER = 0.014
"""Radius [m] of a capsule about a finger, of 14 x 24 mm at most."""

_HAND = (
    Capsule(6, (0, 0, 0), (0, 0, 0.06), 0.053),
    Capsule(6, (0, -0.048, 0.073), (0, 0.048, 0.073), 0.022),
    Capsule(6, (0, -0.043, 0.093), (0, 0.043, 0.093), 0.022),
    Capsule(6, (0, -0.031, 0.113), (0, 0.031, 0.113), 0.019),
)
"""The 2F-85 above its fingers, which move along the flange's y axis."""

_HAND_MASS = Mass(0.903, (0, 0, 0.044), (0.00087627, 0.0007357, 0.00027307, 0, 0, 0))
"""Of the 2F-85 closed on a cable of 8 mm in MuJoCo Menagerie's model (BSD-2-Clause), by `studies/arm_capsules.py`."""

_KNUCKLES = Capsule(6, (0, -0.042, 0.12), (0, 0.042, 0.12), 0.019)
"""Of the open 2F-85."""

_HAND_E = (Capsule(6, (0, 0, 0), (0, 0, 0.11), 0.039), Capsule(6, (0, 0, 0.11), (0, 0, 0.14), 0.019))
"""The Hand-E: a cylinder with a radius of 37.5 mm, its coupling 1 mm more, and fingers of 30 x 22 mm."""

_HAND_E_MASS = Mass(1.059, (0, 0, 0.0556), (0.00169601, 0.00168528, 0.00059302, 0, 0, 0))
"""Of the Hand-E closed on a cable of 8 mm: hand and fingers as `robotiq_hande_gripper.urdf.xacro` of `cambel/robotiq`
has them (GitHub, commit 3c46b213, after Robotiq's drawings), and a coupling of 119 g as in
`AGH-CEAI/robotiq_hande_description`."""

TOOLS: dict[str, Tool] = {
    "2f-85": Tool(0.161, _HAND_MASS, (*_HAND, Capsule(6, (0, 0, 0.12), (0, 0, 0.14), 0.025)), (_KNUCKLES,)),
    "2f-85-long-fingers": Tool(
        0.241, _HAND_MASS, (*_HAND, Capsule(6, (0, 0, 0.12), (0, 0, 0.23), 0.014)), (_KNUCKLES,)
    ),
    "hand-e": Tool(0.155, _HAND_E_MASS, _HAND_E),
}
"""By the name of their bodies in `GRIPPER_BODIES`; longer fingers weigh nothing more here."""


@dataclass(frozen=True, kw_only=True)
class MountedArm:
    """An arm where it stands.

    Attributes:
        position: Of its base (x, y, z) [m] from the middle of the workspace, at the height of the table.
        angle: Of the base's x axis from that of the workspace [rad].
        model: A name of `ARM_MODELS`, or an arm of one's own.

    Raises:
        TaskError: There is no such model, or a number is out of range.
    """

    position: Place
    angle: checks.Radians = 0.0
    model: Annotated[str | OwnArm, f"{', '.join(ARM_MODELS)}, or a mapping"] = "ur5e"

    def __post_init__(self) -> None:
        checks.check_quantities(self)
        if isinstance(self.model, str) and self.model not in ARM_MODELS:
            raise TaskError(f"must be one of {', '.join(ARM_MODELS)}, got {self.model!r}", ("model",))
        position = checks.rows([self.position], (), (PLACE,) * 3)[0]
        object.__setattr__(self, "position", tuple(position.tolist()))

    @property
    def kind(self) -> ArmModel:
        """What the arm is."""
        return ARM_MODELS[self.model] if isinstance(self.model, str) else self.model.model

    def base(self, scene: Scene | SpatialScene) -> Float[np.ndarray, "4 4"]:
        """Pose of the base in the frame of the workspace, see `base_pose`."""
        return base_pose(self.position, self.angle, scene)


def base_pose(position: Place, angle: float, scene: Scene | SpatialScene) -> Float[np.ndarray, "4 4"]:
    """Pose of a base in the frame of the workspace, x to the right, y up in the plane of the table, z upwards.

    Args:
        position: Of the base (x, y, z) [m] from the middle of the workspace, at the height of the table.
        angle: Of its x axis from that of the workspace [rad].
        scene: The workspace.
    """
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y, z = scene.size[0] / 2 + position[0], scene.size[1] / 2 + position[1], position[2]
    return np.array([[cosine, -sine, 0, x], [sine, cosine, 0, y], [0, 0, 1, z], [0, 0, 0, 1]], dtype=float)


class Way(NamedTuple):
    """How the arms hold a cable, of the gripper at its left end and at its right one.

    Attributes:
        holders: Which of the cell's arms.
        turns: Of its tool: 0 or 1, with the flange's y axis to the left of the cable or to its right.
        branches: Of its inverse kinematics, see `cableway.robot.kinematics`.
    """

    holders: tuple[int, int]
    turns: tuple[int, int]
    branches: tuple[int, int]

    @classmethod
    def of_record(cls, metadata: Mapping[str, Any]) -> Way | None:
        """That of a plan; None where it says of none."""
        arms = metadata.get("arms")
        given: list[Any] = [arms.get(name) for name in cls._fields] if isinstance(arms, dict) else []
        if not given or not all(isinstance(pair, list) and len(pair) == ARMS for pair in given):
            return None
        holders, turns, branches = given
        known = holders in ([0, 1], [1, 0]) and all(turn in (0, 1) for turn in turns)
        if not known or not all(branch in range(8) for branch in branches):
            return None
        return cls(*((int(left), int(right)) for left, right in given))

    def of(self, side: int) -> tuple[int, int, int]:
        """Arm, turn and branch of one gripper."""
        return self.holders[side], self.turns[side], self.branches[side]

    def described(self) -> dict[str, list[int]]:
        """What a record with such joints says of them in its metadata, as `arms`."""
        return {name: list(value) for name, value in self._asdict().items()}


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Two arms with the same tool, and how high things on the table are that do not say so.

    Attributes:
        name: For reports.
        arms: The two.
        tool: A name of `TOOLS`; the grippers' body.
        tilt: By which tools lean outward from straight down, see `Grippers` [rad].
        obstacle_height: Of obstacles without a height [m]; None where nothing passes above them.
        wall_height: The same of the walls. Arms come over the walls in any case; hands and cable stay within them.
        way: How the arms hold the cable already, in a run that is under way; None where that is open. Not in files.

    Raises:
        TaskError: There is no such tool, or there are not two arms.
    """

    name: str
    arms: tuple[MountedArm, ...]
    tool: str = "2f-85"
    tilt: Tilt = 0.0
    obstacle_height: Height = None
    wall_height: Height = None
    way: Way | None = None

    def __post_init__(self) -> None:
        checks.check_quantities(self, "cell")
        object.__setattr__(self, "arms", tuple(self.arms))
        if len(self.arms) != ARMS:
            raise TaskError(f"must be {ARMS} arms, got {len(self.arms)}", ("cell", "arms"))
        if self.tool not in TOOLS:
            raise TaskError(f"must be one of {', '.join(TOOLS)}, got {self.tool!r}", ("cell", "tool"))

    @property
    def reach(self) -> float:
        """From a flange to the axis of the cable between the fingers [m]: that of the tool, and its lift if tilted."""
        return TOOLS[self.tool].reach + lift_of(gripper_body(self.tool), self.tilt)

    @property
    def models(self) -> tuple[ArmModel, ...]:
        """What the arms are."""
        return tuple(arm.kind for arm in self.arms)

    def models_of(self, way: Way) -> tuple[ArmModel, ArmModel]:
        """What the arms at the left and the right gripper are."""
        left, right = way.holders
        return self.models[left], self.models[right]

    def furnished(self, scene: Scene) -> Scene:
        """A scene with the heights of the cell where it states none."""
        tall = tuple(
            solid if solid.height is not None else replace(solid, height=self.obstacle_height)
            for solid in scene.obstacles
        )
        wall = self.wall_height if scene.wall_height is None else scene.wall_height
        return replace(scene, obstacles=tall, wall_height=wall)


CELLS: dict[str, Cell] = {
    f"dual-ur5e{ending}": Cell(
        name=f"dual-ur5e{ending}",
        arms=(
            MountedArm(position=(-0.55, 0.0, 0.15), angle=0.0),
            MountedArm(position=(0.55, 0.0, 0.15), angle=math.pi),
        ),
        tool=tool,
        obstacle_height=0.05,
        wall_height=0.001,
    )
    for ending, tool in (("", "2f-85"), ("-long-fingers", "2f-85-long-fingers"), ("-hand-e", "hand-e"))
}
CELLS |= {
    f"dual-ur5e-tilted{ending}": Cell(
        name=f"dual-ur5e-tilted{ending}",
        arms=(
            MountedArm(position=(aside, -0.55, 0.0), angle=math.pi / 2),
            MountedArm(position=(aside, 0.55, 0.0), angle=-math.pi / 2),
        ),
        tilt=0.17,
        obstacle_height=0.05,
        wall_height=0.001,
    )
    for ending, aside in (("", 0.0), ("-aside", 0.15))
}
CELLS["dual-ur10e"] = Cell(
    name="dual-ur10e",
    arms=(
        MountedArm(position=(-0.8, 0.0, 0.0), angle=0.0, model="ur10e"),
        MountedArm(position=(0.8, 0.0, 0.0), angle=math.pi, model="ur10e"),
    ),
    obstacle_height=0.05,
    wall_height=0.001,
)
"""By name: two UR5e at either side of a table of up to 0.8 m, facing each other, on pedestals of 15 cm; and before and
behind it, without pedestals, their tools tilted, in front of its middle or aside; and two UR10e at either side. See
`studies/cell_layouts.py`."""
