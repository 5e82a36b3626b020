"""Files of arms as others describe them, made from numbers: a UR5e, and an arm with seven joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cableway.robot.kinematics import link_frames
from cableway.scene.arm_models import UR5E
from cableway.scene.cell import TOOLS
from cableway.scene.described_arms import DescribedArm, DescribedArms

REACH = TOOLS["2f-85"].reach
HAND = "".join(
    f'<geom type="capsule" fromto="0 {-y} {low} 0 {y} {high}" size="{radius}"/>'
    for y, low, high, radius in ((0, 0, 0.06, 0.053), (0.048, 0.073, 0.073, 0.022), (0.031, 0.113, 0.113, 0.019))
)


def placed(frame: np.ndarray) -> str:
    """Attributes of a body in the frame before it."""
    quat = Rotation.from_matrix(frame[:3, :3]).as_quat(scalar_first=True)
    return 'pos="{} {} {}" quat="{} {} {} {}"'.format(*frame[:3, 3], *quat)


def ur5e_steps() -> list[np.ndarray]:
    """The frame of each link in that before, with all joints at zero."""
    frames, out = np.tile(np.eye(4), (7, 1, 1)), np.empty((7, 3, 4))
    link_frames(np.array(UR5E.lengths), np.eye(4), np.zeros(6), out)
    frames[:, :3] = out
    return [np.linalg.inv(frames[k]) @ frames[k + 1] for k in range(6)]


def ur5e_mjcf(hand: str = HAND) -> str:
    """A UR5e whose joints are those of `UR5E`: link i turns about the z axis of frame i - 1."""
    opened, closed = [], []
    for k, step in enumerate(ur5e_steps()):
        turned, limit = np.eye(4), UR5E.position_limit[k]
        capsules = "".join(
            '<geom type="capsule" fromto="{} {} {} {} {} {}" size="{}"/>'.format(*each.start, *each.end, each.radius)
            for each in UR5E.capsules
            if each.frame == k + 1 and each.start != each.end
        )
        opened.append(
            f'<body name="turn{k}" {placed(turned)}><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
            f'<joint name="{k}" axis="0 0 1" range="{-limit} {limit}"/>'
            f'<body name="link{k + 1}" {placed(step)}>{capsules}'
        )
        closed.append("</body></body>")
    tool = f'<body name="hand">{hand}<site name="grasp" pos="0 0 {REACH}"/></body>'
    base = '<geom type="cylinder" size="0.07 0.04" pos="0 0 0.04"/>'
    body = f'<body name="base">{base}{"".join(opened)}{tool}{"".join(closed)}</body>'
    options = '<compiler angle="radian"/><option cone="elliptic" impratio="10"/>'  # which other models do not have
    return f"<mujoco>{options}<worldbody>{body}</worldbody></mujoco>"


SEVEN = (Path(__file__).parents[1] / "examples" / "arms" / "seven-joints.xml").read_text()
"""An arm with seven joints."""


def ur5e_urdf() -> str:
    """The same UR5e as a URDF, with cylinders for links, whose last link is fixed to the hand."""
    links, joints = ['<link name="base"/>'], []
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    before, step = "base", np.eye(4)
    for k, after in enumerate(ur5e_steps()):
        euler = Rotation.from_matrix(step[:3, :3]).as_euler("xyz")
        origin = '<origin xyz="{} {} {}" rpy="{} {} {}"/>'.format(*step[:3, 3], *euler)
        limit = UR5E.position_limit[k]
        shape = '<geometry><cylinder radius="0.05" length="0.06"/></geometry>'
        links.append(f'<link name="turn{k}">{inertial}<collision>{shape}</collision></link>')
        joints.append(
            f'<joint name="{k}" type="revolute"><parent link="{before}"/><child link="turn{k}"/>{origin}'
            f'<axis xyz="0 0 1"/><limit lower="{-limit}" upper="{limit}" effort="100" velocity="3"/></joint>'
        )
        before, step = f"turn{k}", after
    euler = Rotation.from_matrix(step[:3, :3]).as_euler("xyz")
    at = step[:3, 3] + REACH * step[:3, 2]
    origin = '<origin xyz="{} {} {}" rpy="{} {} {}"/>'.format(*at, *euler)
    links.append('<link name="grasp"/>')
    joints.append(f'<joint name="grip" type="fixed"><parent link="{before}"/><child link="grasp"/>{origin}</joint>')
    return f'<robot name="arm">{"".join(links + joints)}</robot>'


def two(path: Path, text: str, *, apart: float = 1.1, height: float = 0.15, **limits: float) -> DescribedArms:
    """Two arms of a file with this text, at either side of the table, facing each other."""
    path.write_text(text)
    arms = (
        DescribedArm(model=str(path), frame="grasp", position=(side * apart / 2, 0.0, height), angle=angle,
                     speed_limit=limits.get("speed_limit", 3.0))
        for side, angle in ((-1, 0.0), (1, np.pi))
    )  # fmt: skip
    return DescribedArms(name="two", arms=tuple(arms), obstacle_height=0.05)
