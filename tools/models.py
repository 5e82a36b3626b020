"""Compare the deformation models: collect the sets, train every model with three seeds, evaluate, adapt.

    .venv/bin/python tools/models.py                   # all of it, below runs/comparison; some 40 minutes of one core
    .venv/bin/python tools/models.py train --seeds 1   # one stage; what is already there is kept

Interrupted and started again, it goes on where it stopped.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from cableway.datasets.reading import load_transitions
from cableway.models.checkpoint import save_model
from cableway.models.compilation import enable_compilation_cache
from cableway.models.conv import ConvConfig
from cableway.models.frames import Framing
from cableway.models.learned import LearnedConfig
from cableway.models.mlp import MLPConfig
from cableway.models.recipe import Recipe, make_model
from cableway.models.recurrent import RecurrentConfig
from cableway.models.rod import RodConfig
from cableway.models.training_config import TrainingConfig
from cableway.models.transformer import TransformerConfig
from cableway.scene.cable import Cable
from cableway.simulation.collection import collect
from cableway.simulation.episodes import CollectionConfig

STAGES = ("collect", "train")

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
            path.parent.mkdir(parents=True, exist_ok=True)
            recipe = Recipe(collection={}, model=model, training=replace(training, seed=seed))
            made, card = make_model(recipe, data, state_file=path.with_suffix(".state"))
            save_model(path, made, card)
            print(f"{path}: {card['errors']['model']}", flush=True)


def main() -> None:
    """Carry out the stages asked for."""
    parser = argparse.ArgumentParser(description="Compare the deformation models.")
    parser.add_argument("stage", nargs="?", choices=("all", *STAGES), default="all")
    parser.add_argument("--out", type=Path, default=Path("runs/comparison"))
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    enable_compilation_cache()
    stages = STAGES if options.stage == "all" else (options.stage,)
    if "collect" in stages:
        collect_sets(options.out)
    if "train" in stages:
        train_models(options.out, options.seeds)


if __name__ == "__main__":
    main()
