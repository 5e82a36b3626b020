"""Arms of another kind along plans for grippers: how many random tasks they can follow, in what time, and why not.

    .venv/bin/python studies/described_arms.py cell:7000:7100 cell-clutter:7000:7060 [--arms FILE] [--apart 1.1]

Tasks with a witness, as of `cell`, without their arms; those with long fingers are left out. Beside it: how many of the
same plans two UR5e can follow, by the closed form. With `--apart`, the arms stand that far apart [m]. Results are kept
in `NAME.jsonl` in `--out`, and tasks that are there are not done again. Times are of the processor. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

import cableway as cw
from cableway.benchmark.tables import Table
from cableway.core.errors import CablewayError
from cableway.robot.branches import ArmMotion, arm_motion
from cableway.scene.cell import CELLS
from cableway.scene.described_arms import DescribedArms
from cableway.scene.files.described_arms import load_described_arms
from cableway.workflow.described_arms import follow_plan

EXAMPLE = Path(__file__).parents[1] / "examples" / "arms" / "two-arms.yaml"


@dataclass(frozen=True)
class Found:
    """What became of a task."""

    task: str
    followed: bool
    seconds: float
    reason: str
    closed_form: bool


def found_for(kind: str, seed: int, arms: DescribedArms) -> Found | None:
    """A random task; None where its hands have long fingers."""
    task = cw.random_task(seed, kind)
    if task.grippers.body != "2f-85":
        return None
    task = replace(task, cell=None)
    plan = cw.plan(task)
    cell = CELLS["dual-ur5e"]
    closed_form = isinstance(arm_motion(plan.poses, task.in_cell(cell), cell), ArmMotion)
    begun, reason = time.process_time(), ""
    try:
        follow_plan(plan, task, arms, task.name)
    except CablewayError as error:
        reason = str(error)
    return Found(task.name, not reason, time.process_time() - begun, reason, closed_form)


def kept(kind: str, seeds: range, arms: DescribedArms, file: Path) -> list[Found]:
    """Results of a kind, made or read."""
    file.parent.mkdir(parents=True, exist_ok=True)
    lines = file.read_text().splitlines() if file.exists() else []
    known = {each["task"]: Found(**each) for each in map(json.loads, lines)}
    results = []
    for seed in seeds:
        name = f"{kind}-{seed}"
        found = known.get(name) or found_for(kind, seed, arms)
        if found is None:
            continue
        results.append(found)
        if name not in known:
            with file.open("a") as out:
                out.write(json.dumps(asdict(found)) + "\n")
            print(f"{name}: {found.reason or 'followed'}", flush=True)
    return results


def row(kind: str, results: list[Found]) -> tuple[str, ...]:
    """A row of the table."""
    times = [each.seconds for each in results]
    median, p95, worst = np.percentile(times, (50, 95, 100))
    followed, closed = (sum(getattr(each, name) for each in results) for name in ("followed", "closed_form"))
    return kind, str(len(results)), str(followed), str(closed), f"{median:.2f}", f"{p95:.2f}", f"{worst:.2f}"


def main() -> None:
    """Print a Markdown table, and why others were not followed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="+", metavar="KIND:FIRST:LAST")
    parser.add_argument("--arms", type=Path, default=EXAMPLE)
    parser.add_argument("--apart", type=float)
    parser.add_argument("--out", type=Path, default=Path("runs/described-arms"))
    given = parser.parse_args()
    arms = load_described_arms(given.arms)
    if given.apart is not None:
        places = ((side * given.apart / 2, *arm.position[1:]) for side, arm in zip((-1, 1), arms.arms, strict=True))
        moved = (replace(arm, position=place) for arm, place in zip(arms.arms, places, strict=True))
        arms = replace(arms, arms=tuple(moved))
    rows, reasons = [], Counter()
    for each in given.kinds:
        kind, first, last = each.split(":")
        file = given.out / f"{kind}-{given.arms.stem}-{given.apart or 'as-given'}.jsonl"
        results = kept(kind, range(int(first), int(last)), arms, file)
        rows.append(row(kind, results))
        reasons.update(why(result.reason) for result in results if result.reason)
    names = ("tasks", "plans", "followed", "by UR5e", "median [s]", "p95 [s]", "worst [s]")
    print(Table("arms of another kind", (names, *rows)).markdown())
    print("\nNot followed:", *(f"- {count}: {reason}" for reason, count in reasons.most_common()), sep="\n")


def why(reason: str) -> str:
    """A reason without its numbers and names."""
    known = ("at the end of its", "faster than", "come too close", "do not reach", "no arm reaches the start", "verify")
    return next((words for words in known if words in reason), "other")


if __name__ == "__main__":
    main()
