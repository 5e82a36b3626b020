"""Command lines: values of the wrong kind, names that are none, paths that lead nowhere or anywhere."""

from __future__ import annotations

import os
import random
from collections.abc import Iterable
from pathlib import Path

from checks.attack.cases import ANY, DONE, WRONG, Case, command
from checks.attack.made import EPISODE, TASKS, Made

ODD = [
    "-1", "0", "1", "1.5", "nan", "inf", "-inf", "1e400", "1e-400", "-0.0", "0x10", "2147483648", "1_000", "٣",
    "9" * 30, "true", "none", "None", "~", "*", "$HOME", "a,b", ",", "a:b", "-h",
    "--help", "--", "", " ", "x" * 3000, "[bold]x",
    "\x1b[31mred", "\u202eevil", "a\nb", "\udcff", ".", "..", "/dev/null", "/dev/full", "/dev/zero", "/proc/self/mem",
    "/proc/nowhere", "/dev/null/x", "folder", "fifo", "loop", "text.txt", "nowhere", "nowhere.npz", "nowhere.yaml",
    "os:system", "sys:exit", "nowhere.py:X", "lab.py:X", "lab.py", "lab:", "{plan}", "{rollout}", "{task}", "{model}",
    "{data}",
]  # fmt: skip

OPTIONS: dict[str, tuple[str, list[str]]] = {
    "tasks": ("tasks", ["random", "count", "width", "picture", "seed", "out", "json", "quiet"]),
    "tasks, random": ("tasks --random slot", ["random", "width", "seed", "out", "picture"]),
    "show": ("show {task}", ["out", "seed", "json"]),
    "plan": ("plan {task} --time-limit 2", ["planner", "pivot", "time-limit", "alternatives", "seed", "out", "json"]),
    "run": ("run {task} --from {plan} --no-video --controller open-loop",
            ["controller", "model", "plant", "deadline", "speed", "dry-run", "adapt", "seed", "out", "from"]),
    "check": ("check {task} {plan}", ["out", "seed", "json"]),
    "export": ("export {plan}", ["task", "rate", "cable", "unverified", "format", "out"]),
    "collect": ("collect --executor none", ["config", "transitions", "workers", "executor", "seed", "out"]),
    "train": ("train --data nowhere", ["data", "config", "model", "from", "devices", "seed", "out"]),
    "evaluate": ("evaluate linear --data {data}", ["data", "horizon", "out"]),
    "models": ("models {model}", ["out", "json", "seed"]),
    "bench": ("bench " + EPISODE[0] + " --episodes none",
              ["size", "methods", "episodes", "deadline", "against", "workers", "executor", "time-limit", "out"]),
    "reproduce": ("reproduce --size none", ["size", "workers", "executor", "time-limit", "out"]),
}  # fmt: skip
"""For each command a line that ends soon, and the options that are added to it."""

