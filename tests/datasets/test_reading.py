"""What was written is read back: whole, in shuffled batches, by others' tools; what is damaged is named."""

from __future__ import annotations

import json
import pickle
import re
import tracemalloc
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save
from written_sets import CABLE, ORIGIN, SIZES, rows, write_set

from cableway.core.errors import FileFormatError, InputError
from cableway.datasets.manifest import columns_for, read_manifest
from cableway.datasets.reading import load_transitions, shuffled_batches
from cableway.datasets.writing import Origin, open_writer


def test_it_is_read_as_it_was_written(whole):
    data = load_transitions(whole)
    assert len(data) == sum(SIZES)
    assert data.keypoints.shape == (len(data), CABLE.keypoints, 2)
    np.testing.assert_array_equal(data.poses[:, 1, 2], np.arange(len(data)))
    np.testing.assert_array_equal(data.episode, np.repeat(2 * np.arange(len(SIZES)), SIZES))
    assert data.cable.keys() == {"friction", "rest_curvature"}
    np.testing.assert_array_equal(data.cable["friction"], np.arange(len(data)))
    np.testing.assert_array_equal(data.cable["rest_curvature"], np.arange(len(data))[:, None])
    assert data.metadata == {
        "seed": 7, "config": ORIGIN.config, "versions": ORIGIN.versions, "episodes_ended": {"complete": 2 * len(SIZES)},
    }  # fmt: skip


def test_others_read_it_with_safetensors_and_json_alone(whole):
    manifest = json.loads((whole / "manifest.json").read_text())
    parts = [load_file(whole / shard["file"]) for shard in manifest["shards"]]
    for name, column in manifest["columns"].items():
        array = np.concatenate([part[name] for part in parts])
        assert array.shape == (manifest["transitions"], *column["row_shape"])
        assert array.dtype == column["dtype"]
        data = load_transitions(whole)
        known = {**vars(data), **{f"cable.{field}": values for field, values in data.cable.items()}}
        np.testing.assert_array_equal(array, known[name])


def test_the_code_in_the_documentation_reads_it(whole, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs" / "datasets.md").read_text()
    pieces = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    results: dict[str, Any] = {}
    for piece in pieces:
        exec(piece, results)
    assert len(pieces) == 2
    assert whole == tmp_path / results["folder"]
    np.testing.assert_array_equal(results["arrays"]["keypoints"], load_transitions(whole).keypoints[-SIZES[-1] :])


@pytest.mark.parametrize(("batch_size", "buffer"), [(1, 1), (4, 6), (4, 10_000), (100, 1)])
def test_batches_hold_every_transition_once(whole, batch_size, buffer):
    batches = list(shuffled_batches(whole, batch_size, seed=3, buffer=buffer))
    index = np.concatenate([batch.keypoints[:, 0, 0] for batch in batches])
    assert sorted(index) == list(range(sum(SIZES)))
    assert all(len(batch) == batch_size for batch in batches[:-1])
    for batch in batches:
        np.testing.assert_array_equal(batch.actions[:, 0, 0], batch.keypoints[:, 0, 0])
        np.testing.assert_array_equal(batch.cable["friction"], batch.keypoints[:, 0, 0])


def test_batches_are_shuffled_by_the_seed_alone(whole):
    orders = [np.concatenate([b.poses[:, 0, 0] for b in shuffled_batches(whole, 5, seed=seed)]) for seed in (0, 0, 1)]
    np.testing.assert_array_equal(orders[0], orders[1])
    assert (orders[0] != orders[2]).any()
    assert np.abs(np.diff(orders[0])).mean() > 3


def test_batches_need_memory_for_the_buffer_not_for_the_set(tmp_path):
    """Ten times the shards, the same peak."""
    peaks = []
    for shards in (8, 80):
        columns = columns_for(CABLE)
        arrays = {name: np.zeros((500, *column.row_shape), column.dtype) for name, column in columns.items()}
        with open_writer(tmp_path / str(shards), Origin(0, {}, {}, columns)) as writer:
            for number in range(shards):
                writer.add(number, number, Counter(complete=1), arrays)
            writer.finish()
        tracemalloc.start()
        count = sum(len(batch) for batch in shuffled_batches(tmp_path / str(shards), 64, buffer=1500))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert count == 500 * shards
    assert peaks[1] < 1.3 * peaks[0]


@pytest.mark.parametrize(("batch_size", "buffer"), [(0, 1), (1, 0)])
def test_sizes_below_one_are_refused(whole, batch_size, buffer):
    with pytest.raises(InputError, match="must be at least 1, got 0"):
        shuffled_batches(whole, batch_size, buffer=buffer)


def flip_a_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (flip_a_bit, "damaged: its SHA-256 differs from the manifest's; the command that made the data set makes"),
        (lambda path: path.write_bytes(path.read_bytes()[:-1]), "damaged"),
        (Path.unlink, "no such file; the command that made the data set makes it again"),
    ],
)
def test_a_damaged_shard_is_named(whole, damage, message):
    damage(whole / "shard-000003.safetensors")
    for read in (load_transitions, lambda folder: list(shuffled_batches(folder, 2))):
        with pytest.raises(FileFormatError) as caught:
            read(whole)
        assert str(caught.value).startswith(f"{whole}/shard-000003.safetensors: {message}")


