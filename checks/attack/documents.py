"""Configurations, plants, models and cards, data sets, recordings, trainings, results and baselines, tampered with.

What is changed may still be right, so that most of these may end in success; none in a traceback, and none never.
"""

from __future__ import annotations

import copy
import hashlib
import json
import random
import shutil
import struct
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from cableway.core.provenance import describe
from cableway.scene.files.loading import load_task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.table_plant import TableConfig
from cableway.tang2025.models.recipe import CONFIGS
from checks.attack import recordings
from checks.attack.cases import ANY, WRONG, Case, command
from checks.attack.made import EPISODE, TASKS, Made, episode
from checks.attack.mutants import NO_FILES, as_json, as_yaml, brief, damaged, mutated, value

Spoil = Callable[[bytes, random.Random], tuple[bytes, str]]


class Target(NamedTuple):
    """A file to tamper with.

    Attributes:
        place: Where it is in the case's folder.
        content: What it holds when it is right.
        spoil: Gives other content, and says what was done.
        line: The command that reads it.
        seconds: Processor time that this may take where it goes on, JAX's or a simulation.
        harmless: Whether a changed file may be right; else the command must refuse it.
    """

    place: str
    content: Path | bytes
    spoil: Spoil
    line: tuple[object, ...]
    seconds: float
    harmless: bool = True


def yaml_spoilt(content: bytes, rng: random.Random) -> tuple[bytes, str]:
    data, done = mutated(yaml.safe_load(content), rng)
    return as_yaml(data, rng), done


def json_spoilt(content: bytes, rng: random.Random) -> tuple[bytes, str]:
    data, done = mutated(json.loads(content), rng)
    return as_json(data, rng), done


def card_spoilt(content: bytes, rng: random.Random) -> tuple[bytes, str]:
    """A safetensors file with another card; now and then with another header."""
    size = struct.unpack("<Q", content[:8])[0]
    header, weights = json.loads(content[8 : 8 + size]), content[8 + size :]
    if rng.random() < 0.25:
        header, done = mutated(header, rng)
    else:
        card = json.loads(header["__metadata__"]["cableway"])
        card, done = mutated(card, rng)
        header["__metadata__"]["cableway"] = as_json(card, rng).decode(errors="replace")
    text = as_json(header, random.Random(1))
    return struct.pack("<Q", rng.choice([len(text)] * 9 + [2**63])) + text + weights, done


@cache
def plants() -> tuple[bytes, ...]:
    """Plant files that are right."""
    task = load_task(TASKS[0])
    full = describe(Perturbation(table=TableConfig(friction=0.3)))
    full["cable"] = task.cable.as_dict() | {"friction": 0.2}
    full["start"] = [[0.001, 0.0, 0.01], [0.0, 0.001, 0.0]]
    full["obstacles"] = [[0.001, 0.0]] * len(task.scene.obstacles)
    full["pegs"] = [[0.65, 0.65, 0.005]]
    full.pop("notes", None)
    planar = {name: section for name, section in full.items() if name != "table"}
    return tuple(yaml.safe_dump({"cableway": 1, **each}, sort_keys=False).encode() for each in (planar, full))


def targets(rng: random.Random, made: Made) -> dict[str, Target]:
    """All kinds of files that come from elsewhere."""
    recipes = [made.recipe, *sorted(CONFIGS.glob("*.yaml"))]
    data = ("--data", "data", "--horizon", 3)
    bench = ("bench", EPISODE[0], "--methods", EPISODE[1], "--episodes", episode(), "--workers", 1, "--out", "bench")
    plan = made.run(TASKS[0]) / "plan.npz"
    run = ("run", TASKS[0], "--from", plan, "--plant", "plant.yaml", "--controller", "open-loop", "--no-video")
    small = ("--config", made.recipe, "--data", made.data)
    started = ("train", "--config", made.state.with_name("recipe.yaml"), "--data", made.data, "--out", "training")
    judged, learned = ("evaluate", "m.safetensors", "--data", made.data, "--horizon", 3), ("evaluate", "linear", *data)
    shard = "data/shard-000000.safetensors"
    rollout, heard = made.run(TASKS[0]) / "rollout.npz", ("evaluate", "linear", "--horizon", 3, "--data")
    result = f"bench/episodes/{EPISODE[0]}/{EPISODE[1]}/{episode()}.json"
    return {
        # no such executor, no such data: only the file is read
        "collection": Target("config.yaml", rng.choice(recipes), yaml_spoilt,
                             ("collect", "--config", "config.yaml", "--executor", "none"), 5),
        "recipe": Target("config.yaml", rng.choice(recipes), yaml_spoilt,
                         ("train", "--config", "config.yaml", "--data", "nowhere"), 8),
        "plant": Target("plant.yaml", rng.choice(plants()), yaml_spoilt, (*run, "--out", "o"), 60),
        "card": Target("m.safetensors", made.model, card_spoilt, ("models", "m.safetensors"), 8),
        "card, used": Target("m.safetensors", made.model, card_spoilt, judged, 30),
        "model": Target("m.safetensors", made.model, damaged, judged, 30, False),
        "manifest": Target("data/manifest.json", made.data / "manifest.json", json_spoilt, learned, 30),
        "shard": Target(shard, made.folder / shard, damaged, learned, 30, False),
        "shard, hashed": Target(shard, made.folder / shard, card_spoilt_shard, learned, 30),
        "recording": Target(recordings.TABLE, recordings.table(rollout), recordings.table_spoilt,
                            (*heard, recordings.TABLE), 30),
        "recording, archive": Target(recordings.ARCHIVE, recordings.archive(recordings.recorded(rollout)),
                                     recordings.archive_spoilt, (*heard, recordings.ARCHIVE), 30),
        "recording, described": Target(recordings.DESCRIPTION, recordings.description(), yaml_spoilt,
                                       (*heard, recordings.DESCRIPTION), 30),
        "start": Target("m.safetensors", made.model, card_spoilt,
                        ("train", *small, "--from", "m.safetensors", "--out", "training"), 40),
        "state": Target("training/model.safetensors.state", made.state, damaged, started, 40, False),
        "state's header": Target("training/model.safetensors.state", made.state, card_spoilt, started, 40),
        "result": Target(result, made.folder / result, json_spoilt, bench, 30),
        "baseline": Target("baseline.json", made.bench / "baseline.json", json_spoilt,
                           (*bench, "--against", "baseline.json"), 30),
    }  # fmt: skip


