"""Laws of `collect`, `train` and `models`: from nothing to a model that `run` takes."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import Command
from holding import unheld_writes

from cableway.cli import main
from cableway.cli.models import HORIZONS
from cableway.datasets.reading import load_transitions
from cableway.tang2025.models.checkpoint import load_model, model_names, read_card

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
    assert main(["collect", *common, "--transitions", "300", "--seed", "5", "--out", str(folder / "data")]) == 0
    train = ["train", *common, "--data", str(folder / "data"), "--out", str(folder / "small.safetensors")]
    with unheld_writes(folder) as found:
        assert main(train) == 0
    assert found == [], "a training holds its folder until its last file"
    return folder


def test_collect_takes_number_and_seed_from_the_command_line(made: Path):
    data = load_transitions(made / "data")
    assert len(data) == 300
    assert data.metadata["seed"] == 5
    assert data.metadata["config"]["episode_steps"] == 20


def test_collect_says_what_it_wrote(cableway: Command, made: Path):
    command = ("collect", "--config", made / "recipe.yaml", "--transitions", "40", "--json", "--out", "d")
    done = cableway(*command)
    content = json.loads(done.out)
    assert (done.status, content["folder"], content["transitions"], content["made_now"]) == (0, "d", 40, 1)
    assert content["episodes"] == len(np.unique(load_transitions("d").episode))
    assert "collect" in done.err
    assert json.loads(cableway(*command).out) == {**content, "made_now": 0}


def interrupt(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def test_an_interrupted_collection_says_what_it_keeps(cableway: Command, made: Path, monkeypatch: pytest.MonkeyPatch):
    command = ("collect", "--config", made / "recipe.yaml", "--transitions", "40", "--out", "d", "--quiet")
    monkeypatch.setattr("cableway.datasets.writing.DatasetWriter.finish", interrupt)
    kept = "40 transitions are in d, and the same command continues from there"
    assert cableway(*command) == (130, "", f"cableway: interrupted; {kept}\n")


def test_an_interrupted_training_says_what_it_keeps(cableway: Command, made: Path, monkeypatch: pytest.MonkeyPatch):
    common = ("--quiet", "--log", "log.txt")
    command = ("train", "--config", made / "recipe.yaml", "--data", made / "data", "--out", "m", *common)
    with monkeypatch.context() as patch:
        patch.setattr("cableway.tang2025.models.recipe.evaluate", interrupt)
        kept = "the training so far is in m/model.safetensors.state, and the same command continues from there"
        assert cableway(*command) == (130, "", f"cableway: interrupted; {kept}\n")
    (logged,) = re.findall(r" training: (\{.*\})\n", Path("log.txt").read_text())
    assert cableway(*command) == (0, "", "")
    card = read_card("m/model.safetensors")
    assert json.loads(logged) == {name: card[name] for name in ("model", "training")}
    assert Path("m/model.safetensors").read_bytes() == (made / "small.safetensors").read_bytes()
    assert not list(Path("m").glob("*.state"))


def test_another_collection_in_the_same_folder_is_refused(cableway: Command, made: Path):
    done = cableway("collect", "--config", made / "recipe.yaml", "--out", made / "data")
    said = "contains a data set with another seed: 5, not 0; use another folder, or remove this one"
    assert done == (2, "", f"cableway: {made / 'data'}: {said}\n")


def test_without_its_extra_ray_is_asked_for(cableway: Command, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    done = cableway("collect", "--executor", "ray", "--out", "d")
    said = "the executor 'ray' needs Ray, which is not installed: pip install 'cableway[ray]'"
    assert done == (2, "", f"cableway: {said}\n")
    assert not Path("d").exists()


def test_train_leaves_a_model_and_its_card_and_nothing_else(made: Path):
    assert {path.name for path in made.iterdir()} == {
        "recipe.yaml",
        "data",
        "small.safetensors",
        "small.md",
        "small.png",
    }
    assert read_card(made / "small.safetensors")["data"]["transitions"] == 300
    assert load_model(made / "small.safetensors") is not None


def test_train_goes_on_from_a_model_on_mixed_sets(cableway: Command, made: Path):
    sets = ("--data", made / "data", made / "data")
    done = cableway("train", "--config", made / "recipe.yaml", "--from", made / "small.safetensors", *sets, "--json")
    assert json.loads(done.out)["epochs"] == 1
    card = read_card("runs/train/model.safetensors")
    assert card["data"]["transitions"] == 600
    assert card["model"] == read_card(made / "small.safetensors")["model"]
    assert len(card["data"]["metadata"]["sets"]) == 2


def test_evaluate_compares_models_with_those_that_learn_nothing(cableway: Command, made: Path):
    done = cableway("evaluate", made / "small.safetensors", "--data", made / "data", "--horizon", "5", "--json")
    report = json.loads(done.out)
    assert report["models"] == {str(made / "small.safetensors"): 1, "linear": 1, "persistence": 1, "rigid blend": 1}
    errors = report["data"][str(made / "data")]["errors_mm"]
    assert all(curve["horizons"] == [1, 2, 3, 4, 5] for curve in errors.values())
    assert errors["rigid blend"]["mean"] < errors["persistence"]["mean"]
    model = str(made / "small.safetensors")
    assert report["data"][str(made / "data")]["trained_on_it"] == [model], "the errors of what was learned by heart"
    assert f"{model}: trained on {made / 'data'};" in done.err.replace("\n", "")
    assert {path.name for path in Path("runs/evaluate").iterdir()} == {"report.json", "errors.png"}
    assert json.loads(Path("runs/evaluate/report.json").read_text()) == report


def test_evaluate_takes_a_recording_and_says_what_it_made_of_it(cableway: Command, made: Path):
    """Without the poses they come from the cable's ends, which for a single step is nearly the same."""
    data = load_transitions(made / "data")
    times, keypoints = 0.1 * np.arange(len(data)), data.keypoints
    np.savez("r.npz", times=times, keypoints=keypoints, poses=data.poses, episode=data.episode)
    np.savez("ends.npz", times=times, keypoints=keypoints, episode=data.episode, spare=times)
    done = cableway("evaluate", "linear", "--data", "r.npz", "ends.npz", "--horizon", "5", "--json")
    report, notes = json.loads(done.out), " ".join(done.err.split())
    assert report["data"]["r.npz"]["recording"]["poses"] == "recorded"
    assert "gripper poses from the cable's ends; length 299" in notes
    assert "measured; not read: spare" in notes
    curve, ends = (report["data"][name]["errors_mm"]["linear"] for name in ("r.npz", "ends.npz"))
    assert curve["episodes"][0] == len(np.unique(data.episode))
    assert curve["intervals"]["median"][0][0] <= curve["median"][0] <= curve["intervals"]["median"][1][0]
    np.testing.assert_allclose(ends["mean"], curve["mean"], rtol=0.5)
    table = cableway("evaluate", "linear", "--data", "r.npz", "--horizon", "5").out
    assert "Stacked error in mm" in table
    assert f"{curve['median'][0]:.2f} (" in table


