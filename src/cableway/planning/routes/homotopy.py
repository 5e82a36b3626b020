"""Ways round obstacles: which of them a path takes, and pivot paths that take different ones.

Two motions of a cable from the same start to the same goal can be turned into each other without touching an obstacle
only if the paths of its middle can: the cable itself ties every other point's path to that one. So the class of a
motion is that of one path.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import count, pairwise

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import PlanningError
from cableway.planning.config import PivotConfig
from cableway.planning.routes.passages import find_passages, traversed_passages
from cableway.planning.routes.pivot import pivot_cost, pivot_keypoint, plan_pivot_path
from cableway.records import Passage
from cableway.scene.obstacles import Box
from cableway.scene.scene import Scene
from cableway.scene.task import Task

THIN = 0.001
"""Thickness [m] of the wall that closes a passage."""


def signature(scene: Scene, path: Float[np.ndarray, "P 2"]) -> tuple[int, ...]:
    """The homotopy class of a path among paths with the same ends: the reduced word of its crossings of rays.

    A ray goes straight up from a point inside each obstacle, or group of obstacles that touch. Crossing that of group
    k = 1, 2, ... to the right writes k, to the left -k, and a letter followed by its opposite goes away (Bhattacharya,
    Likhachev & Kumar 2012).

    >>> from cableway.scene.obstacles import Disc
    >>> scene = Scene((1.0, 1.0), (Disc(center=(0.5, 0.5), radius=0.1),))
    >>> signature(scene, np.array([[0.1, 0.5], [0.5, 0.9], [0.9, 0.5]]))
    (1,)
    >>> signature(scene, np.array([[0.1, 0.5], [0.5, 0.1], [0.9, 0.5]]))
    ()
    """
    groups = shapely.get_parts(shapely.union_all(scene.solids)) if scene.solids else np.array([])
    letters: list[tuple[float, int]] = []
    x, y = path.T
    for number, group in enumerate(groups, start=1):
        (px, py), *_ = shapely.get_coordinates(shapely.point_on_surface(group))
        right = x >= px
        k = np.flatnonzero(right[1:] != right[:-1])
        share = (px - x[k]) / (x[k + 1] - x[k])
        above = y[k] + share * (y[k + 1] - y[k]) > py
        signs = np.where(right[k + 1], number, -number)
        letters += zip((k + share)[above].tolist(), signs[above].tolist(), strict=True)
    word: list[int] = []
    for _, letter in sorted(letters):
        if word and word[-1] == -letter:
            word.pop()
        else:
            word.append(letter)
    return tuple(word)


def motion_class(task: Task, shapes: Float[np.ndarray, "t n 2"]) -> tuple[int, ...]:
    """The homotopy class of a motion of the cable: that of its middle's path."""
    return signature(task.scene, shapes[:, pivot_keypoint(task.cable.keypoints)])


def different_routes(task: Task, config: PivotConfig, seed: int, most: int) -> Iterator[Float[np.ndarray, "P 2"]]:
    """Pivot paths of different classes, roughly in the order of their cost.

    The best path is the first; then each passage that a path found goes through is closed in turn, and the best way
    round is found. After `most` searches that is the end.
    """
    passages, tick = find_passages(task.scene), count()
    queue: list[tuple[float, int, tuple[int, ...], np.ndarray]] = []
    tried, seen = set[tuple[int, ...]](), set[tuple[int, ...]]()

    def search(closed: tuple[int, ...]) -> None:
        if closed in tried or len(tried) >= most:
            return
        tried.add(closed)
        try:
            path = requested_route(task, config, seed, avoiding=[passages[i] for i in closed])
        except PlanningError:
            return
        heapq.heappush(queue, (pivot_cost(task.scene, path, config), next(tick), closed, path))

    search(())
    while queue:
        _, _, closed, path = heapq.heappop(queue)
        word = signature(task.scene, path)
        if word not in seen:
            seen.add(word)
            yield path
        for index, passage in enumerate(passages):
            if traversed_passages((passage,), path):
                search(tuple(sorted({*closed, index})))


def requested_route(
    task: Task, config: PivotConfig, seed: int, through: Sequence[Passage] = (), avoiding: Sequence[Passage] = ()
) -> Float[np.ndarray, "P 2"]:
    """The pivot path that goes through some passages, in this order, and keeps out of others.

    Raises:
        PlanningError: There is none.
    """
    walls = tuple(_wall(passage) for passage in avoiding if passage.width > 2 * task.cable.radius)
    scene = replace(task.scene, obstacles=(*task.scene.obstacles, *walls))
    middle = pivot_keypoint(task.cable.keypoints)
    stops = [task.start[middle], *(passage.ends.mean(axis=0) for passage in through), task.goal[middle]]
    pieces = [
        plan_pivot_path(scene, first, last, task.cable.radius, config, seed=seed) for first, last in pairwise(stops)
    ]
    return np.vstack([pieces[0], *(piece[1:] for piece in pieces[1:])])


def unmet_request(
    shapes: Float[np.ndarray, "t n 2"], task: Task, through: Sequence[Passage], avoiding: Sequence[Passage]
) -> str:
    """What a motion does against a request, "" if nothing."""
    path = shapes[:, pivot_keypoint(task.cable.keypoints)]
    for wanted, passages in ((True, through), (False, avoiding)):
        for passage in passages:
            if bool(traversed_passages((passage,), path)) is not wanted:
                names = " and ".join(task.scene.name_of(index) for index in passage.between)
                return f"the cable's middle {'does not go' if wanted else 'goes'} through the passage between {names}"
    arcs = [traversed_passages((passage,), path)[0][1] for passage in through]
    return "" if arcs == sorted(arcs) else "the cable's middle goes through the passages in another order"


def _wall(passage: Passage) -> Box:
    across = passage.ends[1] - passage.ends[0]
    x, y = passage.ends.mean(axis=0)
    angle = float(np.arctan2(across[1], across[0]))
    return Box(center=(float(x), float(y)), size=(passage.width, THIN), angle=angle)
