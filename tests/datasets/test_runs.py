"""Laws of collected runs: none is lost or made twice, and tables and data sets hold just what happened."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import moved_aside, moved_plan, perfect_rollout

from cableway.cli import main
from cableway.core.errors import FileFormatError, InputError, UnknownNameError
from cableway.datasets.lerobot import write_lerobot
from cableway.datasets.parquet import write_parquet
from cableway.datasets.runs import StoredRun, count_runs, open_runs, read_runs, run_folder, write_run
from cableway.records import Rollout
from cableway.tasks.generation import FIRST_SEED
from cableway.workflow import collecting
from cableway.workflow.collecting import RunsConfig, collect_runs

parquet = pytest.importorskip("pyarrow.parquet")

TASK, PLAN = moved_plan(rows=9)
ROLLOUT = perfect_rollout(TASK, PLAN)


def unseen(rollout: Rollout) -> Rollout:
    """The same, keypoint 3 unseen from the third row on."""
    observed = rollout.observed.copy()
    observed[2:, 3] = np.nan
    return replace(rollout, observed=observed)


RUNS = (
    (ROLLOUT, {"success": True, "plant": "nominal", "seed": 4, "outcome": "success"}),
    (unseen(moved_aside(ROLLOUT, 0.05)), {"success": False, "plant": "hard", "seed": 5, "outcome": "goal missed"}),
    (None, {"success": False, "plant": "hard", "outcome": "no plan"}),
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    open_runs(tmp_path / "runs", {"kind": "clutter"})
    for number, (rollout, report) in enumerate(RUNS):
        write_run(tmp_path / "runs", number, TASK, rollout, report)
    return tmp_path / "runs"


def columns(path: Path) -> dict[str, np.ndarray]:
    table = parquet.read_table(path)
    return {name: np.array(table[name].to_pylist()) for name in table.column_names}


def test_runs_are_read_as_they_were_written(folder: Path):
    found = list(read_runs(folder))
    assert [(run.number, run.success) for run in found] == [(0, True), (1, False), (2, False)]
    assert found[0].task == TASK
    assert found[2].rollout is None
    assert np.array_equal(found[1].rollout.keypoints, RUNS[1][0].keypoints)
    (run_folder(folder, 0) / "report.json").unlink()
    assert [run.number for run in read_runs(folder)] == [1, 2], "one without a report is not whole"
    with pytest.raises(FileFormatError, match="no such file"):
        list(read_runs(folder / "run-000001"))


def test_all_steps_are_in_the_table(folder: Path, tmp_path: Path):
    assert write_parquet(tmp_path / "pq", read_runs(folder)) == (2, 16)
    steps, runs = columns(tmp_path / "pq/steps.parquet"), columns(tmp_path / "pq/runs.parquet")
    assert steps["run"].tolist() == [0] * 8 + [1] * 8
    assert np.array_equal(steps["actions"][:8].reshape(8, 2, 3), ROLLOUT.actions)
    assert np.array_equal(steps["observed"][8:].reshape(8, -1, 2), RUNS[1][0].observed[:-1], equal_nan=True)
    assert runs["success"].tolist() == [True, False]
    assert np.array_equal(runs["goal"][0].reshape(-1, 2), TASK.goal)


def test_a_data_set_of_lerobot_holds_just_what_happened(folder: Path, tmp_path: Path):
    assert write_lerobot(tmp_path / "lr", read_runs(folder)) == (2, 16)
    data = columns(tmp_path / "lr/data/chunk-000/file-000.parquet")
    episodes = columns(tmp_path / "lr/meta/episodes/chunk-000/file-000.parquet")
    info = json.loads((tmp_path / "lr/meta/info.json").read_text())
    stats = json.loads((tmp_path / "lr/meta/stats.json").read_text())
    assert (info["codebase_version"], info["total_episodes"], info["total_frames"]) == ("v3.0", 2, 16)
    assert set(info["features"]) == set(data) == set(stats)
    for name, feature in info["features"].items():
        assert feature["shape"] == [data[name][0].size]
        assert feature["names"] is None or len(feature["names"]) == data[name].shape[1]
        for kind, of in (("min", np.min), ("max", np.max), ("mean", np.mean), ("std", np.std)):
            wanted = of(data[name].reshape(16, -1).astype(float), axis=0)
            np.testing.assert_allclose(stats[name][kind], wanted, rtol=1e-6, atol=1e-9)
    assert data["index"].tolist() == list(range(16))
    assert (episodes["dataset_from_index"].tolist(), episodes["dataset_to_index"].tolist()) == ([0, 8], [8, 16])
    np.testing.assert_allclose(data["timestamp"], data["frame_index"] / 10, atol=1e-6)
    np.testing.assert_allclose(data["action"][:8], ROLLOUT.actions.reshape(8, 6), atol=1e-7)
    np.testing.assert_allclose(data["observation.state"][:8], ROLLOUT.poses[:-1].reshape(8, 6), atol=1e-6)
    assert np.flatnonzero(data["next.done"]).tolist() == [7, 15]
    assert np.flatnonzero(data["next.success"]).tolist() == [7]


def test_keypoints_that_were_not_seen_are_where_they_were_last(folder: Path, tmp_path: Path):
    write_lerobot(tmp_path / "lr", read_runs(folder))
    seen = columns(tmp_path / "lr/data/chunk-000/file-000.parquet")["observation.environment_state"][8:]
    n = TASK.goal.size
    observed = RUNS[1][0].observed
    np.testing.assert_allclose(seen[:, 6:8], observed[[0, 1, 1, 1, 1, 1, 1, 1], 3], atol=1e-6)
    np.testing.assert_allclose(seen[0, :n], observed[0].ravel(), atol=1e-6)
    np.testing.assert_allclose(seen[:, n:], np.tile(TASK.goal.ravel(), (8, 1)), atol=1e-6)


def test_each_episode_has_its_video(folder: Path, tmp_path: Path):
    def film(run: StoredRun, path: Path) -> np.ndarray:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"film %d" % run.number)
        return np.full((2, 48, 64, 3), (255, 0, 51), np.uint8)

    write_lerobot(tmp_path / "lr", read_runs(folder), film, "above")
    key = "observation.images.above"
    info = json.loads((tmp_path / "lr/meta/info.json").read_text())
    episodes = columns(tmp_path / "lr/meta/episodes/chunk-000/file-000.parquet")
    assert info["features"][key]["shape"] == [48, 64, 3]
    for number in (0, 1):
        place = {name: episodes[f"videos/{key}/{name}"][number] for name in ("chunk_index", "file_index")}
        path = tmp_path / "lr" / info["video_path"].format(video_key=key, **place)
        assert path.read_bytes() == b"film %d" % number
    assert episodes[f"videos/{key}/to_timestamp"].tolist() == [0.8, 0.8]
    mean = json.loads((tmp_path / "lr/meta/stats.json").read_text())[key]["mean"]
    np.testing.assert_allclose(mean, [[[1.0]], [[0.0]], [[0.2]]], atol=1e-9)


def test_what_is_no_data_set_is_told(folder: Path, tmp_path: Path):
    with pytest.raises(InputError, match="there is no run in which the cable was moved"):
        write_parquet(tmp_path / "pq", [])
    with pytest.raises(InputError, match="there is something in this folder"):
        write_lerobot(folder, read_runs(folder))


def runs_of(number: int) -> tuple[Any, ...]:
    rollout, report = RUNS[number % 3]
    return TASK, rollout, report


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of the runs that were made, which take no time."""
    made: list[int] = []

    def run(config: RunsConfig, task: Any, number: int) -> tuple[Any, ...]:
        made.append(number)
        return runs_of(number)

    monkeypatch.setattr(collecting, "_run", run)
    return made


