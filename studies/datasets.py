"""Measure the collection of data sets: rates, memory, shuffled reading, `kill -9` at random moments, Ray.

    .venv/bin/python studies/datasets.py                    # rates, 50,000 transitions, kills: some minutes
    .venv/bin/python studies/datasets.py set --transitions 1000000        # some ten minutes and 0.5 GB of disk
    .venv/bin/python studies/datasets.py ray                # needs the extra `ray`

Linux only: peak memory is VmHWM of /proc. Times depend on what else the machine does.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cableway.datasets.manifest import MANIFEST, read_manifest
from cableway.datasets.reading import read_shard, shuffled_batches
from cableway.scene.cable import Cable
from cableway.simulation.chain import Chain
from cableway.simulation.collection import collect
from cableway.simulation.episodes import CollectionConfig
from cableway.simulation.plant import PlantConfig

ROUNDS = 5
"""How often each rate is measured."""

RATED = 12_000
"""Transitions that a rate is measured on."""

RATED_STEPS = 4000
"""Time steps that MuJoCo alone is rated on."""

LED = np.array([[0.35, 0.35, 0.4, -20.0, 2.0, 3.0], [0.55, 0.45, 1.4, -12.0, -4.0, 1.0]])
"""Rod coordinates between which the cable is then led."""

KILLS = 10
KILLED = "cableway: 1\ncollection: {transitions: 12000, seed: 11, shard_episodes: 8}\n"
"""A collection of some thirty shards."""


@contextmanager
def collecting(folder: Path, workers: int, transitions: int | None = None, recipe: Path | None = None) -> Iterator:
    """The command, running."""
    command = [sys.executable, "-m", "cableway", "collect", "--quiet", "--workers", str(workers), "--out", str(folder)]
    command += [] if transitions is None else ["--transitions", str(transitions)]
    command += [] if recipe is None else ["--config", str(recipe)]
    # what the standard library says of a killed process is of no interest here
    process = subprocess.Popen(command, env={**os.environ, "PYTHONWARNINGS": "ignore"})
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def peak_memory(pid: int) -> float:
    """Largest resident size [MB] of a process so far; 0 where it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return max((int(line.split()[1]) / 1000 for line in lines if line.startswith("VmHWM")), default=0.0)


def children(pid: int) -> list[int]:
    """Its child processes."""
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):
        return []


def rate(folder: Path, workers: int, transitions: int) -> float:
    """Transitions per second once all workers are at work: from the first fifth on."""
    seen: list[tuple[float, float]] = []
    config = CollectionConfig(transitions=transitions, seed=1)
    collect(config, folder, workers=workers, progress=lambda _, share: seen.append((time.perf_counter(), share)))
    begin = next(point for point in seen if point[1] >= 0.2)
    end = next(point for point in seen if point[1] >= 1.0)
    return transitions * (end[1] - begin[1]) / (end[0] - begin[0])


def rate_of_mujoco() -> float:
    """Transitions in a second of processor time, were there nothing to do but MuJoCo's steps."""
    chain = Chain(Cable(), None, PlantConfig.time_step)
    poses = chain.rod.shapes(np.linspace(*LED, RATED_STEPS))[1]
    chain.place(LED[0])
    before = time.process_time()
    chain.advance(poses)
    return RATED_STEPS / PlantConfig().substeps / (time.process_time() - before)


def print_rates(folder: Path) -> None:
    """One worker and two workers in turn, and their ratio; the ratio of each pair has seen much the same machine."""
    one, two, cpu, alone = [], [], [], []
    for number in range(ROUNDS):
        alone.append(rate_of_mujoco())
        before = time.process_time()
        one.append(rate(folder / f"one {number}", 1, RATED))
        cpu.append(RATED / (time.process_time() - before))
        two.append(rate(folder / f"two {number}", 2, RATED))
    ratios = np.array(two) / one
    for name, values, form in (
        ("one worker, transitions/s", one, "7.0f"),
        ("  per second of processor time", cpu, "7.0f"),
        ("  the same, MuJoCo alone", alone, "7.0f"),
        ("two workers, transitions/s", two, "7.0f"),
        ("two workers / one worker", ratios, "7.2f"),
    ):
        print(f"{name:32s} median {np.median(values):{form}}   least {min(values):{form}}   most {max(values):{form}}")


