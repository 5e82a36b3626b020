"""The cache of compiled code, spoilt: noise in its files, files cut short, a stranger's, a file in place of a folder,
one that cannot be made, a full disk, two commands that write the same files at once. Every command goes on: the same
status and files as with a sound cache, nothing on stderr with `--quiet`, no file left over.

`python -m checks.attack.caches SEED COUNT`
"""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from cableway.core.kernel_cache import cache_folder
from checks.attack.commands import CABLEWAY, damaged, prepared, said_wrong
from checks.attack.disks import disk

STRANGER = 12345
"""A user that is nobody here."""

Spoil = Callable[[random.Random, Path], None]


def noise(rng: random.Random, folder: Path) -> None:
    for path in _some(rng, folder):
        path.write_bytes(rng.randbytes(rng.randint(0, 4000)))


def flipped(rng: random.Random, folder: Path) -> None:
    for path in _some(rng, folder):
        content = bytearray(path.read_bytes())
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        path.write_bytes(content)


def cut(rng: random.Random, folder: Path) -> None:
    for path in _some(rng, folder):
        os.truncate(path, rng.randrange(path.stat().st_size))


def folders(rng: random.Random, folder: Path) -> None:
    for path in _some(rng, folder):
        path.unlink()
        path.mkdir()


def exchanged(rng: random.Random, folder: Path) -> None:
    one, other = rng.sample(sorted(folder.glob("*.code")), 2)
    one.write_bytes(other.read_bytes())


def file(rng: random.Random, folder: Path) -> None:
    place = rng.choice([folder, folder.parent, folder.parent.parent])
    shutil.rmtree(place)
    place.write_bytes(b"")


def stranger(rng: random.Random, folder: Path) -> None:
    os.chown(rng.choice([folder, folder.parent]), STRANGER, STRANGER)


def _some(rng: random.Random, folder: Path) -> list[Path]:
    return rng.sample(sorted(folder.glob("*.code")), rng.randint(1, 3))


SPOILT: tuple[Spoil, ...] = (noise, flipped, cut, folders, exchanged, file, stranger)
FULL, AT_ONCE = "full", "at once"


def attack(seed: int, count: int) -> list[str]:
    """What was wrong in `count` cases; each is printed as it comes."""
    rng, found, tally = random.Random(seed), [], Counter[tuple[str, bool]]()
    with tempfile.TemporaryDirectory() as made:
        lines = [line.words for line in prepared(Path(made), "show,check")]
        kinds = (*SPOILT, FULL, AT_ONCE)
        for turn in range(count):
            kind, words = kinds[turn % len(kinds)], lines[rng.randrange(len(lines))]
            name = kind if isinstance(kind, str) else kind.__name__
            faults = _case(rng, kind, words)
            tally[name, bool(faults)] += 1
            if faults:
                found.append(f"{name}, {words[0]}: {'; '.join(faults)}")
                print(found[-1], flush=True)
    for name in dict.fromkeys(name for name, _ in tally):
        print(f"{name}: {tally[name, True]} wrong of {tally[name, True] + tally[name, False]}")
    return found


def _case(rng: random.Random, kind: Spoil | str, words: tuple[str, ...]) -> list[str]:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        home = folder / "cache"
        if kind == FULL:
            home, _ = stack.enter_context(disk(rng.choice([4, 16, 64])))
        kept = home / "cableway" / cache_folder().name
        if kind != FULL:
            shutil.copytree(cache_folder(), kept)
            (noise if kind == AT_ONCE else kind)(rng, kept)  # pyright: ignore[reportCallIssue]
        variables = {**os.environ, "XDG_CACHE_HOME": str(home)}
        command = [CABLEWAY, *words, "--quiet", "--out"]
        running = [
            subprocess.Popen(
                [*command, str(folder / f"out-{k}")], env=variables, cwd=folder, stderr=subprocess.PIPE, text=True
            )
            for k in range(2 if kind == AT_ONCE else 1)
        ]
        faults = []
        for k, process in enumerate(running):
            _, said = process.communicate()
            faults += said_wrong(said, quiet=True, most=0)
            if process.returncode != 0:
                faults.append(f"status {process.returncode}: {said[-300:]!r}")
            faults += damaged(folder / f"out-{k}")
        faults += [f"{path.name} is left over" for path in home.rglob(".*")] if home.is_dir() else []
        return faults


if __name__ == "__main__":
    wrong = attack(int(sys.argv[1]), int(sys.argv[2]))
    print(f"{len(wrong)} of {sys.argv[2]} caches wrong")
    sys.exit(bool(wrong))
