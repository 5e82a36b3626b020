"""What is listed is on disk; what is not sound is made again; a folder belongs to one data set and one writer."""

from __future__ import annotations

import resource
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from written_sets import ORIGIN, SIZES, rows, write_set

from cableway.core.errors import InputError, StorageError
from cableway.datasets.manifest import read_manifest, write_manifest
from cableway.datasets.reading import read_shard
from cableway.datasets.writing import open_writer


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_written_in_any_order_and_in_parts_it_is_the_same(tmp_path, whole):
    write_set(tmp_path / "parts", range(3, 5), finish=False)
    write_set(tmp_path / "parts", range(3), finish=True)
    assert contents(tmp_path / "parts") == contents(whole)


def test_a_sound_shard_is_kept_and_a_damaged_one_is_not(whole):
    (whole / "shard-000003.safetensors").write_bytes(b"")
    (whole / "shard-000001.safetensors").unlink()
    with open_writer(whole, ORIGIN) as writer:
        kept = [number for number in range(len(SIZES)) if writer.shard(2 * number) is not None]
    assert kept == [0, 2, 4]


def test_a_shard_that_is_not_listed_does_not_count(tmp_path, whole):
    """Killed between the shard and the manifest."""
    write_set(tmp_path / "part", range(2), finish=False)
    (tmp_path / "part" / "shard-000002.safetensors").write_bytes((whole / "shard-000002.safetensors").read_bytes())
    with open_writer(tmp_path / "part", ORIGIN) as writer:
        assert writer.shard(4) is None


def test_what_a_killed_writer_left_half_written_goes(whole):
    for name in (".shard-000007.safetensors.x8k2", ".manifest.json.ab12"):
        (whole / name).write_bytes(b"half")
    (whole / "notes.txt").write_text("mine")
    with open_writer(whole, ORIGIN):
        assert not list(whole.glob(".*"))
    assert (whole / "notes.txt").exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"seed": 8}, "seed: 7, not 8"),
        ({"config": {**ORIGIN.config, "motion": {"jitter": 0.1}}}, "config.motion.jitter: 0.2, not 0.1"),
        ({"config": {**ORIGIN.config, "task": "maze-1"}}, "config.task: None, not 'maze-1'"),
        ({"versions": {"cableway": "1"}}, "versions.cableway: '0', not '1'"),
    ],
)
def test_another_data_set_is_not_mixed_with(whole, change, said):
    before = contents(whole)
    with pytest.raises(InputError) as caught, open_writer(whole, replace(ORIGIN, **change)):
        pass
    assert str(caught.value) == (
        f"{whole}: contains a data set with another {said}; use another folder, or remove this one"
    )
    assert contents(whole) == before


def test_packages_of_extras_do_not_make_another_data_set(whole):
    """As where one is installed between an interruption and its continuation."""
    manifest = read_manifest(whole)
    write_manifest(whole, replace(manifest, versions={**manifest.versions, "viser": "1.1"}))
    with open_writer(whole, ORIGIN) as writer:
        assert writer.shard(0) is not None


def test_two_writers_do_not_share_a_folder(tmp_path):
    with (
        open_writer(tmp_path, ORIGIN),
        pytest.raises(InputError, match="another process is writing to this folder"),
        open_writer(tmp_path, ORIGIN),
    ):
        pass
    with open_writer(tmp_path, ORIGIN):
        pass


def test_a_write_that_fails_leaves_what_is_complete(tmp_path):
    """The system's limit on the size of a file stands for a full disk: both fail in the middle of a write."""
    write_set(tmp_path, range(2), finish=False)
    before = contents(tmp_path)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with open_writer(tmp_path, ORIGIN) as writer:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        try:
            with pytest.raises(StorageError) as caught:
                writer.add(3, 6, Counter(complete=2), rows(3))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert writer.shard(6) is None
    assert str(caught.value) == (
        f"{tmp_path / 'shard-000003.safetensors'}: cannot be written: File too large, after 2 complete shards, "
        "which are kept; once there is space, the same command continues from there"
    )
    assert contents(tmp_path) == before
    assert all(read_shard(tmp_path, shard, ORIGIN.columns) for shard in read_manifest(tmp_path).shards)
