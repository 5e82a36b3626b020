"""Compare the deformation models: collect the sets, train every model with three seeds, evaluate, adapt; ship.

    .venv/bin/python studies/models.py                   # the first four, below runs/comparison; half an hour
    .venv/bin/python studies/models.py train --seeds 1   # one stage; what is already there is kept
    .venv/bin/python studies/models.py plateau           # networks trained longer; an hour and a half of one core
    .venv/bin/python studies/models.py ship              # weights; half an hour of one core
    .venv/bin/python studies/models.py shipped           # error of the shipped weights
    .venv/bin/python studies/models.py speed             # one core: taskset -c 0
    .venv/bin/python studies/models.py yu2d --yu2d runs/yu2d  # cables of Yu et al., made by studies/convert_yu2d.py

Interrupted and started again, it goes on where it stopped. `ship` makes the
shipped weights from their configurations but for the paper's networks, which `studies/tang2025_networks.py` makes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

from cableway.core.configuration import from_mapping
from cableway.core.files import write_atomically, write_json
from cableway.datasets.reading import load_transitions
from cableway.datasets.transitions import Transitions
from cableway.figures.learning import horizon_figure
from cableway.figures.style import save_figure
from cableway.scene.cable import Cable
from cableway.simulation.collection import collect
from cableway.simulation.episodes import CollectionConfig
from cableway.tang2025.models.adaptation import AdaptationState, adapt, start_adaptation
from cableway.tang2025.models.base import DeformationModel
from cableway.tang2025.models.card import write_card
from cableway.tang2025.models.checkpoint import WEIGHTS, load_model, model_names
from cableway.tang2025.models.compilation import enable_compilation_cache
from cableway.tang2025.models.dataset import joined, select
from cableway.tang2025.models.evaluation import LONGEST, Curve, baselines, compare, window_errors
from cableway.tang2025.models.frames import Framing
from cableway.tang2025.models.learned import LearnedConfig, LearnedModel
from cableway.tang2025.models.networks import ConvConfig, MLPConfig, RecurrentConfig, RodConfig
from cableway.tang2025.models.recipe import CONFIGS, Recipe, make_model_file, read_training_config
from cableway.tang2025.models.training import TrainingConfig
from cableway.tang2025.models.transformer import TransformerConfig

PLAIN = Framing.plain()
BLIND = replace(PLAIN, angles=False)
ROD = Framing(rod=True)

TRAINING = TrainingConfig(epochs=5, rollout_epochs=0)

MODELS: dict[str, tuple[LearnedConfig, TrainingConfig]] = {
    "linear, plain": (MLPConfig(hidden=(), framing=PLAIN), TRAINING),
    "linear": (MLPConfig(hidden=()), TRAINING),
    "MLP, plain": (MLPConfig(framing=PLAIN), TRAINING),
    "MLP": (MLPConfig(), TRAINING),
    "rod": (RodConfig(damping_time=0.3), replace(TRAINING, epochs=3, learning_rate=1e-2)),
    "C, plain": (ConvConfig(framing=PLAIN), TRAINING),
    "T, plain": (TransformerConfig(framing=PLAIN), TRAINING),
    "B, plain": (RecurrentConfig(framing=PLAIN), TRAINING),
    "T, plain, no angles": (TransformerConfig(framing=BLIND), TRAINING),
    "C": (ConvConfig(), TRAINING),
    "T": (TransformerConfig(), TRAINING),
    "C on rod": (ConvConfig(width=24, framing=ROD), replace(TRAINING, rollout_epochs=1)),
}
"""What is compared. Plain is the paper's way: world coordinates, no blend, ends that may leave the grippers."""

YU2D_MODELS: dict[str, tuple[LearnedConfig, TrainingConfig]] = {
    "linear": (MLPConfig(hidden=(), keypoints=10), TRAINING),
    "rod": (RodConfig(), replace(TRAINING, learning_rate=1e-2)),
    "C": (ConvConfig(), TRAINING),
}

LONGER_MODELS: dict[str, LearnedConfig] = {
    "MLP": MLPConfig(),
    "C": ConvConfig(),
    "T": TransformerConfig(),
    "C, plain": ConvConfig(framing=PLAIN),
    "B, plain": RecurrentConfig(framing=PLAIN),
    "T, plain": TransformerConfig(framing=PLAIN),
    "T, plain, wide": TransformerConfig.paper(),
}
"""Wide is the width that the paper's public code has."""

LONGER: dict[int, dict[str, int]] = {
    10: dict.fromkeys(LONGER_MODELS, 1),
    40: {"MLP": 1, "C": 1, "T": 1, "C, plain": 3, "B, plain": 3, "T, plain": 3},
    160: {"C, plain": 1, "B, plain": 1, "T, plain": 1},
}
"""Epochs, models, seeds of the trainings that look for a plateau; each is one of its own, as the rate falls to 0."""

