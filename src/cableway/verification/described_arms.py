"""Arms of any kind along a plan: own kinematics, as a product of exponentials, and distances by Coal.

Where joints and solids of an arm are comes from its file, as it was read for the motion; nothing else is shared with
what made it. Between rows joints move evenly; the motion is looked at where no solid has moved by more than `STEP`, and
what it may have come nearer in between is taken off the clearance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from cableway.core.extras import require
from cableway.records import Check
from cableway.scene.chains import Chain, ChainSolid
from cableway.scene.gripper_bodies import ABOVE_TABLE
from cableway.scene.spatial.obstacles import Prism
from cableway.scene.task import CONTROL_STEP, Task
from cableway.verification.arms import CLEARANCE, FINEST, STEP, TIP, TIP_ANGLE, most
from cableway.verification.geometry import pose_distance
from cableway.verification.spatial_distance import between, hull, library, nearest, shape_of

NEIGHBOURS = 2
"""Joints between two links of an arm whose solids may overlap, as those of neighbours do at their joint."""

ABOVE = 2.0
"""Height [m] of what nothing passes above."""


class _Placed(NamedTuple):
    """A solid at every look: what it is called, its shape and poses (s, 4, 4), and a ball about it [m]."""

    name: str
    shape: Any
    poses: Float[np.ndarray, "s 4 4"]
    middle: Float[np.ndarray, "s 3"]
    radius: float


def described_arm_checks(
    poses: Float[np.ndarray, "t 2 3"], joints: Float[np.ndarray, "t 2 j"], chains: tuple[Chain, Chain],
    turns: tuple[int, int], task: Task, obstacle_height: float | None = None,
) -> list[Check]:  # fmt: skip
    """Whether arms hold the grippers along a plan, within their joints' limits, and touch nothing.

    Hands are compared with the other arm's links and the table; with obstacles and the other hand only where grippers
    of the plan have no body, which stands for them and is judged with the plan.

    Args:
        poses: Of the grippers [m, m, rad], a control step from row to row.
        joints: Of the arms that hold the left and the right end of the cable then [rad].
        chains: These arms.
        turns: How their hands are turned: 0 or 1, with the frame's y axis to the left of the cable or to its right.
        task: The task.
        obstacle_height: Of obstacles without a height [m]; None where nothing passes above them.

    Raises:
        MissingExtraError: Coal is not installed.
    """
    require("arms", "the verification of arms of other kinds")
    looks = _looks(joints, chains)
    row = np.minimum(looks.astype(int), len(joints) - 2)
    dense = joints[row] + (looks - row)[:, None, None] * (joints[row + 1] - joints[row])
    arms, hands = [_placed(chain, dense[:, arm]) for arm, chain in enumerate(chains)], task.grippers.body is None
    step = max(_moves(each).max(initial=0.0) for arm in arms for each in arm)
    table, *obstacles = _things(task, obstacle_height, len(looks))
    standing = _among(arms, chains, lambda solid: not solid.hand and solid.link > 0, [table, *obstacles])
    standing += _among(arms, chains, lambda solid: solid.hand and hands, obstacles)
    low = _among(arms, chains, lambda solid: solid.hand, [table])  # which hands move along, so nothing is taken off
    return [
        *_tips(poses, dense, looks, chains, turns, task),
        *_limits(joints, chains),
        _closest("arm clearance", _met(arms, chains, hands), looks, step, CLEARANCE),
        _closest("arm clearance from the table", standing, looks, step / 2, CLEARANCE),
        _closest("hand clearance from the table", low, looks, 0.0, ABOVE_TABLE / 2),
    ]


def _motions(chain: Chain, joints: Float[np.ndarray, "s j"]) -> list[Float[np.ndarray, "s 4 4"]]:
    """Motions of what 0, 1, ... j joints move, from where it is with all of them at zero (Lynch and Park 2017, 4.1)."""
    moved, found = np.tile(np.eye(4), (len(joints), 1, 1)), []
    found.append(moved)
    for joint, angle in zip(chain.joints, joints.T, strict=True):
        turn = np.tile(np.eye(4), (len(joints), 1, 1))
        turn[:, :3, :3] = Rotation.from_rotvec(angle[:, None] * joint.axis).as_matrix()
        turn[:, :3, 3] = joint.point - turn[:, :3, :3] @ joint.point
        moved = moved @ turn
        found.append(moved)
    return found


def _placed(chain: Chain, joints: Float[np.ndarray, "s j"]) -> list[_Placed]:
    """The solids of an arm."""
    motions, found = _motions(chain, joints), []
    for solid in chain.solids:
        poses = motions[solid.link] @ solid.pose
        shape, middle, radius = _shape(solid)
        found.append(_Placed(solid.name, shape, poses, poses[:, :3, :3] @ middle + poses[:, :3, 3], radius))
    return found


def _shape(solid: ChainSolid) -> tuple[Any, Float[np.ndarray, "3"], float]:
    """Coal's shape of a solid, and centre and radius [m] of a ball about it, in its frame."""
    coal, (x, y, z) = library(), solid.size
    match solid.kind:
        case "sphere":
            return coal.Sphere(x), np.zeros(3), x
        case "capsule":
            return coal.Capsule(x, 2 * y), np.zeros(3), x + y
        case "cylinder":
            return coal.Cylinder(x, 2 * y), np.zeros(3), float(np.hypot(x, y))
        case "box":
            return coal.Box(2 * x, 2 * y, 2 * z), np.zeros(3), float(np.linalg.norm(solid.size))
        case _:
            middle = (solid.vertices.min(axis=0) + solid.vertices.max(axis=0)) / 2
            return hull(solid.vertices), middle, float(np.linalg.norm(solid.vertices - middle, axis=1).max())


