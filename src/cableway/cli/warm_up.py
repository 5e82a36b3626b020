"""`cableway warm-up`: compile ahead of the first run."""

from __future__ import annotations

import time
from dataclasses import dataclass

import tyro

from cableway.cli.options import Options
from cableway.cli.terminal import Terminal, pairs


@dataclass(frozen=True, kw_only=True)
class WarmUp(Options):
    """Compile everything that plan, run and bench need by default, so that none of them waits for it."""

    seed: tyro.conf.Suppress[None] = None
    """Nothing is drawn."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.core.compiled import compiled_among
        from cableway.core.kernel_cache import cache_folder
        from cableway.workflow.compilation import PLANNING, TRACKING, compile_all, kernels_of

        terminal, begun, kernels = Terminal(self), time.monotonic(), kernels_of(PLANNING, TRACKING)
        total, before = len(kernels), compiled_among(kernels)
        with terminal.progress() as progress:
            compile_all(progress, checking=True)
        seconds = time.monotonic() - begun
        report = {"kernels": total, "compiled": total - before, "seconds": seconds, "folder": str(cache_folder())}
        self.keep("warm-up", report)
        rows = [
            ("kernels", f"{total}, {total - before} of them compiled now"),
            ("took", f"{seconds:.1f} s"),
            ("folder", str(cache_folder())),
        ]
        terminal.result(report, pairs(rows))
        return 0