ON_PLANTS = ("rod", "C on rod", "C", "T", "MLP", "linear")
"""Models that are evaluated on perturbed cables."""

ADAPTED = ("rod",)
ADAPTED_TO = 100
"""Transitions that a model adapts to, in five parts."""

DRAWS = 10
SHOWN = (1, 10, 20, 30, 50)
"""Horizons in the tables."""

TRAINING_SET = CollectionConfig(transitions=50_000, seed=0)

TEST = CollectionConfig(transitions=6_000, seed=101)
"""More than a hundred episodes of up to 60 steps."""

NOMINAL = Cable()
TEST_SETS = {
    "nominal": TEST,
    "friction": replace(TEST, cable=replace(NOMINAL, friction=0.4, linear_density=0.1)),
    "graded": replace(TEST, cable=replace(NOMINAL, stiffness_profile=(0.5, 2.0))),
    "curved": replace(TEST, cable=replace(NOMINAL, rest_curvature=(0.0, 0.0, 5.0))),
    "slow": replace(TEST, cable=replace(NOMINAL, damping_time=0.5)),
    "short": replace(TEST, cable=replace(NOMINAL, length=0.97 * NOMINAL.length)),
    "long": replace(TEST, cable=replace(NOMINAL, length=1.03 * NOMINAL.length)),
}


def collect_sets(folder: Path) -> None:
    """The training set and the test sets."""
    for name, config in {"training": TRAINING_SET, **TEST_SETS}.items():
        collect(config, folder / "sets" / name, workers=1)


def model_path(folder: Path, name: str, seed: int) -> Path:
    """Where a trained model goes."""
    return folder / "models" / f"{name.replace(', ', '-').replace(' ', '-')}-{seed}.safetensors"


def train_models(folder: Path, seeds: int) -> None:
    """All models with the first seed, then all with the next one."""
    data = load_transitions(folder / "sets" / "training")
    for seed in range(seeds):
        for name, (model, training) in MODELS.items():
            path = model_path(folder, name, seed)
            if path.exists():
                continue
            recipe = Recipe(collection={}, model=model, training=replace(training, seed=seed))
            card = make_model_file(path, recipe, data)
            print(f"{path}: {card['errors']['model']}", flush=True)


def train_longer(folder: Path) -> None:
    """Networks after more and more epochs: error by horizon and time of training; shorter trainings first."""
    data, judged = (load_transitions(folder / "sets" / name) for name in ("training", "nominal"))
    for epochs, wanted in LONGER.items():
        curves: dict[str, Curve] = {}
        for name, seeds in wanted.items():
            trained = []
            for seed in range(seeds):
                path = model_path(folder, f"{name}-{epochs}", seed)
                if not path.exists():
                    training = replace(TRAINING, epochs=epochs, seed=seed)
                    recipe = Recipe(collection={}, model=LONGER_MODELS[name], training=training)
                    pace = Pace()
                    make_model_file(path, recipe, data, progress=pace)
                    print(f"{path}: {pace.whole() / 60:.1f} min of processor time", flush=True)
                trained.append(load_model(path))
            curves[name] = compare({name: trained}, judged)[name]
        write_json(folder / f"plateau-{epochs}.json", {name: asdict(curve) for name, curve in curves.items()})
        print_curves(f"{epochs} epochs", curves)


class Pace:
    """Told how far a training is, it knows what the whole of it takes, also where it went on from a kept state."""

    def __init__(self) -> None:
        self.seen: list[tuple[float, float]] = []

    def __call__(self, stage: str, share: float) -> None:
        """Processor time now, and the share done."""
        self.seen.append((time.process_time(), share))

    def whole(self) -> float:
        """Processor time [s] of the whole training."""
        (begun, first), (ended, last) = self.seen[0], self.seen[-1]
        return (ended - begun) / (last - first)


def evaluate_models(folder: Path, seeds: int) -> None:
    """Error against horizon of every model on every test set: tables, pictures, JSON."""
    found: dict[str, dict[str, Curve]] = {}
    for name in TEST_SETS:
        data = load_transitions(folder / "sets" / name)
        models = {
            model: [load_model(path) for seed in range(seeds) if (path := model_path(folder, model, seed)).exists()]
            for model in (MODELS if name == "nominal" else ON_PLANTS)
        }
        models |= {model: [one] for model, one in baselines().items()}
        curves = compare({model: trained for model, trained in models.items() if trained}, data)
        write_json(folder / f"{name}.json", {model: asdict(curve) for model, curve in curves.items()})
        means = {model: curve.mean for model, curve in curves.items()}
        bands = {model: curve.seeds for model, curve in curves.items() if curve.trainings > 1}
        save_figure(horizon_figure(tuple(range(1, LONGEST + 1)), means, bands), folder / f"{name}.png")
        found[name] = curves
    print_curves("nominal", found["nominal"])
    print_sets(found, [*ON_PLANTS, *baselines()])


