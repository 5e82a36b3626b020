"""Whether planning ends when its time limit says so, and in how much memory: random, huge and narrow tasks.

    .venv/bin/python studies/time_limits.py --count 200 --limit 3 [--clock cpu] [--first 0]

Each task is a file, read, planned and written with its picture in a process of its own, as `cableway plan TASK
--time-limit LIMIT` does it. Loaded libraries and compiled kernels are there before. By `--clock cpu` the limit and the
figures count processor time, in which other work on the machine does not show. Of each task it is said, too, how long
nothing looked at the clock at most, and what looked then.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

import cableway as cw
from cableway.cli.planning import LEAST_TIME, write_plans
from cableway.core.errors import CablewayError
from cableway.scene.files.saving import save_task
from cableway.tasks.generation import KINDS
from cableway.workflow.compilation import compile_planning
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

CLOCKS = {"wall": time.perf_counter, "cpu": time.process_time}

PATIENCE = 600.0
"""Wall time [s] after which a task that still runs is given up and counted as a failure."""

CLOCKWORK = ("checkpoint", "expired", "report", "<lambda>")
"""What only passes a look at the clock on."""

DRAWS = 400
"""Attempts to draw a task that can be read."""


@dataclass(frozen=True)
class Ended:
    """How the planning of one task ended.

    Attributes:
        how: The outcome, or the error.
        loading: Time [s] of reading the file.
        seconds: Of planning, up to the report.
        writing: Time [s] of writing the files and drawing the picture, after that.
        megabytes: By which memory grew at its peak.
        blind: Longest time [s] between two looks at the clock in planning, the report included.
        where: What looked at the end of it.
    """

    how: str
    loading: float = 0.0
    seconds: float = 0.0
    writing: float = 0.0
    megabytes: float = 0.0
    blind: float = 0.0
    where: str = ""

    @property
    def whole(self) -> float:
        """Time [s] from reading the file to the end."""
        return self.loading + self.seconds + self.writing


class Watched:
    """A clock that remembers the longest time between two looks at it.

    Attributes:
        blind: That time [s].
        where: The function that looked at its end.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._last = clock, clock()
        self.blind, self.where = 0.0, ""

    def __call__(self) -> float:
        """The time [s]."""
        now = self._clock()
        if now - self._last > self.blind:
            callers = [frame.name for frame in traceback.extract_stack() if "/cableway/" in frame.filename]
            known = [name for name in callers if name not in CLOCKWORK]
            self.blind, self.where = now - self._last, " > ".join(known[-3:])
        self._last = now
        return now


def main() -> None:
    """Plan the tasks and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--limit", type=float, default=3.0, help="seconds")
    parser.add_argument("--clock", choices=CLOCKS, default="wall")
    parser.add_argument("--kinds", nargs="*", choices=DRAWN, default=list(DRAWN))
    given = parser.parse_args()
    compile_planning()
    found: list[tuple[str, Ended]] = []
    for seed in range(given.first, given.first + given.count):
        kind = given.kinds[seed % len(given.kinds)]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "task.yaml"
            DRAWN[kind](seed, path)
            ended = planned(path, given.limit, given.clock)
        found.append((kind, ended))
        late = "LATE " if ended.whole > given.limit + 1 else ""
        print(
            f"{late}{kind} {seed}: {ended.how}, loading {ended.loading:.2f}, planning {ended.seconds:.2f}, "
            f"writing {ended.writing:.2f} s, {ended.megabytes:.0f} MB, {ended.blind:.2f} s until {ended.where}",
            flush=True,
        )
    for kind in dict.fromkeys(given.kinds):
        print(f"{kind}: {summary([ended for name, ended in found if name == kind], given.limit, given.clock)}")


def summary(rows: Sequence[Ended], limit: float, clock: str) -> str:
    """How many ended in time, in words."""
    loading, writing, whole, memory = np.array([(r.loading, r.writing, r.whole, r.megabytes) for r in rows]).T
    return (
        f"ended within {limit:g} + 1 s of {clock} time in {np.sum(whole <= limit + 1)} of {len(rows)}, at the latest "
        f"after {whole.max():.2f} s; loading took up to {loading.max():.2f} s, writing up to {writing.max():.2f} s; "
        f"memory up to {memory.max():.0f} MB; {dict(Counter(row.how.partition(':')[0] for row in rows))}"
    )


def planned(path: Path, limit: float, clock: str) -> Ended:
    """Read and plan a task in a child of this process."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_plan, args=(path, limit, clock, theirs))
    child.start()
    try:
        return ours.recv() if ours.poll(PATIENCE) else Ended("hung", seconds=PATIENCE)
    except EOFError:
        return Ended("process died", seconds=PATIENCE)
    finally:
        child.kill()
        child.join()


