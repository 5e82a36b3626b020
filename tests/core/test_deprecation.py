"""Laws of old names: each still works, with a warning at the caller's line that says the new one."""

from __future__ import annotations

import subprocess
import sys
import types
import warnings
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

import cableway
from cableway.benchmark.methods import load_method, made_by
from cableway.core.deprecation import MODULES, old_names_heard, renamed, renamed_keywords, renamed_value
from cableway.core.errors import InputError
from cableway.outcome import Outcome
from cableway.report import Report


@pytest.mark.parametrize(("old", "new"), MODULES.items())
def test_a_moved_module_is_found_at_its_new_place(old: str, new: str):
    assert find_spec(f"cableway.{new}") is not None
    place = Path(cableway.__file__).parent / old.replace(".", "/")
    assert not (place / "__init__.py").exists()
    assert not place.with_suffix(".py").exists()
    assert import_module(f"cableway.{old}").__name__ == f"cableway.{old}"


def test_a_name_of_a_moved_module_is_the_same_object():
    with pytest.warns(DeprecationWarning, match=r"cableway\.errors has moved to cableway\.core\.errors") as caught:
        from cableway.errors import InputError as old  # pyright: ignore[reportMissingImports]
    assert old is InputError
    assert caught[0].filename == __file__
    with pytest.warns(DeprecationWarning, match=r"cableway\.scene\.files\.loading"):
        from cableway.scene.loading import load_task  # pyright: ignore[reportMissingImports]
    assert load_task.__module__ == "cableway.scene.files.loading"
    with (
        pytest.warns(DeprecationWarning, match="has moved"),
        pytest.raises(ImportError, match="cannot import name 'nothing'"),
    ):
        from cableway.errors import CablewayError, nothing  # pyright: ignore[reportMissingImports]  # noqa: F401


def test_a_module_can_be_reached_from_the_package_in_a_fresh_process():
    code = "import cableway.errors, cableway.models.base as base; cableway.errors.InputError; base.rollout"
    done = subprocess.run([sys.executable, "-W", "always", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("DeprecationWarning") == 2


def test_renamed_attributes_say_their_new_name(monkeypatch: pytest.MonkeyPatch):
    module = types.ModuleType("cableway.made")
    module.new, module.__getattr__ = 7, renamed("cableway.made", {"old": "new", "Gone": "core.errors.InputError"})  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "cableway.made", module)
    with pytest.warns(DeprecationWarning, match=r"cableway\.made\.old is now cableway\.made\.new") as caught:
        assert module.old == 7
    assert caught[0].filename == __file__
    with pytest.warns(DeprecationWarning, match=r"is now cableway\.core\.errors\.InputError"):
        assert module.Gone is InputError
    with pytest.raises(AttributeError, match="no attribute 'other'"):
        module.other  # noqa: B018


def test_renamed_keywords_are_passed_on():
    @renamed_keywords(believed="nominal")
    def plant(nominal: int = 0) -> int:
        return nominal

    assert plant(nominal=1) == 1
    with pytest.warns(DeprecationWarning, match="the argument 'believed' is now 'nominal'") as caught:
        assert plant(believed=2) == 2  # pyright: ignore[reportCallIssue]
    assert caught[0].filename == __file__
    with pytest.raises(TypeError, match="its old name"):
        plant(nominal=1, believed=2)  # pyright: ignore[reportCallIssue]


def test_a_report_keeps_its_names():
    report = Report(task="", outcome=Outcome.SUCCESS, least_achievable_error=0.001)
    for old, new in (
        ("shape_error_floor", "least_achievable_error"),
        ("push_verdict", "insertion_plan_verdict"),
    ):
        with pytest.warns(DeprecationWarning, match=rf"Report\.{old} is now Report\.{new}") as caught:
            assert getattr(report, old) is getattr(report, new)
        assert caught[0].filename == __file__


def test_a_plan_of_an_insertion_may_be_called_push():
    task = cableway.load_task("insertion")
    plan = cableway.plan_insertion(task)
    with pytest.warns(DeprecationWarning, match="the argument 'push' is now 'insertion_plan'"):
        report = cableway.summarize(task, plan, push=plan)  # pyright: ignore[reportCallIssue]
    assert report.insertion_plan_verdict is not None
    assert report.insertion_plan_verdict.passed


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("PlugPush", "InsertionController"),
        ("PlugPushConfig", "InsertionConfig"),
        ("plan_push", "plan_insertion"),
        ("push_in", "insert_plug"),
        ("verify_push", "verify_insertion_plan"),
    ],
)
def test_insertion_keeps_its_public_names(old: str, new: str):
    with pytest.warns(DeprecationWarning, match=rf"cableway\.{old} is now cableway\.{new}") as caught:
        assert getattr(cableway, old) is getattr(cableway, new)
    assert caught[0].filename == __file__
    assert old not in cableway.__all__


def test_planning_keeps_the_names_of_its_settings():
    from cableway.planning import projection, rrt_connect, trajectory_optimization

    for module, old, new in (
        (projection, "RealizationConfig", "ProjectionConfig"),
        (rrt_connect, "ExploreConfig", "RRTConnectConfig"),
        (trajectory_optimization, "RefinementConfig", "TrajectoryOptimizationConfig"),
    ):
        with pytest.warns(DeprecationWarning, match=rf"{old} is now .*\.{new}"):
            assert getattr(module, old) is getattr(module, new)
    wanted = trajectory_optimization.TrajectoryOptimizationConfig(iterations=3)
    with pytest.warns(DeprecationWarning, match="'refinement' is now 'optimization'"):
        assert projection.ProjectionConfig(refinement=wanted).optimization is wanted  # pyright: ignore[reportCallIssue]


def test_the_paper_s_system_keeps_its_names():
    """Planner, controller and methods are found by the names that they had, and say those they have."""
    from cableway.planning.config import PlannerConfig
    from cableway.workflow.registry import controller_entry

    for kind, find, names in (
        ("planner", PlannerConfig.named, {"paper": "tang2025", "paper-refined": "tang2025-refined"}),
        ("controller", controller_entry, {"neural-mpc-paper": "tang2025"}),
        (
            "method",
            load_method,
            {
                "paper": "tang2025",
                "paper-tracking": "tang2025-tracking",
                "paper-plan": "tang2025-plan",
                "paper-refined-plan": "tang2025-refined-plan",
            },
        ),
    ):
        for old, new in names.items():
            with pytest.warns(DeprecationWarning, match=f"the {kind} '{old}' is now '{new}'"):
                found = find(old)
            assert found == find(new)
    assert made_by("paper") == made_by("tang2025")


def test_old_names_are_heard_once_and_other_warnings_are_left_alone():
    with old_names_heard() as heard:
        for _ in range(2):
            assert renamed_value("plant", "old", {"old": "new"}) == "new"
        with pytest.raises(DeprecationWarning, match="something else"):  # an error, as pytest has it
            warnings.warn("something else", DeprecationWarning, stacklevel=1)
    assert heard == ["the plant 'old' is now 'new'; the old name goes with the next release"]
