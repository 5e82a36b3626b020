"""Plan random tasks in space of a kind and print how many are solved and how long it takes.

    .venv/bin/python studies/space_planning.py KIND [--seeds FIRST:END] [--width W] [--body B] [--limit S]
    .venv/bin/python studies/space_planning.py SUITE --frozen COUNT [--body B] [--limit S]

The second form takes the first tasks of a suite of the benchmark.

A body, such as 2f-85, is what grippers take up beyond balls. Random tasks are drawn with it; those of a suite get it,
and where one then has a gripper in something at an end, it is said and does not count.

A task counts as solved where a plan was found within the limit and the judge accepts it. Times are those of the
processor, on one core, without compiling; "search" is without the judge, which each plan ends with. Failures count with
all the time they took.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from cableway.benchmark.suites import SPACE_SUITES, frozen_episodes
from cableway.core.errors import PlanningError, TaskError
from cableway.planning import spatial_planner
from cableway.scene.spatial.task import SpatialTask
from cableway.tasks.space.generation import SPATIAL_KINDS, random_spatial_task

WARM_UP = 60.0
"""Time [s] for the first task, once to compile."""


class Clock:
    """Processor time, and how much of it the judge took."""

    def __init__(self) -> None:
        self._judge, self.judged = spatial_planner.verify_spatial_plan, 0.0

    def verify(self, *given: Any) -> Any:
        """The judge, with its time taken."""
        since = time.process_time()
        verdict = self._judge(*given)
        self.judged += time.process_time() - since
        return verdict


def solve(task: SpatialTask, clock: Clock, limit: float) -> tuple[str, float, float]:
    """How a plan was found, or why none was; time of all and of the judge [s]."""
    since, clock.judged = time.process_time(), 0.0
    try:
        plan = spatial_planner.plan_in_space(task, expired=lambda: time.process_time() - since > limit)
        said = f"{plan.metadata['initial_trajectory']}, {plan.steps} steps"
    except PlanningError as error:
        said = f"no plan: {error}"
    return said, time.process_time() - since, clock.judged


def tasks(given: argparse.Namespace) -> Iterator[SpatialTask | str]:
    """The tasks that are asked for, or why an end of one is impossible."""
    if given.frozen is not None:
        for episode in frozen_episodes(given.kind)[: given.frozen]:
            task = episode.load_spatial()
            try:
                yield replace(task, grippers=replace(task.grippers, body=given.body))
            except TaskError as error:
                yield f"{task.name}: {error.sentence}"
        return
    first, end = map(int, given.seeds.split(":"))
    for seed in range(first, end):
        yield random_spatial_task(seed, given.kind, width=given.width, body=given.body)


def main() -> None:
    """Print a line for each task, then a row of a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=dict.fromkeys([*SPATIAL_KINDS, *sorted(SPACE_SUITES)]))
    parser.add_argument("--seeds", default="0:20")
    parser.add_argument("--width", type=float, help="of windows [m]")
    parser.add_argument("--body", help="of the grippers, by name")
    parser.add_argument("--limit", type=float, default=30.0, help="processor time for each task [s]")
    parser.add_argument("--frozen", type=int, help="so many tasks of the suite")
    given = parser.parse_args()
    clock = Clock()
    spatial_planner.verify_spatial_plan = clock.verify
    for seed in (1, 2, 3):  # each source of samples has kernels of its own
        solve(random_spatial_task(seed, "window"), clock, WARM_UP)
    whole, search, solved, impossible = [], [], 0, 0
    for task in tasks(given):
        if isinstance(task, str):
            impossible += 1
            print(task, flush=True)
            continue
        said, spent, judged = solve(task, clock, given.limit)
        solved += not said.startswith("no plan")
        whole.append(spent)
        search.append(spent - judged)
        print(f"{task.name}: weight {task.cable.weight:.1f}, {spent:.2f} s, judge {judged:.2f} s; {said}", flush=True)
    figures = [f"{np.median(each):.2f}, {np.quantile(each, 0.95):.2f}, {max(each):.2f}" for each in (search, whole)]
    name = given.kind if given.width is None else f"{given.kind} {given.width:g} m"
    name = name if given.body is None else f"{name}, {given.body}"
    which = given.seeds if given.frozen is None else f"first {given.frozen}"
    if impossible:
        print(f"{impossible} have impossible ends and do not count")
    print(f"| {name} | {which} | {solved}/{len(whole)} | {figures[0]} | {figures[1]} |")


if __name__ == "__main__":
    main()
