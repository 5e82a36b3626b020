"""What is taken to stand where something that nobody knows of held the cable."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from cableway.control.base import Contact
from cableway.core.quantities import place
from cableway.geometry import se2
from cableway.scene.clearance import lowest_above
from cableway.scene.obstacles import Disc
from cableway.scene.task import Task

SUSPECTED = (0.015, 0.01, 0.006, 0.003)
"""Radii [m] of discs of which one is then taken to stand beside the cable; keypoints are some 25 mm apart."""

UNSURE = 0.003
"""How far [m] such a disc reaches beyond where it would just touch the cable: its place is known no better."""

LEAST_ROOM = 0.001
"""Clearance [m] that such a disc leaves to the cable and to the goal."""

NAMES = ("left", "right")
"""Of the grippers."""

KNOWN = 0.02
"""Distance [m] of an obstacle up to which it is what holds the cable, and nothing unknown."""


FAN = math.radians(60)
"""Angle [rad] to either side of a gripper's way at which what it ran into may stand, too."""


class Obstruction(NamedTuple):
    """Something that is not known and stands in the way of a gripper.

    Attributes:
        side: Of the gripper, 0 for left.
        place: Of the gripper [m].
        ahead: Unit vector of its way.
    """

    side: int
    place: Float[np.ndarray, "2"]
    ahead: Float[np.ndarray, "2"]

    def __str__(self) -> str:
        return f"something unknown seems to stand before the {NAMES[self.side]} gripper near {place(self.place)}"

    def contacts(self, task: Task) -> list[Contact]:
        """Where a cable as wide as the gripper would touch it: ahead and to either side."""
        normals = [-self.ahead @ se2.rotation(angle).T for angle in (-FAN, 0.0, FAN)]
        beyond = task.grippers.radius - task.cable.radius
        return [Contact(self.place - beyond * normal, normal) for normal in normals]


def held_up(contact: Contact) -> str:
    """What a report says of a contact that nobody expected."""
    return f"something unknown seems to hold the cable near {place(contact.place)}"


def suspected(
    contacts: Sequence[Contact], keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"], task: Task
) -> list[Disc]:
    """Where something may stand that held the cable: the largest of some discs in which neither cable nor goal lies.

    It is as high as the cable at least, and no higher than what of a gripper is above it now or will be at the goal,
    nor in a cell than its obstacles are, as arms may be above it: for all that is known, anything in between. None
    where something known is near.

    Args:
        contacts: Where it may have been held; one disc each.
        keypoints: (n, 2) where the cable lies now [m].
        poses: (2, 3) where the grippers are [m, m, rad].
        task: With the scene as it is known.
    """
    unknown = [contact for contact in contacts if not _is_known(contact, task)]
    found = [_largest(contact, (keypoints, task.goal), poses, task) for contact in unknown]
    return [disc for disc in found if disc is not None]


def has_left(
    contacts: Sequence[Contact], keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"], task: Task
) -> bool:
    """Whether a cable that is led back leaves as much room for what held it as the goal does.

    One that does not, or is not seen whole, may still touch it. Args as for `suspected`.
    """
    return bool(np.isfinite(keypoints).all()) and all(
        _largest(contact, (keypoints, task.goal), poses, task) == _largest(contact, (task.goal,), poses, task)
        for contact in contacts
        if not _is_known(contact, task)
    )


def narrowed(discs: Sequence[Disc], keypoints: Float[np.ndarray, "n 2"], task: Task) -> list[Disc]:
    """What is left of suspected discs of a cable that lies along `keypoints` [m], so that nothing stands there."""
    line, left = shapely.LineString(keypoints), []
    for disc in discs:
        room = line.distance(shapely.Point(disc.center)) - task.cable.radius - LEAST_ROOM
        if room >= disc.radius:
            left.append(disc)
        elif room >= SUSPECTED[-1]:
            left.append(replace(disc, radius=room))
    return left


def _is_known(contact: Contact, task: Task) -> bool:
    return bool(task.scene.signed_distance(contact.place) < KNOWN)


def _largest(
    contact: Contact, shapes: tuple[Float[np.ndarray, "n 2"], ...], poses: Float[np.ndarray, "2 3"], task: Task
) -> Disc | None:
    """The largest disc beside the cable at a contact in which none of some shapes [m] lies, nor their grippers, and
    above which no gripper is lower than the cable is thick.
    """
    lines = [shapely.LineString(shape) for shape in shapes]
    ends = shapely.MultiPoint(np.concatenate([shape[[0, -1]] for shape in shapes]))
    for beyond in SUSPECTED:
        center = contact.place - (beyond + task.cable.radius) * contact.direction
        radius = beyond + UNSURE
        there = shapely.Point(center)
        beside = min(line.distance(there) for line in lines) - task.cable.radius
        if min(beside, ends.distance(there) - task.grippers.radius) > radius + LEAST_ROOM:
            least = lowest_above(there.buffer(radius + LEAST_ROOM), [poses, task.gripper_poses("goal")], task.bodies)
            if task.cell is not None and task.cell.obstacle_height is not None:
                least = min(least, task.cell.obstacle_height)
            if least >= 2 * task.cable.radius:
                at, height = (float(center[0]), float(center[1])), None if math.isinf(least) else least
                return Disc(center=at, radius=radius, height=height)
    return None
