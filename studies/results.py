"""The results table of the README: every catalogue task with seeds 0, 1, 2, through the command.

    .venv/bin/python studies/results.py [FOLDER]

Reports that are already in FOLDER (runs/results unless given) are not made again.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from statistics import median

SEEDS = (0, 1, 2)


def report(task: str, seed: int, folder: Path) -> dict:
    """The report of one run, made if it is missing."""
    out = folder / f"{task}-{seed}"
    if not (out / "report.json").exists():
        command = Path(sys.executable).with_name("cableway")
        options = ["--seed", str(seed), "--out", str(out), "--quiet", "--no-video"]
        subprocess.run([command, "run", task, *options], check=False)
    return json.loads((out / "report.json").read_text())


def row(task: str, reports: list[dict]) -> str:
    """One line: the worst of the seeds, and the median of the times."""

    def worst(name: str, of=max, scale: float = 1000.0) -> str:
        values = [each.get(name) for each in reports]
        return "none" if None in values else f"{scale * of(values):.2f}"

    times = [each["control_time"] for each in reports if each.get("control_time")]
    control = f"{1000 * median(t['median'] for t in times):.0f} / {1000 * max(t['p99'] for t in times):.0f}"
    planning = f"{median(each['planning_time'] for each in reports):.1f}"
    cells = [
        task, f"{sum(each['success'] for each in reports)}/{len(reports)}", worst("shape_error"),
        worst("mean_keypoint_error"), worst("min_clearance", min), worst("largest_deviation"), planning, control,
    ]  # fmt: skip
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/results")
    from cableway.scene.files.loading import task_names

    print("| task | success | error, stacked [mm] | error, mean [mm] | clearance [mm] | deviation [mm] "
          "| planning [s] | control, median / p99 [ms] |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for task in task_names():
        print(row(task, [report(task, seed, folder) for seed in SEEDS]), flush=True)


if __name__ == "__main__":
    main()
