"""The paper's studies on hardware: one plan for all cables, a tube nothing was learned of, an insertion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cableway.benchmark.suites import make_task
from cableway.benchmark.tables import Table, number
from cableway.control.base import Controller
from cableway.control.rod_mpc import RodMPC
from cableway.core.errors import PlanningError
from cableway.figures.insertion import insertion_figure
from cableway.figures.rollout import rollout_figure
from cableway.figures.stages import followers_figure, snapshots_figure, tasks_over_time_figure
from cableway.records import Plan, Rollout
from cableway.scene.files.loading import load_planar_task, task_names
from cableway.scene.task import Task
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tang2025.models.adaptation import AdaptationConfig
from cableway.tang2025.reproduction import paper
from cableway.tang2025.reproduction.identification import identified
from cableway.tang2025.reproduction.page import (
    LABORATORY,
    Draw,
    OnProgress,
    Picture,
    Row,
    Section,
    median_worst,
    spread,
)
from cableway.workflow.run import Run, SolveOptions
from cableway.workflow.solve import solve


def over_time(folder: Path, draw: Draw, progress: OnProgress) -> Section:
    """Error and clearance over time, of every task of the catalogue."""
    runs = []
    for place, name in enumerate(names := task_names()):
        progress(f"over time: {name}", place / len(names))
        runs.append(solve(load_planar_task(name)))
    tracked = [(run.task, run.rollout) for run in runs if run.rollout]
    draw(tasks_over_time_figure(tracked), folder / "over-time.png")
    draw(snapshots_figure([(task.name, task, rollout) for task, rollout in tracked]), folder / "snapshots.png")
    text = (
        "The paper plots both for three simulated tasks; here every task of the catalogue, a run each with our default "
        f"planner and controller on the nominal cable, seed 0, of which {sum(run.success for run in runs)} of "
        f"{len(runs)} succeed."
    )
    caption = (
        "Above, stacked error to the goal, dashed the 30 mm of success; below, least clearance of cable and grippers, "
        "dashed contact. insertion is shown to the standoff."
    )
    pictures = (Picture("over-time.png", caption), Picture("snapshots.png", f"The same runs. {SNAPSHOTS}"))
    return Section("Error and clearance over time", text, pictures=pictures)


SNAPSHOTS = "The cable, coloured by time from start (blue) to end, thin the grippers' ways, dotted the goal."
"""Caption of pictures of runs."""

OPEN = ("open-near-20000~paracord-0.34", "open-near-20001~rubber-0.34", "open-far-20006~ethernet-0.34",
        "open-far-20007~usb-0.34")  # fmt: skip
"""Tasks of `lab-unconstrained`, a cable each."""


def without_obstacles(folder: Path, draw: Draw, progress: OnProgress) -> Section:
    """Runs of the table on unconstrained control, drawn."""
    runs = []
    for place, name in enumerate(OPEN):
        progress(f"without obstacles: {name}", place / len(OPEN))
        task = make_task(name)
        run = _followed(task, _planned(task), RodMPC(), "laid", place)
        if run.rollout is not None:
            runs.append((f"{name.partition('~')[2]}: {_centimetres(run)}", task, run.rollout))
    draw(snapshots_figure(runs), folder / "without-obstacles.png")
    text = f"A run of each cable, of near goals and far ones, with its final error; {LABORATORY}."
    return Section("Unconstrained control, drawn", text, pictures=(Picture("without-obstacles.png", SNAPSHOTS),))


def _centimetres(run: Run) -> str:
    error = run.report.shape_error
    return "-" if error is None else f"{number(100 * error)} cm"


TRACKED = "real-multi~usb-0.34"
"""The task of the paper's case study of planning and tracking, with its cable."""


def tracking(folder: Path, draw: Draw) -> Section:
    """The case study of planning and tracking among several obstacles: the USB cable."""
    task = make_task(TRACKED)
    run = _followed(task, _planned(task), RodMPC(), "laid", 0)
    assert run.rollout is not None
    draw(rollout_figure(task, run.rollout, failure=run.report.failure), folder / "usb-tracking.png")
    text = (
        "The paper shows how the USB cable follows its plan among obstacles, with error and clearance, in one run on "
        f"hardware. Here the simulated one with friction on the table under our default controller, {LABORATORY}; the "
        "start is off by 5 mm and 3 degrees."
    )
    caption = (
        "(a) The cable, coloured by time, and its reference, dashed; (b) stacked error to the "
        "reference and to the goal; (c) clearance of cable and grippers."
    )
    return Section("Case study: tracking", text, pictures=(Picture("usb-tracking.png", caption),))


