"""Local replanning: where an optimised trajectory is still not free, RRT-Connect finds a way round.

An initial trajectory through narrow ways is often good but for a corner or two that the optimisation, which goes
downhill, can't get the cable round. From the last free shape before such a section to the first one after it, two trees
of equilibria meet quickly, because samples are drawn about the shapes of the section.

Note:
    Not in the paper (Tang et al.).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from cableway.core.errors import PlanningError
from cableway.motion.interpolation import evenly_moved, rows_at
from cableway.motion.validity import FreeSpace
from cableway.planning import rrt_connect
from cableway.planning.projection import ProjectedTrajectory, ProjectionConfig, stepped
from cableway.planning.trajectory_optimization import optimize_trajectory
from cableway.scene.task import Task

SAMPLES = 4000
"""Most samples of one search."""

ROOM = (1, 10, 60)
"""Rows by which a section is widened on both sides, one after the other, until the search succeeds."""


def replanned(
    projected: ProjectedTrajectory,
    task: Task,
    config: ProjectionConfig,
    search: rrt_connect.RRTConnectConfig,
    *,
    seed: int = 0,
    progress: Callable[[float], None] = lambda _: None,
) -> ProjectedTrajectory:
    """A projected trajectory, replanned where it is not free, then optimised and stepped again.

    Args:
        projected: Equilibria made of an initial trajectory.
        task: The task.
        config: How it was projected.
        search: What is free, and how trees grow.
        seed: Same seed, same sequence.
        progress: Called with the share that is done; it may raise to stop.

    Raises:
        PlanningError: No way round a section was found, or all rows are free.
    """
    assert projected.nodes is not None
    assert projected.node_places is not None
    q, places = replan_locally(projected.nodes, task, search, seed=seed, progress=lambda share: progress(share / 2))
    at = evenly_moved(task.cable.rod, q, config.row_step)
    rows = np.interp(np.interp(at, np.arange(len(q)), places), np.arange(len(projected.nodes)), projected.node_places)
    q = optimize_trajectory(rows_at(q, at), task, config.optimization, lambda share: progress((1 + share) / 2))
    return stepped(q, rows, task, config)


def replan_locally(
    q: Float[np.ndarray, "t 6"],
    task: Task,
    config: rrt_connect.RRTConnectConfig,
    *,
    seed: int = 0,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Float[np.ndarray, "r 6"], Float[np.ndarray, "r"]]:
    """A sequence of free stable equilibria that leaves the one given only where that is not free.

    Args:
        q: Rod coordinates with angles that run on; the first and last row are start and goal.
        task: The task.
        config: What is free, and how the trees grow.
        seed: Same seed, same sequence.
        progress: Called with the share that is done; it may raise to stop.

    Returns:
        q (R+1, 6), neighbours about `config.step` apart at most, and for each row its place 0..T in the sequence given.

    Raises:
        PlanningError: No way round a section was found, or all rows are free.
    """
    places = evenly_moved(task.cable.rod, q, config.step)
    q = rows_at(q, places)
    free = FreeSpace.of(task, rrt_connect.MARGINS).are_free(q)
    if free.all():
        raise PlanningError("there is nothing to replan")
    if not (free[0] and free[-1]):
        raise PlanningError("start or goal is in collision")
    taken, kept, at = [], [], 0
    while not free[at:].all():
        progress(at / len(q))
        begin, end, way = _way_round(q, free, at, task, config, seed)
        taken += [q[at:begin], way[:-1]]
        kept += [places[at:begin], np.linspace(places[begin], places[end], len(way))[:-1]]
        at = end
    return np.vstack([*taken, q[at:]]), np.concatenate([*kept, places[at:]])


def _way_round(
    q: Float[np.ndarray, "t 6"],
    free: Bool[np.ndarray, "t"],
    at: int,
    task: Task,
    config: rrt_connect.RRTConnectConfig,
    seed: int,
) -> tuple[int, int, Float[np.ndarray, "k 6"]]:
    """The way round the first section after the free row `at` that is not free: from which row to which, and how.

    Raises:
        PlanningError: No search succeeded.
    """
    first = at + int(np.argmin(free[at:]))
    after = first + int(np.argmax(free[first:]))
    rows = np.flatnonzero(free)
    for room in ROOM:
        begin = int(rows[rows <= max(at, first - room)][-1])
        end = int(rows[rows >= min(len(q) - 1, after + room - 1)][0])
        sampler = rrt_connect.about_shapes(q[begin : end + 1])
        few = replace(config, samples=SAMPLES)
        try:
            return (
                begin,
                end,
                rrt_connect.rrt_connect_path(task, sampler, few, seed=(seed, first, room), ends=(q[begin], q[end])),
            )
        except PlanningError:
            continue
    raise PlanningError(f"no path was found around rows {first} to {after - 1} of {len(q)}")
