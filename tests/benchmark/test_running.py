"""Episodes: kept at once, run once, the same again; a method that dies costs itself its own episodes alone."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from holding import unheld_writes
from matplotlib.colors import to_rgb

from cableway.benchmark.episode import Job, Result, jobs_of, run_job, warm_up
from cableway.benchmark.gate import baseline, regressions
from cableway.benchmark.methods import BUILT_IN, load_method, method_names
from cableway.benchmark.runner import picture_path, read_result, result_path, run_jobs
from cableway.benchmark.suites import Episode, frozen_episodes, get_suite
from cableway.benchmark.summary import commits_text, group_of, missed_steps
from cableway.cli import main
from cableway.cli.bench import Bench
from cableway.core.errors import FileFormatError, InputError, UnknownNameError
from cableway.core.provenance import commit
from cableway.figures import palette
from cableway.metrics import METRICS

FILE = Path(__file__).with_name("methods_for_tests.py")
EPISODE = frozen_episodes("unconstrained")[0]
TIMES = {"reference_time", "planning_time", "control_median", "control_p99", "control_max"}


def job(name: str, episode: Episode = EPISODE) -> Job:
    return jobs_of(f"{FILE}:{name.upper()}", [episode])[0]


def without_times(result: Result) -> dict:
    return {name: value for name, value in asdict(result).items() if name not in TIMES}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a sound method and of those that fail in every way, side by side."""
    folder = tmp_path_factory.mktemp("bench")
    warm_up()  # compiles once, for both workers
    names = ("hangs", "sound", "dies", "quits", "claims", "raises", "tells")
    run_jobs([job(name) for name in names], folder, workers=2, time_limit=12.0)
    return folder


@pytest.mark.parametrize(
    ("name", "outcome", "detail"),
    [
        ("hangs", "timed out", "not finished within 12 s"),
        ("dies", "crashed", "ProcessExpired"),
        ("quits", "crashed", "the process was to be ended by SystemExit: 0 (methods_for_tests.py, line"),
        ("claims", "crashed", "the method claims overwrote the task"),
        ("raises", "crashed", "ValueError: broken inside"),
        ("tells", "infeasible", "the gap is too narrow"),
    ],
)
def test_a_failure_is_named_counted_and_drawn(folder: Path, name: str, outcome: str, detail: str):
    result = read_result(job(name), folder)
    assert result is not None
    assert (result.outcome, result.success, result.strict) == (outcome, False, False)
    assert detail in result.detail
    assert (result.shape_error, result.mean_keypoint_error) == (None, None), "what never moved has no error"
    assert picture_path(job(name), folder).read_bytes().startswith(b"\x89PNG")


def test_what_died_cost_the_others_nothing(folder: Path):
    result = read_result(job("sound"), folder)
    assert result is not None
    assert result.success, result.detail
    assert result.strict
    assert result.verified
    assert not picture_path(job("sound"), folder).exists()


def test_an_episode_run_again_is_the_same(folder: Path):
    known = read_result(job("sound"), folder)
    assert known is not None
    assert without_times(run_job(job("sound")).result) == without_times(known)


def test_a_blocked_task_is_solved_by_saying_so():
    blocked = frozen_episodes("blocked")[0]
    assert run_job(job("tells", blocked)).result.success
    result = run_job(jobs_of("cableway", [blocked])[0]).result
    assert result.outcome == "success", result.detail
    assert METRICS["shape_error"].value(result) is None


def test_contact_is_no_success_however_near_the_goal():
    """The straight way of clutter leads through an obstacle: that is what makes a task one of clutter."""
    result = run_job(job("through", frozen_episodes("clutter")[0])).result
    assert result.contact
    assert (result.clearance or 0.0) <= 0.0
    assert (result.outcome, result.success, result.strict) == ("contact", False, False)


def test_an_episode_with_cameras_says_how_well_the_cable_was_seen():
    """And the same with true keypoints says nothing of that; the noise of the plant's keypoints is in neither."""
    seen = replace(EPISODE, suite="eyes", plant="noise-2", condition="above")
    rows = [run_job(jobs_of(name, [seen])[0]).result for name in ("cableway", "true-keypoints")]
    assert [row.success for row in rows] == [True, True]
    assert rows[0].tracking_error is not None
    assert rows[0].tracking_p99 is not None
    assert 0 < rows[0].tracking_error < rows[0].tracking_p99 < 0.01
    assert (rows[0].lost, rows[0].unknown) == (False, 0.0)
    assert 0 <= (rows[0].hidden or 0) < 0.5
    assert (rows[1].tracking_error, rows[1].lost, rows[1].condition) == (None, None, "above")
    assert rows[1].shape_error is not None
    assert rows[1].shape_error < 0.002
    assert group_of(rows[0]) == "above"


