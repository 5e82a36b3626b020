"""Laws of `collect`, `train` and `models`: from nothing to a model that `run` takes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Command

from cableway.cli import main
from cableway.cli.models import HORIZONS
from cableway.models.checkpoint import load_model, model_names, read_card
from cableway.records import Transitions

RECIPE = """
cableway: 1
collection: {transitions: 900, episode_steps: 20}
model: {kind: transformer, width: 8, heads: 2, encoder_blocks: 1}
training: {epochs: 1, rollout_epochs: 0, batch_size: 64}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recipe, data and a model."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "recipe.yaml").write_text(RECIPE)
    common = ["--config", str(folder / "recipe.yaml"), "--quiet"]
    assert main(["collect", *common, "--transitions", "300", "--seed", "5", "--out", str(folder / "data.npz")]) == 0
    train = ["train", *common, "--data", str(folder / "data.npz"), "--out", str(folder / "small.safetensors")]
    assert main(train) == 0
    return folder


def test_collect_takes_number_and_seed_from_the_command_line(made: Path):
    data = Transitions.load(made / "data.npz")
    assert len(data) == 300
    assert data.metadata["seed"] == 5
    assert data.metadata["config"]["episode_steps"] == 20


def test_collect_says_what_it_wrote(cableway: Command, made: Path):
    done = cableway("collect", "--config", made / "recipe.yaml", "--transitions", "40", "--json", "--out", "d")
    content = json.loads(done.out)
    assert (done.status, content["file"], content["transitions"]) == (0, "d/data.npz", 40)
    assert content["episodes"] == len(np.unique(Transitions.load("d/data.npz").episode))
    assert "collect" in done.err


def test_train_leaves_a_model_and_its_card_and_nothing_else(made: Path):
    assert {path.name for path in made.iterdir()} == {"recipe.yaml", "data.npz", "small.safetensors", "small.md"}
    assert read_card(made / "small.safetensors")["data"]["transitions"] == 300
    assert load_model(made / "small.safetensors") is not None


def test_models_lists_the_shipped_the_named_and_those_below_runs(cableway: Command, made: Path):
    Path("runs/train").mkdir(parents=True)
    (Path("runs/train") / "local.safetensors").write_bytes((made / "small.safetensors").read_bytes())
    done = cableway("models", made / "small.safetensors", "--json", "--out", "list")
    rows = {row["model"]: row for row in json.loads(done.out)["models"]}
    assert set(rows) == {*model_names(), str(made / "small.safetensors"), "runs/train/local.safetensors"}
    row = rows["runs/train/local.safetensors"]
    assert row["mean_error_mm"].keys() == {str(steps) for steps in HORIZONS}
    assert row["mean_error_mm"]["1"] > 0
    assert row["kind"] == "transformer"
    assert json.loads(Path("list/report.json").read_text()) == json.loads(done.out)


def test_models_as_a_table_has_a_row_for_each(cableway: Command, made: Path):
    Path("m.safetensors").write_bytes((made / "small.safetensors").read_bytes())
    done = cableway("models", "m.safetensors")
    assert done.status == 0
    assert "m.safetensors" in done.out
    assert " mm" in done.out


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("collection: {}", "cableway must be 1"),
        ("cableway: 1\ncollection: {transition: 3}", "collection has an unknown key 'transition'; known: "),
        ("cableway: 1\ncollection: {transitions: many}", "collection.transitions must be a whole number, got 'many'"),
        ("cableway: 1\nrobot: {}", "unknown section 'robot'; known: "),
    ],
)
def test_a_recipe_with_a_mistake_is_one_sentence(cableway: Command, text: str, said: str):
    Path("r.yaml").write_text(text)
    done = cableway("collect", "--config", "r.yaml")
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("cableway: r.yaml: ")
    assert said in done.err
    assert done.err.count("\n") == 1


def test_data_of_another_kind_are_refused(cableway: Command, made: Path):
    np.savez("plan.npz", shapes=np.zeros((3, 13, 2)))
    done = cableway("train", "--config", made / "recipe.yaml", "--data", "plan.npz")
    assert done == (2, "", "cableway: plan.npz: not a transitions file, it has no array 'keypoints'\n")