def _plan(path: Path, limit: float, clock: str, reply: Connection) -> None:
    now, before, loaded, run = Watched(CLOCKS[clock]), _peak(), 0.0, None
    begun = now()
    try:
        task = cw.load_task(path)
        loaded = now() - begun
        now.blind = 0.0
        left = max(limit - loaded, LEAST_TIME)
        run = solve(task, SolveOptions(time_limit=left, clock=now, track=False))
        how = str(run.report.outcome)
    except CablewayError as error:
        how = f"refused: {error}"
    except Exception as error:  # that is what is looked for
        how = f"FAULT: {type(error).__name__}: {error}"
    ended, blind, where = now(), now.blind, now.where
    begun += loaded
    if run is not None:
        write_plans(path.parent / "out", run, tracked=False)
    reply.send(Ended(how, loaded, ended - begun, now() - ended, _peak() - before, blind, where))


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _random(seed: int, path: Path) -> None:
    save_task(cw.random_task(seed, sorted(KINDS)[seed // len(DRAWN) % len(KINDS)]), path)


def _drawn(draw: Callable[[np.random.Generator], dict[str, Any]], seed: int, path: Path) -> None:
    """The first draw that can be read."""
    rng = np.random.default_rng(seed)
    for _ in range(DRAWS):
        path.write_text(json.dumps({"cableway": 1, **draw(rng)}, default=float))  # which is YAML, too
        try:
            cw.load_task(path)
        except CablewayError:
            continue
        return
    raise RuntimeError(f"no task could be drawn with seed {seed}")


def _huge(rng: np.random.Generator) -> dict[str, Any]:
    """Large halls, long cables, hundreds of obstacles, tiny steps."""
    size = np.exp(rng.uniform(np.log(1.5), np.log(50.0), 2))
    length = float(np.exp(rng.uniform(np.log(0.1), np.log(min(10.0, size.min())))))
    count = int(rng.choice([0, 5, 50, 300, 1000]))
    step = float(np.exp(rng.uniform(np.log(1e-5), np.log(0.2))))
    content = _content(rng, size, length, int(rng.choice([3, 13, 13, 50, 200])))
    content["grippers"] = {"max_step": step, "max_turn": min(3.0, 10 * step)}
    if rng.uniform() < 0.3:
        content["grippers"] |= {"max_acceleration": 0.01, "max_jerk": 0.01}
    largest = 0.5 * size.min() / np.sqrt(count + 1)
    content["obstacles"] = [_obstacle(rng, size, largest) for _ in range(count)]
    if rng.uniform() < 0.2:
        content["cable"] |= {"friction": 0.3, "stiffness_profile": [1.0, 2.0]}
    return content


def _narrow(rng: np.random.Generator) -> dict[str, Any]:
    """Thin workspaces, and combs of walls whose gaps hardly let the cable through."""
    length = float(np.exp(rng.uniform(np.log(0.02), np.log(2.0))))
    wide = length * rng.uniform(1.5, 40.0)
    thin = length * rng.uniform(0.1, 0.5)
    comb = rng.uniform() < 0.6
    size = np.minimum(50.0, [wide, 1.2 * length if comb else thin])
    radius = length * rng.uniform(0.004, 0.02)
    content = _content(rng, size, length, 13, bent=0.05 if not comb else 0.3)
    content["cable"]["radius"] = radius
    content["grippers"] = {"radius": radius, "max_step": length * rng.uniform(0.001, 0.05)}
    if comb:
        walls = int(rng.integers(1, 12))
        gap = 2 * radius * rng.uniform(0.9, 4.0)
        places = np.linspace(0.1, 0.9, walls + 2)[1:-1] * size[0]
        content["obstacles"] = [_wall(x, rng.uniform(0, size[1] - gap), gap, size[1]) for x in places for _ in (0,)]
        content["obstacles"] = [box for pair in content["obstacles"] for box in pair]
    return content


def _content(
    rng: np.random.Generator, size: np.ndarray, length: float, keypoints: int, bent: float = 0.5
) -> dict[str, Any]:
    ends = []
    for _ in range(2):
        span, turn = length * rng.uniform(1 - bent, 0.98), rng.uniform(-np.pi, np.pi) if size.min() > length else 0.0
        middle = rng.uniform(0.1, 0.9, 2) * size
        along = 0.5 * span * np.array([np.cos(turn), np.sin(turn)])
        lift = rng.uniform(0.2, 0.8) * np.sqrt(max(0.0, 1 - span / length))
        poses = [[*(middle - along), turn + lift], [*(middle + along), turn - lift]]
        ends.append({"grippers": [[float(x) for x in pose] for pose in poses], "bend": "left"})
    cable = {"length": length, "radius": min(0.1, max(1e-4, 0.01 * length)), "keypoints": keypoints}
    return {"workspace": {"size": size.tolist()}, "cable": cable, "start": ends[0], "goal": ends[1]}


def _obstacle(rng: np.random.Generator, size: np.ndarray, largest: float) -> dict[str, Any]:
    radius = float(largest * rng.uniform(0.05, 0.5))
    center = rng.uniform(radius, size - radius)
    match rng.integers(3):
        case 0:
            return {"type": "disc", "center": center.tolist(), "radius": radius}
        case 1:
            sides = (radius * rng.uniform(0.3, 1.0, 2)).tolist()
            return {"type": "box", "center": center.tolist(), "size": sides, "angle": float(rng.uniform(-3, 3))}
        case _:
            turns = np.linspace(0, 2 * np.pi, int(rng.integers(3, 40)), endpoint=False)
            return {"type": "polygon", "vertices": (center + radius * np.c_[np.cos(turns), np.sin(turns)]).tolist()}


def _wall(x: float, low: float, gap: float, height: float) -> list[dict[str, Any]]:
    """A wall across, with a gap."""
    boxes = []
    for bottom, top in ((0.0, low), (low + gap, height)):
        if top - bottom > 0.001:
            center = [float(x), float((bottom + top) / 2)]
            boxes.append({"type": "box", "center": center, "size": [0.02 * height, float(top - bottom)]})
    return boxes


DRAWN: dict[str, Callable[[int, Path], None]] = {
    "random": _random,
    "huge": partial(_drawn, _huge),
    "narrow": partial(_drawn, _narrow),
}
"""What writes the task file of a seed, by kind."""


if __name__ == "__main__":
    main()
