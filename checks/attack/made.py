"""What is attacked: runs, a data set, a model, a training under way and a benchmark's results, made as a user would."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import yaml

from cableway.cli import main
from cableway.scene.files.loading import load_task

TASKS = ("single-obstacle-2", "insertion", "real-single", "open")
"""Those that there is a run of; in the last one there is nothing in the way of whatever is forged."""

EPISODE = ("unconstrained", "open-loop")

RECIPE = """
cableway: 1
collection: {transitions: 300, episode_steps: 20, seed: 5}
model: {kind: mlp, hidden: [8]}
training: {epochs: 1, rollout_epochs: 0, batch_size: 64}
"""


@dataclass(frozen=True)
class Made:
    """Where everything is."""

    folder: Path

    @property
    def data(self) -> Path:
        return self.folder / "data"

    @property
    def recipe(self) -> Path:
        return self.folder / "recipe.yaml"

    @property
    def model(self) -> Path:
        return self.folder / "model" / "model.safetensors"

    @property
    def state(self) -> Path:
        return self.folder / "training" / "model.safetensors.state"

    @property
    def bench(self) -> Path:
        return self.folder / "bench"

    def run(self, task: str) -> Path:
        return self.folder / task

    def source(self, task: str) -> str:
        """What a command line calls it."""
        return str(self.folder / "open.yaml") if task == "open" else task


def make(folder: Path) -> Made:
    """All of it, or what is missing; what is compiled or loaded on the way, every case finds so."""
    made = Made(folder)
    folder.mkdir(parents=True, exist_ok=True)
    start = load_task(TASKS[0]).start
    content = {"cableway": 1, "name": "open", "workspace": {"size": [2, 2]}}
    content |= {"start": (start + 0.8).tolist(), "goal": (start + [0.9, 1.0]).tolist()}
    Path(made.source("open")).write_text(yaml.safe_dump(content))
    with tempfile.TemporaryDirectory() as other:
        _run(made.source(TASKS[0]), Path(other))
    for task in TASKS:
        if not (made.run(task) / "rollout.npz").exists():
            _run(made.source(task), made.run(task))
    main(["show", TASKS[0], "--quiet", "--out", str(folder / "task.png")])
    made.recipe.write_text(RECIPE)
    _apart(made.data, "collect", "--config", made.recipe)
    _apart(made.model.parent, "train", "--config", made.recipe, "--data", made.data)
    suite, method = EPISODE
    _apart(made.bench, "bench", suite, "--methods", method, "--episodes", episode(), "--workers", 1)
    _training_under_way(made)
    return made


def _run(task: str, out: Path) -> None:
    line = ["run", task, "--controller", "open-loop", "--no-video", "--quiet", "--out", str(out)]
    assert main(line) == 0
    assert main(["check", task, str(out / "plan.npz"), "--quiet"]) == 0


def episode() -> str:
    """Name of the episode of the benchmark."""
    from cableway.benchmark.suites import frozen_episodes

    return frozen_episodes(EPISODE[0])[0].name


def tool(*arguments: object) -> list[str]:
    """A command line of this environment's cableway."""
    return [str(Path(sys.executable).with_name("cableway")), *map(str, arguments)]


def _apart(out: Path, *arguments: object) -> None:
    """In a process of its own: what loads JAX must not be forked from."""
    if not out.exists():
        subprocess.run(tool(*arguments, "--quiet", "--out", out), check=True)


def _training_under_way(made: Made) -> None:
    """A training that is killed after an epoch."""
    if made.state.exists():
        return
    made.state.parent.mkdir(parents=True)
    config = made.state.with_name("recipe.yaml")
    config.write_text(RECIPE.replace("epochs: 1,", "epochs: 30,", 1))
    line = tool("train", "--config", config, "--data", made.data, "--out", made.state.parent, "--quiet")
    with subprocess.Popen(line, start_new_session=True) as training:
        while not made.state.exists():
            assert training.poll() is None
            time.sleep(0.01)
        os.killpg(training.pid, signal.SIGKILL)
