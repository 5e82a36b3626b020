"""Laws of interrupts: whatever a command does, it ends in one sentence and a status, and leaves whole files."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.machinery import ExtensionFileLoader
from multiprocessing import synchronize
from pathlib import Path
from typing import Any

import pytest
from commands import Command
from spatial_problems import ball_task

from cableway.cli import outputs
from cableway.cli.interrupts import INTERRUPTS, Interrupted
from cableway.records import Plan, Rollout
from cableway.scene.files.saving import save_task
from cableway.tasks.generation import random_task

READY = 60.0
"""[s] that a command may take to come to what is waited for, on a busy machine."""


def interrupted(tmp_path: Path, arguments: list[str], number: int, ready: Callable[[Path], bool]) -> tuple[int, str]:
    """Exit status and stderr of a command that gets a signal, with all its processes, once it has come so far."""
    out = tmp_path / "o"
    command = [sys.executable, "-m", "cableway", *arguments, "--quiet", "--out", str(out)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        until = time.monotonic() + READY
        while process.poll() is None and not ready(out) and time.monotonic() < until:
            time.sleep(0.01)
        if process.poll() is None:
            os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
        _, said = process.communicate(timeout=READY)
        return process.returncode, said


def soon(_: Path) -> bool:
    time.sleep(0.4)  # modules are being imported
    return True


def planned(out: Path) -> bool:
    return (out / "plan.png").exists()


def in_space(folder: Path, _: Path) -> Path:
    pytest.importorskip("coal")
    save_task(ball_task(), folder / "ball.yaml")
    return folder / "ball.yaml"


@pytest.mark.parametrize(
    ("number", "status", "sentence"),
    [
        (signal.SIGINT, 130, "cableway: interrupted; in {}: {}\n"),
        (signal.SIGTERM, 143, "cableway: terminated; in {}: {}\n"),
        (signal.SIGKILL, -signal.SIGKILL, ""),
    ],
)
@pytest.mark.parametrize("task_file", [lambda _, moved: moved, in_space], ids=["on a table", "in space"])
def test_a_run_that_is_interrupted_keeps_its_plan_and_what_was_tracked(
    tmp_path: Path, moved_file: Path, number: int, status: int, sentence: str, task_file: Callable[[Path, Path], Path]
):
    ended, said = interrupted(tmp_path, ["run", str(task_file(tmp_path, moved_file))], number, planned)
    left = {path.name for path in (tmp_path / "o").iterdir()}
    kept = ", ".join(name for name in outputs.ALL if name in left)
    assert (ended, said) == (status, sentence.format(tmp_path / "o", kept))
    assert left - {"rollout.npz", "rollout.png"} == {"plan.npz", "plan.png", "report.json", "task.yaml"}
    assert Plan.load(tmp_path / "o/plan.npz").steps > 0
    report = json.loads((tmp_path / "o/report.json").read_text())
    assert (report["success"], report["outcome"]) == (False, "interrupted")
    if "rollout.npz" in left:
        assert Rollout.load(tmp_path / "o/rollout.npz").outcome == "interrupted"


@pytest.mark.parametrize(
    "command", [["run", "single-obstacle-2"], ["bench", "paper", "--workers", "2"]], ids=lambda command: command[0]
)
def test_an_interrupt_in_the_first_moments_is_one_sentence(tmp_path: Path, command: list[str]):
    assert interrupted(tmp_path, command, signal.SIGINT, soon) == (130, "cableway: interrupted\n")
    assert not list(tmp_path.rglob("*.npz"))


def test_a_benchmark_whose_workers_are_at_work_ends_with_them(tmp_path: Path):
    def at_work(out: Path) -> bool:
        time.sleep(6.0)
        return True

    status, said = interrupted(tmp_path, ["bench", "paper", "--workers", "2"], signal.SIGINT, at_work)
    assert status == 130
    ended = len(list((tmp_path / "o").rglob("*.json")))
    kept = f"; {ended} of 11 episodes are in {tmp_path / 'o'}, and the same command continues from there"
    assert said == f"cableway: interrupted{kept if ended else ''}\n"


@pytest.mark.parametrize("kept", ["", "; 3 of 20 tasks are in o"])
def test_random_tasks_that_were_made_are_told(cableway: Command, monkeypatch: pytest.MonkeyPatch, kept: str):
    def interrupt(seed: int, *given: Any, **options: Any) -> Any:
        if seed == (3 if kept else 0):
            os.kill(os.getpid(), signal.SIGINT)
        return random_task(seed, *given, **options)

    monkeypatch.setattr("cableway.tasks.space.generation.random_task", interrupt)
    done = cableway("tasks", "--random", "open-near", "--count", "20", "--out", "o", "--quiet")
    assert done == (130, "", f"cableway: interrupted{kept}\n")
    assert len(list(Path().rglob("*.yaml"))) == (3 if kept else 0)


def test_an_error_that_an_interrupt_became_is_an_interrupt(cableway: Command, monkeypatch: pytest.MonkeyPatch):
    """As extension modules make of it while they are imported."""

    def broken(_: object) -> None:
        with pytest.raises(Interrupted):
            os.kill(os.getpid(), signal.SIGINT)
        raise SystemError("initialization of a module failed without raising an exception")

    monkeypatch.setattr("cableway.cli.commands.parse", broken)
    assert cableway("tasks") == (130, "", "cableway: interrupted\n")
    assert INTERRUPTS.came == signal.SIGINT


def test_an_error_without_an_interrupt_stays_one(cableway: Command, monkeypatch: pytest.MonkeyPatch):
    def broken(_: object) -> None:
        raise SystemError("initialization of a module failed without raising an exception")

    monkeypatch.setattr("cableway.cli.commands.parse", broken)
    with pytest.raises(SystemError):
        cableway("tasks")


def test_what_is_held_looks_itself_and_a_second_signal_does_not_wait(
    cableway: Command, monkeypatch: pytest.MonkeyPatch
):
    seen = []

    def held(_: object) -> None:
        INTERRUPTS.hold()
        os.kill(os.getpid(), signal.SIGTERM)
        seen.append(INTERRUPTS.came)
        os.kill(os.getpid(), signal.SIGINT)
        seen.append("unreachable")

    monkeypatch.setattr("cableway.cli.commands.parse", held)
    assert cableway("tasks") == (143, "", "cableway: terminated\n")
    assert seen == [signal.SIGTERM]


def test_what_is_held_and_does_not_look_is_interrupted_after_a_while(
    cableway: Command, monkeypatch: pytest.MonkeyPatch
):
    def hung(_: object) -> None:
        INTERRUPTS.hold()
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(READY)

    monkeypatch.setattr("cableway.cli.commands.parse", hung)
    monkeypatch.setattr("cableway.cli.interrupts.GRACE", 0.1)
    begun = time.monotonic()
    assert cableway("tasks").status == 130
    assert time.monotonic() - begun < READY / 2


def test_an_interrupt_that_something_swallows_comes_again(cableway: Command, monkeypatch: pytest.MonkeyPatch):
    """As in a bare `except` around an import, or in a destructor."""

    def deaf(_: object) -> None:
        with contextlib.suppress(BaseException):
            os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(READY)

    monkeypatch.setattr("cableway.cli.commands.parse", deaf)
    monkeypatch.setattr("cableway.cli.interrupts.GRACE", 0.1)
    begun = time.monotonic()
    assert cableway("tasks") == (143, "", "cableway: terminated\n")
    assert time.monotonic() - begun < READY / 2


def test_a_library_that_was_half_loaded_says_nothing_as_the_process_ends():
    """Its clean-up fails where a part of it is missing; that of a command left alone is still heard of."""
    begun = (
        "import atexit, os, signal\n"
        "from cableway.cli import commands, main\n"
        "def clean_up(): raise NameError('clear_caches')\n"
        "def parse(_):\n"
        "    atexit.register(clean_up)\n"
        "    {}\n"
        "commands.parse = parse\n"
        "raise SystemExit(main())\n"
    )
    ends = {"os.kill(os.getpid(), signal.SIGTERM)": (143, "cableway: terminated\n"), "raise SystemExit(1)": (1, None)}
    for end, (status, said) in ends.items():
        done = subprocess.run([sys.executable, "-c", begun.format(end)], capture_output=True, text=True, timeout=READY)
        assert done.returncode == status
        assert done.stderr == said if said else "NameError: clear_caches" in done.stderr


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_interrupted_command_puts_things_in_order(
    cableway: Command, monkeypatch: pytest.MonkeyPatch, error: type[BaseException]
):
    """However long it takes, and whatever became of the interrupt on the way."""
    seen = []

    def orderly(_: object) -> None:
        try:
            try:
                os.kill(os.getpid(), signal.SIGINT)
            except KeyboardInterrupt as stop:
                raise error from stop
        finally:
            time.sleep(0.3)
            seen.append("in order")

    monkeypatch.setattr("cableway.cli.commands.parse", orderly)
    monkeypatch.setattr("cableway.cli.interrupts.GRACE", 0.05)
    assert cableway("tasks") == (130, "", "cableway: interrupted\n")
    assert seen == ["in order"]


def test_an_extension_module_is_loaded_to_its_end(cableway: Command, monkeypatch: pytest.MonkeyPatch):
    """Some crash where an exception comes out of the Python that they call meanwhile."""
    seen = []

    class Loader(ExtensionFileLoader):
        def exec_module(self, module: object) -> None:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.2)
            seen.append("loaded")

    def load(_: object) -> None:
        Loader("module", "module.so").exec_module(None)
        time.sleep(READY)
        seen.append("went on")

    monkeypatch.setattr("cableway.cli.commands.parse", load)
    assert cableway("tasks") == (130, "", "cableway: interrupted\n")
    assert seen == ["loaded"]


def test_a_lock_that_is_collected_is_taken_away_whole(cableway: Command, monkeypatch: pytest.MonkeyPatch):
    """Nobody receives an exception there, and the half of it that is left is warned of as the process ends."""
    done, taken_away = [], vars(synchronize)["sem_unlink"]

    def unlink(name: str) -> None:
        taken_away(name)
        os.kill(os.getpid(), signal.SIGTERM)
        done.append("unlinked")

    monkeypatch.setattr(synchronize, "sem_unlink", unlink)
    monkeypatch.setattr("multiprocessing.resource_tracker.register", lambda name, kind: None)
    monkeypatch.setattr("multiprocessing.resource_tracker.unregister", lambda name, kind: done.append("unregistered"))

    def collect(_: object) -> None:
        lock: list[object] = [multiprocessing.get_context("spawn").Lock()]
        lock.clear()
        time.sleep(READY)
        done.append("went on")

    monkeypatch.setattr("cableway.cli.commands.parse", collect)
    assert cableway("tasks") == (143, "", "cableway: terminated\n")
    assert done == ["unlinked", "unregistered"]


@pytest.mark.parametrize("moment", ["__enter__", "__exit__"])
def test_a_signal_just_before_or_after_the_command_ends_it_in_one_sentence(
    cableway: Command, monkeypatch: pytest.MonkeyPatch, moment: str
):
    """While the handlers are there, but nobody receives an exception yet, or any more."""
    manager = contextlib._GeneratorContextManager
    method, sent = getattr(manager, moment), []

    def signalled(self: Any, *given: object) -> object:
        ours = self.gen.__qualname__ == "Interrupts.handled" and not sent
        done = method(self, *given) if moment == "__enter__" else None
        if ours:
            sent.append(moment)
            os.kill(os.getpid(), signal.SIGTERM)
        return done if moment == "__enter__" else method(self, *given)

    monkeypatch.setattr(manager, moment, signalled)
    assert cableway("--version")[::2] == (143, "cableway: terminated\n")
    assert sent == [moment]
