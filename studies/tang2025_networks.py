"""The paper's T-DM, C-DM and B-DM: in world coordinates, of one width, on 50,000 transitions, three seeds each.

    .venv/bin/python studies/tang2025_networks.py collect            # two minutes
    .venv/bin/python studies/tang2025_networks.py train --jobs 9     # minutes of a GPU, days of a core
    .venv/bin/python studies/tang2025_networks.py evaluate           # a table, and errors.json
    .venv/bin/python studies/tang2025_networks.py ship               # the first seed's, with their cards

Interrupted and started again, it goes on where it stopped. `--epochs` and `--rate` try other trainings, into another
folder.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, replace
from multiprocessing import get_context
from pathlib import Path

from models import TEST, model_path, print_curves

from cableway.core.configuration import from_mapping
from cableway.core.files import write_json
from cableway.datasets.reading import load_transitions
from cableway.simulation.collection import collect
from cableway.simulation.episodes import CollectionConfig
from cableway.tang2025.models.card import write_card
from cableway.tang2025.models.checkpoint import WEIGHTS, load_model, read_card, save_model
from cableway.tang2025.models.evaluation import compare
from cableway.tang2025.models.learned import LearnedModel
from cableway.tang2025.models.recipe import Recipe, make_model_file, read_training_config, shipped_config

NETWORKS = ("tang2025-tdm", "tang2025-cdm", "tang2025-bdm")
SEEDS = 3


def collect_sets(folder: Path) -> None:
    """The training set, and the test set of `studies/models.py`."""
    training = read_training_config(shipped_config(NETWORKS[0])).collection
    collect(from_mapping(CollectionConfig, training, "collection"), folder / "training", workers=1)
    collect(TEST, folder / "test", workers=1)


def train_one(folder: Path, name: str, seed: int, recipe: Recipe) -> str:
    """Train one network; a line about it."""
    path = model_path(folder, name, seed)
    if not path.exists():
        make_model_file(path, recipe, load_transitions(folder / "training"))
    history = read_card(path)["history"]
    return f"{path.stem}: {history[-1]['validation_error']:.3f} mm held out after {len(history)} epochs"


def train_all(folder: Path, jobs: int, epochs: int | None, rate: float | None) -> None:
    """All networks of all seeds, so many at a time; processes share what device JAX finds."""
    given = {"epochs": epochs, "learning_rate": rate}
    changed = {key: value for key, value in given.items() if value is not None}
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        made = []
        for seed in range(SEEDS):
            for name in NETWORKS:
                recipe = read_training_config(shipped_config(name))
                recipe = replace(recipe, training=replace(recipe.training, seed=seed, **changed))
                made.append(pool.submit(train_one, folder, name, seed, recipe))
        for one in as_completed(made):
            print(one.result(), flush=True)


def evaluate_all(folder: Path) -> None:
    """Error against horizon on the test set."""
    models = {name: [load_model(model_path(folder, name, seed)) for seed in range(SEEDS)] for name in NETWORKS}
    curves = compare(models, load_transitions(folder / "test"))
    write_json(folder / "errors.json", {name: asdict(curve) for name, curve in curves.items()})
    print_curves("the paper's networks", curves)


def ship(folder: Path) -> None:
    """The networks of the first seed among the shipped weights, in half precision."""
    for name in NETWORKS:
        made = model_path(folder, name, 0)
        model = load_model(made)
        assert isinstance(model, LearnedModel)
        save_model(WEIGHTS / f"{name}.safetensors", model, read_card(made), half=True)
        print(write_card(WEIGHTS / f"{name}.safetensors"))


def main() -> None:
    """Run a stage."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stage", choices=("collect", "train", "evaluate", "ship"))
    parser.add_argument("--out", type=Path, default=Path("runs/tang2025-networks"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--epochs", type=int)
    parser.add_argument("--rate", type=float)
    given = parser.parse_args()
    if given.stage == "collect":
        collect_sets(given.out)
    elif given.stage == "train":
        train_all(given.out, given.jobs, given.epochs, given.rate)
    else:
        {"evaluate": evaluate_all, "ship": ship}[given.stage](given.out)


if __name__ == "__main__":
    main()
