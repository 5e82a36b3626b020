"""Plans and rollouts that are forged or damaged, which no verdict may accept; and honest ones, which every one must."""

from __future__ import annotations

import io
import json
import random
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import test_forged_rollouts
from test_forged_rollouts import FORGED, UNREADABLE, along, crumpled, kept, says

from cableway.records import THEN_FAILED
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from checks.attack.cases import ANY, DONE, FAILED, WRONG, Case, command
from checks.attack.made import TASKS, Made
from checks.attack.mutants import NO_FILES, brief, damaged, value

REFUSED = (FAILED, WRONG)
KINDS = ("rollout", "plan", "insertion", "insertion-plan")

Arrays = dict[str, Any]
Forge = Callable[[Arrays, random.Random, Task], Any]


def row(arrays: Arrays, rng: random.Random) -> int:
    """One on the way, where the grippers move: not while they wait at the start or at the end."""
    way = np.cumsum(np.linalg.norm(np.diff(np.nan_to_num(arrays["poses"]), axis=0), axis=2).max(1))
    return int(np.searchsorted(way, rng.uniform(0.3, 0.55) * way[-1]))


def span(arrays: Arrays, rng: random.Random, least: int = 5) -> slice:
    first = row(arrays, rng)
    return slice(first, first + rng.randint(least, least + 10))


def sign(rng: random.Random) -> int:
    return rng.choice([-1, 1])


def points(arrays: Arrays) -> list[str]:
    """Names of the arrays that say where the cable lies."""
    return [name for name in ("keypoints", "centreline", "shapes") if name in arrays]


