"""Plants and controllers that misbehave, in closed loops of all controllers that need no learned model.

What happens is counted at the plant's door and measured by the simulator behind it: no command beyond the grippers'
limits, no contact called a success, no error but those of the package, the record of the run kept.
"""

from __future__ import annotations

import asyncio
import random
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import test_misbehaving as tests

import cableway as cw
from cableway.core.errors import CablewayError, Cancelled, InputError, PlanningError
from cableway.outcome import SUCCESS_ERROR
from cableway.records import Observation, Plan, Rollout
from cableway.scene.files.loading import load_task
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.simulation.plant import CableSimulator
from cableway.workflow.registry import make_controller
from checks.attack import hostile_methods
from checks.attack.cases import DONE, FAILED, Case, command
from checks.attack.made import TASKS, Made

CONTROLLERS = ("open-loop", "rod-jacobian", "rod-mpc", "broyden")
TOLERANCE = 1.0 + 1e-6
"""Of the limits, by which a command may be beyond them."""

Answers = Callable[[Any], Any]


class Door:
    """A plant that does to its simulator what it is told, and counts it.

    Args:
        task: The task.
        kind: How it misbehaves, a key of `kinds`.
        since: Control step from which on it does.
    """

    def __init__(self, task: Task, kind: str, since: int) -> None:
        self.simulator, self.known, self.control_step = CableSimulator(task), task, 0.1
        self.what, self.answers = kinds()[kind]
        self.since, self.count, self.first = since, 0, None
        self.farthest, self.turned, self.clearance = 0.0, 0.0, np.inf

    @property
    def task(self) -> Task:
        return self._answer("task", self.known)

    def reset(self) -> Observation:
        self.first = self.simulator.reset()
        return self._answer("step", self.first)

    def step(self, action: np.ndarray) -> Observation:
        self.count += 1
        self.farthest = np.maximum(self.farthest, np.linalg.norm(action[:, :2], axis=1).max())
        self.turned = np.maximum(self.turned, np.abs(action[:, 2]).max())
        proper = self.simulator.step(self._answer("moves", action))
        measured = self.simulator.measure()
        self.clearance = min(self.clearance, measured.clearance, measured.gripper_clearance)
        return self._answer("step", proper)

    def measure(self) -> Any:
        return self._answer("measure", self.simulator.measure())

    def _answer(self, what: str, proper: Any) -> Any:
        if what != self.what or self.count < self.since:
            return proper
        return self.answers(self, proper) if self.answers.__code__.co_argcount == 2 else self.answers(proper)


