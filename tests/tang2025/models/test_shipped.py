"""The shipped models, judged on transitions that are simulated afresh."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from cableway.core.configuration import from_mapping
from cableway.datasets.reading import load_transitions
from cableway.datasets.transitions import Transitions
from cableway.scene.cable import Cable
from cableway.simulation.collection import collect
from cableway.simulation.episodes import CollectionConfig
from cableway.tang2025.models.base import Persistence, RigidBlend
from cableway.tang2025.models.card import card_text
from cableway.tang2025.models.checkpoint import load_model, model_file, model_names, read_card
from cableway.tang2025.models.evaluation import evaluate
from cableway.tang2025.models.recipe import read_training_config, shipped_config
from cableway.tang2025.models.training import TrainingConfig

OTHER_SEED = 4321
"""Not the seed of the shipped model's data."""


@pytest.mark.parametrize(
    ("cable", "better"),
    [(Cable(), 5.0), (Cable(length=0.17, damping_time=0.05), 3.0)],
    ids=["the cable it was trained on", "a shorter cable that lags less"],
)
def test_it_beats_the_baselines_on_fresh_transitions(cable, better, tmp_path):
    collect(CollectionConfig(transitions=600, seed=OTHER_SEED, cable=cable), tmp_path)
    data = load_transitions(tmp_path)
    models = {"model": load_model("transformer"), "blend": RigidBlend(), "still": Persistence()}
    table = evaluate(models, data, horizons=(1, 10), stride=5)
    for row, blend, still in zip(table["model"], table["blend"], table["still"], strict=True):
        assert better * row.median < blend.median < still.median
        assert row.p95 < blend.p95


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """Other transitions of a kind, collected once."""

    @cache
    def collected(config: CollectionConfig) -> Transitions:
        folder = tmp_path_factory.mktemp("others")
        collect(config, folder)
        return load_transitions(folder)

    return collected


@pytest.mark.parametrize("name", model_names())
def test_it_predicts_as_its_card_says(name, others):
    """The medians over other episodes of the kind it was trained on, within a third."""
    config = from_mapping(CollectionConfig, read_training_config(shipped_config(name)).collection, "collection")
    data = others(replace(config, transitions=3000, seed=OTHER_SEED))
    table = evaluate({"model": load_model(name)}, data, horizons=(1, 10), stride=5)
    said = {row["horizon"]: row["median"] for row in read_card(name)["errors"]["model"]}
    assert [row.median for row in table["model"]] == pytest.approx([said[1], said[10]], rel=1 / 3)


@pytest.mark.parametrize("name", model_names())
def test_it_is_what_its_configuration_says(name):
    recipe, card = read_training_config(shipped_config(name)), read_card(name)
    assert from_mapping(type(recipe.model), card["model"], "card") == recipe.model
    assert from_mapping(TrainingConfig, card["training"], "card") == recipe.training
    assert card["data"]["transitions"] == recipe.collection["transitions"]
    assert len(card["history"]) == recipe.training.epochs


@pytest.mark.parametrize("name", model_names())
def test_its_page_shows_the_figures_of_its_file(name):
    assert model_file(name).with_suffix(".md").read_text() == card_text(name, read_card(name))


def test_a_model_is_shipped_and_small():
    assert "transformer" in model_names()
    assert all(model_file(name).stat().st_size < 2e6 for name in model_names())
