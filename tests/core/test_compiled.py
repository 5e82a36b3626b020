"""Compiled kernels: where they are kept, by what they are found again, and what happens where they cannot be kept."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from numba.core import event

from cableway.core import compiled, kernel_cache, user_cache
from cableway.core.compiled import compiled_among, kernel, kernels_below

KERNEL = "@kernel\ndef f(): ...\n"


def folder_of(package: Path, monkeypatch: pytest.MonkeyPatch, kernel: str = KERNEL) -> Path:
    """The cache folder of a package that lies here and has this kernel."""
    (package / "geometry").mkdir(parents=True, exist_ok=True)
    (package / "geometry" / "convex.py").write_text(kernel)
    monkeypatch.setattr(kernel_cache, "__file__", str(package / "geometry" / "kernel_cache.py"))
    return kernel_cache.cache_folder.__wrapped__()


@pytest.mark.parametrize("source", [KERNEL, KERNEL.replace("@kernel", "@inlined")])
def test_kernels_alone_name_the_folder_wherever_they_are_installed(tmp_path, monkeypatch, source):
    first = folder_of(tmp_path / "a", monkeypatch, source)
    assert folder_of(tmp_path / "b", monkeypatch, source) == first
    assert folder_of(tmp_path / "b", monkeypatch, source.replace("f", "g")) != first


@pytest.mark.parametrize("what", ["processor", "optimization", "Python"])
def test_code_made_for_another_processor_or_python_is_in_another_folder(tmp_path, monkeypatch, what):
    """So that it is neither run nor taken for compiled."""
    first = folder_of(tmp_path, monkeypatch)
    flags, tag = sys.flags.optimize, sys.implementation.cache_tag
    if what == "processor":
        codegen = SimpleNamespace(magic_tuple=lambda: ("another", "one", ""))
        context = SimpleNamespace(codegen=lambda: codegen)
        monkeypatch.setattr(kernel_cache, "cpu_target", SimpleNamespace(target_context=context))
    else:
        flags, tag = (flags + 1, tag) if what == "optimization" else (flags, "cpython-299")
        other = SimpleNamespace(flags=SimpleNamespace(optimize=flags), implementation=SimpleNamespace(cache_tag=tag))
        monkeypatch.setattr(kernel_cache, "sys", other)
    assert folder_of(tmp_path, monkeypatch) != first


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder."""
    monkeypatch.setattr(user_cache, "PROBLEMS", problems := {})
    monkeypatch.setattr(kernel_cache, "PROBLEMS", problems)
    kept_in(tmp_path / "cache", monkeypatch)
    return tmp_path / "cache"