class Spiteful(Exception):
    """An error that cannot even be printed."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


def seen(**changes: Callable[[np.ndarray], Any]) -> Answers:
    """Observations of which some arrays are changed."""
    return lambda it: replace(it, **{name: change(getattr(it, name)) for name, change in changes.items()})


def raising(error: BaseException) -> Answers:
    return tests.raising(error)


def slowly(it: Any) -> Any:
    time.sleep(0.02)
    return it


RNG = np.random.default_rng(0)
ERRORS: list[BaseException] = [
    MemoryError(), RecursionError("deep"), StopIteration(3), AssertionError(), BrokenPipeError(32, "gone"),
    KeyError("x"), OSError(28, "full"), UnicodeDecodeError("utf-8", b"\xff", 0, 1, "bad"), SystemExit(0), Spiteful(),
    SystemExit("bye"), ExceptionGroup("two", [ValueError("1"), OSError("2")]), RuntimeError("\x1b[31mred\nlines\u202e"),
    GeneratorExit(), RuntimeError("x" * 10**6), InputError("no such cable"), PlanningError("none"), Cancelled("enough"),
    FloatingPointError(), KeyboardInterrupt(), ImportError("no driver"), DeprecationWarning("old"),
    asyncio.CancelledError(), type("Odd", (BaseException,), {})(),
]  # fmt: skip
STEPS: dict[str, Answers] = {
    "keypoints in reverse": seen(keypoints=lambda at: at[::-1]),
    "keypoints mirrored": seen(keypoints=lambda at: at * [1, -1] + [0, 0.6]),
    "keypoints mirrored about their middle": seen(keypoints=lambda at: 2 * at.mean(0) - at),
    "keypoints with x and y exchanged": seen(keypoints=lambda at: at[:, ::-1]),
    "keypoints 30 mm aside": seen(keypoints=lambda at: at + 0.03),
    "keypoints with noise of 20 mm": seen(keypoints=lambda at: at + RNG.normal(0, 0.02, at.shape)),
    "keypoints with strays": seen(keypoints=lambda at: np.where(RNG.random(at.shape) < 0.2, 5.0, at)),
    "keypoints in millimetres": seen(keypoints=lambda at: 1000 * at),
    "keypoints of 1e300": seen(keypoints=lambda at: 1e300 * at),
    "keypoints of infinity": seen(keypoints=lambda at: at + np.inf),
    "keypoints at one point": seen(keypoints=lambda at: np.tile(at[0], (len(at), 1))),
    "keypoints at the middle alone": seen(keypoints=lambda at: np.where(np.arange(len(at))[:, None] == 6, at, np.nan)),
    "ends never seen": seen(keypoints=lambda at: np.where(np.arange(len(at))[:, None] % 12 == 0, np.nan, at)),
    "keypoints masked": seen(keypoints=lambda at: np.ma.masked_greater(at, 0.3)),
    "keypoints as whole numbers": seen(keypoints=lambda at: at.astype(int)),
    "keypoints as a matrix": seen(keypoints=np.asmatrix),
    "poses exchanged": seen(poses=lambda at: at[::-1]),
    "poses in degrees": seen(poses=lambda at: at * [1, 1, 57.3]),
    "poses in millimetres": seen(poses=lambda at: at * [1000, 1000, 1]),
    "poses that jump by a turn": seen(poses=lambda at: at + [0, 0, 2 * np.pi * RNG.integers(-1, 2)]),
    "poses with noise": seen(poses=lambda at: at + RNG.normal(0, 0.01, at.shape)),
    "poses of 1e300": seen(poses=lambda at: at + 1e300),
    "one pose missing": seen(poses=lambda at: np.where([[True], [False]], at, np.nan)),
    "poses elsewhere": seen(poses=lambda at: at + [0.05, 0, 0]),
    "a time that stands": seen(time=lambda at: 1.0),
    "a time that runs backwards": seen(time=lambda at: -at),
    "a time that jumps": seen(time=lambda at: at + RNG.integers(0, 2) * 1e6),
    "a time in milliseconds": seen(time=lambda at: 1000 * at),
    "an infinite time": seen(time=lambda at: np.inf),
    "frames of the future": lambda it: replace(it, taken=it.time + 100),
    "frames of long ago": lambda it: replace(it, taken=-1e9),
    "frames without a time": lambda it: replace(it, taken=np.nan),
    "confidence of 0": lambda it: replace(it, confidence=np.zeros(13)),
    "confidence below 0": lambda it: replace(it, confidence=-np.ones(13)),
    "confidence that is none": lambda it: replace(it, confidence=np.full(13, np.nan)),
    "the first observation again": lambda door, it: door.first,
    "keypoints of the start": lambda door, it: replace(it, keypoints=door.first.keypoints),
    "keypoints of the goal": lambda door, it: replace(it, keypoints=door.known.goal),
    "poses of the start": lambda door, it: replace(it, poses=door.first.poses),
    "slow answers": slowly,
    "a word": lambda it: "ok",
    "a class": lambda it: Observation,
}  # fmt: skip
MOVES: dict[str, Answers] = {
    "half the way": lambda it: 0.5 * it,
    "twice the way": lambda it: 2 * it,
    "backwards": lambda it: -it,
    "no turns": lambda it: it * [1, 1, 0],
    "the left one dead": lambda it: it * [[0], [1]],
    "the right one dead": lambda it: it * [[1], [0]],
    "both dead": lambda it: 0 * it,
    "y downwards": lambda it: it * [1, -1, -1],
    "exchanged": lambda it: it[::-1].copy(),
    "turned by a quarter": lambda it: np.stack([-it[:, 1], it[:, 0], it[:, 2]], axis=1),
    "a drift": lambda it: it + [0.001, 0, 0],
    "shaking": lambda it: it + RNG.normal(0, 0.003, it.shape),
    "now and then": lambda it: it * RNG.integers(0, 2),
    "the left one turns the wrong way": lambda it: it * [[1, 1, -1], [1, 1, 1]],
}  # fmt: skip
TASKS_SAID: dict[str, Answers] = {
    "no task": lambda it: None,
    "a task of fewer keypoints": lambda it: replace(
        it, cable=replace(it.cable, keypoints=7), start=it.start[::2], goal=it.goal[::2]
    ),
    "a task without obstacles": lambda it: replace(it, scene=Scene(it.scene.size)),
    "another task": lambda it: cw.load_task("maze-1"),
    "a goal elsewhere": lambda it: replace(it, goal=it.start),
}  # fmt: skip
LIES: dict[str, Answers] = {
    "a clearance of 1e9": lambda it: replace(it, clearance=1e9),
    "a clearance below 0": lambda it: replace(it, clearance=-0.01),
    "always at the goal": lambda door, it: replace(it, keypoints=door.known.goal),
    "a centreline of one point": lambda it: replace(it, centreline=it.centreline[:1]),
    "a centreline of none": lambda it: replace(it, centreline=it.centreline[:0]),
    "an observation": lambda it: Observation(0.0, it.keypoints, it.poses),
}  # fmt: skip


@cache
def kinds() -> dict[str, tuple[str, Answers]]:
    """What misbehaves, and how, by name; where a plant's measurements lie nobody can know what it touched."""
    answers = tests.WRONG | tests.SEEN | {f"never {name}": each[0] for name, each in tests.BLIND.items()} | STEPS
    found = {f"step: {name}": ("step", each) for name, each in answers.items()}
    found |= {f"step raises {error!r:.30}": ("step", raising(error)) for error in ERRORS}
    found |= {f"measure: {name}": ("measure", each) for name, each in (tests.WRONG | tests.MEASURED | LIES).items()}
    found |= {f"moves: {name}": ("moves", each) for name, each in (tests.ELSEWHERE | MOVES).items()}
    return found | {f"task: {name}": ("task", each) for name, each in TASKS_SAID.items()}


