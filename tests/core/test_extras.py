"""Laws of extras: without their packages the default planner and controller work, and what needs them says so."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from cableway.core.errors import MissingExtraError
from cableway.core.extras import EXTRAS, require

BLOCK = "import sys; sys.modules.update(dict.fromkeys(('casadi', 'equinox', 'jax', 'jaxlib', 'ompl', 'optax')));"
NEEDS = "needs CasADi, Equinox, JAX and Optax, which are not installed: pip install 'cableway[tang2025]'"
SENTENCE = f"the system of Tang et al. (its planner, models and neural MPC) {NEEDS}"
COMMAND = "from cableway.cli import main; sys.exit(main(sys.argv[1:]))"


def without_packages(code: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python in which the packages of the extra `tang2025` cannot be imported."""
    command = [sys.executable, "-W", "error", "-c", BLOCK + code, *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_planning_and_tracking_need_no_extra(tmp_path: Path):
    code = (
        "import cableway as cw, cableway.benchmark.pages, cableway.cli.commands\n"
        "from cableway.workflow.solve import solve\n"
        "assert solve(cw.load_task('single-obstacle-1')).success"
    )
    done = without_packages(code, tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "command",
    [
        "plan single-obstacle-1 --planner tang2025",
        "plan single-obstacle-1 --pivot rrt_star",
        "run single-obstacle-1 --controller neural-mpc",
        "run single-obstacle-1 --controller tang2025",
        "collect",
        "train",
        "evaluate",
        "models",
        "reproduce",
    ],
)
def test_a_command_that_needs_the_extra_says_so_in_one_sentence(command: str, tmp_path: Path):
    done = without_packages(COMMAND, tmp_path, *command.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith(f"cableway: {SENTENCE}\n")
    assert "Traceback" not in done.stderr


def test_bench_says_so_before_it_begins(tmp_path: Path):
    code = (
        "from cableway.benchmark.episode import jobs_of; from cableway.benchmark.methods import BUILT_IN\n"
        "from cableway.core.errors import MissingExtraError\n"
        "for name in BUILT_IN:\n"
        "    try: jobs_of(name, ())\n"
        "    except MissingExtraError as error: print(name + ':', error)"
    )
    asked = {
        "tdm-mpc": "neural-mpc",
        "cdm-mpc": "neural-mpc",
        "bdm-mpc": "neural-mpc",
        "tang2025": "tang2025",
        "tang2025-tracking": "tang2025",
        "tang2025-plan": "tang2025",
        "tang2025-refined-plan": "tang2025-refined",
    }
    done = without_packages(code, tmp_path)
    assert set(done.stdout.splitlines()) == {f"{method}: {name} {NEEDS}" for method, name in asked.items()}


@pytest.mark.parametrize("name", ["MPCConfig", "NeuralMPC", "load_model"])
def test_a_public_name_that_needs_the_extra_says_so(name: str, tmp_path: Path):
    code = f"import cableway as cw\ntry: cw.{name}\nexcept ImportError as error: print(error)"
    assert without_packages(code, tmp_path).stdout == f"{SENTENCE}\n"


def test_one_missing_package_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(MissingExtraError, match=r"^this needs JAX, which is not installed: pip install 'cableway\["):
        require("tang2025", "this")


def test_nothing_is_said_where_all_packages_are_there():
    require("tang2025", "this")
    assert set(EXTRAS) == {
        "arms",
        "cell",
        "data",
        "gym",
        "import",
        "ray",
        "realsense",
        "studio",
        "tang2025",
        "ur",
        "vision",
    }
