"""The paper's studies on hardware: one plan for all cables, a tube nothing was learned of, an insertion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cableway.benchmark.methods import load_method
from cableway.benchmark.suites import make_task
from cableway.benchmark.tables import Table, number
from cableway.control.base import Controller
from cableway.figures.stages import followers_figure
from cableway.figures.style import save_figure
from cableway.records import SUCCESS_ERROR, Rollout
from cableway.scene.files.loading import cable_from_preset, load_task
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tang2025.models.base import DeformationModel
from cableway.tang2025.reproduction import paper
from cableway.tang2025.reproduction.sections import LABORATORY, Row, Section, Tell, median_worst, spread
from cableway.tracking import track


def one_plan(folder: Path) -> Section:
    """One plan that all cables follow from starts that differ."""
    method = load_method("cableway")
    thickest = make_task("real-single~rubber-0.34")
    plan, controller = method.planner(thickest, 0), method.controller()
    rollouts: dict[str, Rollout] = {}
    rows: list[Row] = [("cable", "error [cm]", "largest deviation [cm]", "least clearance [cm]")]
    for seed, cable in enumerate(paper.CONTROL_BY_CABLE):
        task = make_task(f"real-single~{cable}-0.34")
        rollout = track(named_perturbation("laid", task, seed).build(task, seed), controller, plan, seed=seed)
        rollouts[cable] = rollout
        deviation = float(rollout.deviations_from_reference.max())
        values = (rollout.shape_error(task.goal), deviation, rollout.least_clearance)
        rows.append((cable, *(number(100 * value) for value in values)))
    save_figure(followers_figure(thickest, rollouts), folder / "one-plan.png")
    text = f"The plan of the thickest cable, tracked with all four from starts off by 5 mm and 3 degrees; {LABORATORY}."
    return Section("One plan for all cables", text, (Table("one plan", tuple(rows)),), ("one-plan.png",))


@dataclass(frozen=True)
class _Learner:
    """A controller of the silicone tube: which cable its model was identified on, and whether it is adapted."""

    cable: str
    adapted: bool

    def __str__(self) -> str:
        return f"{self.cable}, {'adapted while it runs' if self.adapted else 'as it is'}"


LEARNERS = (_Learner("hdmi", True), _Learner("hdmi", False), _Learner("silicone", False))
"""The case, without adaptation, and the upper bound."""

KIND, EPOCHS = "conv", 40
"""Of the models that are identified."""

DATA_SEED = 302
"""Of the data sets they are identified on."""


def silicone(folder: Path, transitions: int, trials: int, tell: Tell) -> Section:
    """The case study of a tube driven with a model of another cable.

    Args:
        folder: Where data sets and models are kept; those that are there are not made again.
        transitions: In the data set of each cable.
        trials: For each way and task.
        tell: Told what goes on.
    """
    from cableway.tang2025.control.mpc_config import ADAPT_EVERY, MPCConfig
    from cableway.tang2025.control.neural_mpc import NeuralMPC
    from cableway.tang2025.models.compilation import enable_compilation_cache

    enable_compilation_cache()
    models = {cable: _identified(cable, folder, transitions, tell) for cable in ("hdmi", "silicone")}
    controllers: dict[str, Controller[Any]] = {
        str(way): NeuralMPC(models[way.cable], MPCConfig(adapt_every=ADAPT_EVERY if way.adapted else 0))
        for way in LEARNERS
    }
    controllers["no model: adaptive rod MPC"] = load_method("cableway").controller()
    rows: list[Row] = [("model identified on", "success", "error [cm]", "largest error [cm]",
                        "largest deviation, median / worst [cm]", "least clearance [cm]",
                        "model changes taken / refused")]  # fmt: skip
    tasks = [make_task(f"{name}~silicone-0.27") for name in ("real-single", "real-multi")]
    plans = [load_method("cableway").planner(task, 0) for task in tasks]
    for place, (name, controller) in enumerate(controllers.items()):
        rollouts = []
        for trial in range(trials * len(tasks)):
            tell("silicone tube", (place + trial / (trials * len(tasks))) / len(controllers))
            which = trial % len(tasks)
            plant = named_perturbation("laid", tasks[which], trial).build(tasks[which], trial)
            rollouts.append((tasks[which].goal, track(plant, controller, plans[which], seed=trial)))
        rows.append((name, *_led(rollouts)))
    text = (
        "The silicone tube, 0.27 m, on real-single and real-multi with end shapes scaled to its length, under neural "
        f"MPC ({KIND}) with a model identified on {transitions} transitions of the simulated HDMI cable of 0.25 m, "
        "with no data of the tube; with a model of the tube itself, identified alike, as the upper bound; and under "
        f"our default, which needs no training. All track the same two plans; {LABORATORY}; the start is off by "
        "5 mm and 3 degrees. The paper shows one run on hardware, without numbers. A model update is accepted only "
        "if it predicts held-out frames better."
    )
    return Section("Case study: silicone tube", text, (Table("silicone tube", tuple(rows)),))


def _identified(cable: str, folder: Path, transitions: int, tell: Tell) -> DeformationModel:
    """A model of a cable, from data collected of it; the one in the folder where it is there."""
    from cableway.datasets.reading import load_transitions
    from cableway.simulation.collection import collect
    from cableway.simulation.episodes import CollectionConfig
    from cableway.tang2025.models.checkpoint import load_model, save_model
    from cableway.tang2025.models.recipe import make_model, read_training_config, shipped_config

    path = folder / "models" / f"{cable}-{transitions}.safetensors"
    if not path.exists():
        data = folder / "data" / f"{cable}-{transitions}"
        tell(f"collect: {cable}", 0.0)
        collect(CollectionConfig(transitions=transitions, seed=DATA_SEED, cable=cable_from_preset(cable)), data)
        recipe = read_training_config(shipped_config(KIND))
        recipe = replace(recipe, training=replace(recipe.training, epochs=EPOCHS))
        path.parent.mkdir(parents=True, exist_ok=True)
        model, card = make_model(
            recipe, load_transitions(data), state_file=path.with_suffix(".state"),
            progress=lambda words, share: tell(f"{cable}: {words}", share),
        )  # fmt: skip
        save_model(path, model, card)
    return load_model(str(path))


def _led(rollouts: Sequence[tuple[np.ndarray, Rollout]]) -> tuple[str, ...]:
    """The cells of some rollouts, each with its goal."""
    errors = np.array([100 * run.shape_error(goal) for goal, run in rollouts])
    deviations = [100 * float(run.deviations_from_reference.max()) for _, run in rollouts]
    clearances = [100 * run.least_clearance for _, run in rollouts]
    good = [error < 100 * SUCCESS_ERROR and clear > 0 for error, clear in zip(errors, clearances, strict=True)]
    changes = [[entry.value for entry in run.estimated().values()] for _, run in rollouts]
    taken = "{:.0f} / {:.0f}".format(*np.sum(changes, axis=0)) if len(changes[0]) == 2 else "-"
    return (
        f"{sum(good)}/{len(good)}", spread((float(errors.mean()), float(errors.std()))), number(float(errors.max())),
        median_worst(deviations), number(min(clearances)), taken,
    )  # fmt: skip


def insertion(trials: int, tell: Tell) -> Section:
    """The case study of an HDMI cable plugged in on a cluttered table."""
    from cableway.control.insertion import PlugPush
    from cableway.planning.insertion import plan_push
    from cableway.report import summarize
    from cableway.tracking import may_push, push_in

    task, method = load_task("insertion"), load_method("cableway")
    plan, push, controller, pusher = method.planner(task, 0), plan_push(task), method.controller(), PlugPush()
    rows: list[Row] = [
        ("trial", "plugged in", "off the axis [mm]", "turned [deg]", "depth [mm]", "least clearance [mm]")
    ]
    for seed in range(trials):
        tell("insertion", seed / trials)
        plant = named_perturbation("hdmi", task, seed).build(task, seed)
        rollout, inserted = track(plant, controller, plan, seed=seed), None
        if may_push(rollout, task):
            inserted = push_in(plant, push, controller=pusher, seed=seed)
        report = summarize(task, plan, rollout, push=push, insertion=inserted)
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
    return Section("Case study: insertion", text, (Table("insertion", tuple(rows)),))