def print_sets(found: Mapping[str, Mapping[str, Curve]], models: Sequence[str], horizon: int = 20) -> None:
    """A table in Markdown: median / mean over the windows of each set."""
    print(f"\nstacked error after {horizon} steps [mm], median / mean\n")
    print("| set | " + " | ".join(models) + " |")
    print("|" + "---|" * (len(models) + 1))
    for name, curves in found.items():
        errors = [curves[model].at(horizon) for model in models]
        print(f"| {name} | " + " | ".join(f"{at['median']:.2f} / {at['mean']:.2f}" for at in errors) + " |", flush=True)


def print_curves(title: str, curves: Mapping[str, Curve], horizons: tuple[int, ...] = SHOWN) -> None:
    """A table in Markdown: median / mean, and the range of the seeds' means."""
    first = next(iter(curves.values()))
    print(f"\n{title}: stacked error [mm], median / mean (range of the seeds' means)\n")
    print("| model | seeds | " + " | ".join(f"{h} step{'s' * (h > 1)}" for h in horizons) + " |")
    print("|" + "---|" * (len(horizons) + 2))
    for name, curve in curves.items():
        cells = []
        for h in horizons:
            at, (low, high) = curve.at(h), (edge[curve.horizons.index(h)] for edge in curve.seeds)
            spread = f" ({low:.2f} to {high:.2f})" if curve.trainings > 1 else ""
            cells.append(f"{at['median']:.2f} / {at['mean']:.2f}{spread}")
        print(f"| {name} | {curve.trainings} | " + " | ".join(cells) + " |")
    counts = [f"{first.windows[h - 1]} windows of {first.episodes[h - 1]} episodes at {h}" for h in horizons]
    print("\n" + ", ".join(counts), flush=True)


def adapt_models(folder: Path) -> None:
    """20-step error on every test set before and after 100 transitions, ten draws; other episodes judge."""
    replay = load_transitions(folder / "sets" / "training")
    print("\n20-step stacked error [mm], mean over other episodes, median / worst of the draws\n")
    print(
        "| model | set | before | after | half or 4 mm | draws worse | episodes worse | changed | ms, median / worst |"
    )
    print("|" + "---|" * 9)
    draws: dict[str, dict[str, list[list[float]]]] = {}
    for model in ADAPTED:
        trained = load_model(model_path(folder, model, 0))
        assert isinstance(trained, LearnedModel)
        start = start_adaptation(trained, replay=replay)
        for name in TEST_SETS:
            rows = np.array([draw_of(start, load_transitions(folder / "sets" / name), k) for k in range(DRAWS)])
            draws.setdefault(model, {})[name] = rows[:, :2].tolist()
            before, after, worse, changed, median, slowest = rows.T
            reached = int(np.sum((after <= 0.5 * before) | (after <= 4.0)))
            spread = [f"{np.median(values):.2f} / {values.max():.2f}" for values in (before, after)]
            counts = (
                f"{int(np.sum(after > before + 0.01))} | {100 * worse.mean():.1f}% | {int((changed > 0).sum())}/{DRAWS}"
            )
            took = f"{np.median(median):.0f} / {slowest[1:].max():.0f}"
            print(f"| {model} | {name} | {' | '.join(spread)} | {reached}/{DRAWS} | {counts} | {took} |", flush=True)
    write_json(folder / "adaptation.json", draws)


