"""Methods that fail in every way, given to the benchmark by file."""

from __future__ import annotations

import os
import time

from cableway.benchmark.methods import Method, default_planner
from cableway.control.open_loop import OpenLoop
from cableway.errors import PlanningError


def hanging(task, seed):
    time.sleep(600)


def dying(task, seed):
    os._exit(3)


def raising(task, seed):
    raise ValueError("broken inside")


def telling(task, seed):
    raise PlanningError("there is no plan: the gap is too narrow")


SOUND = Method(name="sound", description="works", controller=OpenLoop, recovers=False)
HANGS = Method(name="hangs", description="never returns", controller=OpenLoop, planner=hanging)
DIES = Method(name="dies", description="ends its process", controller=OpenLoop, planner=dying)
RAISES = Method(name="raises", description="raises", controller=OpenLoop, planner=raising)
TELLS = Method(name="tells", description="always says that there is no plan", controller=OpenLoop, planner=telling)
NO_METHOD = default_planner