def one_plan(folder: Path, draw: Draw) -> Section:
    """One plan that all cables follow from starts that differ."""
    thickest = make_task("real-single~rubber-0.34")
    plan, controller = _planned(thickest), RodMPC()
    rollouts: dict[str, Rollout] = {}
    rows: list[Row] = [("cable", "error [cm]", "largest deviation [cm]", "least clearance [cm]")]
    for seed, cable in enumerate(paper.CONTROL_BY_CABLE):
        task = make_task(f"real-single~{cable}-0.34")
        rollout = _followed(task, plan, controller, "laid", seed).rollout
        if rollout is None:
            continue
        rollouts[cable] = rollout
        deviation = float(rollout.deviations_from_reference.max())
        values = (rollout.shape_error(task.goal), deviation, rollout.least_clearance)
        rows.append((cable, *(number(100 * value) for value in values)))
    draw(followers_figure(thickest, rollouts), folder / "one-plan.png")
    text = f"The plan of the thickest cable, tracked with all four from starts off by 5 mm and 3 degrees; {LABORATORY}."
    caption = "(a) The cables at the start, halfway and at the end, dotted the task's ends; (b) error to the goal."
    pictures = (Picture("one-plan.png", caption),)
    return Section("One plan for all cables", text, (Table("one plan", tuple(rows)),), pictures)


def _planned(task: Task) -> Plan:
    """The plan of a task, rehearsed where its cable asks for it.

    Raises:
        PlanningError: There is none.
    """
    run = solve(task, SolveOptions(track=False))
    if run.plan is None:
        raise PlanningError(f"{task.name}: {run.report.failure}", run.attempt, run.report.outcome)
    return run.plan


def _followed(task: Task, plan: Plan, controller: Controller[Any], plant: str, seed: int) -> Run:
    """A run along a plan on the plant of a name."""
    perturbation = named_perturbation(plant, task, seed)
    return solve(task, SolveOptions(plan=plan, controller=controller, perturbation=perturbation, seed=seed))


SECOND_START = (0.2, 0.14)
"""From the maze's first start, reflected in the x-axis, to the second one [m]: further right, bent the other way."""


def mazes(folder: Path, trials: int, progress: OnProgress, draw: Draw) -> Section:
    """The maze from two starts, as in the paper's snapshots, a plan each.

    Args:
        folder: Where the picture goes.
        trials: From each start.
        progress: Called with the stage and the share done.
        draw: Writes the picture.
    """
    rows: list[Row] = [("cable", "start", "n", "success", "error, mean ± SD [cm]", "largest error [cm]",
                        "least clearance [cm]")]  # fmt: skip
    cases, drawn = [("rubber", "first"), ("rubber", "second"), ("paracord", "first")], []
    for place, (cable, start) in enumerate(cases):
        task = make_task(f"real-maze~{cable}-0.17")
        if start == "second":
            task = replace(task, start=task.start * (1, -1) + SECOND_START, start_poses=None)
        plan = _planned(task)
        runs = []
        for trial in range(trials):
            progress(f"maze: {cable}, {start} start", (place + trial / trials) / len(cases))
            runs.append(_followed(task, plan, RodMPC(), "laid", trial))
        cells = _cells(runs)
        rows.append((cable, start, str(len(runs)), *cells[:3], cells[-2]))
        drawn += [(f"{cable}, {start} start", task, run.rollout) for run in runs[:1] if run.rollout is not None]
    draw(snapshots_figure(drawn), folder / "mazes.png")
    text = (
        "The paper starts the rubber cable in its maze in two ways and Paracord in one, in one run each on hardware, "
        "without numbers. Here one plan for each, under our default controller, on the simulated cables with friction "
        f"on the table; {LABORATORY}; the start is off by 5 mm and 3 degrees."
    )
    tables, caption = (Table("maze from two starts", tuple(rows)),), f"The first trial of each row. {SNAPSHOTS}"
    return Section("Maze from two starts", text, tables, (Picture("mazes.png", caption),))


@dataclass(frozen=True)
class _Learner:
    """A controller of the silicone tube: which cable its model was identified on, and how it is adapted, if it is."""

    cable: str
    how: str
    adaptation: AdaptationConfig | None = None

    def __str__(self) -> str:
        return f"{self.cable}, {self.how}"


LEARNERS = (
    _Learner("hdmi", "adapted as in the paper", AdaptationConfig.paper()),
    _Learner("hdmi", "adapted where held-out frames say so", AdaptationConfig.for_network()),
    _Learner("hdmi", "as it is"),
    _Learner("silicone", "as it is"),
)
"""The case, our rule, no adaptation, and the upper bound."""


