"""`cableway export` of collected runs: tables and data sets to learn from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cableway.cli.terminal import Terminal, pairs
from cableway.core.errors import InputError

if TYPE_CHECKING:
    from cableway.cli.export import Export

KINDS = ("parquet", "lerobot")
"""Formats that hold many runs."""


def export_data(options: Export, kind: str) -> int:
    """Carry the command out and return its exit status.

    Raises:
        InputError: RUN is no folder of collected runs, there is something in the folder for results, or no run
            succeeded.
        MissingExtraError: pyarrow is not installed.
    """
    from cableway.core.extras import require
    from cableway.core.files import only_writer
    from cableway.datasets.lerobot import write_lerobot
    from cableway.datasets.parquet import write_parquet
    from cableway.datasets.runs import MANIFEST, is_runs, read_runs
    from cableway.workflow.filming import filmed_by

    require("data", f"--format {kind}")
    if not is_runs(options.run):
        raise InputError(f"{options.run}: holds no {MANIFEST}, which `cableway collect --episodes` leaves")
    folder = options.out or Path("runs") / f"{options.run.name}-{kind}"
    if folder.is_file():
        raise InputError(f"--out {folder}: a file with this name exists; give a folder")
    film = None if options.camera is None else filmed_by(options.camera)
    chosen = (run for run in read_runs(options.run) if run.success or options.failures)
    if kind == "lerobot":
        episodes, frames = write_lerobot(folder, chosen, film, options.camera or "")
    else:
        with only_writer(folder):
            episodes, frames = write_parquet(folder, chosen)
    report = {"folder": str(folder), "runs": episodes, "steps": frames}
    Terminal(options).result(report, pairs([(name, str(value)) for name, value in report.items()]))
    return 0
