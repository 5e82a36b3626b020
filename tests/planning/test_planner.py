"""The whole planner on problems that are not in the catalogue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import problems
import pytest

from cableway.core.errors import InputError, PlanningError, UnknownNameError
from cableway.planning.config import PlannerConfig
from cableway.planning.planner import plan
from cableway.records import Plan
from cableway.verification import verify_plan


@pytest.mark.parametrize("name", problems.SOLVABLE)
def test_finds_a_plan_that_verifies(name):
    """A plan is found, and verifies when judged afresh from its file's arrays."""
    task = problems.SOLVABLE[name]()
    found = plan(task)
    assert verify_plan(found, task).passed
    assert found.progress[0].max() < 1e-6
    assert found.progress[-1].min() > 1 - 1e-6
    assert (np.diff(found.progress, axis=0) > -1e-9).all()


@pytest.mark.parametrize("guide", ["corridor", "tube", "slide-head", "slide-tail", "head", "tail", "anywhere"])
def test_each_guide_alone_passes_the_door(guide):
    """Each of these leads through a door by itself ("uniform", in which no end leads, does not)."""
    assert plan(problems.doorway(), config=PlannerConfig(guides=(guide,))).metadata["guide"] == guide


def test_same_seed_same_plan():
    """Two calls give the same arrays, bit for bit."""
    first, second = plan(problems.beside_disc(), seed=3), plan(problems.beside_disc(), seed=3)
    for name in ("shapes", "poses", "pivot", "passages", "path_set", "progress"):
        assert np.array_equal(getattr(first, name), getattr(second, name)), name


def test_stages_report_their_progress_in_order():
    """Each stage begins at 0 and ends at 1."""
    seen: list[tuple[str, float]] = []
    plan(problems.free(), progress=lambda stage, share: seen.append((stage, share)))
    stages = list(dict.fromkeys(stage for stage, _ in seen))
    assert stages == ["pivot path", "guide", "realisation", "verification"]
    for stage in stages:
        shares = [share for name, share in seen if name == stage]
        assert shares[0] == 0.0
        assert shares[-1] == 1.0


def test_no_plan_says_why():
    """Behind a sealed wall there is no plan; the error says who cannot pass, and so does the attempt that is drawn."""
    with pytest.raises(PlanningError, match="there is no plan: the left gripper needs a way 16 mm wide") as raised:
        plan(problems.sealed())
    assert str(raised.value) == f"there is no plan: {raised.value.attempt.reason}"


def test_when_time_runs_out_the_closest_attempt_is_handed_on():
    """No guide has the clearance wanted, which is not asked of them; the limit ends the search after the first."""
    from cableway.verification import VerificationLimits

    seen: list[str] = []
    config = PlannerConfig(limits=VerificationLimits(clearance=0.02), guides=("slide-head", "slide-tail"))
    with pytest.raises(PlanningError, match=r"the time limit ran out .*cable clearance") as caught:
        plan(
            problems.doorway(),
            config=config,
            progress=lambda stage, share: seen.append(stage),
            expired=lambda: seen.count("verification") == 2,
        )
    assert caught.value.attempt is not None
    assert caught.value.attempt.shapes is not None


def test_time_that_is_up_at_once():
    with pytest.raises(PlanningError, match=r"the time limit ran out before a plan was found$"):
        plan(problems.free(), expired=lambda: True)


def test_what_does_not_verify_is_not_handed_on():
    """A clearance not asked of the guide: the error names the failed check and carries the attempt for a picture."""
    from cableway.verification import VerificationLimits

    config = PlannerConfig(limits=VerificationLimits(clearance=0.02), guides=("slide-head",))
    with pytest.raises(PlanningError, match="clearance") as caught:
        plan(problems.doorway(), config=config)
    attempt = caught.value.attempt
    assert not attempt.verdict.passed
    assert attempt.shapes.shape[1:] == (13, 2)


def test_plan_file_round_trip(tmp_path):
    """A plan comes back from its file as it was."""
    found = plan(problems.free())
    found.save(tmp_path / "plan.npz")
    loaded = Plan.load(tmp_path / "plan.npz")
    assert np.array_equal(loaded.shapes, found.shapes)
    assert np.array_equal(loaded.poses, found.poses)
    assert loaded.metadata == found.metadata
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.npz"]


def test_unknown_guides_are_refused():
    """The message lists the guides there are."""
    with pytest.raises(UnknownNameError, match="slide-head"):
        PlannerConfig(guides=("sideways",))  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="at least one of"):
        PlannerConfig(guides=())


def test_a_plan_keeps_the_grippers_apart_and_the_bends_wide():
    """Limits that only some tasks have; the plan made without them breaks both."""
    free = problems.doorway()
    cable, grippers = replace(free.cable, min_bend_radius=0.09), replace(free.grippers, separation=0.26)
    task = replace(free, cable=cable, grippers=grippers)
    broken = {check.name for check in verify_plan(plan(free), task).failures()}
    assert broken >= {"gripper separation", "curvature"}
    assert verify_plan(plan(task), task).passed