def card_spoilt_shard(content: bytes, rng: random.Random) -> tuple[bytes, str]:
    """A shard with another header; the manifest beside it is made to fit, see `lay_out`."""
    size = struct.unpack("<Q", content[:8])[0]
    header, done = mutated(json.loads(content[8 : 8 + size]), rng)
    text = as_json(header, rng)
    return struct.pack("<Q", len(text)) + text + content[8 + size :], done


def lay_out(target: Target, made: Made, write: Callable[[Path], Any]) -> None:
    """Everything that the command reads, with the file tampered with in its place."""
    top = target.place.partition("/")[0]
    if top in ("data", "bench") or "bench" in target.line:
        source = made.data if top == "data" else made.bench
        shutil.copytree(source, source.name)
    if target.place == recordings.DESCRIPTION:
        Path(recordings.TABLE).write_bytes(recordings.table(made.run(TASKS[0]) / "rollout.npz"))
    path = Path(target.place)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    write(path)
    if target.spoil is card_spoilt_shard:
        manifest = Path("data/manifest.json")
        content = json.loads(manifest.read_text())
        content["shards"][0]["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
        manifest.write_text(json.dumps(content))


def tampered(name: str, target: Target, rng: random.Random, made: Made) -> Case:
    """A case of one file spoilt."""
    original = target.content if isinstance(target.content, bytes) else target.content.read_bytes()
    content, done = target.spoil(original, rng)

    def act() -> Iterable[str]:
        lay_out(target, made, lambda path: path.write_bytes(content))
        yield from command(*target.line, allowed=ANY if target.harmless or content == original else [WRONG])

    return Case(f"{name}: {done}", act, target.seconds)


def replaced(name: str, target: Target, write: Callable[[Path], Any], made: Made) -> Case:
    """A case of what is no file at all."""

    def act() -> Iterable[str]:
        lay_out(target, made, write)
        absent = write.__name__ in ("missing", "loop") and name.startswith(("state", "result"))
        yield from command(*target.line, allowed=ANY if absent else [WRONG])

    return Case(f"{name}: {write.__name__}", act, target.seconds)


def several(rng: random.Random, made: Made) -> Case:
    """A configuration of which one value is another."""
    content = copy.deepcopy(yaml.safe_load(made.recipe.read_text()))
    section = rng.choice(["collection", "model", "training"])
    key, new = rng.choice([*content[section], "seed", "workers", "learning_rate", "devices", "patience"]), value(rng)
    content[section][key] = new
    line = ("collect", "--config", "config.yaml", "--executor", "none")

    def act() -> Iterable[str]:
        Path("config.yaml").write_bytes(as_yaml(content, random.Random(1)))
        yield from command(*line, allowed=[WRONG])

    return Case(f"configuration: {section}.{key} = {brief(new)}", act)


def case(rng: random.Random, number: int, made: Made) -> Case:
    """The case of a number: by turns, first what is no file at all."""
    known = targets(rng, made)
    names = [name for name in known if not name.endswith(("used", "hashed", "header"))]
    if number < len(names) * len(NO_FILES):
        name, write = names[number % len(names)], NO_FILES[number // len(names)]
        return replaced(name, known[name], write, made)
    if rng.random() < 0.1:
        return several(rng, made)
    shares = {
        "plant": 4,
        "collection": 4,
        "recipe": 2,
        "card": 3,
        "baseline": 2,
        "result": 2,
        "manifest": 2,
        "model": 2,
        "recording": 3,
        "recording, archive": 3,
        "recording, described": 3,
    }
    name = rng.choices(list(known), [shares.get(name, 1) for name in known])[0]
    return tampered(name, known[name], rng, made)
