"""Ends of a task that the bodies of its grippers or its arms cannot hold, moved by as little as is needed.

Shapes about the designed one are drawn, from near to far, until one is free and can be held. Then the way back from it
is tried, and shapes about what that leaves.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from cableway.core.errors import PlanningError
from cableway.core.quantities import quantity
from cableway.geometry import polyline
from cableway.motion.limits import Margins
from cableway.motion.validity import FreeSpace
from cableway.planning.config import PlannerConfig
from cableway.planning.initial_trajectories import InitialTrajectories
from cableway.robot.branches import NoMotion, PackedCell, possible_ways
from cableway.rod.inverse import fit_keypoints
from cableway.scene import validity
from cableway.scene.cell import Cell, Way
from cableway.scene.files.loading import TaskSource, as_draft, as_task, load_cell
from cableway.scene.task import END_DECIMALS, ENDS, Draft, End, Task

DISTANCES = (0.003, 0.006, 0.012, 0.024, 0.04, 0.06, 0.08, 0.1)
"""About how far [m] keypoints of the drawn shapes are moved, and the farthest that any is at last."""

SAMPLES = 400
"""Shapes drawn for each of them."""

LOOKED_AT = 60
"""Free shapes, of those the nearest, of which it is asked whether arms can hold them."""

BACK, CLOSER = 24, 4
"""Steps of the way back to the designed shape, and times that nearer ones are drawn about the one found."""

SPREAD = (1.0, 1.0, 10.0, 160.0, 160.0, 40.0)
"""Standard deviations of rod coordinates [m, m, rad, -, -, -] for a move of 1 m: about as wide as a tube of
RRT-Connect."""

SLID_ROWS, FOLLOWED = 60, 0.9
"""Of a cable slid from start to goal along one curve, rows that are looked at, and the share of them that a way in
which arms can hold it must keep for both ends to be moved into it."""

MOST_WAYS = 8
"""Of them, how many are tried."""

APART = "the arms cannot hold both ends in the same branches of their joints"


@dataclass(frozen=True)
class MovedEnds:
    """A task whose ends can be held.

    Attributes:
        task: The task.
        moved: By how much the farthest keypoint of each end that was moved is off the designed one [m].
        reasons: Why.
    """

    task: Task
    moved: Mapping[End, float] = field(default_factory=dict)
    reasons: Mapping[End, str] = field(default_factory=dict)

    def notes(self) -> tuple[str, ...]:
        """What was moved, a sentence for each end."""
        return tuple(
            f"The {end} was moved by {quantity(far)}, because {self.reasons[end]}." for end, far in self.moved.items()
        )


def set_up(source: TaskSource, cell: Cell | str | None = None, *, move: bool = False) -> MovedEnds:
    """A task, or that of a name or file, put into a cell if one is given, its ends moved if that is asked for.

    Raises:
        InputError: There is no such task or cell, or an end is in collision, and not to be moved or not movable.
    """
    cell = load_cell(cell) if isinstance(cell, str) else cell
    draft = as_draft(source).unchecked() if move else as_task(source)
    draft = draft if cell is None else draft.in_cell(cell)
    return MovedEnds(draft) if isinstance(draft, Task) else move_ends(draft)


def move_ends(draft: Draft) -> MovedEnds:
    """The task with the ends that bodies or arms cannot hold moved, if there are any and a shape is found near them.

    A moved end keeps what plans keep (`Margins`), and a plug stays before its port. Of two ends that arms can hold, but
    not in the same way, the one that has less far to go is moved; or both, into the way in which arms can nearly follow
    a cable slid along one curve, to which the arms are then held. Where no shape is found, the task is as designed, and
    the planner says why not.

    Args:
        draft: The task, with its cell if it has one; bodies may be in collision at its ends.

    Raises:
        TaskError: An end has a fault that is not one of bodies, or none is found that bodies can hold.
    """
    if any(_is_wrong(draft, end) for end in ENDS):
        return MovedEnds(_task(draft))
    mover = _Mover(draft)
    start, goal = (mover.designed(end) for end in ENDS)
    if start.ways & goal.ways:
        return MovedEnds(_task(draft))
    way: Way | None = None
    if start.ways and goal.ways:
        way, changed = mover.into_one_way(start, goal)
        if way is None:
            found = [mover.moved(goal, start.ways, APART), mover.moved(start, goal.ways, APART)]
            changed = [min((each for each in found if each), key=lambda each: each.distance, default=None)]
    else:
        bad, other = (goal, start) if start.ways else (start, goal)
        changed = [mover.moved(bad, other.ways or None)]
        if not other.ways and changed[0]:
            changed.append(mover.moved(other, changed[0].ways))
    ends = [each for each in changed if each]
    if len(ends) < len(changed):
        return MovedEnds(_task(draft))
    task = _task(draft, ends)
    return MovedEnds(
        task if way is None else task.held(way),
        {each.end: each.distance for each in ends},
        {each.end: each.fault for each in ends},
    )


@dataclass(frozen=True)
class _Held:
    """An end of the task, as designed or moved.

    Attributes:
        end: Which.
        q: The cable's shape.
        ways: How arms can hold it; {None} where there are no arms, and empty where it cannot be held.
        fault: Why not, or why it was moved.
        distance: Of the farthest keypoint from where it was designed [m].
    """

    end: End
    q: Float[np.ndarray, "dof"]
    ways: Set[Way | None]
    fault: str = ""
    distance: float = 0.0


class _Mover:
    """Draws shapes of a task's cable until bodies and arms can hold one."""

    def __init__(self, draft: Draft) -> None:
        self.draft, self.rod, self.rng = draft, draft.cable.rod, np.random.default_rng(0)
        self.space = FreeSpace.around(np.empty((0, self.rod.dof)), draft, Margins())
        self.packed = None if draft.cell is None else PackedCell(draft, draft.cell)

    def designed(self, end: End) -> _Held:
        """An end as the task has it."""
        q = fit_keypoints(self.rod, getattr(self.draft, end))[0]
        faults = [fault for fault in self.draft.faults() if fault.place and str(fault.place[0]).startswith(end)]
        if faults:
            return _Held(end, q, frozenset(), f"it {faults[0].problem}")
        return _Held(end, q, *self._ways(q))

    def moved(self, held: _Held, wanted: Set[Way | None] | None, fault: str = "") -> _Held | None:
        """The nearest shape found that can be held, in one of the ways `wanted` if any are given."""

        def first(rows: Float[np.ndarray, "k dof"], below: float) -> _Held | None:
            away = self._displacement(rows, held.q)
            near = np.flatnonzero((away < below) & self.space.are_free(rows))
            near = near[self._before_port(held.end, rows[near])]
            for k in near[np.argsort(away[near], kind="stable")][:LOOKED_AT]:
                ways = self._ways(rows[k])[0]
                if ways if wanted is None else ways & wanted:
                    return _Held(held.end, rows[k], ways, fault or held.fault, float(away[k]))
            return None

        drawn = (first(self._about(held.q, distance), DISTANCES[-1]) for distance in DISTANCES)
        found = next((each for each in drawn if each), None)
        for _ in range(CLOSER if found else 0):
            assert found is not None
            back = held.q + np.linspace(0, 1, BACK)[:, None] * (found.q - held.q)
            found = first(back, found.distance) or found
            found = first(self._about(found.q, found.distance / 4), found.distance) or found
        return found

    def into_one_way(self, start: _Held, goal: _Held) -> tuple[Way | None, list[_Held | None]]:
        """The way that a slid cable keeps most, and the ends moved into it; None where there is no such way."""
        for way in self._followed()[:MOST_WAYS]:
            found = [self.moved(held, {way}, APART) for held in (start, goal) if way not in held.ways]
            if all(found):
                return way, found
        return None, []

    def _followed(self) -> list[Way]:
        """Ways in which arms can hold the cable in most rows as it slides from start to goal, the best first."""
        assert self.packed is not None
        try:
            slid = InitialTrajectories(self.draft.checked(), PlannerConfig()).make("slide-head")
        except PlanningError:
            return []
        rows = polyline.end_poses(slid.shapes[np.linspace(0, len(slid.shapes) - 1, SLID_ROWS).astype(int)])
        found = (possible_ways(row, self.packed) for row in rows)
        kept = Counter(way for ways in found if not isinstance(ways, NoMotion) for way in ways)
        return [way for way, count in kept.most_common() if count >= FOLLOWED * SLID_ROWS]

    def _before_port(self, end: End, rows: Float[np.ndarray, "k dof"]) -> Bool[np.ndarray, "k"]:
        """Which shapes bring a plug before its port, where that is asked of the end."""
        plug, port = self.draft.plug, self.draft.port
        if end != "goal" or plug is None or port is None:
            return np.ones(len(rows), bool)
        poses = self.rod.shapes(rows)[1][:, 1]
        return np.array([not any(validity.port_faults(pose, plug, port)) for pose in poses], bool)

    def _ways(self, q: Float[np.ndarray, "dof"]) -> tuple[Set[Way | None], str]:
        if self.packed is None:
            return frozenset({None}), ""
        found = possible_ways(self.rod.shapes(q[None])[1][0], self.packed)
        return (frozenset(), found.reason) if isinstance(found, NoMotion) else (frozenset(found), "")

    def _about(self, q: Float[np.ndarray, "dof"], distance: float) -> Float[np.ndarray, "k dof"]:
        longer = np.array([1.0, 1.0, *[0.3 / self.rod.length] * (self.rod.dof - 2)])  # as of a cable of 0.3 m
        return q + distance * longer * SPREAD * self.rng.normal(size=(SAMPLES, self.rod.dof))

    def _displacement(self, rows: Float[np.ndarray, "k dof"], q: Float[np.ndarray, "dof"]) -> Float[np.ndarray, "k"]:
        keypoints = self.rod.at_keypoints(self.rod.shapes(np.vstack([q, rows]))[0])
        return np.linalg.norm(keypoints[1:] - keypoints[0], axis=2).max(axis=1)


def _is_wrong(draft: Draft, end: End) -> bool:
    """Whether an end has another fault than that bodies are in something."""
    shape = getattr(draft, end)
    if shape is None:
        return True
    return any(validity.shape_faults(end, shape, draft.scene, draft.cable, draft.grippers))


def _task(draft: Draft, ends: list[_Held] | None = None) -> Task:
    rod, changes = draft.cable.rod, dict[str, Any]()
    for each in ends or ():
        keypoints = rod.at_keypoints(rod.shapes(each.q[None])[0])[0]
        changes |= {each.end: keypoints.round(END_DECIMALS), f"{each.end}_poses": None}
    return replace(draft, **changes).checked()
