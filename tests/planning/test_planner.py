"""The whole planner on problems that are not in the catalogue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import problems
import pytest

from cableway.core.errors import InputError, PlanningError, UnknownNameError
from cableway.motion.validity import is_pulled_straight
from cableway.planning.candidates import STRAIGHT, Search
from cableway.planning.config import PlannerConfig
from cableway.planning.planner import plan
from cableway.records import Plan
from cableway.tasks.generation import random_task
from cableway.verification import verify_plan


@pytest.mark.parametrize("name", problems.SOLVABLE)
def test_finds_a_plan_that_verifies(name):
    """A plan is found, and verifies when judged afresh from its file's arrays."""
    task = problems.SOLVABLE[name]()
    found = plan(task)
    assert verify_plan(found, task).passed
    assert found.stages is None


@pytest.mark.parametrize("name", [*PlannerConfig().initial_trajectories, "head", "tail"])
def test_each_initial_trajectory_alone_passes_the_door(name):
    """Each of these leads through a door by itself ("uniform", in which no end leads, does not)."""
    found = plan(problems.doorway(), config=PlannerConfig(initial_trajectories=(name,)))
    assert found.metadata["initial_trajectory"] == name
    assert (found.stages is not None) == (name in ("head", "tail")), "only the paper's chain has such stages"


def test_restarts_find_what_single_searches_miss():
    """In this narrow maze the searches with 6,000 samples fail, and so do the slides (which take longer to say so)."""
    task = random_task(20162, "maze")
    assert PlannerConfig().initial_trajectories[-1] == "restarts"
    with pytest.raises(PlanningError, match="no plan was found with any of 2"):
        plan(task, config=PlannerConfig(initial_trajectories=("corridor", "tube")))
    found = plan(task, config=PlannerConfig(initial_trajectories=("restarts",)))
    assert verify_plan(found, task).passed


def test_rod_coordinates_are_those_of_the_shapes():
    """The shapes and poses of a plan are those that the rod takes at its coordinates."""
    task = problems.doorway()
    found = plan(task)
    assert found.q is not None
    stations, poses = task.cable.rod.shapes(found.q)
    np.testing.assert_allclose(task.cable.rod.at_keypoints(stations), found.shapes, atol=1e-12)
    np.testing.assert_allclose(poses, found.poses, atol=1e-12)


def test_a_plan_of_the_paper_s_chain_has_its_stages():
    """The progress along the path set belongs to the rows of the plan, rises from 0 to 1 and never falls."""
    found = plan(problems.doorway(), config=PlannerConfig(initial_trajectories=("head",)))
    assert found.stages is not None
    progress = found.stages.progress
    assert progress.shape == found.shapes.shape[:2]
    assert progress[0].max() < 1e-6
    assert progress[-1].min() > 1 - 1e-6
    assert (np.diff(progress, axis=0) > -1e-9).all()


def test_the_pivot_path_is_made_only_where_it_is_followed():
    """A cable that slides along a curve has no use for it."""
    seen: list[str] = []
    plan(
        problems.free(),
        config=PlannerConfig(initial_trajectories=("slide-head",)),
        progress=lambda stage, share: seen.append(stage),
    )
    assert "pivot path" not in seen


def test_same_seed_same_plan():
    """Two calls give the same arrays, bit for bit."""
    first, second = plan(problems.beside_disc(), seed=3), plan(problems.beside_disc(), seed=3)
    for name in ("shapes", "poses", "q"):
        assert np.array_equal(getattr(first, name), getattr(second, name)), name


def test_stages_report_their_progress_in_order():
    """Each stage begins at 0 and ends at 1."""
    seen: list[tuple[str, float]] = []
    plan(problems.free(), progress=lambda stage, share: seen.append((stage, share)))
    stages = list(dict.fromkeys(stage for stage, _ in seen))
    assert stages == ["pivot path", "initial trajectory", "projection", "verification"]
    for stage in stages:
        shares = [share for name, share in seen if name == stage]
        assert shares[0] == 0.0
        assert shares[-1] == 1.0