def print_set(folder: Path, transitions: int) -> None:
    """One command from nothing to a complete set, with the largest memory of its processes."""
    main, others = 0.0, 0.0
    start, before = time.perf_counter(), processor_time()
    with collecting(folder, 2, transitions) as process:
        while process.poll() is None:
            main = max(main, peak_memory(process.pid))
            others = max([others, *map(peak_memory, children(process.pid))])
            time.sleep(0.2)
        assert process.returncode == 0
    seconds = time.perf_counter() - start
    size = sum(path.stat().st_size for path in folder.iterdir()) / 1e6
    print(
        f"{transitions:9,d} transitions     {seconds:7.1f} s from start to end, two workers "
        f"({processor_time() - before:.1f} s of processor time); {size:.0f} MB; "
        f"peak memory {main:.0f} MB main process, {others:.0f} MB worker"
    )


def processor_time() -> float:
    """Of all processes that were begun here and have ended [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def read_shuffled(folder: Path) -> None:
    """Read a set once in shuffled batches; for a process of its own."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    start = time.perf_counter()
    count = sum(len(batch) for batch in shuffled_batches(folder, 256, seed=0))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    seconds = time.perf_counter() - start
    print(
        f"{count:9,d} read shuffled   {seconds:7.1f} s in batches of 256; "
        f"peak memory {peak:.0f} MB, {before:.0f} MB of it before reading"
    )


def print_kills(folder: Path) -> None:
    """Kill a collection ten times at random moments, then let it end, and compare with one that was left alone."""
    recipe = folder / "recipe.yaml"
    recipe.write_text(KILLED)
    with collecting(folder / "whole", 2, recipe=recipe) as process:
        process.wait()
    rng, killed, listed = np.random.default_rng(0), folder / "killed", [0]
    for _ in range(KILLS):
        with collecting(killed, 2, recipe=recipe) as process:
            wanted = listed[-1] + rng.integers(4)
            while process.poll() is None and shards_listed(killed) < wanted:
                time.sleep(0.01)
            time.sleep(rng.uniform(0, 0.3))
            os.kill(process.pid, signal.SIGKILL)
            assert process.wait() == -signal.SIGKILL
        listed.append(sound_shards(killed))
    with collecting(killed, 2, recipe=recipe) as process:
        process.wait()
    print(f"killed {KILLS} times: complete shards after each: {listed[1:]}; then completed: ", end="")
    print("identical" if contents(killed) == contents(folder / "whole") else "DIFFERENT")


def print_ray(folder: Path) -> None:
    """Two Ray workers and two local ones."""
    config = CollectionConfig(transitions=5000, seed=2, shard_episodes=20)
    collect(config, folder / "local", workers=2)
    collect(config, folder / "ray", workers=2, executor="ray")
    same = contents(folder / "ray") == contents(folder / "local")
    print(f"two Ray workers: {'identical to' if same else 'DIFFERENT from'} two local ones")


def contents(folder: Path) -> dict[str, bytes]:
    """All files of a folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def shards_listed(folder: Path) -> int:
    """Number of shards that the manifest lists."""
    return len(read_manifest(folder).shards) if (folder / MANIFEST).exists() else 0


def sound_shards(folder: Path) -> int:
    """The same; raises where one is not sound."""
    if not shards_listed(folder):
        return 0
    manifest = read_manifest(folder)
    for shard in manifest.shards:
        read_shard(folder, shard, manifest.columns)
    return len(manifest.shards)


def print_sets(folder: Path, transitions: int) -> None:
    """A set, and reading it."""
    print_set(folder / "set", transitions)
    subprocess.run([sys.executable, __file__, "--read", str(folder / "set")], check=True)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="?", choices=["rates", "set", "kills", "ray"], help="one alone")
    parser.add_argument("--transitions", type=int, default=50_000, help="of the set")
    parser.add_argument("--scratch", type=Path, help="folder for what is made; a temporary one unless given")
    parser.add_argument("--read", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.read is not None:
        read_shuffled(options.read)
        return
    measures = {"rates": print_rates, "kills": print_kills, "ray": print_ray}
    with tempfile.TemporaryDirectory(dir=options.scratch) as name:
        for part in [options.part] if options.part else ["rates", "set", "kills"]:
            folder = Path(name) / part
            folder.mkdir()
            if part == "set":
                print_sets(folder, options.transitions)
            else:
                measures[part](folder)


if __name__ == "__main__":
    main()
