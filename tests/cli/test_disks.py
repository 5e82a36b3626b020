"""Laws of the folder for results: a disk that is full, two commands at once, and what a command leaves in it."""

from __future__ import annotations

import errno
import json
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from commands import Command
from holding import unheld_writes
from safetensors.numpy import save_file

from cableway.core.files import only_writer


@contextmanager
def full_disk() -> Iterator[None]:
    """The system's limit on the size of a file stands for a full disk: both fail in the middle of a write."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


COMMANDS = {
    "tasks": ("tasks", "--random", "open-near"),
    "show": ("show", "maze-1"),
    "plan": ("plan", "{moved}"),
    "check": ("check", "{moved}", "{plan}"),
}


@pytest.mark.parametrize("name", list(COMMANDS))
def test_a_full_disk_is_one_sentence_and_leaves_no_part_of_a_file(
    cableway: Command, moved_file: Path, run_folder: Path, name: str
):
    arguments = [each.format(moved=moved_file, plan=run_folder / "plan.npz") for each in COMMANDS[name]]
    with full_disk():
        done = cableway(*arguments, "--out", "o", "--quiet")
    assert (done.status, done.err.count("\n")) == (1, 1)
    assert done.err.startswith("cableway: o/")
    assert done.err.endswith(": cannot be written: File too large\n")
    assert not [path for path in Path.cwd().rglob("*") if path.is_file()]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_output_that_cannot_be_written_is_one_sentence():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "cableway", "tasks"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "cableway: standard output: No space left on device\n")


SHARING = (
    ("plan", "{moved}"), ("tasks",), ("tasks", "--random", "open-near", "--picture"), ("bench", "paper"),
    ("check", "{moved}", "{run}/plan.npz"), ("reproduce",),
)  # fmt: skip


@pytest.mark.parametrize("arguments", SHARING)
def test_two_commands_do_not_share_a_folder(
    cableway: Command, moved_file: Path, run_folder: Path, arguments: tuple[str, ...]
):
    with only_writer(Path("o")):
        words = [each.format(moved=moved_file, run=run_folder) for each in arguments]
        done = cableway(*words, "--out", "o", "--quiet")
        assert (done.status, done.err) == (2, "cableway: o: another process is writing to this folder\n")
    assert not Path("o").exists()


@pytest.mark.parametrize("arguments", SHARING[:3])
def test_a_command_holds_its_folder_until_its_last_file(
    cableway: Command, moved_file: Path, run_folder: Path, arguments: tuple[str, ...]
):
    with unheld_writes(Path("o")) as found:
        words = [each.format(moved=moved_file, run=run_folder) for each in arguments]
        assert cableway(*words, "--out", "o", "--quiet").status == 0
    assert list(Path("o").iterdir())
    assert found == []


def test_a_file_system_without_locks_holds_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    def unknown(handle: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", unknown)
    with only_writer(tmp_path / "o"), only_writer(tmp_path / "o"):
        (tmp_path / "o/file").touch()
    assert (tmp_path / "o/file").exists()


def test_a_command_that_was_killed_holds_its_folder_no_longer(cableway: Command):
    holding = (
        "from pathlib import Path; from cableway.core.files import only_writer\n"
        "with only_writer(Path('o')): print(flush=True); input()"
    )
    with subprocess.Popen([sys.executable, "-c", holding], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        other.stdout.readline()
        assert cableway("tasks", "--random", "open-near", "--out", "o").status == 2
        other.kill()
    assert cableway("tasks", "--random", "open-near", "--out", "o", "--quiet").status == 0


def test_shards_of_a_data_set_are_no_models(cableway: Command):
    """`collect` and then `models`, both with their default folders."""
    shard = Path("runs/collect/shard-000000.safetensors")
    shard.parent.mkdir(parents=True)
    save_file({}, shard, metadata={"cableway": json.dumps({"format": "cableway-transitions"})})
    shard.with_name("manifest.json").touch()
    assert cableway("models", "--quiet") == (0, "", "")
    other = Path("runs/other/some.safetensors")
    other.parent.mkdir()
    shard.rename(other)
    assert "Left out: runs/other/some.safetensors: a safetensors file, but not" in cableway("models").err
    other.rename(shard)
    assert cableway("models", shard).status == 2, "what is named must be one"
