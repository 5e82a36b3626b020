"""Plan random tasks in space and print how many of each kind are solved and how long it takes.

    .venv/bin/python studies/space_planning.py KIND ... [--seeds FIRST:END] [--width W] [--body B] [--limit S]
    .venv/bin/python studies/space_planning.py SUITE ... --frozen COUNT [--body B] [--limit S]

The second form takes the first tasks of suites of the benchmark.

A body, such as 2f-85, is what grippers take up beyond balls. Random tasks are drawn with it; those of a suite get it,
and where one then has a gripper in something at an end, it counts as impossible and nowhere else.

A task counts as solved where a plan was found within the limit and the judge accepts it. Times are those of the
processor, on one core, without compiling; "search" is without the judge, which each plan ends with. Failures count with
all the time they took. Each task leaves a line in FOLDER/KIND.jsonl (runs/space-planning unless given), and tasks that
stand there are not planned again. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cableway.benchmark.suites import SPACE_SUITES, frozen_episodes
from cableway.benchmark.tables import Table
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


def drawn(kind: str, given: argparse.Namespace) -> Iterator[tuple[str, Callable[[], SpatialTask]]]:
    """Names of the tasks that are asked for, and what makes each."""
    if given.frozen is not None:
        for episode in frozen_episodes(kind)[: given.frozen]:
            yield episode.name, lambda episode=episode: with_body(episode.load_spatial(), given.body)
        return
    for seed in range(*map(int, given.seeds.split(":"))):
        yield f"{kind}-{seed}", lambda seed=seed: random_spatial_task(seed, kind, width=given.width, body=given.body)


def with_body(task: SpatialTask, body: str | None) -> SpatialTask:
    """The task with a body of its grippers."""
    return task if body is None else replace(task, grippers=replace(task.grippers, body=body))


def planned(kind: str, clock: Clock, given: argparse.Namespace) -> list[dict[str, Any]]:
    """What became of the tasks of a kind; those that are missing are planned."""
    label = "-".join(str(each) for each in (kind, given.width, given.body, given.frozen and "frozen") if each)
    file = given.out / f"{label}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    known = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    rows = {row["task"]: row for row in known}
    wanted = []
    for name, make in drawn(kind, given):
        wanted.append(name)
        if name in rows:
            continue
        try:
            task = make()
        except TaskError as error:
            row = {"task": name, "impossible": error.sentence}
        else:
            said, spent, judged = solve(task, clock, given.limit)
            row = {"task": name, "weight": task.cable.weight, "said": said, "seconds": spent, "judge": judged}
        rows[name] = row
        with file.open("a") as log:
            log.write(json.dumps(row) + "\n")
        if not row.get("said", "no plan").count(" steps"):
            print(json.dumps(row), flush=True)
    return [rows[name] for name in wanted]


TITLES = ("tasks", "solved", "search [s], median", "p95", "worst", "with the judge [s], median", "p95", "worst",
          "weights of those not solved", "impossible ends")  # fmt: skip


def line(kind: str, rows: list[dict[str, Any]]) -> tuple[str, ...]:
    """The table's row of some tasks."""
    tried = [row for row in rows if "said" in row]
    failed = [row for row in tried if row["said"].startswith("no plan")]
    whole = np.array([row["seconds"] for row in tried])
    search = whole - [row["judge"] for row in tried]
    figures = (f"{value:.2f}" for each in (search, whole) for value in (*np.quantile(each, (0.5, 0.95)), each.max()))
    weights = ", ".join(f"{weight:.0f}" for weight in sorted(row["weight"] for row in failed))
    return (kind, f"{len(tried) - len(failed)} of {len(tried)}", *figures, weights, f"{len(rows) - len(tried)}")


def main() -> None:
    """Plan what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="+", choices=[*SPATIAL_KINDS, *sorted(set(SPACE_SUITES) - set(SPATIAL_KINDS))])
    parser.add_argument("--seeds", default="0:20")
    parser.add_argument("--width", type=float, help="of windows [m]")
    parser.add_argument("--body", help="of the grippers, by name")
    parser.add_argument("--limit", type=float, default=30.0, help="processor time for each task [s]")
    parser.add_argument("--frozen", type=int, help="so many tasks of each suite")
    parser.add_argument("--out", type=Path, default=Path("runs/space-planning"))
    given = parser.parse_args()
    clock = Clock()
    spatial_planner.verify_spatial_plan = clock.verify
    for seed in (1, 2, 3):  # each source of samples has kernels of its own
        solve(random_spatial_task(seed, "window"), clock, WARM_UP)
    if any(kind.endswith("-cell") for kind in given.kinds):
        solve(random_spatial_task(1, "yu", cell="dual-ur5e"), clock, 4 * WARM_UP)
    rows, every = [TITLES], []
    for kind in given.kinds:
        found = planned(kind, clock, given)
        every += found
        rows.append(line(kind, found))
        print(*rows[-1], sep=" | ", flush=True)
    if len(given.kinds) > 1:
        rows.append(line("all", every))
    print("\n" + Table("", tuple(rows)).markdown())


if __name__ == "__main__":
    main()
