"""Methods that fail in every way, given to the benchmark by file."""

from __future__ import annotations

import os
import sys
import time

from cableway.benchmark.methods import Method
from cableway.control.open_loop import OpenLoop
from cableway.core.errors import PlanningError


def hanging(task, seed):
    while True:
        pass


def dying(task, seed):
    os._exit(3)


def quitting(task, seed):
    sys.exit(0)


def raising(task, seed):
    raise ValueError("broken inside")


def telling(task, seed):
    raise PlanningError("there is no plan: the gap is too narrow", outcome="infeasible")


class Claims(OpenLoop):
    def init(self, task, plan):
        object.__setattr__(task, "goal", task.start)
        return super().init(task, plan)


class Breaks(OpenLoop):
    def step(self, state, observation):
        raise ValueError("broken inside")


class Stays(OpenLoop):
    def step(self, state, observation):
        action, state = super().step(state, observation)
        return 0.0 * action, state


class Dawdles(OpenLoop):
    asked = 0

    def step(self, state, observation):
        self.asked += 1
        time.sleep(0.0 if self.asked % 5 else 0.15)
        return super().step(state, observation)


SOUND = Method(name="sound", description="works", controller=OpenLoop, recovers=False)
HANGS = Method(name="hangs", description="never returns", controller=OpenLoop, planner=hanging)
DIES = Method(name="dies", description="ends its process", controller=OpenLoop, planner=dying)
QUITS = Method(name="quits", description="calls sys.exit", controller=OpenLoop, planner=quitting)
CLAIMS = Method(name="claims", description="takes the start for the goal", controller=Claims, recovers=False)
RAISES = Method(name="raises", description="raises", controller=OpenLoop, planner=raising)
TELLS = Method(name="tells", description="always says that there is no plan", controller=OpenLoop, planner=telling)
NO_METHOD = hanging
BREAKS = Method(name="breaks", description="raises in every step", controller=Breaks, recovers=False)
STAYS = Method(name="stays", description="never moves", controller=Stays, recovers=False)
DAWDLES = Method(name="dawdles", description="takes its time now and then", controller=Dawdles, recovers=False)
THROUGH = Method(
    name="through",
    description="straight to the goal, whatever stands there",
    controller=OpenLoop,
    planner="straight",
    follows_unverified=True,
    recovers=False,
)