def draw_of(start: AdaptationState, data: Transitions, draw: int) -> tuple[float, ...]:
    """Mean error before and after [mm], share of episodes that got worse, updates taken, ms per update."""
    rows = np.arange(draw * len(data) // DRAWS, draw * len(data) // DRAWS + ADAPTED_TO)
    state, times = start, []
    for part in np.split(rows, 5):
        begun = time.perf_counter()
        state = adapt(state, select(data, part))
        times.append(1e3 * (time.perf_counter() - begun))
    others = select(data, ~np.isin(data.episode, np.unique(data.episode[rows])))
    before, after = (window_errors(model, others, (20,)) for model in (start.model, state.model))
    known = np.isfinite(before.stacked[:, 0])
    errors = [1e3 * side.stacked[known, 0] for side in (before, after)]
    episodes = before.episode[known]
    # a tenth of a millimetre over 26 numbers is nothing
    worse = [errors[1][episodes == one].mean() > errors[0][episodes == one].mean() + 0.1 for one in np.unique(episodes)]
    means = [float(error.mean()) for error in errors]
    return (*means, float(np.mean(worse)), float(state.accepted), float(np.median(times)), float(np.max(times)))


def compare_yu2d(folder: Path, sets: Path, seeds: int) -> None:
    """Each length left out in turn: models trained on the others, evaluated on it."""
    found = {path.stem: load_transitions(path) for path in sorted(sets.glob("*.yaml"))}
    for left_out, data in found.items():
        training = joined([other for name, other in found.items() if name != left_out])
        models: dict[str, list[DeformationModel]] = {}
        for name, (model, settings) in YU2D_MODELS.items():
            for seed in range(seeds):
                path = folder / "yu2d" / f"{name.replace(' ', '-')}-{left_out}-{seed}.safetensors"
                if not path.exists():
                    recipe = Recipe(collection={}, model=model, training=replace(settings, seed=seed))
                    make_model_file(path, recipe, training)
                models.setdefault(name, []).append(load_model(path))
        models |= {name: [one] for name, one in baselines().items()}
        curves = compare(models, data, 20)
        write_json(folder / f"yu2d-{left_out}.json", {name: asdict(curve) for name, curve in curves.items()})
        print_curves(f"yu2d, trained without {left_out} m, evaluated on it", curves, (1, 5, 10, 20))


def evaluate_shipped(folder: Path) -> None:
    """Error against horizon of every shipped model on the nominal test set."""
    data = load_transitions(folder / "sets" / "nominal")
    print_curves("shipped", compare({name: [load_model(name)] for name in model_names()}, data))


def ship_models(folder: Path) -> None:
    """Our shipped weights and their cards, each from its configuration in `cableway.tang2025.models.recipe.CONFIGS`."""
    for config in sorted(set(CONFIGS.glob("*.yaml")) - set(CONFIGS.glob("tang2025-*.yaml"))):
        recipe = read_training_config(config)
        collection = from_mapping(CollectionConfig, recipe.collection, f"{config}: collection")
        data, made = folder / "sets" / f"{collection.transitions}", folder / "shipped" / f"{config.stem}.safetensors"
        if not made.exists():
            collect(collection, data, workers=1)
            make_model_file(made, recipe, load_transitions(data))
        path, content = WEIGHTS / made.name, made.read_bytes()
        write_atomically(path, lambda file, content=content: file.write(content))
        print(write_card(path), flush=True)


def time_models() -> None:
    """One prediction with its whole Jacobian by shape, poses and action, for each shipped model."""
    rod = Cable().rod
    stations, poses = rod.shapes(np.array([[0.3, 0.3, 0.4, -15.0, 4.0, 1.5]]))
    shape, action = rod.at_keypoints(stations)[0], np.full((2, 3), 0.004)
    sample = [part.astype(np.float32) for part in (shape, poses[0], action)]

    @eqx.filter_jit
    def both(model: DeformationModel, *sample: Any) -> tuple[Any, Any]:
        return model(*sample), jax.jacfwd(lambda *parts: model(*parts), argnums=(0, 1, 2))(*sample)

    print("\n| model | prediction with Jacobian [ms], median / p95 of 500 |\n|---|---|")
    for name in model_names():
        model, times = load_model(name), []
        for _ in range(510):
            begun = time.perf_counter()
            jax.block_until_ready(both(model, *sample))
            times.append(1e3 * (time.perf_counter() - begun))
        print(f"| {name} | {np.median(times[10:]):.2f} / {np.percentile(times[10:], 95):.2f} |", flush=True)


STAGES = ("collect", "train", "evaluate", "adapt")


def main() -> None:
    """Run the chosen stages."""
    parser = argparse.ArgumentParser(description="Compare the deformation models.")
    parser.add_argument(
        "stage", nargs="?", choices=("all", *STAGES, "plateau", "ship", "shipped", "yu2d", "speed"), default="all"
    )
    parser.add_argument("--out", type=Path, default=Path("runs/comparison"))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--yu2d", type=Path, default=Path("runs/yu2d"))
    options = parser.parse_args()
    enable_compilation_cache()
    work = {
        "collect": lambda: collect_sets(options.out),
        "train": lambda: train_models(options.out, options.seeds),
        "evaluate": lambda: evaluate_models(options.out, options.seeds),
        "adapt": lambda: adapt_models(options.out),
        "ship": lambda: ship_models(options.out),
        "shipped": lambda: evaluate_shipped(options.out),
        "plateau": lambda: train_longer(options.out),
        "speed": time_models,
        "yu2d": lambda: compare_yu2d(options.out, options.yu2d, options.seeds),
    }
    for stage in STAGES if options.stage == "all" else (options.stage,):
        work[stage]()


if __name__ == "__main__":
    main()
