"""Recipes: read strictly, carried out, and written up."""

from __future__ import annotations

import json

import pytest

from cableway.core.errors import FileFormatError, InputError, UnknownNameError
from cableway.tang2025.models.card import card_text, write_card
from cableway.tang2025.models.checkpoint import save_model
from cableway.tang2025.models.dataset import fingerprint
from cableway.tang2025.models.recipe import make_model, make_model_file, read_training_config, shipped_config
from cableway.tang2025.models.transformer import TransformerConfig

GOOD = """
cableway: 1
collection: {transitions: 100, cable: {length: 0.2}}
model: {kind: transformer, width: 16, heads: 2, encoder_blocks: 1, framing: {blend: false}}
training: {epochs: 2, rollout_epochs: 0, batch_size: 64, learning_rate: 1.0e-3}
"""


@pytest.fixture
def recipe(tmp_path):
    path = tmp_path / "recipe.yaml"
    path.write_text(GOOD)
    return path


def test_a_recipe_is_read_with_defaults_for_what_it_leaves_out(recipe):
    read = read_training_config(recipe)
    assert isinstance(read.model, TransformerConfig)
    assert (read.model.width, read.model.decoder_blocks, read.model.framing.blend) == (16, 1, False)
    assert read.model.framing.hard_ends
    assert (read.training.epochs, read.training.mirror) == (2, True)
    assert read.collection == {"transitions": 100, "cable": {"length": 0.2}}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("cableway: 1", "cableway: 2", "cableway must be 1"),
        ("cableway: 1", "cableway: 1\nextra: 1", "unknown section 'extra'; known: cableway, collection, model"),
        ("width: 16", "widht: 16", "model.widht is not a known key; did you mean 'width'.* known here: .*width"),
        ("width: 16", "width: 16.5", "model.width must be a whole number, got 16.5"),
        ("width: 16", "width: true", "model.width must be a whole number, got True"),
        ("blend: false", "blend: 0", "model.framing.blend must be true or false, got 0"),
        ("blend: false", "frame: sky", "model.framing.frame must be one of cable, world, got 'sky'"),
        ("1.0e-3", ".nan", "training.learning_rate must be a finite number, got nan"),
        ("epochs: 2,", "epochs: 0,", "training: training.epochs must be whole and at least 1, got 0"),
        ("{transitions: 100, cable: {length: 0.2}}", "[1]", "collection must be a mapping"),
    ],
)
def test_each_mistake_in_a_recipe_has_its_sentence(recipe, old, new, message):
    recipe.write_text(GOOD.replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        read_training_config(recipe)
    assert str(recipe) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_kind_is_refused_with_the_known_ones(recipe):
    recipe.write_text(GOOD.replace("kind: transformer", "kind: oracle"))
    with pytest.raises(InputError, match=r"recipe.yaml: model.kind must be one of bilstm, conv, .*, got 'oracle'$"):
        read_training_config(recipe)


def test_files_that_are_no_recipe_are_refused(tmp_path):
    with pytest.raises(FileFormatError, match="no such file"):
        read_training_config(tmp_path / "none.yaml")
    (tmp_path / "bad.yaml").write_text("a: [1")
    with pytest.raises(FileFormatError, match=r"bad\.yaml:1: not valid YAML"):
        read_training_config(tmp_path / "bad.yaml")
    (tmp_path / "list.yaml").write_text("- 1")
    with pytest.raises(InputError, match="must be a mapping of keys to values"):
        read_training_config(tmp_path / "list.yaml")


def test_the_shipped_recipe_is_valid():
    read = read_training_config(shipped_config())
    assert isinstance(read.model, TransformerConfig)


def test_an_unknown_shipped_recipe_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match="unknown model configuration 'oracle'; known: bilstm, conv"):
        shipped_config("oracle")


@pytest.mark.parametrize("meanwhile", ["evaluate", "save_model"])
def test_a_training_is_kept_until_its_model_is_saved(recipe, transitions, tmp_path, monkeypatch, meanwhile):
    """Interrupted while it is evaluated or saved, it does not begin anew, and ends as the model of one left alone."""
    read, file, other = read_training_config(recipe), tmp_path / "tiny.safetensors", tmp_path / "other.safetensors"
    make_model_file(other, read, transitions)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(f"cableway.tang2025.models.recipe.{meanwhile}", interrupted)
        with pytest.raises(KeyboardInterrupt):
            make_model_file(file, read, transitions)
    assert not file.exists()
    stages = []
    make_model_file(file, read, transitions, progress=lambda stage, share: stages.append(stage))
    assert stages == []
    assert file.read_bytes() == other.read_bytes()
    assert {path.suffix for path in tmp_path.iterdir()} == {".safetensors", ".yaml"}


def test_a_made_model_brings_a_card_with_its_own_figures(recipe, transitions, tmp_path):
    recipe.write_text(GOOD.replace("{blend: false}", "{}"))
    model, card = make_model(read_training_config(recipe), transitions)
    assert json.loads(json.dumps(card, allow_nan=False)) == card
    assert card["data"]["sha256"] == fingerprint(transitions)
    assert card["parameters"] == model.parameters
    assert [row["horizon"] for row in card["errors"]["model"]] == [1, 5, 10, 20]
    assert set(card["errors"]) == {"model", "persistence", "rigid blend"}
    file = tmp_path / "tiny.safetensors"
    save_model(file, model, card)
    page = write_card(file).read_text()
    assert page == card_text("tiny", card)
    assert page.startswith("# tiny\n")
    assert f"{card['errors']['model'][0]['median']:.2f}" in page
    assert card["data"]["sha256"] in page
