"""Laws of model files: exact both ways, and every other file is refused with one sentence."""

from __future__ import annotations

import json
from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from cableway.core.errors import FileFormatError, InputError, UnknownNameError
from cableway.tang2025.models.checkpoint import (
    METADATA_KEY,
    load_model,
    model_file,
    model_names,
    read_card,
    read_metadata,
    save_model,
)
from cableway.tang2025.models.learned import LearnedModel
from cableway.tang2025.models.networks import RodConfig

CARD = {"kind": "transformer", "note": "made by a test"}


@pytest.fixture
def file(model, tmp_path):
    path = tmp_path / "some.safetensors"
    save_model(path, model, CARD)
    return path


def rewrite(path, *, arrays=None, **changes):
    """The same file with other metadata or arrays."""
    metadata = {**read_metadata(path), **changes}
    save_file(arrays or load_file(path), path, metadata={METADATA_KEY: json.dumps(metadata)})


def test_a_model_comes_back_bit_for_bit(model, file):
    loaded = load_model(file)
    assert eqx.tree_equal(loaded, model)
    assert loaded.config == model.config
    assert read_card(file) == CARD


def test_saving_again_gives_the_same_bytes(model, file, tmp_path):
    save_model(tmp_path / "again.safetensors", load_model(file), CARD)
    assert (tmp_path / "again.safetensors").read_bytes() == file.read_bytes()


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileFormatError, match=r"none.safetensors: no such file"):
        load_model(tmp_path / "none.safetensors")


@pytest.mark.parametrize("cut", [4, 200, -50])
def test_a_file_cut_short_is_refused(file, cut):
    file.write_bytes(file.read_bytes()[:cut])
    with pytest.raises(FileFormatError, match="not a readable safetensors file"):
        load_model(file)


@pytest.mark.parametrize("changed", [b"made by", b""])
def test_a_file_with_one_bit_changed_is_refused(file, changed):
    """In its card and in its weights alike, though what is there then is as good a text and as good a number."""
    content = bytearray(file.read_bytes())
    content[content.index(changed) if changed else -200] ^= 1
    file.write_bytes(content)
    with pytest.raises(FileFormatError, match="checksum"):
        load_model(file)


def test_another_safetensors_file_is_refused(tmp_path):
    save_file({"w": np.zeros(3)}, tmp_path / "other.safetensors")
    with pytest.raises(FileFormatError, match="not a cableway model of kind bilstm, conv, mlp, rod, transformer"):
        load_model(tmp_path / "other.safetensors")


def test_another_version_is_refused(file):
    rewrite(file, version=3)
    with pytest.raises(FileFormatError, match="of version 3; this cableway reads version 1 and 2"):
        load_model(file)


def test_a_rod_in_a_file_of_version_1_keeps_its_stiffness_and_rest_curvature(tmp_path):
    """Its second modes are given for x^2 - 1/3."""
    path, hinges = tmp_path / "rod.safetensors", 24
    save_model(path, LearnedModel(RodConfig(), key=jax.random.key(0)), CARD)
    arrays = load_file(path)
    arrays["rod.stiffness"], arrays["rod.rest"] = np.float32([0.5, -0.4]), np.float32([0.6, 0.8])
    rewrite(path, arrays=arrays, version=1)
    x = (2 * np.arange(hinges) + 1) / hinges - 1
    modes = np.stack([x, x**2 - 1 / 3])
    material = load_model(path).rod.material(hinges)
    np.testing.assert_allclose(material.stiffness, np.exp(arrays["rod.stiffness"] @ modes), rtol=1e-6)
    np.testing.assert_allclose(hinges * material.rest, arrays["rod.rest"] @ modes, atol=1e-6)
    save_model(path, load_model(path), CARD)
    assert read_metadata(path)["version"] == 2
    np.testing.assert_allclose(load_file(path)["rod.stiffness"], [0.5, -0.4 * 2 / 3], rtol=1e-6)


def test_a_file_that_does_not_say_how_many_keypoints_a_network_saw_has_it_with_its_data(model, file):
    config = {key: value for key, value in read_metadata(file)["config"].items() if key != "keypoints"}
    for card, keypoints in (
        (CARD, model.config.keypoints),
        ({"data": {"metadata": {"config": {"cable": {"keypoints": 10}}}}}, 10),
    ):
        rewrite(file, config=config, card=card)
        assert load_model(file).config == replace(model.config, keypoints=keypoints)


def test_another_kind_is_refused_with_the_known_ones(file):
    rewrite(file, kind="oracle")
    with pytest.raises(FileFormatError, match="unknown kind of model 'oracle'; known: bilstm, conv, mlp, rod"):
        load_model(file)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"width": 24}, "multiple of its"),
        ({"width": 16, "heads": 2, "wings": 2}, "wings is not a known key; known here: .*decoder_blocks"),
        ({"width": "wide"}, "width must be a whole number, got 'wide'"),
        (None, "must be a mapping"),
        ({"width": 16, "heads": 2, "encoder_blocks": 2}, "array 'encoder.1"),
        ({"width": 32, "heads": 2, "encoder_blocks": 1}, "is float32"),
    ],
)
def test_a_configuration_that_does_not_fit_is_refused(file, config, message):
    if config == {"width": 24}:
        config = {"width": 25}
    rewrite(file, config=config)
    with pytest.raises(FileFormatError, match=message):
        load_model(file)


def test_a_weight_that_is_not_finite_is_refused(file):
    arrays = load_file(file)
    arrays["readout.bias"] = np.array([np.nan, 0.0], np.float32)
    rewrite(file, arrays=arrays)
    with pytest.raises(FileFormatError, match=r"'readout.bias' holds a number that is not finite"):
        load_model(file)


def test_an_unknown_name_lists_the_shipped_ones():
    with pytest.raises(UnknownNameError, match="unknown model 'transfomer'; known: ") as caught:
        load_model("transfomer")
    assert isinstance(caught.value, InputError)
    assert all(name in str(caught.value) for name in model_names())


def test_names_and_paths_are_told_apart(tmp_path):
    assert model_file("./transformer").parts == ("transformer",)
    assert model_file("mine.safetensors").name == "mine.safetensors"
    assert model_file(tmp_path / "transformer") == tmp_path / "transformer"


def test_loading_does_not_depend_on_random_numbers(file):
    first, second = load_model(file), load_model(file)
    assert eqx.tree_equal(first, second)
    assert len(jax.tree.leaves(first)) > 20


def test_half_precision_makes_a_smaller_file_and_hardly_changes_the_weights(model, file, tmp_path):
    rounded = tmp_path / "half.safetensors"
    save_model(rounded, model, CARD, half=True)
    assert rounded.stat().st_size < 0.9 * file.stat().st_size
    changed = 0
    for weight, other in zip(*(jax.tree.leaves(eqx.filter(load_model(path), eqx.is_array)) for path in (file, rounded)),
                             strict=True):  # fmt: skip
        np.testing.assert_allclose(other, weight, rtol=1e-3, atol=1e-6)
        assert other.dtype == weight.dtype
        changed += not np.array_equal(weight, other)
    assert changed
