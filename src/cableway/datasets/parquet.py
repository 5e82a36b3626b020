"""Runs as two Parquet tables: one row for each control step, one for each run. pyarrow's."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cableway.core.extras import require
from cableway.core.files import write_bytes
from cableway.core.provenance import versions
from cableway.datasets.runs import StoredRun

STEPS, RUNS = "steps.parquet", "runs.parquet"

COLUMNS = {
    "keypoints": "true keypoints, x before y, from left to right [m]",
    "observed": "keypoints as the controller saw them, NaN where it did not [m]",
    "poses": "x, y, theta of the left gripper, then of the right one [m, m, rad]",
    "actions": "motion asked for in the step, as poses [m, m, rad]",
    "reference": "keypoints wanted then [m]",
}
"""Arrays of a rollout that become lists of numbers, and what is in them."""


def write_table(path: Path, columns: Mapping[str, Any], metadata: Mapping[str, str] | None = None) -> None:
    """Write a Parquet file atomically.

    Args:
        path: Where to.
        columns: By name: an array (k,) or (k, m), which becomes lists of m numbers, or a list of values.
        metadata: Texts of the file's own.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    require("data", "writing Parquet")
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table({name: _column(values) for name, values in columns.items()})
    file = io.BytesIO()
    pyarrow.parquet.write_table(table.replace_schema_metadata(dict(metadata or {})), file, compression="snappy")
    write_bytes(path, file.getvalue())


def _column(values: Any) -> Any:
    import pyarrow

    if not isinstance(values, np.ndarray):
        return pyarrow.array(values)
    if values.ndim == 1:
        return pyarrow.array(values)
    return pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(np.ascontiguousarray(values).ravel()), values.shape[1])


def write_parquet(folder: Path, runs: Iterable[StoredRun]) -> tuple[int, int]:
    """Write all steps of runs, and the runs.

    Args:
        folder: Where `STEPS` and `RUNS` go.
        runs: All of the same number of keypoints.

    Returns:
        Number of runs and of steps.

    Raises:
        MissingExtraError: pyarrow is not installed.
        InputError: There is no run with a rollout.
    """
    steps: dict[str, list[np.ndarray]] = {}
    about: list[dict[str, Any]] = []
    for run in with_rollouts(runs):
        about.append(_about(run))
        for name, rows in _steps(run).items():
            steps.setdefault(name, []).append(rows)
    told = {"cableway": json.dumps({"version": versions()["cableway"], "columns": COLUMNS})}
    table = {name: np.concatenate(rows) for name, rows in steps.items()}
    write_table(folder / STEPS, table, told)
    write_table(folder / RUNS, {name: [row[name] for row in about] for name in about[0]}, told)
    return len(about), len(table["step"])


def with_rollouts(runs: Iterable[StoredRun]) -> Iterable[StoredRun]:
    """Those that came to moving the cable, in one number of keypoints.

    Raises:
        InputError: There is none, or they differ.
    """
    from cableway.core.errors import InputError

    count = 0
    keypoints = None
    for run in runs:
        if run.rollout is None or not run.rollout.steps:
            continue
        n = run.rollout.keypoints.shape[1]
        if keypoints not in (None, n):
            raise InputError(f"runs of one table have one number of keypoints, and these have {keypoints} and {n}")
        count, keypoints = count + 1, n
        yield run
    if not count:
        raise InputError("there is no run in which the cable was moved")


def _about(run: StoredRun) -> dict[str, Any]:
    assert run.rollout is not None
    report = run.report
    return {
        "run": run.number,
        "task": run.task.name,
        "plant": str(report.get("plant", "")),
        "seed": int(report.get("seed", 0)),
        "success": run.success,
        "outcome": str(report.get("outcome", "")),
        "steps": run.rollout.steps,
        "shape_error": float(report.get("shape_error", np.nan)),
        "least_clearance": run.rollout.least_clearance,
        "goal": run.task.goal.ravel().tolist(),
    }


def _steps(run: StoredRun) -> dict[str, np.ndarray]:
    """A row for each control step: the state before it, and what was done."""
    rollout = run.rollout
    assert rollout is not None
    count = rollout.steps
    arrays = {name: getattr(rollout, name)[:count].reshape(count, -1) for name in COLUMNS}
    return {
        "run": np.full(count, run.number),
        "step": np.arange(count),
        "time": rollout.times[:-1],
        **arrays,
        "clearance": np.minimum(rollout.clearance, rollout.gripper_clearance)[1:],
        "solve_time": rollout.solve_time,
    }
