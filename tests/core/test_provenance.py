"""Laws of provenance: versions of what is installed, and configurations as JSON."""

from __future__ import annotations

import json
import math
import subprocess
from dataclasses import dataclass
from enum import Enum
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from cableway.core import provenance
from cableway.core.provenance import WITH_CHANGES, commit_of, describe, required_versions, versions
from cableway.planning.config import PlannerConfig


@dataclass(frozen=True)
class Inner:
    where: Path
    values: np.ndarray


@dataclass(frozen=True)
class Outer:
    inner: Inner
    pair: tuple[float, None]


class Colour(Enum):
    RED = "red"


def test_versions_are_those_installed_and_leave_out_the_extras():
    found = versions()
    assert found["cableway"] == metadata.version("cableway")
    assert found["mujoco"] == metadata.version("mujoco")
    assert "python" in found
    assert "pytest" not in found
    assert "not installed" not in found.values()


def test_versions_have_the_packages_of_extras_that_are_there(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(provenance, "EXTRAS", {"some": {"beartype": "beartype", "no-such-package": "None"}})
    found = versions()
    assert found["beartype"] == metadata.version("beartype")
    assert "no-such-package" not in found
    assert "beartype" not in required_versions()


def test_a_nested_configuration_becomes_plain_json():
    config = Outer(Inner(Path("a/b"), np.array([1.0, 2.0])), (math.inf, None))
    plain = describe({"x": config, 3: Colour.RED, "t": True, "n": np.int64(4)})
    assert plain == {
        "x": {"inner": {"where": "a/b", "values": [1.0, 2.0]}, "pair": ["inf", None]},
        "3": "red",
        "t": True,
        "n": 4,
    }
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain


def test_every_field_of_the_planners_configuration_is_described():
    plain = describe(PlannerConfig.paper())
    assert plain["pivot"]["method"] == "rrt_star"
    assert plain["limits"]["clearance"] > 0


def test_what_is_no_configuration_is_refused():
    with pytest.raises(TypeError, match="set is not a configuration value"):
        describe({"a": {1, 2}})


def test_the_commit_of_a_checkout_says_whether_its_source_was_changed(tmp_path: Path):
    """A file outside `src` changes nothing that runs; an untracked one in it may."""

    def git(*arguments: str) -> str:
        author = ("-c", "user.name=a", "-c", "user.email=a@b.example")
        return subprocess.check_output(["git", "-C", tmp_path, *author, *arguments], text=True).strip()

    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "module.py").write_text("A = 1\n")
    assert commit_of(tmp_path) is None
    git("init", "--quiet")
    assert commit_of(tmp_path) is None, "nothing committed yet"
    git("add", "src")
    git("commit", "--quiet", "-m", "first")
    (tmp_path / "notes.txt").write_text("")
    assert commit_of(tmp_path) == git("rev-parse", "HEAD")
    (tmp_path / "src" / "other.py").write_text("")
    assert commit_of(tmp_path) == git("rev-parse", "HEAD") + WITH_CHANGES
    (tmp_path / "src" / "other.py").unlink()
    (tmp_path / "src" / "module.py").write_text("A = 2\n")
    assert commit_of(tmp_path) == git("rev-parse", "HEAD") + WITH_CHANGES


def test_without_git_there_is_no_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / ".git").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path))
    assert commit_of(tmp_path) is None