SHARD = {
    "file": "shard-000000.safetensors",
    "sha256": 64 * "0",
    "first_episode": 0,
    "episodes": 1,
    "transitions": 0,
    "ended": {},
}


class Trap:
    def __reduce__(self):
        return (pytest.fail, ("a file was executed",))


def forged(folder: Path, content: bytes) -> None:
    """A shard of other content, with its right checksum in the manifest."""
    import hashlib

    (folder / "shard-000000.safetensors").write_bytes(content)
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["shards"][0]["sha256"] = hashlib.sha256(content).hexdigest()
    (folder / "manifest.json").write_text(json.dumps(manifest))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (pickle.dumps(Trap()), "not a readable safetensors file"),
        (save({"keypoints": np.zeros((7, 3, 2))}), "its arrays are"),
        (save({**rows(0), "episode": np.zeros(7)}), "its arrays are"),
    ],
)
def test_a_shard_of_another_kind_is_refused_and_not_executed(whole, content, message):
    forged(whole, content)
    with pytest.raises(FileFormatError, match=message):
        load_transitions(whole)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 2}, "manifest.version must be one of 1, got 2"),
        ({"format": "other"}, "manifest.format must be one of cableway-transitions, got 'other'"),
        ({"seed": "0"}, "manifest.seed must be a whole number, got '0'"),
        ({"columns": {}}, "columns must be keypoints, poses"),
        (
            {"shards": [{**SHARD, "file": "../../elsewhere"}]},
            "shard.file must be shard-NUMBER.safetensors, got '../",
        ),
        ({"transitions": 26}, "the manifest says 26 transitions, but its shards have 25"),
        ({"shards": [{**SHARD, "episodes": 0}]}, "shard.episodes must be whole and positive, got 0"),
        ({"extra": 1}, "manifest.extra is not a known key"),
    ],
)
def test_a_manifest_that_is_not_one_is_refused(whole, change, message):
    path = whole / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(FileFormatError) as caught:
        load_transitions(whole)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("columns", "actions", "dtype"), "x", "manifest.columns.actions.dtype must be one of float64, int64, got 'x'"),
        (("columns", "poses", "row_shape"), [-2, 3], "row_shape must have sizes of at least 1, got [-2, 3]"),
        (("columns", "poses", "row_shape"), [2**60, 3], "is listed twice, or with more than the 0 transitions"),
        (("shards", 0, "transitions"), 10**12, "shard-000000.safetensors is listed twice, or with more than"),
        (("shards", 1, "file"), "shard-000000.safetensors", "shard-000000.safetensors is listed twice"),
    ],
)
def test_a_manifest_that_promises_what_no_file_holds_is_refused(whole, place, value, message):
    """Before anything is made as large as it says."""
    path, (*outer, key) = whole / "manifest.json", place
    content = inner = json.loads(path.read_text())
    for step in outer:
        inner = inner[step]
    inner[key] = value
    path.write_text(json.dumps(content))
    with pytest.raises(FileFormatError) as caught:
        load_transitions(whole)
    assert message in str(caught.value)


def test_no_manifest_and_no_json_are_refused(tmp_path, whole):
    with pytest.raises(FileFormatError, match="not a data set; one is a folder with manifest"):
        load_transitions(tmp_path)
    (whole / "manifest.json").write_bytes(b"\xff{")
    with pytest.raises(FileFormatError, match=r"manifest\.json: not JSON: "):
        read_manifest(whole)


def test_a_set_that_is_not_complete_is_refused(tmp_path):
    write_set(tmp_path, range(2), finish=False)
    assert read_manifest(tmp_path).transitions == 8
    with pytest.raises(FileFormatError, match="incomplete, with 8 transitions so far"):
        load_transitions(tmp_path)
