"""Task files: those that people got wrong, those that somebody made to harm, and others spoilt at random."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable, Iterable
from functools import cache, partial
from pathlib import Path
from typing import Any

import yaml
from scene_task_files import VALID
from test_show_faults import CASES, possible, straight

from cableway.scene.files.loading import catalogue_file, task_names
from checks.attack.cases import ANY, DONE, WRONG, Case, command
from checks.attack.made import Made
from checks.attack.mutants import NO_FILES, as_yaml, laughs, mutated, nested

LIMIT = 2
"""[s] of `--time-limit`."""

Content = dict[str, Any]
Change = Callable[[Content], Any]


def put(*path: Any) -> Change:
    """The last of `path` at the place that the others lead to."""

    def change(content: Content) -> None:
        *outer, key, value = path
        for step in outer:
            content = content[step] if isinstance(content, list) else content.setdefault(step, {})
        content[key] = value

    return change


def scaled(factor: float, *, units: str = "") -> Change:
    """All lengths in another unit, said or not."""

    def times(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: each if key == "keypoints" else times(each) for key, each in value.items()}
        if isinstance(value, list):
            return [times(each) for each in value]
        return value if isinstance(value, str) else factor * value

    def change(content: Content) -> None:
        for key in set(content) - {"cableway", "name", "description"}:
            content[key] = times(content[key])
        if units:
            content["units"] = units

    return change


def both(*changes: Change) -> Change:
    def change(content: Content) -> None:
        for each in changes:
            each(content)

    return change


def discs(count: int) -> Change:
    """A field of small discs between start and goal."""
    side = int(count**0.5 + 0.999)
    at = [(0.02 + 0.66 * (k % side) / side, 0.2 + 0.2 * (k // side) / side) for k in range(count)]
    return put("obstacles", [{"type": "disc", "center": list(each), "radius": 0.001} for each in at])


def polygon(count: int, radius: float) -> list[list[float]]:
    """Vertices round a circle."""
    turns = [2 * math.pi * k / count for k in range(count)]
    return [[radius * math.cos(turn), radius * math.sin(turn)] for turn in turns]


def corner(x: float, y: float, theta: float, right: list[float]) -> Content:
    return {"grippers": [[x, y, theta], right], "bend": "left"}


BOX = {"type": "box", "center": [0.35, 0.3], "size": [0.1, 0.05]}
PLUG = put("plug", {"length": 0.04, "width": 0.012})
PORT = {"position": [0.56, 0.5], "angle": 0.0, "standoff": 0.02, "depth": 0.01}
HAND = {"outline": [[-0.01, -0.02], [0.01, -0.02], [0.01, 0.02], [-0.01, 0.02]], "heights": [0.0, 0.1]}
LETTERS = "\x1b[31m\x1b]0;t\x07\r\u202ered\x9b2J"

CHANGES: dict[str, tuple[Change, Iterable[int]]] = {
    "in millimetres": (scaled(1000), [WRONG]),
    "in centimetres": (scaled(100), [WRONG]),
    "in millimetres, and said so": (scaled(1000, units="mm"), [DONE]),
    "metres, said to be millimetres": (scaled(1, units="mm"), [WRONG]),
    "a hall of 30 m": (put("workspace", "size", [30.0, 30.0]), ANY),
    "a table of 9 m with 100 discs": (both(put("workspace", "size", [9.0, 9.0]), discs(100)), ANY),
    "a workspace of 1000 m": (put("workspace", "size", [1000.0, 1000.0]), ANY),
    "a workspace of 1e300 m": (put("workspace", "size", [1e300, 1e300]), [WRONG]),
    "a thin workspace": (put("workspace", "size", [0.7, 1e-6]), [WRONG]),
    "a long thin workspace": (put("workspace", "size", [100.0, 0.6]), ANY),
    "an angle in degrees": (put("obstacles", [{**BOX, "angle": 45}]), [WRONG]),
    "an angle in degrees, and said so": (both(put("obstacles", [{**BOX, "angle": 45}]), put("angles", "deg")), [DONE]),
    "theta in degrees": (put("start", corner(0.2, 0.1, 30, [0.45, 0.1, -30])), [WRONG]),
    "20 m in a step": (put("grippers", "max_step", 20), [WRONG]),
    "a cable of 600": (put("cable", "length", 600), [WRONG]),
    "dollars in the description": (put("description", r"costs $5 or \frac{1}{0} $"), [DONE]),
    "a formula in the name": (put("name", r"$\mathbf{x}^{$"), ANY),
    "a plug of 1e6 m": (put("plug", {"length": 1e6, "width": 0.01}), [WRONG]),
    "a port 1e6 m deep": (both(PLUG, put("port", {**PORT, "depth": 1e6})), [WRONG]),
    "a description that steers the terminal": (put("description", LETTERS), ANY),
    "a name that steers the terminal": (put("name", LETTERS), ANY),
    "a key that steers the terminal": (put(LETTERS, 1), [WRONG]),
    "a type that steers the terminal": (put("obstacles", [{**BOX, "type": LETTERS}]), [WRONG]),
    "a preset that steers the terminal": (put("cable", "preset", LETTERS), [WRONG]),
    "a name that leads elsewhere": (put("name", "../../elsewhere"), ANY),
    "an empty name": (put("name", ""), ANY),
    "a name of 5,000 letters": (put("name", "x" * 5000), ANY),
    "a name with NUL": (put("name", "a\x00b"), ANY),
    "max_step of 1e-12": (put("grippers", "max_step", 1e-12), [WRONG]),
    "max_turn of 1e-12": (put("grippers", "max_turn", 1e-12), [WRONG]),
    "acceleration of 1e-9": (put("grippers", "max_acceleration", 1e-9), ANY),
    "jerk of 1e-9": (put("grippers", "max_jerk", 1e-9), ANY),
    "slow grippers": (put("grippers", "max_step", 2e-5), ANY),
    "1,000 obstacles": (discs(1000), ANY),
    "10,000 obstacles": (discs(10_000), ANY),
    "one obstacle 1,000 times": (put("obstacles", [BOX] * 1000), ANY),
    "a cable of radius 1e-7": (put("cable", "radius", 1e-7), [WRONG]),
    "a cable of density 1e-13": (put("cable", "density", 1e-13), [WRONG]),
    "a cable of density 1e9": (put("cable", "density", 1e9), ANY),
    "a cable thicker than long": (put("cable", "radius", 0.4), [WRONG]),
    "a stiff cable": (put("cable", "bending_stiffness", 1e30), ANY),
    "a slow cable": (put("cable", "damping_time", 1e30), ANY),
    "friction of 1e30": (put("cable", "friction", 1e30), ANY),
    "a million keypoints": (put("cable", "keypoints", 10**6), [WRONG]),
    "one keypoint": (put("cable", "keypoints", 1), [WRONG]),
    "201 keypoints": (both(put("cable", "keypoints", 201), put("start", straight(0.2, 0.1, keypoints=201)),
                           put("goal", straight(0.2, 0.5, keypoints=201))), ANY),
    "start is goal": (put("goal", straight(0.2, 0.1)), ANY),
    "discs as large as the cable": (put("grippers", "radius", 0.5), [WRONG]),
    "farther apart than the cable": (put("grippers", "separation", 0.5), [WRONG]),
    "no gripper of that name": (put("grippers", "body", LETTERS), [WRONG]),
    "a hand of its own": (put("grippers", "body", [HAND]), ANY),
    "300 hands": (put("grippers", "body", [HAND] * 300), [WRONG]),
    "12 hands": (put("grippers", "body", [HAND] * 12), ANY),
    "a hand of 2,000 corners": (put("grippers", "body", [{**HAND, "outline": polygon(2000, 0.02)}]), [WRONG]),
    "a hand as wide as the table": (put("grippers", "body", [{**HAND, "outline": polygon(8, 0.6)}]), [WRONG]),
    "a hand upside down": (put("grippers", "body", [{**HAND, "heights": [0.1, 0.0]}]), [WRONG]),
    "a hand that is a line": (put("grippers", "body", [{**HAND, "outline": [[0, 0], [1, 0], [2, 0]]}]), [WRONG]),
    "a hand without pieces": (put("grippers", "body", []), ANY),
    "a hand in millimetres": (put("grippers", "body", [{**HAND, "heights": [0, 100]}]), [WRONG]),
    "a post of no height": (put("obstacles", [{**BOX, "height": 0}]), [WRONG]),
    "a post of 1e300 m": (put("obstacles", [{**BOX, "height": 1e300}]), [WRONG]),
    "walls of negative height": (put("workspace", "wall_height", -1), [WRONG]),
    "an endless polygon": (put("obstacles", [{"type": "polygon", "vertices": [[0.3, 0.3]] * 50_000}]), [WRONG]),
    "a polygon that crosses itself": (
        put("obstacles", [{"type": "polygon", "vertices": [[0.3, 0.2], [0.4, 0.3], [0.4, 0.2], [0.3, 0.3]]}]), [WRONG]),
    "a polygon of a line": (put("obstacles", [{"type": "polygon", "vertices": [[0.3, 0.3], [0.4, 0.3], [0.35, 0.3]]}]),
                            [WRONG]),
    "a box of no size": (put("obstacles", [{**BOX, "size": [0, 0]}]), [WRONG]),
    "a box of negative size": (put("obstacles", [{**BOX, "size": [-0.1, 0.1]}]), [WRONG]),
    "a disc of radius 1e-300": (put("obstacles", [{"type": "disc", "center": [0.35, 0.3], "radius": 1e-300}]), ANY),
    "lists in lists": (put("obstacles", nested(200)), [WRONG]),
    "lists in lists in the description": (put("description", nested(200)), [WRONG]),
    "not a number": (put("start", 3, 0, float("nan")), [WRONG]),
    "an infinite number": (put("workspace", "size", [float("inf"), 0.7]), [WRONG]),
    "a number of 400 digits": (put("cable", "length", 10**400), [WRONG]),
    "another version": (put("cableway", 2), [WRONG]),
} | {f"{change.__name__} in show's tests": (change, [WRONG]) for change, *_ in CASES}  # fmt: skip

TEXT = yaml.safe_dump(possible(), sort_keys=False)
RAW: dict[str, bytes] = {
    "no text": b"",
    "a list": b"[1, 2]",
    "a word": b"cableway",
    "bytes that are no text": bytes(range(256)),
    "UTF-16, a description of its own": TEXT.encode("utf-16"),
    "two documents": f"{TEXT}---\n{TEXT}".encode(),
    "a key twice": f"{TEXT}name: again\n".encode(),
    "a key twice inside": TEXT.replace("  radius: 0.004", "  radius: 0.004\n  radius: 0.005").encode(),
    "an object of Python": b"!!python/object/apply:os.system ['touch /tmp/harmed']",
    "a list that holds itself": b"obstacles: &a [*a]\n",
    "a mapping that holds itself": b"cable: &a {b: *a}\n",
    "brackets without end": b"[" * 100_000,
    "braces without end": b"{a: " * 20_000,
    "dashes without end": b"- " * 50_000,
    "a merge": f"{TEXT}<<: {{name: merged}}\n".encode(),
    "an archive": b"PK\x03\x04" + bytes(100),
    "30 MB of comment": TEXT.encode() + b"#" + b"x" * 30_000_000,
    "a line of 5 MB": TEXT.encode() + b"description: " + b"x" * 5_000_000,
}  # fmt: skip


@cache
def bases() -> list[Content]:
    """Task files that are right."""
    return [possible(), VALID, *(yaml.safe_load(catalogue_file(name).read_text()) for name in task_names())]


def shown(allowed: Iterable[int], *options: object) -> Iterable[str]:
    """What is wrong with `show`, which draws what it can."""
    yield from command("show", "task.yaml", *options, "--out", "task.png", allowed=allowed)


def planned(what: str, allowed: Iterable[int]) -> Iterable[str]:
    allowed = [WRONG] if list(allowed) == [WRONG] else ANY
    quickly = ("--no-video", "--controller", "open-loop") if what == "run" else ()
    yield from command(what, "task.yaml", "--time-limit", LIMIT, *quickly, "--out", "o", allowed=allowed)


def on(write: Callable[[Path], Any], what: str, allowed: Iterable[int]) -> Iterable[str]:
    """Write the file, and give it to a command."""
    write(Path("task.yaml"))
    yield from shown(allowed) if what == "show" else planned(what, allowed)


@cache
def named() -> list[tuple[str, Callable[[Path], Any], Iterable[int]]]:
    """Those by hand: name, what writes the file, the statuses allowed."""

    def changed(change: Change, path: Path) -> None:
        content = copy.deepcopy(possible())
        change(content)
        path.write_text(yaml.safe_dump(content, sort_keys=False))

    found = [(name, partial(changed, change), allowed) for name, (change, allowed) in CHANGES.items()]
    for name, text in RAW.items():
        found.append((name, lambda path, text=text: path.write_bytes(text), ANY if "description" in name else [WRONG]))
    found += [(f"task file: {write.__name__}", write, [WRONG]) for write in NO_FILES]
    return [*found, ("laughs as a task", laughs, [WRONG])]


def case(rng: random.Random, number: int, made: Made) -> Case:
    """The case of a number."""
    del made
    what, by_hand = ("show", "plan")[number % 2], named()
    if number // 2 < len(by_hand):
        name, write, allowed = by_hand[number // 2]
        return Case(f"{what}: {name}", lambda: on(write, what, allowed))
    what = rng.choices(["show", "plan", "run"], [70, 22, 8])[0]
    content, done = mutated(rng.choice(bases()), rng)
    text = as_yaml(content, rng)
    return Case(
        f"{what}: {content.get('name')!s:.20} {done}", lambda: on(lambda path: path.write_bytes(text), what, ANY)
    )
