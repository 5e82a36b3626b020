"""What the paper leaves open in its planner, chosen on tasks apart, and how the choice then fares.

    .venv/bin/python studies/tang2025_settings.py sweep KIND [--seeds FIRST:END]
    .venv/bin/python studies/tang2025_settings.py frozen SUITE [--size SIZE]
    .venv/bin/python studies/tang2025_settings.py table

`sweep` tries `SWEEP` on random tasks of a kind, with seeds below those of every suite; `frozen` runs `paper_planner` as
it is on the episodes of a suite. Both leave a line for each try in runs/tang2025-settings, unless --out names another
folder, and do not repeat what stands there; `table` prints what there is, with Wilson's intervals.

Only the planner is judged, without a network. A try succeeds where

1. no keypoint's path enters an obstacle,
2. Ipopt converged, and
3. the plan, although it does not verify, led open loop on the nominal simulated cable ends below 3 cm (stacked) without
   contact, by the benchmark's judge of rollouts.

Where 1 fails, 2 and 3 are not tried. Beside it stands whether it would succeed with the rod's Jacobian as feedback.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.benchmark.statistics import share
from cableway.benchmark.suites import get_suite
from cableway.control.jacobian import JacobianFeedback
from cableway.control.open_loop import OpenLoop
from cableway.core.errors import CablewayError, PlanningError
from cableway.judge import judge
from cableway.outcome import Outcome
from cableway.planning.initial_trajectories import InitialTrajectories
from cableway.planning.projection import project
from cableway.records import Plan
from cableway.scene.task import Task
from cableway.simulation.plant import CableSimulator
from cableway.tang2025.planning.chain import PaperChain
from cableway.tang2025.planning.config import PaperPlannerConfig, paper_planner
from cableway.tang2025.planning.deformation import GUESSES
from cableway.tasks.generation import random_task
from cableway.tracking import track
from cableway.verification import verify_rollout

OUT = Path("runs/tang2025-settings")

BASE: dict[str, Any] = {"alpha": 0.1, "gamma": 0.1, "guess": "head", "iterations": 1000, "sharpness": 10.0}
"""Where the sweep starts from; each of its lines changes one setting of it, or alpha and the first guess together."""

ALPHAS = (0.5, 0.25, 0.1)

SWEEP = tuple(
    BASE | changed
    for changed in (
        *({"alpha": alpha, "guess": guess} for alpha in ALPHAS for guess in GUESSES),
        {"gamma": 0.01}, {"sharpness": 2.0},
    )
)  # fmt: skip
"""The settings tried. In the authors' public code, gamma is 0.01, alpha about 0.24, the sharpness about 2. How many
iterations are needed follows from what Ipopt used."""


COLUMNS = (
    "tasks", "α", "γ", "a", "first guess", "tries", "no path in an obstacle", "converged", "open loop [%]",
    "feedback [%]", "iterations, median / most",
)  # fmt: skip


def configuration(setting: dict[str, Any]) -> PaperPlannerConfig:
    """The paper's planner with a setting."""
    paper = paper_planner()
    return replace(
        paper,
        path_set=replace(paper.path_set, spread=setting["alpha"], shrink=setting["gamma"]),
        deformation=replace(paper.deformation, iterations=setting["iterations"], sharpness=setting["sharpness"]),
        initial_trajectories=(setting["guess"],),
    )


def setting_of(config: PaperPlannerConfig) -> dict[str, Any]:
    """The setting of a configuration."""
    path_set, deformation = config.path_set, config.deformation
    return {
        "alpha": path_set.spread, "gamma": path_set.shrink, "guess": config.initial_trajectories[0],
        "iterations": deformation.iterations, "sharpness": deformation.sharpness,
    }  # fmt: skip


def attempt(task: Task, seed: int, config: PaperPlannerConfig, pivot: Float[np.ndarray, "P 2"]) -> dict[str, Any]:
    """One try along a pivot path, in a line."""
    chain = PaperChain(task, config, pivot)
    row: dict[str, Any] = {"paths": float(task.scene.clearance(chain.path_set.paths, 0.0).min())}
    if row["paths"] <= 0:
        return row
    shapes, stages = chain.deformation(setting_of(config)["guess"])
    ended = stages.metadata["ipopt"]
    row |= {name: ended[name] for name in ("status", "energy", "converged")} | {"used": ended["iterations"]}
    projected = project(shapes, task, config.projection)
    plan = Plan(projected.shapes, projected.poses)
    for led, controller in (("open loop", OpenLoop()), ("feedback", JacobianFeedback())):
        rollout = track(CableSimulator(task), controller, plan, seed=seed)
        # a plug is not inserted here, only led to its place before the port
        outcome = judge(replace(task, port=None), rollout, rollout_verdict=verify_rollout(rollout, task))[0]
        row[led] = {
            "outcome": outcome.value,
            "error": rollout.shape_error(task.goal),
            "clearance": rollout.least_clearance,
            "deviation": float(rollout.deviations_from_reference.max()),
        }
        row[f"{led} success"] = outcome is Outcome.SUCCESS
    return row | {"success": row["open loop success"] and row["converged"]}


