"""What appears on the table during a run, by depth cameras: obstacles that the task does not have."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import NamedTuple

import shapely

from cableway.core.errors import InputError
from cableway.perception.survey import Survey, survey
from cableway.scene.obstacles import Polygon, to_shapely
from cableway.scene.scene import Scene
from cableway.tracking.photographer import DepthViews

EVERY, LATE = 0.5, 0.5
"""Time [s] from one survey to the next, and until its result is there: on one core it takes 0.3 to 0.8 s."""

ROUNDING = 1e-9
"""[s]."""

NEAR = 0.02
"""How far [m] about obstacles that are known nothing is new: outlines are 10 mm too large, 16 at worst."""

SAME = 0.01
"""How far [m] an outline may stand out of that of before and be of what has not moved."""

MISSES = 2
"""Surveys in a row that see the table free where something stood, until it is free."""


class Standing(NamedTuple):
    """Something that appeared, and how many surveys in a row have seen the table there instead."""

    outline: Polygon
    misses: int = 0


class Lookout:
    """Keeps what appeared on a table.

    Something that two surveys in a row show stands there. It stays, or is where it was seen last, until two in a row
    show that the table is free there: what no camera sees has not gone. What the task has never goes.

    Args:
        scene: What is known to stand there.

    Attributes:
        appeared: What stands there besides.
        surveys: How many there were.
        failures: How many of them showed too little of the table.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, self._known = scene, scene
        self._candidates: tuple[Polygon, ...] = ()
        self._standing: list[Standing] = []
        self._coming: deque[tuple[float, Survey]] = deque()
        self._next = 0.0
        self.surveys = self.failures = 0

    @property
    def appeared(self) -> tuple[Polygon, ...]:
        """Outlines with heights."""
        return tuple(each.outline for each in self._standing)

    @property
    def scene(self) -> Scene:
        """What is known to stand there, with what appeared."""
        return self._known

    def is_due(self, now: float) -> bool:
        """Whether the table is to be looked at [s]."""
        return now >= self._next - ROUNDING

    def look(self, now: float, views: DepthViews) -> None:
        """Look at the table, which is understood `LATE` after that."""
        self._next, self.surveys = self._next + EVERY, self.surveys + 1
        try:
            self._coming.append((now + LATE, survey(views, self._scene.size)))
        except InputError:  # too little of the table is seen: nothing is learnt
            self.failures += 1

    def learn(self, now: float) -> bool:
        """Take note of what is understood by now [s]; whether the scene is another one."""
        before = self.appeared
        while self._coming and self._coming[0][0] <= now + ROUNDING:
            self.note(self._coming.popleft()[1])
        if self.appeared == before:
            return False
        self._known = replace(self._scene, obstacles=(*self._scene.obstacles, *self.appeared))
        return True

    def note(self, found: Survey) -> None:
        """Take note of a survey."""
        news = found.beyond(self._scene, NEAR)
        doubt = shapely.union_all([to_shapely(each) for each in found.hidden])
        kept, used = [], set[int]()
        for outline, misses in self._standing:
            here = [k for k, new in enumerate(news) if _touch(new, outline)]
            used.update(here)
            around = to_shapely(outline).buffer(SAME)
            if here and all(around.covers(to_shapely(news[k])) for k in here):
                kept.append(Standing(outline))
            elif here:
                kept += [Standing(news[k]) for k in here]
            elif shapely.intersects(to_shapely(outline), doubt):
                kept.append(Standing(outline))
            elif misses + 1 < MISSES:
                kept.append(Standing(outline, misses + 1))
        others = tuple(new for k, new in enumerate(news) if k not in used)
        entered = [new for new in others if any(_touch(new, each) for each in self._candidates)]
        self._standing = [*kept, *map(Standing, entered)]
        self._candidates = tuple(new for new in others if new not in entered)


def _touch(a: Polygon, b: Polygon) -> bool:
    return bool(shapely.intersects(to_shapely(a), to_shapely(b)))
