"""The paper's tables and figures, as far as simulation can show them, with the paper's numbers beside ours.

Each section says what is ours: where the paper's number is from hardware, ours is a simulation with stated noise.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cableway.benchmark.episode import Result
from cableway.benchmark.statistics import mean
from cableway.benchmark.suites import cable_of, kind_of
from cableway.benchmark.summary import Results
from cableway.benchmark.tables import Table, number
from cableway.core.provenance import describe
from cableway.figures.learning import horizons_figure
from cableway.figures.stages import stages_figure
from cableway.planning.config import PivotConfig, PlannerConfig
from cableway.planning.initial_trajectories import InitialTrajectories
from cableway.scene.files.loading import load_planar_task
from cableway.scene.task import Task
from cableway.tang2025.planning.chain import PaperChain
from cableway.tang2025.planning.config import PaperPlannerConfig
from cableway.tang2025.planning.deformation import optimize_deformation
from cableway.tang2025.reproduction import paper
from cableway.tang2025.reproduction.identification import TUNING_EPOCHS, collected, fine_tuned
from cableway.tang2025.reproduction.page import (
    LABORATORY,
    Draw,
    OnProgress,
    Picture,
    Row,
    Section,
    median_worst,
    spread,
    successes,
)

if TYPE_CHECKING:
    from cableway.tang2025.models.evaluation import Curve

RUNS = {
    "paper": ("cableway", "tang2025"),
    "lab-unconstrained": ("cableway", "tdm-mpc", "cdm-mpc", "bdm-mpc", "broyden"),
    "lab-constrained": ("cableway",),
    "lab-drawn": ("cableway",),
    "paper-cell": ("cableway",),
}
"""Suites that are run, and the methods of each."""

DATA_SEED = 301
"""Of the data sets that models are compared on."""

STAGED = ("single-obstacle-2", "multi-obstacle-1", "maze-1", "real-multi")
"""Tasks whose planning is drawn: those of the paper's figures."""

STAGES = (
    "(a) pivot paths with weights k_c of clearance, (b) the passages that the path traverses and the path set, "
    "(c) the deformation optimised along it, (d) the progress σ of each keypoint along its path."
)
"""Caption of the pictures of planning."""

WEIGHTS = (0.0, 0.01, 0.1, 1.0)
"""Clearance weights k_c [m] of the pivot paths drawn."""

MODELS = {
    "the paper's": {"T-DM": "tang2025-tdm", "C-DM": "tang2025-cdm", "B-DM": "tang2025-bdm"},
    "ours": {"T-DM": "transformer", "C-DM": "conv", "B-DM": "bilstm"},
}
"""Shipped models, by whose they are and the paper's name of their kind."""

HORIZON = 30
"""Steps predicted at most."""

COUNTS, STEPS = (7, 13, 25, 49), (25, 50, 100, 200)
"""Keypoints n and time steps T for which planning is timed."""

TRIALS = 16
"""Trials of each task in the paper's summary."""


def hyperparameters() -> Section:
    """Table "Key Hyperparameters"."""
    from cableway.control.rod_mpc import RodMPCConfig
    from cableway.tang2025.control.mpc_config import MPCConfig

    paper_values = describe(PlannerConfig.paper()) | {"control": describe(MPCConfig.paper())}
    ours = describe(PlannerConfig()) | {"control": describe(RodMPCConfig())}
    rows: list[Row] = [("", "paper", "our configuration of the paper", "our default")]
    rows += [
        (what, value, _at(paper_values, places), _at(ours, places)) for what, value, places in paper.HYPERPARAMETERS
    ]
    text = (
        "Read from the configurations that are used below. Our default controller has another cost, so its weights "
        "have no counterpart."
    )
    return Section("Hyperparameters", text, (Table("hyperparameters", tuple(rows)),))


def _at(values: Any, places: Sequence[str]) -> str:
    found = []
    for place in places:
        value = values
        for key in place.split("."):
            value = value.get(key, "-") if isinstance(value, dict) else "-"
        found.append(f"{value:g}" if isinstance(value, (int, float)) else str(value))
    return ", ".join(found)