def _looks(joints: Float[np.ndarray, "t 2 j"], chains: tuple[Chain, Chain]) -> Float[np.ndarray, "s"]:
    """Fractional rows between which no solid moves by more than `STEP`, or `FINEST` of them from row to row."""
    moved = np.max(
        [_moves(each) for arm, chain in enumerate(chains) for each in _placed(chain, joints[:, arm])], axis=0
    )
    counts = np.clip(np.ceil(moved / STEP), 1, FINEST).astype(int)
    return np.concatenate([*(row + np.arange(n) / n for row, n in enumerate(counts)), [len(joints) - 1]])


def _moves(each: _Placed) -> Float[np.ndarray, "moves"]:
    """By how much any point of a solid moves from look to look, at most [m]."""
    turned = np.einsum("sji,sjk->sik", each.poses[:-1, :3, :3], each.poses[1:, :3, :3])
    angle = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1.0, 1.0))
    return np.linalg.norm(np.diff(each.middle, axis=0), axis=1) + angle * each.radius


def _tips(
    poses: Float[np.ndarray, "t 2 3"], dense: Float[np.ndarray, "s 2 j"], looks: Float[np.ndarray, "s"],
    chains: tuple[Chain, Chain], turns: tuple[int, int], task: Task,
) -> list[Check]:  # fmt: skip
    """How far hands are from the grippers' poses, and how far they lean."""
    rows, off, askew = np.arange(len(poses)), [], []
    for side, (chain, turn) in enumerate(zip(chains, turns, strict=True)):
        tips = _motions(chain, dense[:, side])[-1] @ chain.tip
        along = tips[:, :3, 0] * (-1.0 if turn == 0 else 1.0)
        seen = np.column_stack([tips[:, :2, 3], np.arctan2(along[:, 1], along[:, 0])])
        gap, angle = pose_distance(seen, np.column_stack([np.interp(looks, rows, c) for c in poses[:, side].T]))
        off.append(np.hypot(gap, tips[:, 2, 3] - task.cable.radius))
        askew.append(np.maximum(angle, np.arccos(np.clip(-tips[:, 2, 2], -1.0, 1.0))))
    return [
        most("tool distance", np.max(off, axis=0), "m", TIP, looks),
        most("tool angle", np.max(askew, axis=0), "rad", TIP_ANGLE, looks),
    ]