def kept_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have kernels kept in a folder."""
    monkeypatch.setattr(kernel_cache, "trusted_folder", lambda: user_cache.private_folder(folder))
    monkeypatch.setattr(compiled, "trusted_folder", kernel_cache.trusted_folder)
    monkeypatch.setattr(kernel_cache, "cache_folder", lambda: folder)


def double():
    """A kernel that nothing is known of yet in this process."""

    @kernel
    def double(x):
        return 2 * x

    return double


def loaded(each) -> bool:
    """Whether the code of a kernel that was called with one signature came from the folder."""
    return sum(each.stats.cache_hits.values()) == 1


def test_what_one_process_compiled_another_one_loads(folder):
    assert double()(21) == 42
    again = double()
    assert again(21) == 42
    assert loaded(again)
    other = double()
    assert other(1.5) == 3.0
    assert not loaded(other)
    assert len(list(folder.iterdir())) == 2, "each signature has a file of its own"


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:20],
        lambda content: content[:-1],
        lambda content: content[:100] + bytes([content[100] ^ 1]) + content[101:],
        lambda content: os.urandom(len(content)),
    ],
    ids=["empty", "no digest", "cut short", "a bit", "garbage"],
)
def test_a_damaged_file_is_compiled_anew_and_replaced(folder, damage):
    double()(21)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    again = double()
    assert again(21) == 42
    assert not loaded(again)
    assert double()(21) == 42
    assert len(file.read_bytes()) > 1000
    last = double()
    assert last(21) == 42
    assert loaded(last)


def test_the_code_of_another_kernel_is_not_taken(folder):
    """Whatever was copied or renamed in the folder."""
    double()(21)
    (file,) = folder.iterdir()
    double()(1.5)
    (other,) = set(folder.iterdir()) - {file}
    file.write_bytes(other.read_bytes())
    again = double()
    assert again(21) == 42
    assert not loaded(again)


def test_kernels_run_where_the_folder_cannot_be_made(folder, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    kept_in(tmp_path / "file" / "cache", monkeypatch)
    assert double()(21) == 42
    (said,) = user_cache.problems()
    assert str(tmp_path / "file" / "cache") in said
    assert "Not a directory" in said


def test_kernels_run_where_the_disk_is_full(folder):
    """By a limit on the size of files; what was begun goes again, and nothing more is tried."""
    double()(21)
    (file,) = folder.iterdir()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        assert double()(1.5) == 3.0
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(folder.iterdir()) == [file]
    (said,) = user_cache.problems()
    assert "File too large" in said


def test_the_folder_becomes_the_users_alone(folder):
    """It is unpickled from."""
    folder.mkdir(mode=0o755)
    folder.chmod(0o777)
    double()(21)
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_folder_of_another_user_is_neither_read_nor_written(folder, monkeypatch):
    double()(21)
    (file,) = folder.iterdir()
    if os.getuid() == 0:  # root's own folder is trusted
        os.chown(folder, 12345, -1)
    else:
        other = os.getuid() + 1
        monkeypatch.setattr(os, "getuid", lambda: other)
    again = double()
    assert again(21) == 42
    assert not loaded(again)
    double()(1.5)
    assert list(folder.iterdir()) == [file]
    assert "belongs to another user" in user_cache.problems()[0]


def test_the_clock_stands_still_while_kernels_are_compiled_and_loaded(folder, monkeypatch):
    """By a clock on which each takes an hour."""
    now = [0.0]

    def an_hour(*_: object) -> None:
        now[0] += 3600

    monkeypatch.setattr(compiled, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(kernel_cache, "kept", an_hour)
    begun = compiled.clock()
    double()(21)
    assert now[0] == 3600
    assert compiled.clock() == pytest.approx(begun)
    with event.trigger_event("numba:compile", data={}):
        an_hour()
        with event.trigger_event("numba:compile", data={}):
            an_hour()
        assert compiled.clock() == pytest.approx(begun)
    now[0] += 5
    assert compiled.clock() == pytest.approx(begun + 5)


@kernel
def halved(x):
    return x / 2


@kernel
def quartered(x):
    return halved(halved(x))


def test_kernels_are_counted_with_those_that_they_call(folder):
    """Compiled in this process or kept by another one, of which only what is called from Python is loaded."""
    both = kernels_below(quartered)
    assert set(both) == {halved, quartered}
    assert compiled_among(both) == 0
    assert quartered(8.0) == 2.0
    assert compiled_among(both) == 2
    assert len(list(folder.iterdir())) == 2
    assert kernels_below(quartered, without=halved) == (quartered,)


COVERED = """
import sys
from numba.core.dispatcher import Dispatcher
from cableway.workflow import compilation
compilation.compile_planning(); compilation.compile_ahead()
everything = {each for name, module in list(sys.modules.items()) if name.startswith("cableway")
              for each in vars(module).values() if isinstance(each, Dispatcher)}
called = {each for each in everything if each.signatures}
said = {compilation._kernel(name) for names in compilation.KERNELS.values() for name in names}
print(sorted(each.__name__ for each in called - set(compilation.kernels_of(*compilation.KERNELS))))
print(sorted(each.__name__ for each in said - called))
"""


def test_the_kernels_that_a_run_calls_are_those_that_are_counted():
    """So that "37 of 55" is true: none that is called is left out, and none is named that is not called."""
    done = subprocess.run([sys.executable, "-c", COVERED], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n[]\n"