def plant_of(kind: str, since: int) -> Callable[[Task], Door]:
    """What makes a plant of a kind."""
    return lambda task: Door(task, kind, since)


def led(kind: str, since: int, controller: Any, recover: bool, plan: Path) -> Iterator[str]:
    """What is wrong with a run on a plant of a kind."""
    doors: list[Door] = []

    def make(task: Task) -> Door:
        doors.append(Door(task, kind, since))
        return doors[0]

    task, run = load_task(TASKS[0]), None
    chosen = cw.SolveOptions(controller=controller, plan=Plan.load(plan), plant=make, recover=recover, time_limit=2.0)
    try:
        run = cw.solve(task, chosen)
    except CablewayError as error:
        if doors and doors[0].count > 1:
            yield f"the record is lost: {type(error).__name__}: {error}"
        if len(str(error)) > 1000 or "\n" in str(error):
            yield f"a sentence of {len(str(error))} letters or several lines"
    except BaseException as error:
        if isinstance(error, Exception) or "raises" not in kind:
            yield f"raised {type(error).__name__}: {error!s:.200}"
    for door in doors:
        yield from within_limits(door, task)
        if run is not None:
            yield from recorded(door, run, task)


def within_limits(door: Door, task: Task) -> Iterator[str]:
    """What was commanded."""
    if not door.farthest <= TOLERANCE * task.grippers.max_step:
        yield f"a command of {1000 * door.farthest:.1f} mm, more than {1000 * task.grippers.max_step:.1f}"
    if not door.turned <= TOLERANCE * task.grippers.max_turn:
        yield f"a command to turn by {door.turned:.3f} rad, more than {task.grippers.max_turn:.3f}"