# ---------------------------------------------------------------------------------------------- of either kind
def aside(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """The cable away from its grippers."""
    by = sign(rng) * rng.uniform(0.004, 0.2)
    for name in points(arrays):
        arrays[name][span(arrays, rng), :, rng.randrange(2)] += by


def grown(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Everything larger, grippers included."""
    factor = rng.choice([rng.uniform(1.06, 3.0), rng.uniform(0.3, 0.94)])
    for name in points(arrays):
        arrays[name] *= factor
    arrays["poses"][..., :2] *= factor


def mirrored(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Some rows seen from below the table."""
    rows, axis = span(arrays, rng), rng.randrange(2)
    for name in points(arrays):
        arrays[name][rows, :, axis] = task.scene.size[axis] - arrays[name][rows, :, axis]
    arrays["poses"][rows, :, axis] = task.scene.size[axis] - arrays["poses"][rows, :, axis]


def ends_swapped(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Left for right in the cable, in some rows or in all."""
    rows = rng.choice([slice(None), span(arrays, rng)])
    for name in points(arrays):
        arrays[name][rows] = arrays[name][rows, ::-1]


def grippers_swapped(arrays: Arrays, rng: random.Random, task: Task) -> None:
    rows = rng.choice([slice(None), span(arrays, rng)])
    arrays["poses"][rows] = arrays["poses"][rows, ::-1]


def bunched(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Keypoints that crowd at one end."""
    name, power, rows = points(arrays)[0], rng.choice([0.3, 0.6, 1.6, 3.0]), span(arrays, rng)
    count = arrays[name].shape[1]
    fine = np.array([along(line, 2000) for line in arrays[name][rows]])
    arrays[name][rows] = fine[:, (1999 * np.linspace(0, 1, count) ** power).astype(int)]


def level(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """All angles of a gripper the same, and not as they are."""
    angles = arrays["poses"][:, rng.randrange(2), 2]
    same = rng.choice([0.0, np.pi, np.pi / 2, -np.pi / 2])
    angles[:] = same + np.pi / 2 * (np.abs(np.angle(np.exp(1j * (angles - same)))).max() < 0.35)


def turned(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Grippers that hold the cable askew."""
    arrays["poses"][:, rng.choice([slice(None), 0, 1]), 2] += sign(rng) * rng.uniform(0.35, np.pi)


def whole_turn(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Angles that jump by turns on the way, and are not all within one, as a robot may report them, see `wrapped`."""
    first, side, turns = row(arrays, rng), rng.randrange(2), rng.choice([1, 2, 50])
    angles = arrays["poses"][:, side, 2]
    up = np.ptp(angles + 2 * np.pi * turns * (np.arange(len(angles)) >= first)) > 2 * np.pi
    angles[first:] += 2 * np.pi * turns * (1 if up else -1)


def in_degrees(arrays: Arrays, rng: random.Random, task: Task) -> None:
    arrays["poses"][..., 2] = np.degrees(arrays["poses"][..., 2])


def shuffled(arrays: Arrays, rng: random.Random, task: Task) -> None:
    order = list(range(len(arrays["poses"])))
    rng.shuffle(order)
    for name in [*points(arrays), "poses"]:
        arrays[name] = arrays[name][order]


def reversed_rows(arrays: Arrays, rng: random.Random, task: Task) -> None:
    for name in [*points(arrays), "poses"]:
        arrays[name] = arrays[name][::-1]


def straight_on(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """From the first row to the last without regard for what is between."""
    share = np.linspace(0, 1, len(arrays["poses"])).reshape(-1, 1, 1) ** rng.choice([1, 2])
    for name in [*points(arrays), "poses"]:
        arrays[name] = (1 - share) * arrays[name][0] + share * arrays[name][-1]


def noisy(arrays: Arrays, rng: random.Random, task: Task) -> None:
    name = points(arrays)[0]
    arrays[name] += np.random.default_rng(rng.randrange(99)).normal(0, rng.uniform(0.004, 0.1), arrays[name].shape)


def stuck(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """A cable that stands still while its grippers move."""
    first = row(arrays, rng)
    for name in points(arrays):
        arrays[name][first : first + 25] = arrays[name][first]


def jumped_to_goal(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """The last row is the goal, though the way there is missing."""
    last = {name: arrays[name][-1].copy() for name in [*points(arrays), "poses"]}
    cut(arrays, slice(0, row(arrays, rng)))
    for name, array in last.items():
        arrays[name][-1] = array


def stopped_short(arrays: Arrays, rng: random.Random, task: Task) -> None:
    cut(arrays, slice(0, row(arrays, rng)))


def begun_later(arrays: Arrays, rng: random.Random, task: Task) -> None:
    cut(arrays, slice(row(arrays, rng), None))


def every_nth(arrays: Arrays, rng: random.Random, task: Task) -> None:
    cut(arrays, slice(None, None, rng.choice([3, 5, 8])))


def hole(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Rows dropped."""
    count, first = len(arrays["poses"]), row(arrays, rng)
    cut(arrays, np.r_[0:first, min(count - 2, first + rng.randint(8, 30)) : count])


def crumpled_rows(arrays: Arrays, rng: random.Random, task: Task) -> None:
    name = points(arrays)[-1]
    for k in range(*span(arrays, rng, 1).indices(99)):
        arrays[name][k] = along(crumpled(along(arrays[name][k], 60)), arrays[name].shape[1])
        for other in points(arrays):
            arrays[other][k] = along(arrays[name][k], arrays[other].shape[1])


def one_number(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """One number that cannot be."""
    array = arrays[rng.choice([*points(arrays), "poses"])]
    array[row(arrays, rng), rng.randrange(2), rng.randrange(2)] = rng.choice(
        [np.nan, np.inf, -np.inf, 1e300, 1e7, 50.0, -3]
    )


def another_kind(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Numbers that are none, or not real ones."""
    name = rng.choice([*points(arrays), "poses"])
    arrays[name] = arrays[name].astype(rng.choice(["c16", "?", "U8", "S4", "m8[s]", "M8[s]", "c8", "i8", "O", "u1"]))


def too_large(arrays: Arrays, rng: random.Random, task: Task) -> None:
    name = rng.choice([*points(arrays), "poses"])
    arrays[name] = arrays[name].astype(np.longdouble) * np.longdouble("1e4000")


def another_shape(arrays: Arrays, rng: random.Random, task: Task) -> None:
    name = rng.choice([*points(arrays), "poses"])
    array = arrays[name]
    arrays[name] = rng.choice([array[:-1], array[:, :1], array[..., :1], array[None], array.ravel(), array[:0]])


def missing_array(arrays: Arrays, rng: random.Random, task: Task) -> None:
    del arrays[rng.choice([*points(arrays), "poses"])]


def broken_metadata(arrays: Arrays, rng: random.Random, task: Task) -> None:
    texts = ["", "[]", "3", "{", "[" * 99_999, '{"a": NaN}', '{"a": 1, "a": 2}', '{"a": 1e999}', "\x00", "null"]
    arrays["metadata"] = np.array(rng.choice(texts))


def cut(arrays: Arrays, rows: Any) -> None:
    """Keep some rows of a plan or a rollout."""
    if "times" in arrays:
        times = arrays["times"]
        kept(arrays, rows)
        arrays["times"] = times[: len(arrays["times"])]
    else:
        for name in ("shapes", "poses", "q"):
            if name in arrays:
                arrays[name] = arrays[name][rows]


# ---------------------------------------------------------------------------------------------- rollouts
def slower(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Time scaled, so that no limit counts."""
    arrays["times"] = arrays["times"] * rng.choice([1.7, 2, 10, 1e4, 1e6, 1e300])


def faster(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """In less time than the grippers need; an insertion in 0.4 times as long keeps their limits."""
    step = np.linalg.norm(np.diff(arrays["poses"][..., :2], axis=0), axis=2).max()
    much = [0.4] if step > 0.5 * task.grippers.max_step else []
    arrays["times"] = arrays["times"] * rng.choice([*much, 0.1, 1e-3, 0, -1, 1e-300])


def odd_times(arrays: Arrays, rng: random.Random, task: Task) -> None:
    count = len(arrays["times"])
    arrays["times"] = rng.choice([
        np.arange(count, 0, -1).astype(np.uint8), (230 + np.arange(count)).astype(np.uint8), np.zeros(count),
        np.sort(arrays["times"])[::-1], arrays["times"] % 3.0, arrays["times"] ** 2, np.full(count, np.nan),
        np.arange(count).astype(np.uint64) << 58, np.logspace(-300, 300, count),
    ])  # fmt: skip


def recorded_clearance(arrays: Arrays, rng: random.Random, task: Task) -> None:
    name = rng.choice(["clearance", "gripper_clearance"])
    arrays[name] = rng.choice([
        arrays[name] + rng.uniform(0.03, 1.0), np.full_like(arrays[name], rng.choice([np.inf, 1e9, np.nan, 0.0, -1.0])),
        -arrays[name],
    ])  # fmt: skip


def outcome(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """What the file says of its own end is that it failed, or nothing that there is."""
    ends = ["plant failed", "contact", "left plan", "controller failed", "interrupted", "crashed", "wrong setup"]
    said = rng.choice([
        {"outcome": rng.choice(ends)}, {"outcome": rng.choice(ends), "detail": "then a gripper stopped"},
        {"outcome": "settled", "detail": "contact with a box"}, {"outcome": "well"}, {"outcome": ["settled"]},
        {"outcome": {"settled": 1}}, {"outcome": ""}, {"outcome": "settled: contact"},
    ])  # fmt: skip
    says(arrays, **said)


def failed_status(arrays: Arrays, rng: random.Random, task: Task) -> None:
    arrays["status"] = arrays["status"].astype("U60")
    arrays["status"][rng.choice([-1, 3])] = "tracking" + THEN_FAILED


def odd_status(arrays: Arrays, rng: random.Random, task: Task) -> None:
    count = len(arrays["status"])
    arrays["status"] = rng.choice([np.zeros(count), arrays["status"][:-1], np.zeros((count, 2)), np.array("tracking")])


def another_plant(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """A cable that no gripper poses bring to the goal, or none at all."""
    cable = rng.choice(
        [{"length": 2.0}, {"length": -1}, {"length": "long"}, {"length": 1e9}, {"length": [0.3]}, {"length": 0}]
    )
    plant = json.loads(str(arrays["metadata"]))["plant"]
    says(arrays, plant={**plant, "cable": {**plant["cable"], **cable}})


def other_commands(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Grippers that went where nobody sent them."""
    actions = arrays["actions"]
    arrays["actions"] = rng.choice([0 * actions, -actions, 3 * actions])


def settled_at_last(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """A cable beside where it is, but in the last row."""
    for name in points(arrays):
        arrays[name][:-1, :, rng.randrange(2)] += rng.uniform(0.02, 0.1) * np.sin(
            np.linspace(0, np.pi, arrays[name].shape[1])
        )


def looped(arrays: Arrays, rng: random.Random, task: Task) -> None:
    test_forged_rollouts.looped(arrays, task)


def hairpin(arrays: Arrays, rng: random.Random, task: Task) -> None:
    test_forged_rollouts.hairpin(arrays, task)


# ---------------------------------------------------------------------------------------------- plans
def other_coordinates(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Rod coordinates that are not those of the shapes."""
    q = arrays["q"] = arrays.get("q", np.zeros((len(arrays["poses"]), 6))).copy()
    kind = rng.randrange(6)
    if kind == 0:
        q[row(arrays, rng) :, 2] += 2 * np.pi
    elif kind == 1:
        q[:, rng.randrange(2)] += 0.02
    else:
        arrays["q"] = [q[::-1], np.zeros_like(q) + 0.3, q[:, :5], q * np.nan][kind - 2]


def two_rows(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Nothing but start and goal."""
    cut(arrays, [0, -1])


def one_row(arrays: Arrays, rng: random.Random, task: Task) -> None:
    cut(arrays, [-1])


def inserting(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """Called another part than it is."""
    part = json.loads(str(arrays["metadata"])).get("part")
    says(arrays, part=None if part else "insertion")


EITHER: list[Forge] = [
    aside, grown, mirrored, ends_swapped, grippers_swapped, bunched, level, turned, whole_turn, in_degrees, shuffled,
    reversed_rows, straight_on, noisy, stuck, jumped_to_goal, stopped_short, begun_later, every_nth, hole,
    crumpled_rows, one_number, another_kind, too_large, another_shape, missing_array, broken_metadata, inserting,
]  # fmt: skip
OF_ROLLOUTS: list[Forge] = [
    slower, faster, odd_times, recorded_clearance, outcome, failed_status, odd_status, another_plant, other_commands,
    settled_at_last, looped, hairpin,
]  # fmt: skip
OF_PLANS: list[Forge] = [other_coordinates, two_rows, one_row]


TOO_SLIGHT: dict[str, tuple[Forge, ...]] = {
    "insertion-plan": (every_nth, hole, straight_on),
    "insertion": (other_commands,),
}
"""What an insertion, of some 30 mm in 4 s, may be and keep all limits."""


# ---------------------------------------------------------------------------------------------- honest ones
def same(arrays: Arrays, rng: random.Random, task: Task) -> None:
    pass


def single(arrays: Arrays, rng: random.Random, task: Task) -> None:
    converted(arrays, np.float32)


def long_double(arrays: Arrays, rng: random.Random, task: Task) -> None:
    converted(arrays, np.longdouble)


def big_endian(arrays: Arrays, rng: random.Random, task: Task) -> None:
    converted(arrays, np.dtype(">f8"))


def columns_first(arrays: Arrays, rng: random.Random, task: Task) -> None:
    arrays.update({name: np.asfortranarray(array) for name, array in arrays.items() if array.ndim})


def turned_wholly(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """All angles of a gripper are shifted by whole turns."""
    arrays["poses"][:, rng.randrange(2), 2] += 2 * np.pi * rng.choice([-3, -1, 1, 5])


def wrapped(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """All angles of a gripper within one turn, as robots report them: they may jump on the way."""
    if "times" in arrays:
        angles, least = arrays["poses"][:, rng.randrange(2), 2], rng.uniform(-5.0, 0.0)
        angles[:] = least + np.remainder(angles - least, 2 * np.pi)


def another_note(arrays: Arrays, rng: random.Random, task: Task) -> None:
    says(arrays, note="kept by the lab", day=3)


def another_array(arrays: Arrays, rng: random.Random, task: Task) -> None:
    arrays["forces"] = np.zeros((3, 2))


def later(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """A clock that did not begin at zero."""
    if "times" in arrays:
        arrays["times"] = arrays["times"] + rng.choice([5.0, -2.0, 1e5])


def blind(arrays: Arrays, rng: random.Random, task: Task) -> None:
    """A camera that saw nothing."""
    if "observed" in arrays:
        arrays["observed"] = arrays["observed"] * np.nan


def no_coordinates(arrays: Arrays, rng: random.Random, task: Task) -> None:
    arrays.pop("q", None)


def converted(arrays: Arrays, kind: Any) -> None:
    arrays.update({name: array.astype(kind) for name, array in arrays.items() if array.dtype.kind == "f"})


HONEST: list[Forge] = [
    same, single, long_double, big_endian, columns_first, turned_wholly, wrapped, another_note, another_array, later,
    blind, no_coordinates,
]  # fmt: skip


# ---------------------------------------------------------------------------------------------- cases
@cache
def task_of(name: str) -> Task:
    return load_task(name)


def arrays_of(made: Made, task: str, kind: str) -> Arrays:
    return dict(np.load(made.run(task) / f"{kind}.npz"))


def judged(arrays: Arrays, task: str, kind: str, allowed: Iterable[int], how: str = "check") -> Iterable[str]:
    """Save, and give it to a command that must look at it."""
    save = np.savez_compressed if len(arrays) % 2 else np.savez
    save("forged.npz", **arrays)  # pyright: ignore[reportArgumentType]
    yield from asked(task, allowed, how)


def asked(task: str, allowed: Iterable[int], how: str) -> Iterable[str]:
    if how == "check":
        yield from command("check", task, "forged.npz", allowed=allowed)
    elif how == "run":
        quickly = ("--controller", "open-loop", "--no-video", "--out", "o")
        yield from command(
            "run", task, "--from", "forged.npz", *quickly, allowed=[DONE] if DONE in allowed else [WRONG]
        )
    else:
        yield from command("export", "forged.npz", "--task", task, "--out", "o.csv",
                           allowed=[DONE] if DONE in allowed else [WRONG])  # fmt: skip


def forged(forge: Forge, rng: random.Random, made: Made, task: str, kind: str, allowed: Iterable[int]) -> Case:
    """A case of one forgery on one record."""
    how = rng.choices(["check", "run", "export"], [8, 2 * (kind == "plan"), 1])[0]

    def act() -> Iterable[str]:
        arrays = arrays_of(made, task, kind)
        forge(arrays, rng, task_of(made.source(task)))
        yield from judged(arrays, made.source(task), kind, allowed, how)

    verdict = "honest" if DONE in allowed else "forged"
    return Case(f"{how} {verdict} {kind} of {task}: {forge.__name__}", act)


def by_hand(number: int, made: Made) -> Case:
    """Those of the tests, as files."""
    forge, _ = [*FORGED, *UNREADABLE][number]

    def act() -> Iterable[str]:
        arrays = arrays_of(made, TASKS[0], "rollout")
        forge(arrays, task_of(TASKS[0]))
        yield from judged(arrays, TASKS[0], "rollout", REFUSED)

    return Case(f"check {forge.__name__} in the tests of forged rollouts", act)


def spoilt(rng: random.Random, made: Made, task: str, kind: str) -> Case:
    """A file damaged, or none at all."""
    how = rng.choice(["check", "check", "run", "export"])
    if rng.random() < 0.3:
        write = rng.choice(NO_FILES)

        def act() -> Iterable[str]:
            write(Path("forged.npz"))
            yield from asked(made.source(task), [WRONG], how)

        return Case(f"{how} {write.__name__} as a record", act)
    content, done = damaged((made.run(task) / f"{kind}.npz").read_bytes(), rng)

    def act_on_damaged() -> Iterable[str]:
        Path("forged.npz").write_bytes(content)
        same_arrays = _holds_the_same(content, made.run(task) / f"{kind}.npz")
        yield from command("check", made.source(task), "forged.npz", allowed=[DONE] if same_arrays else REFUSED)

    return Case(f"check {kind} of {task}: {done}", act_on_damaged)


def _holds_the_same(content: bytes, path: Path) -> bool:
    """Whether what was damaged is nothing that counts."""
    try:
        found, wanted = dict(np.load(io.BytesIO(content))), dict(np.load(path))
    except Exception:
        return False
    return found.keys() >= wanted.keys() and all(np.array_equal(found[name], wanted[name]) for name in wanted)


def odd_metadata(rng: random.Random, made: Made, task: str, kind: str) -> Case:
    """Whatever the metadata say; the arrays are true, so that any verdict may be right."""
    content = json.loads(str(arrays_of(made, task, kind)["metadata"]))
    spoilt_at = rng.choice([key for key in content if key != "versions"])
    new = value(rng)
    content[spoilt_at] = new

    def act() -> Iterable[str]:
        arrays = arrays_of(made, task, kind)
        arrays["metadata"] = np.array(json.dumps(content))
        yield from judged(arrays, made.source(task), kind, ANY)

    return Case(f"check {kind} of {task}: metadata.{spoilt_at} = {brief(new)}", act)


def case(rng: random.Random, number: int, made: Made) -> Case:
    """The case of a number."""
    if number < len(FORGED) + len(UNREADABLE):
        return by_hand(number, made)
    turn = number - len(FORGED) - len(UNREADABLE)
    task = rng.choice(TASKS[:-1])
    kind = rng.choice(KINDS if task == "insertion" else KINDS[:2])
    if turn % 8 == 0:
        return forged(HONEST[turn // 8 % len(HONEST)], rng, made, task, kind, [DONE])
    if turn % 8 == 1:
        return spoilt(rng, made, task, kind)
    if turn % 8 == 2:
        return odd_metadata(rng, made, task, kind)
    own = OF_PLANS if "plan" in kind else OF_ROLLOUTS
    known, left_out = EITHER if rng.random() < 0.6 else own, TOO_SLIGHT.get(kind, ())
    forge = rng.choice([each for each in known if each not in left_out])
    task, kind = ("open", "rollout") if forge in (looped, hairpin) else (task, kind)
    return forged(forge, rng, made, task, kind, REFUSED)