@cache
def pivot_path(make: Any, seed: int) -> tuple[Task, Float[np.ndarray, "P 2"] | str]:
    """A task and its pivot path, or why there is none; the same for all settings."""
    task = make()
    try:
        return task, InitialTrajectories(task, paper_planner(), seed).pivot
    except PlanningError as error:
        return task, str(error)


def line(name: str, make: Any, seed: int, setting: dict[str, Any]) -> dict[str, Any]:
    """A try with what it was, how it went, and the processor time [s] that it took beside the pivot path."""
    task, pivot = pivot_path(make, seed)
    row, begun = {"task": name, "seed": seed, **setting}, time.process_time()
    try:
        row |= {"reason": pivot} if isinstance(pivot, str) else attempt(task, seed, configuration(setting), pivot)
    except CablewayError as error:
        row["reason"] = str(error)
    return {"success": False} | row | {"cpu": round(time.process_time() - begun, 2)}


def lines(file: Path) -> list[dict[str, Any]]:
    """What stands in a file."""
    return [json.loads(text) for text in file.read_text().splitlines()] if file.exists() else []


def run(file: Path, wanted: Iterable[tuple[str, Any, int, dict[str, Any]]]) -> None:
    """Try what does not stand in a file yet."""

    def key(row: dict[str, Any]) -> tuple[Any, ...]:
        return tuple(row[name] for name in ("task", "seed", *BASE))

    file.parent.mkdir(parents=True, exist_ok=True)
    known = {key(row) for row in lines(file)}
    for name, make, seed, setting in wanted:
        if key({"task": name, "seed": seed, **setting}) not in known:
            row = line(name, make, seed, setting)
            with file.open("a") as log:
                log.write(json.dumps(row) + "\n")
            print(json.dumps(row), flush=True)


def table(folder: Path) -> Iterator[str]:
    """A row for each setting of the sweep, all kinds of tasks together, and for each suite."""
    suites = {file.stem.removeprefix("suite-"): [file] for file in sorted(folder.glob("suite-*.jsonl"))}
    kinds = sorted(set(folder.glob("*.jsonl")) - {file for files in suites.values() for file in files})
    yield f"| {' | '.join(COLUMNS)} |"
    yield "|" + "---|" * len(COLUMNS)
    for label, files in {" + ".join(file.stem for file in kinds): kinds, **suites}.items():
        groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
        for row in with_least_energy([row for file in files for row in lines(file)]):
            groups.setdefault((row["alpha"], row["gamma"], row["sharpness"], row["guess"]), []).append(row)
        for (alpha, gamma, sharpness, guess), rows in sorted(groups.items(), key=lambda group: group[0][:3]):
            yield f"| {label} | {alpha:g} | {gamma:g} | {sharpness:g} | {guess} | {figures(rows)} |"


def with_least_energy(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows, and for each setting with all three first guesses the one that "least-energy" takes."""
    alike: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in rows:
        alike.setdefault(tuple(row[name] for name in ("task", "seed", *BASE) if name != "guess"), []).append(row)
    best = (
        min(each, key=lambda row: (not row.get("converged"), row.get("energy", 0.0)))
        for each in alike.values()
        if len(each) == len(GUESSES)
    )
    return rows + [row | {"guess": "least-energy"} for row in best]


def figures(rows: list[dict[str, Any]]) -> str:
    """The cells of a setting."""
    tasks = [row["task"] for row in rows]
    free = sum(row.get("paths", 0) > 0 for row in rows)
    used = [row["used"] for row in rows if row.get("converged")]
    shares = [
        share([bool(row.get("converged") and row.get(f"{led} success")) for row in rows], tasks)
        for led in ("open loop", "feedback")
    ]
    intervals = [f"{100 * s.value:.0f} ({100 * s.low:.0f} to {100 * s.high:.0f})" for s in shares if s is not None]
    spread = f"{np.median(used):.0f} / {max(used)}" if used else "-"
    return " | ".join(map(str, (len(rows), free, len(used), *intervals, spread)))


def main() -> None:
    """Do what is asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("do", choices=("sweep", "frozen", "table"))
    parser.add_argument("of", nargs="?", default="", help="kind of random task, or suite")
    parser.add_argument("--seeds", default="15000:15010")
    parser.add_argument("--size", default="standard")
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    if options.do == "table":
        print("\n".join(table(options.out)))
    elif options.do == "frozen":
        episodes = get_suite(options.of).episodes(options.size)
        setting = setting_of(paper_planner())
        run(options.out / f"suite-{options.of}.jsonl", ((e.task, e.load, e.seed, setting) for e in episodes))
    else:
        seeds = range(*map(int, options.seeds.split(":")))
        makers = [(f"{options.of}-{seed}", cache(lambda seed=seed: random_task(seed, options.of))) for seed in seeds]
        wanted = ((name, make, 0, setting) for name, make in makers for setting in SWEEP)
        run(options.out / f"{options.of}.jsonl", wanted)


if __name__ == "__main__":
    main()