def test_a_suite_brings_the_methods_beside_which_others_are_seen():
    bench, suite = Bench(suites="eyes", methods="open-loop"), get_suite("eyes")
    jobs = bench._jobs([suite], {name: load_method(name) for name in ("true-keypoints", "open-loop")})
    assert [job.method for job in jobs[:3]] == ["true-keypoints", "open-loop", "true-keypoints"]


def test_a_cable_that_stays_where_it_is_has_missed_its_goal():
    result = run_job(job("stays")).result
    task = EPISODE.load()
    assert (result.outcome, result.success, result.contact) == ("missed goal", False, False)
    assert result.shape_error == pytest.approx(np.linalg.norm(task.start - task.goal), rel=1e-3)
    assert result.gripper_travel == pytest.approx(0.0, abs=1e-6)
    assert "final error" in result.detail


def test_a_controller_that_breaks_is_said_to_have_failed():
    result = run_job(job("breaks")).result
    assert (result.outcome, result.success) == ("controller failed", False)


def test_steps_that_miss_a_deadline_are_counted():
    """Of a controller that takes 150 ms in every fifth step, with a deadline of 100 ms; without one, nothing is."""
    (late,) = jobs_of(f"{FILE}:DAWDLES", [EPISODE], deadline=0.1)
    result = run_job(late).result
    assert result.missed is not None
    assert result.steps is not None
    assert 0.15 * result.steps < result.missed < 0.5 * result.steps
    assert METRICS["missed"].value(result) is True
    assert missed_steps([result, result]) == {"deadline": {"steps": 2 * result.steps, "missed": 2 * result.missed}}
    assert late.made_by.endswith(", deadline 0.1 s"), "not taken for a result without"
    free = run_job(job("sound")).result
    assert (free.missed, METRICS["missed"].value(free), missed_steps([free])) == (None, None, {})
    with pytest.raises(InputError, match="deadline must be finite and positive"):
        jobs_of(f"{FILE}:SOUND", [EPISODE], deadline=0.0)


def test_a_method_that_was_changed_is_run_again(tmp_path: Path):
    file = tmp_path / "mine.py"
    file.write_text(FILE.read_text())
    before = jobs_of(f"{file}:SOUND", [EPISODE])
    run_jobs(before, tmp_path, workers=1, time_limit=60.0)
    assert read_result(before[0], tmp_path) is not None
    file.write_text(FILE.read_text() + "\n")
    after = jobs_of(f"{file}:SOUND", [EPISODE])
    assert read_result(after[0], tmp_path) is None
    assert read_result(before[0], tmp_path) is not None


def test_results_of_another_task_or_version_are_not_taken_for_ours(folder: Path, tmp_path: Path):
    path = result_path(job("sound"), folder)
    content = json.loads(path.read_text())
    copy = result_path(job("sound"), tmp_path)
    copy.parent.mkdir(parents=True)
    copy.write_text(json.dumps(content | {"digest": "0"}))
    with pytest.raises(FileFormatError, match="digest"):
        read_result(job("sound"), tmp_path)
    copy.write_text("{")
    with pytest.raises(FileFormatError, match="sound"):
        read_result(job("sound"), tmp_path)
    assert read_result(job("hangs"), tmp_path) is None


def test_methods_by_name_by_file_and_by_mistake():
    assert set(BUILT_IN) <= set(method_names())
    assert load_method("cableway").name == "cableway"
    with pytest.raises(UnknownNameError, match="rod-jacobian"):
        load_method("jacobian")
    with pytest.raises(InputError, match="no such file"):
        load_method("missing.py:METHOD")
    with pytest.raises(InputError, match="has no 'NOTHING'"):
        load_method(f"{FILE}:NOTHING")
    with pytest.raises(InputError, match="must be a"):
        load_method(f"{FILE}:NO_METHOD")


def test_a_method_file_may_define_data_classes(tmp_path: Path):
    file = tmp_path / "tuned.py"
    file.write_text(
        "from __future__ import annotations\n\nfrom dataclasses import dataclass\n\n"
        "from cableway.benchmark.methods import Method\n\n\n"
        "@dataclass(frozen=True)\nclass Setting:\n    gain: float\n\n\n"
        'METHOD = Method(name=f"tuned-{Setting(0.5).gain}", description="")\n'
    )
    assert load_method(f"{file}:METHOD").name == "tuned-0.5"
    file.write_text("1 / 0")
    loaded = set(sys.modules)
    with pytest.raises(InputError, match="failed to run: ZeroDivisionError"):
        load_method(f"{file}:METHOD")
    assert f"plugin {file}" in loaded - set(sys.modules)