def test_a_model_is_trained_on_a_recording(cableway: Command, made: Path):
    data = load_transitions(made / "data")
    np.savez("r.npz", times=0.1 * np.arange(len(data)), keypoints=data.keypoints, episode=data.episode)
    done = cableway("train", "--config", made / "recipe.yaml", "--data", "r.npz", "--out", "m.safetensors", "--quiet")
    assert done == (0, "", "")
    assert read_card("m.safetensors")["data"]["metadata"]["config"]["source"] == "r.npz"


def test_evaluate_refuses_a_model_for_other_cables(cableway: Command, made: Path):
    done = cableway("evaluate", "mlp", "--data", made / "data", "--horizon", "0")
    assert (done.status, done.out) == (2, "")
    assert "horizon must be at least 1, got 0" in done.err


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
        (
            "cableway: 1\ncollection: {transition: 3}",
            "collection.transition is not a known key; did you mean 'transitions'? known here: transitions, ",
        ),
        ("cableway: 1\ncollection: {transitions: many}", "collection.transitions must be a whole number, got 'many'"),
        ("cableway: 1\nrobot: {}", "unknown section 'robot'; known: "),
        (f"cableway: {'x' * 9999}", "cableway must be 1, the version of the format, got 'xxxxx"),
    ],
)
def test_a_recipe_with_a_mistake_is_one_sentence(cableway: Command, text: str, said: str):
    Path("r.yaml").write_text(text)
    done = cableway("collect", "--config", "r.yaml")
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("cableway: r.yaml: ")
    assert said in done.err
    assert done.err.count("\n") == 1
    assert len(done.err) < 500


def test_data_of_another_kind_are_refused(cableway: Command, made: Path):
    np.savez("plan.npz", shapes=np.zeros((3, 13, 2)))
    done = cableway("train", "--config", made / "recipe.yaml", "--data", "plan.npz")
    said = "a recording has the arrays times and keypoints; it has ['shapes']"
    assert done == (2, "", f"cableway: plan.npz: {said}\n")
