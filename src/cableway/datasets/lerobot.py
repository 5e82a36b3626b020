"""Runs as a data set of LeRobot, in the layout of its version 3.0 (https://huggingface.co/docs/lerobot).

`observation.state` is where the grippers are, `observation.environment_state` the keypoints as the controller saw them
and those of the goal, `action` the motion of the grippers in a control step; `next.done` and `next.success` are of the
state after it, so that the last frame of an episode says whether it succeeded.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from cableway.core.errors import InputError
from cableway.core.files import write_json
from cableway.datasets.parquet import with_rollouts, write_table
from cableway.datasets.runs import StoredRun
from cableway.records import Rollout
from cableway.scene.task import CONTROL_STEP

VERSION = "v3.0"

RATE = round(1 / CONTROL_STEP)
"""Frames per second."""

PER_FILE, PER_CHUNK = 1000, 1000
"""Episodes in a file of data, and files in a folder; LeRobot's own files have up to 100 MB, these a tenth."""

DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"

QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)

POSES = [f"{side}_{axis}" for side in ("left", "right") for axis in ("x", "y", "theta")]

EVERY = 8
"""Rows and columns of a picture of which one is in the statistics."""

IMAGES = "observation.images."
"""How the names of pictures begin."""

INDICES = ("frame_index", "episode_index", "index", "task_index")

Film = Callable[[StoredRun, Path], UInt8[np.ndarray, "k h w 3"]]
"""Writes the video of a run, one frame for each control step, to a file; returns some of the frames."""