WRONGLY: dict[str, str] = {
    "nothing": "",
    "show": " | fifo | /dev/zero | folder | loop | nowhere",
    "plan": "",
    "check": (
        "{task} | {task} {task} | {plan} {plan} | {task} nowhere.npz | {task} folder | {task} fifo | "
        "{task} /dev/zero | fifo {plan}"
    ),
    "show {task}": "--out text.txt | --out text.txt/x",
    "plan {task}": (
        "--out text.txt | --out /dev/null | --out /proc/nowhere | --time-limit 0 | --time-limit nan | "
        "--time-limit -3 | --alternatives 0 | --alternatives -1 | --planner none | --pivot none | "
        "--seed -1 | --seed 1e3"
    ),
    "run {task}": (
        "--speed 0 | --speed 2 | --speed nan | --deadline -1 | --deadline nan | --controller none | "
        "--model none | --plant fifo | --plant folder | --plant lab.py | --plant nowhere:X | "
        "--controller sys:exit | --controller rod-mpc --model conv | --controller open-loop --adapt | "
        "--from {rollout} | --from {plan} --planner slide"
    ),
    "run": "maze-1 --from {plan}",
    "export {plan}": "--out x.txt | --rate 0 | --rate 1e9 | --rate nan | --task maze-1 | --format urscript",
    "export": "text.txt --task {task}",
    "tasks": (
        "--random none | --random maze --count 0 | --count 3 | --random slot --width -1 | "
        "--random slot --width nan | --random slot --width 9 | --random open-near --width 0.1 | "
        "--random slot --count 2 --seed 2147483647"
    ),
    "collect": (
        "--config nowhere.yaml | --config fifo | --transitions 0 | --transitions 10 --workers 0 | "
        "--transitions 10 --workers -1 | --out text.txt"
    ),
    "train": (
        "--data folder | --data fifo | --data nowhere | --data {data} --model none | "
        "--data {data} --config fifo | --data {data} --devices 0 | --data {data} --devices 999"
    ),
    "evaluate": ("none --data {data} | {plan} --data {data} | linear --data {plan} | linear --data {data} --horizon 0"),
    "models": "nowhere.safetensors | fifo | {plan} | folder",
    "bench": (
        "none | , | paper --methods none | paper --methods fifo | paper --methods lab.py | "
        "paper --methods lab.py:X | paper --size none | paper --episodes none | paper --against fifo | "
        "paper --against {plan} | paper --workers 0 | paper --time-limit 0 | paper --deadline 0 | "
        "paper --executor none | paper --out text.txt"
    ),
    "reproduce": "--size none",
    "studio": "none | nowhere.yaml | fifo | maze-1 --port 70000 | maze-1 --port -1 | maze-1 --host nowhere.invalid",
    "warm-up": "--seed 3 | --out text.txt",
}
"""Ends of command lines that must be refused, by their beginnings."""

NAMED: list[tuple[str, Iterable[int]]] = [
    ("", ANY),
    ("--version", [DONE]),
    ("--help", [DONE]),
    ("show {task} --out folder", [DONE]),
    *((f"{begin} {end}".strip(), [WRONG]) for begin, ends in WRONGLY.items() for end in ends.split(" | ")),
]

SLOW = ("train", "evaluate", "models", "collect", "bench", "warm-up", "run")
"""Commands that load more than the others; some begin to work before they are told what is wrong."""


def lay_out() -> None:
    """What the odd values name."""
    Path("folder").mkdir()
    Path("text.txt").write_text("a text")
    Path("lab.py").write_text("raise OSError('no robot')\n")
    os.mkfifo("fifo")
    Path("loop").symlink_to("loop")


def asked(line: list[str], allowed: Iterable[int]) -> Iterable[str]:
    lay_out()
    yield from command(*line, allowed=allowed)


def case(rng: random.Random, number: int, made: Made) -> Case:
    """The case of a number: those by hand, then others."""
    known = {
        "task": TASKS[0], "plan": made.run(TASKS[0]) / "plan.npz", "rollout": made.run(TASKS[0]) / "rollout.npz",
        "model": made.model, "data": made.data,
    }  # fmt: skip
    if number < len(NAMED):
        words, allowed = NAMED[number]
        line = [word.format(**known) for word in words.split()]
        return Case(words, lambda: asked(line, allowed), 30.0 if words.split(" ")[0] in SLOW else 5.0)
    name = rng.choice(list(OPTIONS))
    words, options = OPTIONS[name]
    line = words.split()
    for option in rng.sample(options, min(len(options), rng.choice([1, 1, 2, 3]))):
        line += [f"--{option}", rng.choice(ODD)]
    if rng.random() < 0.15:
        line.insert(rng.randrange(1, len(line)), rng.choice(ODD))
    filled = [word.format(**known) if word.startswith("{") and word.endswith("}") else word for word in line]
    return Case(" ".join(line)[:150], lambda: asked(filled, ANY), 30.0 if line[0] in SLOW else 8.0)