def planning(folder: Path, draw: Draw) -> Section:
    """The figures of the planner's stages."""
    rows: list[Row] = [("task", "largest lead of an end", "at step", "ends when both are at 0.99: first, last")]
    pictures = []
    for name in STAGED:
        task = load_planar_task(name)
        pivots = {f"$k_c$ = {1000 * weight:g} mm": _chain(task, weight).pivot for weight in WEIGHTS}
        shapes, stages = _chain(task).deformation("head")
        draw(stages_figure(task, pivots, shapes, stages), folder / f"stages-{name}.png")
        caption = f"{name}: {STAGES}" if name == STAGED[0] else f"{name}, as above."
        pictures.append(Picture(f"stages-{name}.png", caption))
        first, last = stages.progress[:, 0], stages.progress[:, -1]
        lead = last - first
        ends = [int(np.argmax(curve >= 0.99)) for curve in (first, last)]
        rows.append((name, number(float(np.abs(lead).max())), str(int(np.abs(lead).argmax())), f"{ends[0]}, {ends[1]}"))
    text = (
        "Pivot paths with different weights, passages and path set, the deformation optimised along it, and sigma over "
        "time. Of the three stages that the paper sees in sigma (one end goes ahead, both go on, the other follows) "
        "the table shows the lead of one end over the other."
    )
    return Section("Deformation planning", text, (Table("sigma", tuple(rows)),), tuple(pictures))


def _chain(task: Task, weight: float = 1.0) -> PaperChain:
    config = PaperPlannerConfig(pivot=PivotConfig(clearance_weight=weight))
    return PaperChain(task, config, InitialTrajectories(task, config).pivot)


def simulated(results: Results) -> Section:
    """The simulated tasks."""
    rows: list[Row] = [
        ("task", "paper, error [cm]", "ours: success", "error, median / worst [cm]", "least clearance [cm]",
         "the paper's configuration: success", "error, median / worst [cm]"),
    ]  # fmt: skip
    for task in dict.fromkeys(result.task for result in results["paper"]["cableway"]):
        bound = paper.SIMULATED.get(task)
        cells = [task, f"< {bound:g}" if bound else "-"]
        for name in RUNS["paper"]:
            found = [result for result in results["paper"].get(name, ()) if result.task == task]
            errors = [100 * result.shape_error for result in found if result.shape_error is not None]
            cells += [successes(found), median_worst(errors)]
            if name == "cableway":
                least = [100 * result.clearance for result in found if result.clearance is not None]
                cells.append(number(min(least)) if least else "-")
        rows.append(tuple(cells))
    text = (
        "Nominal cable, contact on; other tasks than the three with a number in the paper are of the same kinds. The "
        "paper's configuration plans over keypoints alone; its plan is tracked although it does not verify."
    )
    return Section("Simulated tasks", text, (Table("simulation", tuple(rows)),))


def prediction(folder: Path, transitions: int, tuning: int, progress: OnProgress, draw: Draw) -> Section:
    """The comparison of the deformation models.

    Args:
        folder: Where data sets, models and the picture go; data and models that are there are not made again.
        transitions: Of each cable, on which the models are compared.
        tuning: Of each cable, on which they are fine-tuned.
        progress: Called with the stage and the share done.
        draw: Writes the picture.
    """
    from cableway.tang2025.models.checkpoint import load_model
    from cableway.tang2025.models.evaluation import compare

    shown = (1, 10, 20, 30)
    tables, curves = [], {}
    for whose, names in MODELS.items():
        rows: list[Row] = [("cable", "model", *(f"after {h} [mm]" for h in shown), "95% of the last", "T-DM less by",
                            "in the paper")]  # fmt: skip
        for place, cable in enumerate(paper.CONTROL_BY_CABLE):
            progress(f"models, {whose}: {cable}", place / len(paper.CONTROL_BY_CABLE))
            data = collected(cable, folder / "data" / cable, transitions, DATA_SEED)
            shipped = {kind: load_model(name) for kind, name in names.items()}
            tuned = {kind: fine_tuned(name, cable, folder, tuning, progress) for kind, name in names.items()}
            for models, what in ((shipped, "as shipped"), (tuned, "fine-tuned")):
                found = compare({kind: [model] for kind, model in models.items()}, data, HORIZON)
                claims = paper.PREDICTION if cable == "usb" and what == "fine-tuned" else {}
                rows += [_predicted(cable, kind, what, found, claims, shown) for kind in names]
                curves[whose, cable] = found
        tables.append(Table(f"prediction, {whose}", tuple(rows)))
    drawn = {cable: found for (whose, cable), found in curves.items() if whose == "the paper's"}
    means = {cable: {kind: curve.mean for kind, curve in found.items()} for cable, found in drawn.items()}
    bands = {cable: {kind: curve.quartiles for kind, curve in found.items()} for cable, found in drawn.items()}
    draw(horizons_figure(means, bands), folder / "prediction.png")
    text = (
        "Mean stacked error of open-loop prediction over so many steps, on simulated cables of these kinds with "
        "friction on the table, on episodes that no model has seen. The paper's networks are in world coordinates, of "
        "one width, trained alike on 50,000 transitions of the nominal simulated cable; ours, smaller, in the cable's "
        "own frame, on 100,000. One seed each. Fine-tuned ones were trained on with "
        f"{TUNING_EPOCHS} epochs of {tuning} transitions of the cable, as the paper does with 25,000 of each real one. "
        "docs/results/models.md compares three seeds, on the nominal cable."
    )
    caption = (
        "The paper's networks, fine-tuned: mean stacked error against the steps predicted without looking; bands from "
        "quartile to quartile."
    )
    pictures = (Picture("prediction.png", caption),)
    return Section("Deformation models", text, tuple(tables), pictures)


