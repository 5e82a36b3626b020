"""`cableway studio`: tasks in a browser, dragged, planned and watched."""

from __future__ import annotations

import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from cableway.cli.options import Flag, Options, option
from cableway.cli.planning import CELL_NAMES
from cableway.cli.terminal import Terminal


@dataclass(frozen=True, kw_only=True)
class Studio(Options):
    """A page in the browser: drag obstacles and grippers, see the plan at once, play it. `--out` is the folder to save
    tasks in, each in one of its own; by default, runs/studio. Ends with ctrl-c."""

    task: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="[TASK]")] = "single-obstacle-2"
    """Name in the catalogue, or a YAML file, also of a task that no cable can do; or a plan.npz or rollout.npz with
    its task.yaml beside it, as commands leave them."""

    cell: Annotated[str | None, option(metavar=CELL_NAMES)] = None
    """Arms that hold the grippers, as `cableway plan --cell` has them; by default, what the task says."""

    host: str = "127.0.0.1"
    """Address to listen on; another than this machine's own lets everybody in who can reach it."""

    port: int = 8765
    """Port to listen on; 0 for any that is free."""

    no_browser: Flag = False
    """Do not open a browser."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.studio.opening import opened
        from cableway.studio.studio import Studio as Pages

        def announce(address: str) -> None:
            Terminal(self).note(f"{address} (ctrl-c to end)")
            if not self.no_browser:
                webbrowser.open(address)

        out = self.out or Path("runs/studio")
        task = self.task if self.cell is None else opened(self.task, self.cell)
        pages = Pages(task, self.host, self.port, out, self.seed or 0, announce=announce)
        try:
            pages.wait()
        finally:
            pages.stop()
        return 0