def silicone(folder: Path, transitions: int, trials: int, progress: OnProgress) -> Section:
    """The case study of a tube driven with a model of another cable.

    Args:
        folder: Where data sets and models are kept; those that are there are not made again.
        transitions: In the data set of each cable.
        trials: For each way and task.
        progress: Called with the stage and the share done.
    """
    from cableway.tang2025.control.mpc_config import ADAPT_EVERY, MPCConfig
    from cableway.tang2025.control.neural_mpc import NeuralMPC
    from cableway.tang2025.models.compilation import enable_compilation_cache

    enable_compilation_cache()
    models = {cable: identified("transformer", cable, folder, transitions, progress) for cable in ("hdmi", "silicone")}
    controllers: dict[str, Controller[Any]] = {
        str(way): NeuralMPC(
            models[way.cable], MPCConfig(adapt_every=ADAPT_EVERY if way.adaptation else 0), way.adaptation
        )
        for way in LEARNERS
    }
    controllers["no model: adaptive rod MPC"] = RodMPC()
    rows: list[Row] = [("model identified on", "success", "error [cm]", "largest error [cm]",
                        "largest deviation, median / worst [cm]", "least clearance [cm]",
                        "model changes taken / refused")]  # fmt: skip
    tasks = [make_task(f"{name}~silicone-0.27") for name in ("real-single", "real-multi")]
    plans = [_planned(task) for task in tasks]
    for place, (name, controller) in enumerate(controllers.items()):
        runs = []
        for trial in range(trials * len(tasks)):
            progress("silicone tube", (place + trial / (trials * len(tasks))) / len(controllers))
            which = trial % len(tasks)
            runs.append(_followed(tasks[which], plans[which], controller, "laid", trial))
        rows.append((name, *_cells(runs)))
    text = (
        "The silicone tube, 0.27 m, on real-single and real-multi with end shapes scaled to its length, under neural "
        f"MPC with a T-DM identified on {transitions} transitions of the simulated HDMI cable of 0.25 m, with no data "
        "of the tube; with one of the tube itself, identified alike, as the upper bound; and under our default, which "
        f"needs no training. All track the same two plans; {LABORATORY}; the start is off by 5 mm and 3 degrees. The "
        "paper shows one run on hardware, without numbers. It fine-tunes the decoder and keeps what comes out; our "
        "rule takes a change only where it halves the error on held-out frames."
    )
    return Section("Case study: silicone tube", text, (Table("silicone tube", tuple(rows)),))


def _cells(runs: Sequence[Run]) -> tuple[str, ...]:
    """The cells of some runs."""
    rollouts = [run.rollout for run in runs if run.rollout is not None]
    errors = np.array([100 * run.report.shape_error for run in runs if run.report.shape_error is not None])
    deviations = [100 * float(rollout.deviations_from_reference.max()) for rollout in rollouts]
    clearances = [100 * rollout.least_clearance for rollout in rollouts]
    changes = [[entry.value for entry in rollout.estimated().values()] for rollout in rollouts]
    taken = "{:.0f} / {:.0f}".format(*np.sum(changes, axis=0)) if len(changes[0]) == 2 else "-"
    return (
        f"{sum(run.success for run in runs)}/{len(runs)}",
        spread((float(errors.mean()), float(errors.std()))), number(float(errors.max())),
        median_worst(deviations), number(min(clearances)), taken,
    )  # fmt: skip


def insertion(folder: Path, trials: int, progress: OnProgress, draw: Draw) -> Section:
    """The case study of an HDMI cable plugged in on a cluttered table."""
    task, controller = load_planar_task("insertion"), RodMPC()
    plan = _planned(task)
    rows: list[Row] = [
        ("trial", "plugged in", "off the axis [mm]", "turned [deg]", "depth [mm]", "least clearance [mm]")
    ]
    pictures: list[Picture] = []
    for seed in range(trials):
        progress("insertion", seed / trials)
        run = _followed(task, plan, controller, "hdmi", seed)
        if run.insertion is not None and not pictures:
            draw(insertion_figure(task, run.insertion), folder / "insertion.png")
            caption = (
                f"Trial {seed}: (a) the plug on its way into the port; (b) how far its tip is off the port's axis and "
                "(c) turned from it, against its depth."
            )
            pictures.append(Picture("insertion.png", caption))
        report = run.report
        found, clearance = report.insertion, report.min_clearance
        figures = (
            (found.lateral_at_mouth, 1000), (found.angle_at_mouth, 180 / np.pi), (found.depth, 1000)
        ) if found else ()  # fmt: skip
        cells = ["-" if value is None else number(scale * float(value)) for value, scale in figures] or ["-"] * 3
        least = "-" if clearance is None else number(1000 * clearance)
        rows.append((str(seed), "yes" if report.success else f"no: {report.failure}", *cells, least))
    text = (
        "The catalogue's task `insertion`: routed through clutter, aligned with the port and inserted along its axis. "
        f"The simulated HDMI cable with friction on the table, {LABORATORY}. Inserted means within 2 mm and 3 "
        "degrees at the mouth, to full depth, without contact. The paper shows one run on hardware, without "
        "numbers."
    )
    return Section("Case study: insertion", text, (Table("insertion", tuple(rows)),), tuple(pictures))
