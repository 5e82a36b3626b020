"""Compiling the planner's kernels before the clock of a search runs."""

from __future__ import annotations

from functools import cache

from cableway.core.compiled import mark_compiled
from cableway.planning.planner import plan
from cableway.scene.files.loading import load_task

EXAMPLE = "single-obstacle-2"


@cache
def compile_kernels() -> None:
    """Have every kernel of the default planner compiled and kept, by planning a task of the catalogue.

    About a minute where nothing is compiled yet, about a second where `is_compiled("planning")`, no time where this
    process has done it before.
    """
    plan(load_task(EXAMPLE))
    mark_compiled("planning")