def _predicted(
    cable: str, kind: str, what: str, curves: Mapping[str, Curve], claims: Mapping[str, float], shown: Sequence[int]
) -> Row:
    """A row of the comparison: errors of a model, and by how much that of the T-DM is smaller."""
    curve = curves[kind]
    less = "-" if kind == "T-DM" else f"{100 * (1 - curves['T-DM'].mean[-1] / curve.mean[-1]):.0f}%"
    claim = f"{100 * claims[kind]:.1f}%" if kind in claims else "-"
    low, high = (number(end) if end is not None else "-" for end in curve.interval("mean", HORIZON))
    return (cable, f"{kind}, {what}", *(number(curve.at(h)["mean"]) for h in shown), f"{low} to {high}", less, claim)


def unconstrained(results: Results) -> Section:
    """Unconstrained control, by cable and by method."""
    found = results["lab-unconstrained"]
    simulated = ("simulated: n", "mean ± SD [cm]", "95% of the mean", "median / worst [cm]", "below 3 cm")
    by_cable: list[Row] = [("cable", "hardware, T-DM MPC: n", "mean ± SD, paper [cm]", *simulated)]
    for cable, known in paper.CONTROL_BY_CABLE.items():
        rows = [result for result in found["cableway"] if cable_of(result.task) == cable]
        by_cable.append((cable, str(paper.TRIALS_OF_CONTROL), spread(known), *_errors(rows)))
    by_method: list[Row] = [("method", "hardware: mean ± SD, paper [cm]", *simulated)]
    common = set.intersection(*({result.episode for result in rows} for rows in found.values()))
    for name, results_of in found.items():
        known, rows = paper.CONTROL_BY_METHOD.get(name), [row for row in results_of if row.episode in common]
        by_method.append((name, spread(known) if known else "-", *_errors(rows)))
    text = (
        f"Simulated cables of four kinds, 0.34 m, friction on the table, {LABORATORY}; the start is off by 5 mm and 3 "
        "degrees. Half of the goals are near, half across the table. The first table has our default method. All "
        "methods track the same plans, which are made and rehearsed with the cable that is then led; the paper's had "
        "none. It does not say how many trials each method had."
    )
    return Section(
        "Unconstrained control", text, (Table("by cable", tuple(by_cable)), Table("by method", tuple(by_method)))
    )


