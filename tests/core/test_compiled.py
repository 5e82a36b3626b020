"""Where compiled kernels are kept: by the sources and by the place of the installation."""

from __future__ import annotations

from pathlib import Path

import pytest

from cableway.core import compiled


def folder_of(package: Path, monkeypatch: pytest.MonkeyPatch, kernel: str = "@kernel\ndef f(): ...\n") -> Path:
    """The cache folder of a package that lies here and has this kernel."""
    (package / "geometry").mkdir(parents=True, exist_ok=True)
    (package / "geometry" / "convex.py").write_text(kernel)
    monkeypatch.setattr(compiled, "__file__", str(package / "geometry" / "compiled.py"))
    return compiled.cache_folder.__wrapped__()


def test_each_installation_has_a_folder_of_its_own(tmp_path, monkeypatch):
    """Numba compiles anew for each place, so a second one must not pass for compiled."""
    assert folder_of(tmp_path / "a", monkeypatch) != folder_of(tmp_path / "b", monkeypatch)
    assert folder_of(tmp_path / "a", monkeypatch) == folder_of(tmp_path / "a", monkeypatch)


def test_another_kernel_has_another_folder(tmp_path, monkeypatch):
    first = folder_of(tmp_path, monkeypatch)
    assert folder_of(tmp_path, monkeypatch, "@kernel\ndef g(): ...\n") != first