def _limits(joints: Float[np.ndarray, "t 2 j"], chains: tuple[Chain, Chain]) -> list[Check]:
    """Joints beyond their ranges [rad], and faster than they can."""
    low, high = (np.array([[joint.range[k] for joint in chain.joints] for chain in chains]) for k in range(2))
    beyond = np.max([low - joints, joints - high], axis=0).max(axis=(1, 2))
    speeds = np.abs(np.diff(joints, axis=0)) / CONTROL_STEP
    share = np.max([speeds[:, arm] / chain.speed_limit for arm, chain in enumerate(chains)], axis=(0, 2))
    return [
        most("joint position beyond its range", beyond, "rad", 0.0, np.arange(len(beyond))),
        most("joint speed", share, "1", 1.0, np.arange(len(share))),
    ]


def _met(arms: list[list[_Placed]], chains: tuple[Chain, Chain], hands: bool) -> list[tuple[_Placed, _Placed]]:
    """What of the two arms could touch; hand and hand only if `hands`."""
    both = list(product(*(list(zip(arm, chain.solids, strict=True)) for arm, chain in zip(arms, chains, strict=True))))
    pairs = [(a, b) for (a, one), (b, other) in both if hands or not (one.hand and other.hand)]
    for arm, chain in zip(arms, chains, strict=True):
        for (a, one), (b, other) in combinations(zip(arm, chain.solids, strict=True), 2):
            if abs(one.link - other.link) > NEIGHBOURS:
                pairs.append((a, b))
    return pairs


def _things(task: Task, height: float | None, looks: int) -> list[_Placed]:
    """The table, and what stands on it."""
    pose = np.eye(4)
    pose[2, 3] = -0.5
    things = [_still("the table", library().Box(10.0, 10.0, 1.0), pose, np.zeros(3), 10.0, looks)]
    for index, obstacle in enumerate(task.scene.obstacles):
        stated = height if obstacle.height is None else obstacle.height
        shape = shape_of(Prism(section=replace(obstacle, height=stated)), ABOVE)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = shape.place.getRotation(), shape.place.getTranslation()
        middle, radius = (shape.low + shape.high) / 2, float(np.linalg.norm(shape.high - shape.low) / 2)
        things.append(_still(task.scene.name_of(index), shape.solid, pose, middle, radius, looks))
    return things


def _still(
    name: str, shape: Any, pose: Float[np.ndarray, "4 4"], middle: Float[np.ndarray, "3"], radius: float, looks: int
) -> _Placed:
    return _Placed(name, shape, pose[None].repeat(looks, 0), middle[None].repeat(looks, 0), radius)


def _among(
    arms: list[list[_Placed]], chains: tuple[Chain, Chain], which: Callable[[ChainSolid], bool], things: list[_Placed]
) -> list[tuple[_Placed, _Placed]]:
    """Each of the solids that could touch some things, with each of these."""
    solids = [pair for arm, chain in zip(arms, chains, strict=True) for pair in zip(arm, chain.solids, strict=True)]
    return [(each, thing) for each, solid in solids if which(solid) for thing in things]


def _closest(
    name: str, pairs: list[tuple[_Placed, _Placed]], looks: Float[np.ndarray, "s"], step: float, limit: float
) -> Check:
    """Least clearance of pairs, less what they may come nearer between looks."""
    if not pairs:
        return most(name, np.zeros(0), "m", limit, np.zeros(0))
    transform = library().Transform3s

    def gap(pair: int, row: int) -> float:
        a, b = pairs[pair]
        at_a, at_b = (transform(each.poses[row, :3, :3], each.poses[row, :3, 3]) for each in (a, b))
        return between(a.shape, at_a, b.shape, at_b)

    bounds = np.array([np.linalg.norm(a.middle - b.middle, axis=1) - a.radius - b.radius for a, b in pairs])
    least, pair, row = nearest(bounds, gap)
    a, b = pairs[pair]
    value = least - step
    return Check(name, value, "m", limit, value >= limit and value > 0, f"{a.name} and {b.name}", float(looks[row]))