def summary(results: Results) -> Section:
    """Table "Real-world Experiment Summary", and the cables that it has not."""
    rows: list[Row] = [
        ("task", "cables", "hardware: success", "error, mean ± SD, paper [cm]", "clearance, mean ± SD, paper [cm]",
         "simulated: success", "error, mean ± SD [cm]", "95% of the mean", "largest error [cm]", "least clearance [cm]")
    ]  # fmt: skip
    for task, (error, clearance, rate) in paper.SUMMARY.items():
        known, drawn = (
            [result for result in results[suite]["cableway"] if kind_of(result.task) == task]
            for suite in ("lab-constrained", "lab-drawn")
        )
        usual = [result for result in known if cable_of(result.task) in paper.CONTROL_BY_CABLE][:TRIALS]
        rows.append((task, "as in the paper", rate, spread(error), spread(clearance), *_constrained(usual)))
        rows.append((task, "all seven, drawn", "-", "-", "-", *_constrained(drawn)))
        others = [result for result in known if cable_of(result.task) not in paper.CONTROL_BY_CABLE]
        for cable in dict.fromkeys(cable_of(result.task) for result in others):
            rows.append((task, cable, "-", "-", "-", *_constrained([r for r in others if cable_of(r.task) == cable])))
    text = (
        f"Simulated cables as the presets have them, with friction on the table, {LABORATORY}; the start is off by 5 "
        "mm and 3 degrees. Long cables on the first two tasks, 0.17 m rubber and paracord in the maze, sixteen trials "
        "each; cotton, HDMI and silicone have end shapes scaled to their length. Plans of these rows are made and "
        "rehearsed with the cable that is then led. In the rows 'drawn' the stiffness of the cable led, its profile, "
        "rest curvature, damping and friction are drawn from the ranges of its kind, and the plan, made and rehearsed "
        "with the preset, does not know them; the start is as planned."
    )
    return Section("Constrained tasks on seven cables", text, (Table("summary", tuple(rows)),))


def cost(repeats: int, progress: OnProgress) -> Section:
    """Planning cost against the number of keypoints and of time steps."""
    rows: list[Row] = [("keypoints n", *(f"T = {steps} [s]" for steps in STEPS), "exponent in T")]
    table: list[list[float]] = []
    for place, count in enumerate(COUNTS):
        progress("planning cost", place / len(COUNTS))
        task = load_planar_task("multi-obstacle-1")
        cable = replace(task.cable, keypoints=count)
        ends = cable.rod.at_keypoints(cable.rod.shapes(np.array([task.start_equilibrium, task.goal_equilibrium]))[0])
        task = replace(task, cable=cable, start=ends[0], goal=ends[1], start_poses=None, goal_poses=None)
        paths = _chain(task).path_set
        table.append([_optimisation_time(paths, task, steps, repeats) for steps in STEPS])
        rows.append((str(count), *(number(seconds) for seconds in table[-1]), number(_slope(STEPS, table[-1]))))
    progress("planning cost", 1.0)
    by_n = [_slope(COUNTS, [row[k] for row in table]) for k in range(len(STEPS))]
    rows.append(("exponent in n", *(number(slope) for slope in by_n), ""))
    text = (
        f"Processor time of the deformation's optimisation on multi-obstacle-1, median of {repeats}, with the "
        "exponents of the power laws that fit best. The paper claims linear growth: exponents of 1. Rough: it depends "
        "on the machine and on how many iterations Ipopt needs."
    )
    return Section("Planning cost", text, (Table("cost", tuple(rows)),))


def _optimisation_time(paths: Any, task: Task, steps: int, repeats: int) -> float:
    config = PaperPlannerConfig().deformation
    config = replace(config, steps=steps, upper_bound=config.upper_bound * config.steps / steps)
    seconds = []
    for _ in range(repeats):
        before = time.process_time()
        optimize_deformation(paths, task.cable, config)
        seconds.append(time.process_time() - before)
    return float(np.median(seconds))


def _slope(sizes: Sequence[int], seconds: Sequence[float]) -> float:
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def _constrained(results: Sequence[Result]) -> tuple[str, ...]:
    errors = _in_cm(results)
    clearance = [100 * result.clearance for result in results if result.clearance is not None]
    least = number(min(clearance)) if clearance else "-"
    return successes(results), *_mean(results), number(max(errors)) if errors else "-", least


def _errors(results: Sequence[Result]) -> tuple[str, ...]:
    return str(len(results)), *_mean(results), median_worst(_in_cm(results)), successes(results)


def _mean(results: Sequence[Result]) -> tuple[str, str]:
    """Mean and standard deviation [cm] of the errors, and the 95% interval of the mean."""
    errors, tasks = _in_cm(results), [result.task for result in results if result.shape_error is not None]
    estimate = mean(errors, tasks)
    if estimate is None:
        return "-", "-"
    interval = f"{number(estimate.low)} to {number(estimate.high)}"
    return spread((estimate.value, float(np.std(errors)))), interval


def _in_cm(results: Sequence[Result]) -> list[float]:
    return [100 * result.shape_error for result in results if result.shape_error is not None]