def test_an_interrupted_collection_is_continued(tmp_path: Path, asked: list[int]):
    config = RunsConfig(episodes=5, plants=("nominal", "hard"))

    def stop(stage: str, share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        collect_runs(config, tmp_path / "runs", progress=stop)
    assert count_runs(tmp_path / "runs") == (3, 1)
    (run_folder(tmp_path / "runs", 1) / "report.json").unlink()
    asked.clear()
    assert collect_runs(config, tmp_path / "runs") == 3
    assert asked == [1, 3, 4]
    collect_runs(config, tmp_path / "whole")
    assert set(files(tmp_path / "runs")) == set(files(tmp_path / "whole"))
    assert collect_runs(config, tmp_path / "runs") == 0
    assert collect_runs(replace(config, episodes=6), tmp_path / "runs") == 1, "more of the same"
    with pytest.raises(InputError, match=r"holds runs with seed 0, not 1"):
        collect_runs(replace(config, seed=1), tmp_path / "runs")
    with pytest.raises(InputError, match="there is something else in this folder"):
        collect_runs(config, tmp_path)


def test_a_run_follows_from_its_number_alone():
    few = RunsConfig(episodes=1, kind="open-near", plants=("nominal", "hard"))
    task, plant, seed = few.drawn(3, None)
    assert (task, plant, seed) == replace(few, episodes=50).drawn(3, None)
    assert plant == "hard"
    assert seed >= FIRST_SEED
    assert few.drawn(4, TASK)[0] is TASK
    assert few.drawn(4, TASK)[2] != few.drawn(5, TASK)[2]


@pytest.mark.parametrize(
    ("options", "said"),
    [({"kind": "x"}, "kind"), ({"plants": ("x",)}, "plant"), ({"controller": "x"}, "controller")],
)
def test_names_that_are_not_known(options: dict[str, Any], said: str):
    with pytest.raises(UnknownNameError, match=said):
        RunsConfig(episodes=1, **options)


def test_the_commands(
    tmp_path: Path, asked: list[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Collect, and export what succeeded; `docs/guides/data.md`, which CI runs, makes true runs."""
    monkeypatch.chdir(tmp_path)
    options = ["--kind", "open-near", "--workers", "1", "--out", "runs", "--json"]
    assert main(["collect", "--episodes", "3", *options]) == 0
    assert json.loads(capsys.readouterr().out)["succeeded"] == 1
    assert main(["export", "runs", "--format", "lerobot", "--out", "lr", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["runs"] == 1
    assert len(columns(Path("lr/data/chunk-000/file-000.parquet"))["index"]) == told["steps"]
    for wrong, said in (
        (["export", "runs", "--format", "parquet", "--camera", "above"], "--camera: only goes with --format lerobot"),
        (["export", "runs", "--format", "parquet", "--rate", "9"], "--rate: does not go with --format parquet"),
        (["export", "lr", "--format", "parquet"], "lr: holds no runs.json"),
        (["export", "runs", "--format", "csv", "--failures"], "--failures: only goes with"),
        (["collect", "--kind", "maze"], "--kind: only goes with --episodes"),
        (["collect", "--episodes", "3", "--transitions", "3"], "goes with neither"),
    ):
        assert main(wrong) == 2
        assert said in capsys.readouterr().err