def recorded(door: Door, run: cw.Run, task: Task) -> Iterator[str]:
    """What is said and kept of it."""
    if run.rollout is None and door.count == 0:
        return
    if run.rollout is None or run.rollout.steps < door.count - 1:
        yield f"of {door.count} steps {run.rollout and run.rollout.steps} are recorded"
        return
    run.rollout.save("rollout.npz")
    if not np.array_equal(Rollout.load("rollout.npz").actions, run.rollout.actions):
        yield "the record is not what was saved"
    if not run.success and not run.report.failure:
        yield f"no word on why it ended: {run.report.outcome}"
    if run.success and door.what != "measure":
        error = float(np.linalg.norm(door.simulator.measure().keypoints - task.goal))
        if door.clearance <= 0:
            yield f"a contact of {-1000 * door.clearance:.2f} mm called a success"
        if error >= SUCCESS_ERROR:
            yield f"an error of {1000 * error:.0f} mm called a success"


def commanded(kind: str, since: int, controller: str, plan: Path) -> Iterator[str]:
    """The same through the command."""
    root = Path(__file__).resolve().parents[2]
    Path("lab.py").write_text(
        f"import sys\nsys.path.insert(0, {str(root)!r})\nfrom checks.attack.plants import plant_of\n"
        f"PLANT = plant_of({kind!r}, {since})\n"
    )
    sys.modules.pop("lab", None)
    line = (
        "run",
        TASKS[0],
        "--from",
        plan,
        "--plant",
        "lab:PLANT",
        "--controller",
        controller,
        "--no-video",
        "--out",
        "o",
    )
    ends = "raises KeyboardInterrupt" in kind
    yield from command(
        *line, allowed=[DONE, FAILED, 130] if ends else [DONE, FAILED, 2] if since < 2 else [DONE, FAILED]
    )


def controllers() -> dict[str, type]:
    """Controllers that misbehave, by name."""
    found = {name: value.controller for name, value in vars(hostile_methods).items() if name.isupper()}
    return {name: each for name, each in found.items() if each is not hostile_methods.OpenLoop and name != "LEAVING"}


def steered(name: str, plan: Path) -> Iterator[str]:
    """A proper plant, led by a controller that misbehaves."""
    try:
        controller = controllers()[name]()
    except OSError:
        return
    yield from led(next(iter(kinds())), 10**9, controller, False, plan)


def case(rng: random.Random, number: int, made: Made) -> Case:
    """The case of a number: each kind in turn, with the controllers in turn."""
    names, plan = list(kinds()), made.run(TASKS[0]) / "plan.npz"
    if number % 12 == 11:
        name = list(controllers())[number // 12 % len(controllers())]
        return Case(f"a controller: {name}", lambda: steered(name, plan), 60.0)
    kind, since = names[number % len(names)], rng.choice([0, 0, 1, 5, 20, 20, 20, 60])
    controller, recover = CONTROLLERS[rng.randrange(len(CONTROLLERS))], rng.random() < 0.5
    if number % 10 == 9 or number % 25 == 24:
        name = f"run with {controller} on {kind} since {since}"
        return Case(name, lambda: commanded(kind, since, controller, plan), 60.0)
    name = f"{controller}{' with recovery' * recover} on {kind} since {since}"
    return Case(name, lambda: led(kind, since, make_controller(controller), recover, plan), 60.0)