def test_ray_gives_what_this_machine_gives(folder: Path, tmp_path: Path):
    pytest.importorskip("ray")
    run_jobs([job("sound"), job("raises")], tmp_path, executor="ray", workers=2)
    for name in ("sound", "raises"):
        here, there = read_result(job(name), folder), read_result(job(name), tmp_path)
        assert here is not None
        assert there is not None
        assert without_times(there) == without_times(here)


def test_the_command_runs_resumes_and_leaves_everything(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("cableway.benchmark.gate.LEAST_ERROR", 1e-6)  # the run's own is just above it
    command = ["bench", "unconstrained", "--methods", f"{FILE}:SOUND,{FILE}:RAISES", "--episodes", EPISODE.name,
               "--out", str(folder), "--workers", "1", "--json", "--vector", "svg"]  # fmt: skip
    before = result_path(job("sound"), folder).stat().st_mtime_ns
    with unheld_writes(folder) as found:
        assert main(command) == 0
    assert found == [], "the folder is held until the last file"
    assert result_path(job("sound"), folder).stat().st_mtime_ns == before
    shown = json.loads(capsys.readouterr().out)
    figures = shown["suites"]["unconstrained"]["methods"]
    assert shown["commits"] == {commit() or "": 2}
    assert figures["sound"]["metrics"]["success"]["value"] == 1.0
    assert figures["raises"]["outcomes"] == {"crashed": 1}
    assert figures["raises"]["differences"]["success"]["value"] == -1.0
    page = (folder / "report.html").read_text()
    assert "http" not in page.replace("https://", "http")
    assert f"--episodes {EPISODE.name}" in page
    assert commits_text(shown["commits"]) in page
    drawn = matplotlib.image.imread(folder / "failures/unconstrained/raises" / f"{EPISODE.name}.png")[..., :3]
    assert (np.abs(drawn - to_rgb(palette.BAD)).max(axis=2) < 0.02).any(), (
        "what went wrong stands above the task, in red"
    )
    assert f"failures/unconstrained/raises/{EPISODE.name}.png" in page
    rows = (folder / "results.csv").read_text().splitlines()
    assert len(rows) == 3
    for name in (
        "tables.md",
        "success.png",
        "success.svg",
        "errors.png",
        "errors.svg",
        "summary.json",
        "baseline.json",
    ):
        assert (folder / name).stat().st_size > 100
    assert main([*command, "--against", str(folder / "baseline.json")]) == 0
    better = json.loads((folder / "baseline.json").read_text())
    for name, row in better["episodes"].items():
        if "sound" in name:
            row["shape_error"] /= 100
    (folder / "better.json").write_text(json.dumps(better))
    assert main([*command, "--against", str(folder / "better.json")]) == 1
    assert "errors are" in capsys.readouterr().err
    next(iter(better["episodes"].values())).pop("digest")
    (folder / "better.json").write_text(json.dumps(better))
    assert main([*command, "--against", str(folder / "better.json")]) == 2


def test_worse_than_the_baseline_is_reported(folder: Path):
    known = read_result(job("sound"), folder)
    assert known is not None
    results = [Result(**{**asdict(known), "episode": f"e{k}"}) for k in range(5)]
    before = baseline(results)
    assert regressions(results, before) == []
    lost = [Result(**{**asdict(r), "success": k > 1, "strict": k > 1}) for k, r in enumerate(results)]
    assert [sentence.split(":")[0] for sentence in regressions(lost, before)] == ["success", "strict"]
    one = [Result(**{**asdict(r), "strict": k > 0}) for k, r in enumerate(results)]
    assert regressions(one, before) == []
    off = [Result(**{**asdict(r), "shape_error": 2 * (r.shape_error or 0) + 2e-4}) for r in results]
    assert "errors are" in regressions(off, before)[0]
    slow = [Result(**{**asdict(r), "planning_time": 3 * (r.planning_time or 0)}) for r in results]
    assert "planning_time" in regressions(slow, before)[0]
    slower_machine = [Result(**{**asdict(r), "reference_time": 3 * (r.reference_time or 0)}) for r in slow]
    assert regressions(slower_machine, before) == []
    assert "2 of 5 episodes" in regressions(results[2:], before)[0]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "unknown suite 'nowhere'"),
        (["clutter", "--size", "huge"], "unknown size 'huge'"),
        (["clutter", "--episodes", "nothing"], "no 'nothing' in clutter"),
        (["clutter", "--seed", "3"], "Unrecognized"),
        (["clutter", "--against", "missing.json"], "missing.json"),
        (["clutter", "--workers", "0"], "workers must be at least 1"),
        (["clutter", "--time-limit", "0"], "time limit must be positive"),
        (["clutter", "--executor", "moon"], "unknown executor 'moon'"),
    ],
)
def test_mistakes_are_told_in_a_sentence(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["bench", *arguments, "--out", str(tmp_path), "--quiet"]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