@dataclass
class _Writer:
    """A data set on the way."""

    folder: Path
    film: Film | None
    camera: str
    episodes: list[dict[str, Any]] = field(default_factory=list)
    stats: list[dict[str, dict[str, np.ndarray]]] = field(default_factory=list)
    tasks: dict[str, int] = field(default_factory=dict)
    waiting: list[dict[str, np.ndarray]] = field(default_factory=list)
    frames: int = 0
    picture: tuple[int, int] | None = None

    def add(self, run: StoredRun) -> None:
        """Take an episode up."""
        assert run.rollout is not None
        number, count = len(self.episodes), run.rollout.steps
        said = run.task.description or f"Lead the cable to its goal: {run.task.name}"
        task = self.tasks.setdefault(said, len(self.tasks))
        columns = {**_features(run), **_numbers(number, count, self.frames, task)}
        stats = {name: _stats(values) for name, values in columns.items()}
        place = dict(zip(("chunk_index", "file_index"), divmod(number // PER_FILE, PER_CHUNK), strict=True))
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [said],
            "length": count,
            **{f"data/{name}": value for name, value in place.items()},
            "dataset_from_index": self.frames,
            "dataset_to_index": self.frames + count,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        if self.film is not None:
            row |= self._filmed(run, number, count, stats)
        for name, values in stats.items():
            row |= {f"stats/{name}/{kind}": _shown(name, kind, value) for kind, value in values.items()}
        self.episodes.append(row)
        self.stats.append(stats)
        self.waiting.append(columns)
        self.frames += count
        if len(self.episodes) % PER_FILE == 0:
            self.flush()

    def _filmed(self, run: StoredRun, number: int, count: int, stats: dict[str, Any]) -> dict[str, Any]:
        """Where the video of an episode is: each in a file of its own. Its colours go to the statistics."""
        assert self.film is not None
        key = f"{IMAGES}{self.camera}"
        chunk, file = divmod(number, PER_CHUNK)
        path = self.folder / VIDEO.format(video_key=key, chunk_index=chunk, file_index=file)
        some = self.film(run, path)
        self.picture = some.shape[2], some.shape[1]
        stats[key] = {**_stats(some[:, ::EVERY, ::EVERY].reshape(-1, 3) / 255), "count": np.array([len(some)])}
        place = {"chunk_index": chunk, "file_index": file, "from_timestamp": 0.0, "to_timestamp": count / RATE}
        return {f"videos/{key}/{name}": value for name, value in place.items()}

    def flush(self) -> None:
        """Write the episodes that wait to one file."""
        if not self.waiting:
            return
        chunk, file = divmod((len(self.episodes) - 1) // PER_FILE, PER_CHUNK)
        table = {name: np.concatenate([each[name] for each in self.waiting]) for name in self.waiting[0]}
        write_table(self.folder / DATA.format(chunk_index=chunk, file_index=file), table)
        self.waiting.clear()

    def finish(self, keypoints: int) -> None:
        """Write the rest; `info.json` last, without which it is no data set."""
        self.flush()
        table = {name: [row[name] for row in self.episodes] for name in self.episodes[0]}
        write_table(self.folder / EPISODES.format(chunk_index=0, file_index=0), table)
        columns = {"task_index": np.arange(len(self.tasks)), INDEX: list(self.tasks)}
        write_table(self.folder / "meta/tasks.parquet", columns, {"pandas": json.dumps(PANDAS)})
        write_json(self.folder / "meta/stats.json", _together(self.stats))
        write_json(self.folder / "meta/info.json", self._info(keypoints))

    def _info(self, keypoints: int) -> dict[str, Any]:
        points = [f"{axis}{k}" for k in range(keypoints) for axis in "xy"]
        features: dict[str, Any] = {
            "observation.state": _feature("float32", POSES),
            "observation.environment_state": _feature("float32", [*points, *(f"goal_{name}" for name in points)]),
            "action": _feature("float32", [f"delta_{name}" for name in POSES]),
            "next.done": _feature("bool"),
            "next.success": _feature("bool"),
            "timestamp": _feature("float32"),
            **{name: _feature("int64") for name in INDICES},
        }
        if self.picture is not None:
            width, height = self.picture
            features[f"{IMAGES}{self.camera}"] = {
                "dtype": "video",
                "shape": [height, width, 3],
                "names": ["height", "width", "channels"],
                "info": {
                    "video.height": height, "video.width": width, "video.codec": "h264", "video.pix_fmt": "yuv420p",
                    "video.is_depth_map": False, "video.fps": RATE, "video.channels": 3, "has_audio": False,
                },
            }  # fmt: skip
        return {
            "codebase_version": VERSION,
            "robot_type": "cableway",
            "total_episodes": len(self.episodes),
            "total_frames": self.frames,
            "total_tasks": len(self.tasks),
            "chunks_size": PER_CHUNK,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": RATE,
            "splits": {"train": f"0:{len(self.episodes)}"},
            "data_path": DATA,
            "video_path": None if self.picture is None else VIDEO,
            "features": features,
        }


INDEX = "__index_level_0__"
"""Column of an index in a table that pandas wrote."""

PANDAS = {
    "index_columns": [INDEX],
    "column_indexes": [
        {"name": None, "field_name": None, "pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    ],
    "columns": [
        {"name": name, "field_name": field, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
        for name, field, kind, numpy in (
            ("task_index", "task_index", "int64", "int64"),
            (None, INDEX, "unicode", "object"),
        )
    ],
    "pandas_version": "2.0.0",
}  # fmt: skip
"""Says which column of the tasks is the index, as pandas writes it."""


def write_lerobot(
    folder: Path, runs: Iterable[StoredRun], film: Film | None = None, camera: str = "above"
) -> tuple[int, int]:
    """Write runs as a data set of LeRobot.

    Args:
        folder: Where it goes; it must be empty or missing.
        runs: All with one number of keypoints; those without a rollout are left out.
        film: Writes a video of each, if there is to be one.
        camera: What it is called.

    Returns:
        Number of episodes and of frames.

    Raises:
        InputError: There is something in the folder, or no run in which the cable was moved.
        MissingExtraError: pyarrow is not installed.
    """
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder}: there is something in this folder; give a new one")
    writer, keypoints = _Writer(folder, film, camera), 0
    for run in with_rollouts(runs):
        writer.add(run)
        keypoints = len(run.task.goal)
    writer.finish(keypoints)
    return len(writer.episodes), writer.frames


def _features(run: StoredRun) -> dict[str, np.ndarray]:
    """What was seen and done in each control step."""
    rollout = run.rollout
    assert rollout is not None
    count = rollout.steps
    goal = np.broadcast_to(run.task.goal.ravel(), (count, run.task.goal.size))
    last = np.arange(count) == count - 1
    columns = {
        "observation.state": rollout.poses[:-1].reshape(count, -1),
        "observation.environment_state": np.hstack([_last_seen(rollout).reshape(count, -1), goal]),
        "action": rollout.actions.reshape(count, -1),
        "timestamp": np.arange(count) / RATE,
    }
    flags = {"next.done": last, "next.success": last & run.success}
    return {**{name: values.astype(np.float32) for name, values in columns.items()}, **flags}


def _last_seen(rollout: Rollout) -> Float[np.ndarray, "k n 2"]:
    """Keypoints as seen before each step; those not seen then where they were last, at first where they were."""
    seen = rollout.observed[:-1].copy()
    for k in range(len(seen)):
        before = rollout.keypoints[0] if k == 0 else seen[k - 1]
        seen[k] = np.where(np.isfinite(seen[k]), seen[k], before)
    return seen


def _numbers(episode: int, count: int, first: int, task: int) -> dict[str, np.ndarray]:
    frames = np.arange(count)
    return dict(zip(INDICES, (frames, np.full(count, episode), first + frames, np.full(count, task)), strict=True))


def _feature(dtype: str, names: list[str] | None = None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": [1 if names is None else len(names)], "names": names}


def _stats(values: np.ndarray) -> dict[str, np.ndarray]:
    """Of each number of a feature, over the frames of an episode."""
    rows = values.reshape(len(values), -1).astype(np.float64)
    quantiles = dict(
        zip((f"q{round(100 * q):02d}" for q in QUANTILES), np.quantile(rows, QUANTILES, axis=0), strict=True)
    )
    extremes = {"min": rows.min(axis=0), "max": rows.max(axis=0)}
    return {**extremes, "mean": rows.mean(axis=0), "std": rows.std(axis=0), "count": np.array([len(rows)]), **quantiles}


def _together(stats: list[dict[str, dict[str, np.ndarray]]]) -> Mapping[str, Any]:
    """Of all episodes; quantiles are means of theirs, by their lengths, as LeRobot has them."""
    whole: dict[str, Any] = {}
    for name in stats[0]:
        parts = [each[name] for each in stats]
        counts = np.array([part["count"][0] for part in parts], float)
        share = (counts / counts.sum())[:, None]
        mean = (share * [part["mean"] for part in parts]).sum(axis=0)
        spread = [part["std"] ** 2 + (part["mean"] - mean) ** 2 for part in parts]
        found = {
            "min": np.min([part["min"] for part in parts], axis=0),
            "max": np.max([part["max"] for part in parts], axis=0),
            "mean": mean,
            "std": np.sqrt((share * spread).sum(axis=0)),
            "count": np.array([int(counts.sum())]),
        }
        found |= {q: (share * [part[q] for part in parts]).sum(axis=0) for q in parts[0] if q.startswith("q")}
        whole[name] = {kind: _shown(name, kind, value) for kind, value in found.items()}
    return whole


def _shown(name: str, kind: str, value: np.ndarray) -> Any:
    """Statistics as they are written; those of pictures have a channel, a row and a column."""
    return (value.reshape(-1, 1, 1) if name.startswith(IMAGES) and kind != "count" else value).tolist()