def test_no_plan_says_why():
    """Behind a sealed wall there is no plan; the error says who cannot pass, and so does the attempt that is drawn."""
    with pytest.raises(PlanningError, match="there is no plan: the left gripper needs a route 16 mm wide") as raised:
        plan(problems.sealed())
    assert str(raised.value) == f"there is no plan: {raised.value.attempt.reason}"


def test_when_time_runs_out_the_closest_attempt_is_handed_on():
    """None has the clearance wanted, which is not asked of them; the limit ends the search after the first."""
    from cableway.verification import VerificationLimits

    seen: list[str] = []
    config = PlannerConfig(
        limits=VerificationLimits(clearance=0.035), initial_trajectories=("slide-head", "slide-tail")
    )
    with pytest.raises(PlanningError, match=r"the time limit ran out .*the cable and obstacles") as caught:
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
    """A clearance not asked of the shapes: the error names the failed check and carries the attempt for a picture."""
    from cableway.verification import VerificationLimits

    config = PlannerConfig(limits=VerificationLimits(clearance=0.035), initial_trajectories=("slide-head",))
    with pytest.raises(PlanningError, match=r"the cable and obstacles\[0\] .* \(limit 35 mm\)") as caught:
        plan(problems.doorway(), config=config)
    attempt = caught.value.attempt
    assert not attempt.verdict.passed
    assert attempt.shapes.shape[1:] == (13, 2)


@pytest.mark.parametrize("planner", ["default", "tang2025-refined"])
def test_plan_file_round_trip(tmp_path, planner):
    """A plan comes back from its file as it was."""
    found = plan(problems.free(), config=PlannerConfig.named(planner))
    found.save(tmp_path / "plan.npz")
    loaded = Plan.load(tmp_path / "plan.npz")
    for name in ("shapes", "poses", "q"):
        assert np.array_equal(getattr(loaded, name), getattr(found, name)), name
    assert (loaded.stages is None) == (planner == "default")
    if loaded.stages is not None and found.stages is not None:
        for name in ("pivot", "passages", "path_set", "progress"):
            assert np.array_equal(getattr(loaded.stages, name), getattr(found.stages, name)), name
    assert loaded.metadata == found.metadata
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.npz"]


def test_unknown_initial_trajectories_are_refused():
    """The message lists those there are."""
    with pytest.raises(UnknownNameError, match="slide-head"):
        PlannerConfig(initial_trajectories=("sideways",))  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="at least one of"):
        PlannerConfig(initial_trajectories=())


def test_a_plan_keeps_the_grippers_apart_and_the_bends_wide():
    """Limits that only some tasks have; the plan made without them breaks both."""
    free = problems.doorway()
    cable, grippers = replace(free.cable, min_bend_radius=0.09), replace(free.grippers, separation=0.26)
    task = replace(free, cable=cable, grippers=grippers)
    broken = {check.name for check in verify_plan(plan(free), task).failures()}
    assert broken >= {"gripper separation", "bend radius"}
    assert verify_plan(plan(task), task).passed


def test_old_names_of_the_settings_go_on_working():
    with pytest.warns(DeprecationWarning, match="'guides' is now 'initial_trajectories'"):
        config = PlannerConfig(guides=("slide-head",))  # pyright: ignore[reportCallIssue]
    assert config == PlannerConfig(initial_trajectories=("slide-head",))


def test_a_plan_that_pulls_the_cable_straight_is_taken_only_where_there_is_no_other(monkeypatch) -> None:
    """Of this maze "slide-tail" with all room bends the nearly straight cable to the other side at once."""
    task = random_task(20233, "maze", width=0.07)
    config = PlannerConfig(initial_trajectories=("slide-tail",))
    other = plan(task, config=config)
    assert not is_pulled_straight(other.poses, task.cable.length, STRAIGHT)
    monkeypatch.setattr(Search, "follow_closely", lambda self, accept: None)
    only = plan(task, config=config)
    assert only.verdict is not None
    assert only.verdict.passed
    assert is_pulled_straight(only.poses, task.cable.length, STRAIGHT)
