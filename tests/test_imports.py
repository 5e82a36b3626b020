"""Laws of importing: what imports what, what it costs, and that it changes nothing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import cableway

ROOT = Path(__file__).resolve().parents[1]
HEAVY = {"jax", "mujoco", "ompl", "casadi", "numba", "scipy", "shapely", "matplotlib", "equinox"}

LOADED_BY = """
import sys
{statement}
print(*{{name.split(".")[0] for name in sys.modules}})
"""

CHANGED_BY_IMPORT = """
import importlib, os, pkgutil, sys, warnings
# what others change when they are imported is theirs
import casadi, equinox, gymnasium, imageio_ffmpeg, jax, matplotlib, mujoco, numba, numpy, optax, rich, shapely, tyro
import viser, scipy.interpolate, scipy.optimize, scipy.sparse.linalg, scipy.stats, threadpoolctl
if sys.platform == "linux":
    import ompl.base

def state():
    return {
        "environment": dict(os.environ),
        "jax.config": dict(jax.config.values),
        "matplotlib.rcParams": dict(matplotlib.rcParams),
        "numba.cache": numba.config.CACHE_DIR,
        "numpy.errors": numpy.geterr(),
        "warnings.filters": list(warnings.filters),
    }

before = state()
import cableway
modules = [m.name for m in pkgutil.walk_packages(cableway.__path__, "cableway.") if not m.name.endswith("__main__")]
for name in modules:
    importlib.import_module(name)
assert len(modules) > 40, modules
after = state()
print(*[name for name in before if before[name] != after[name]])
"""


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_imports_point_one_way():
    """Every contract of `[tool.importlinter]` in pyproject.toml is kept."""
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True, no_logo=True))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout


@pytest.mark.parametrize(
    "statement",
    [
        "import cableway",
        "from cableway import cli",
        "import sys; sys.argv = ['cableway', '--help']\nfrom cableway.cli import main\n"
        "import contextlib, io\n"
        "with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit): main()",
    ],
    ids=["package", "command", "help"],
)
def test_importing_and_help_touch_nothing_heavy(statement: str):
    loaded = set(run(LOADED_BY.format(statement=statement)).split())
    assert "cableway" in loaded
    assert not loaded & HEAVY


def test_a_page_of_the_studio_is_served_before_what_plans_and_draws_is_imported():
    loaded = set(run(LOADED_BY.format(statement="import cableway.studio.studio, cableway.studio.view.server")).split())
    assert "viser" in loaded
    assert loaded & HEAVY == {"numba", "scipy", "shapely"}  # by which a task is checked


def test_importing_every_module_changes_nothing_global():
    assert run(CHANGED_BY_IMPORT).split() == []


@pytest.mark.parametrize("name", cableway.__all__)
def test_every_public_name_exists(name: str):
    assert getattr(cableway, name).__doc__


def test_an_unknown_public_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'planner'"):
        _ = cableway.planner
