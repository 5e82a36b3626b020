"""Runs in space: plans of random tasks, led open loop on the nominal cable, and with feedback on cables that differ.

    .venv/bin/python studies/space_runs.py KIND ... [--seeds 3000:3030] [--runs R,...] [--body B] [--out FOLDER]

Each task is planned with a time limit of 30 s of processor time. Its plan is led open loop, by grippers without lag, on
the nominal cable of the plant in MuJoCo; then by each controller on a cable of `SpatialPerturbation.drawn`: up to 2%
longer or shorter, 30% stiffer or less stiff, held up to 3 mm and 5 degrees askew, seen with 1 mm of noise and 0.1 s
late. "seen-by-three" and "seen-by-two" are rod-mpc on such a cable by the markers in pictures of cameras, above, front
and back, or the first two of these, alone. Results are kept in the folder, so that an interrupted study goes on, with
the runs that were asked for then. Prints Markdown; tasks without a plan count.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cableway.benchmark.statistics import share
from cableway.benchmark.tables import Table
from cableway.core.errors import CablewayError
from cableway.core.files import write_json
from cableway.planning.planner import plan
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.simulation.spatial_plant import SpatialConfig
from cableway.tasks.space.generation import SPATIAL_KINDS, random_spatial_task
from cableway.tracking.photographer import EyesConfig
from cableway.tracking.spatial_eyes import SETUP
from cableway.workflow.spatial_run import CONTROLLERS, follow_in_space

LIMIT = 30.0
"""Processor time [s] of a search."""

SEEN = {"seen-by-three": ("above", "front", "back"), "seen-by-two": ("above", "front")}
"""Runs by pictures, and where their cameras stand."""

RUNS = ("nominal", *CONTROLLERS, *SEEN)


def runs_of(kind: str, seed: int, body: str | None, runs: Sequence[str]) -> dict[str, Any]:
    """What became of a task, by run."""
    task, begun = random_spatial_task(seed, kind, body=body), time.process_time()
    found: dict[str, Any] = {"weight": task.rod.weight}
    try:
        made = plan(task, seed=0, expired=lambda: time.process_time() - begun > LIMIT)
    except CablewayError as error:
        return found | {"no plan": str(error)}
    exact = SpatialPerturbation(config=SpatialConfig(servo_time=0.0))
    cases = {"nominal": ("open-loop", exact)}
    cases |= {name: (name, SpatialPerturbation.drawn(task, seed)) for name in CONTROLLERS}
    cases |= {name: ("rod-mpc", SpatialPerturbation.drawn(task, seed)) for name in SEEN}
    for name, (controller, perturbation) in ((name, cases[name]) for name in runs):
        eyes = EyesConfig(cameras=SEEN[name], tracker="markers", seed=seed, **SETUP) if name in SEEN else None
        rollout, _, outcome, why = follow_in_space(
            task, made, controller=controller, perturbation=perturbation, eyes=eyes, seed=seed
        )
        found[name] = {"outcome": str(outcome), "why": why}
        if rollout is not None:
            found[name] |= {
                "error": rollout.shape_error(task.keypoints("goal")),
                "deviation": float(rollout.deviations_from_reference.max()),
                "clearance": rollout.least_clearance,
                "eyes": rollout.metadata.get("eyes"),
            }
    return found


TITLES = ("kind", "run", "tasks", "success [%]", "contacts", "error [mm]", "deviation [mm]", "clearance [mm]",
          "seen, mean and p99 [mm]", "known [%]", "markers hidden [%]")  # fmt: skip


def line(kind: str, name: str, rows: list[dict[str, Any]]) -> tuple[str, ...]:
    """A row of the table."""
    runs = [row[name] for row in rows if name in row]
    good = [run["outcome"] == "success" for run in runs] + [False] * (len(rows) - len(runs))
    succeeded = share(good, [str(number) for number in range(len(good))])
    assert succeeded is not None
    cells = [f"{100 * succeeded.value:.0f} ({100 * succeeded.low:.0f} to {100 * succeeded.high:.0f})"]
    cells.append(str(sum(run.get("clearance", 1.0) <= 0 for run in runs)))
    for what in ("error", "deviation", "clearance"):
        values = 1000 * np.array([run[what] for run in runs if what in run])
        if not len(values):
            cells.append("-")
            continue
        worst = values.min() if what == "clearance" else values.max()
        tail = np.percentile(values, 5 if what == "clearance" else 95)
        cells.append(f"{np.median(values):.1f} / {tail:.1f} / {worst:.1f}")
    return (kind, name, f"{len(rows)}", *cells, *seen([run["eyes"] for run in runs if run.get("eyes")]))


def seen(eyes: list[dict[str, Any]]) -> tuple[str, str, str]:
    """Median and worst of runs by pictures: errors of keypoints where they are known, and shares."""
    if not eyes:
        return ("-", "-", "-")
    mean, p99 = ([1000 * each[what] for each in eyes if each[what]] for what in ("mean_error", "p99_error"))
    known, hidden = ([100 * each[what] for each in eyes] for what in ("known", "hidden"))
    return (
        f"{np.median(mean):.2f} / {max(mean):.2f}, {np.median(p99):.2f} / {max(p99):.2f}",
        f"{np.median(known):.0f} / {min(known):.0f}",
        f"{np.median(hidden):.0f} / {max(hidden):.0f}",
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="+", choices=SPATIAL_KINDS)
    parser.add_argument("--seeds", default="3000:3030")
    parser.add_argument("--runs", default=",".join(RUNS), help=f"of {', '.join(RUNS)}")
    parser.add_argument("--body", help="of the grippers, by name")
    parser.add_argument("--out", type=Path, default=Path("runs/space-runs"))
    given = parser.parse_args()
    lines, every, runs = [TITLES], [], given.runs.split(",")
    for kind in given.kinds:
        rows = [kept(kind, seed, given.body, runs, given.out) for seed in range(*map(int, given.seeds.split(":")))]
        every += rows
        lines += [line(kind, name, rows) for name in runs]
    if len(given.kinds) > 1:
        lines += [line("all", name, every) for name in runs]
    print("\n" + Table("", tuple(lines)).markdown())


def kept(kind: str, seed: int, body: str | None, runs: Sequence[str], out: Path) -> dict[str, Any]:
    """What became of a task, from the folder or now."""
    file = out / f"{'-'.join(filter(None, (kind, body, str(seed))))}.json"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        write_json(file, runs_of(kind, seed, body, runs))
    row = json.loads(file.read_text())
    outcomes = {name: run["outcome"] for name, run in row.items() if isinstance(run, dict)}
    print(kind, seed, outcomes or row, flush=True)
    return row


if __name__ == "__main__":
    main()
