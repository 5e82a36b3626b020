"""A collection that is killed, damaged or done by others ends as the one that nothing happened to, byte for byte."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cableway.core.executors import open_executor
from cableway.core.files import write_atomically
from cableway.datasets.manifest import MANIFEST, read_manifest
from cableway.datasets.reading import load_transitions, read_shard
from cableway.simulation.collection import collect
from cableway.simulation.episodes import CollectionConfig

RANGES = {"damping_time": (0.05, 0.3)}
CONFIG = CollectionConfig(transitions=1500, seed=11, episode_steps=20, shard_episodes=8, ranges=RANGES)

COLLECT = """
import sys
from cableway.core.files import write_atomically
from cableway.simulation.collection import collect
from cableway.simulation.episodes import CollectionConfig
if __name__ == "__main__":
    ranges = {"damping_time": (0.05, 0.3)}
    config = CollectionConfig(transitions=1500, seed=11, episode_steps=20, shard_episodes=8, ranges=ranges)
    collect(config, sys.argv[1], workers=int(sys.argv[2]))
"""


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Files of the collection without interruption, by one process."""
    folder = tmp_path_factory.mktemp("whole")
    collect(CONFIG, folder)
    return contents(folder)


def children(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def wait_for(condition, seconds: float = 60.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it never came"
        time.sleep(0.005)


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at processes in /proc")
@pytest.mark.parametrize(("workers", "kills"), [(1, 2), (2, 1)])
def test_killed_at_random_moments_it_ends_the_same(tmp_path, whole, workers, kills):
    """Killed as by `kill -9`; what was listed then is sound, is not made again, and no worker is left behind."""
    rng, folder = np.random.default_rng(workers), tmp_path / "set"
    listed = 0
    for _ in range(kills):
        process = subprocess.Popen([sys.executable, "-c", COLLECT, str(folder), str(workers)])
        wait_for(lambda before=listed: (folder / MANIFEST).exists() and len(read_manifest(folder).shards) > before)
        time.sleep(rng.uniform(0, 0.03))
        workers_left = children(process.pid)
        os.kill(process.pid, signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL, "it was done before it was killed"
        wait_for(lambda left=workers_left: not any(map(is_running, left)))
        manifest = read_manifest(folder)
        for shard in manifest.shards:
            read_shard(folder, shard, manifest.columns)
        listed = len(manifest.shards)
    done = collect(CONFIG, folder)
    assert done.made == len(done.manifest.shards) - listed
    assert contents(folder) == whole


def test_damaged_and_missing_shards_are_made_again(tmp_path, whole):
    for name, content in whole.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "shard-000000.safetensors").write_bytes(whole["shard-000001.safetensors"])
    (tmp_path / "shard-000003.safetensors").unlink()
    last = max(name for name in whole if name.startswith("shard-"))
    (tmp_path / last).write_bytes(whole[last][:-1])
    assert collect(CONFIG, tmp_path).made == 3
    assert contents(tmp_path) == whole
    assert collect(CONFIG, tmp_path).made == 0


def test_shards_of_another_size_hold_the_same_transitions(tmp_path, whole):
    for name, content in whole.items():
        write_atomically(tmp_path / "small" / name, lambda file, content=content: file.write(content))
    collect(replace(CONFIG, shard_episodes=60), tmp_path / "large")
    small, large = load_transitions(tmp_path / "small"), load_transitions(tmp_path / "large")
    assert len(read_manifest(tmp_path / "large").shards) < len(read_manifest(tmp_path / "small").shards)
    for name in ("keypoints", "poses", "actions", "next_keypoints", "episode"):
        np.testing.assert_array_equal(getattr(large, name), getattr(small, name))
    assert large.metadata["episodes_ended"] == small.metadata["episodes_ended"]


def test_ray_writes_the_same_bytes(tmp_path, whole):
    pytest.importorskip("ray")
    collect(CONFIG, tmp_path, workers=2, executor="ray")
    assert contents(tmp_path) == whole


def test_results_come_in_order_and_few_wait(tmp_path):
    begun: list[int] = []
    with open_executor("local", 1) as executor:
        results = executor.in_order(lambda number: begun.append(number) or number, ((k,) for k in range(50)))
        assert [next(results) for _ in range(5)] == [0, 1, 2, 3, 4]
        assert len(begun) == 5
        assert list(results) == list(range(5, 50))
