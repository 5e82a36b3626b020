"""How long `cableway run TASK` spends on imports and compilation: `python studies/startup.py [TASK]`.

Everything a run does is done twice in this process, up to the first control step. The imports, and what the first
time takes longer than the second, are what a new process pays. Run it twice: the first fills the cache folder.
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable
from typing import Any

MODULES = (
    "cableway.cli.commands",
    "cableway.scene.files.loading",
    "cableway.planning.planner",
    "cableway.control.rod_mpc",
    "cableway.simulation.plant",
    "cableway.tracking",
    "cableway.report",
    "cableway.figures.plan",
    "cableway.figures.rollout",
    "cableway.figures.video",
)


def timed(action: Callable[[], Any]) -> float:
    """Seconds that the action takes."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def until_first_step(name: str) -> dict[str, float]:
    """Seconds of each part of a run, up to and with the first control step."""
    from cableway.control.rod_mpc import RodMPC
    from cableway.planning.planner import plan
    from cableway.scene.files.loading import load_task
    from cableway.simulation.plant import CableSimulator

    found: dict[str, Any] = {}
    parts: dict[str, Callable[[], Any]] = {
        "load task": lambda: found.update(task=load_task(name)),
        "plan": lambda: found.update(plan=plan(found["task"])),
        "make plant": lambda: CableSimulator(found["task"]),
    }
    seconds = {part: timed(action) for part, action in parts.items()}
    seconds["compile controller"] = timed(lambda: RodMPC().init(found["task"], found["plan"]))
    return seconds


def main() -> None:
    """Print the table."""
    name = sys.argv[1] if len(sys.argv) > 1 else "single-obstacle-2"
    imports = timed(lambda: [importlib.import_module(module) for module in MODULES])
    first, second = until_first_step(name), until_first_step(name)
    first_only = {part: first[part] - second[part] for part in first}
    first_only["compile controller"] = first["compile controller"]
    print(f"imports              {imports:5.2f} s")
    for part, seconds in first_only.items():
        print(f"{part:20} {seconds:5.2f} s")
    print(f"in all               {imports + sum(first_only.values()):5.2f} s")


if __name__ == "__main__":
    main()
