"""Methods that somebody might hand in; see `checks.attack.methods`. None is sound."""

from __future__ import annotations

import os
import signal
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np

from cableway.benchmark.methods import Method
from cableway.control.open_loop import OpenLoop
from cableway.core.errors import InputError
from cableway.planning.planner import plan as find_plan
from cableway.records import Plan


def method(name, planner=None, controller=OpenLoop, **rest):
    given = {} if planner is None else {"planner": planner}
    return Method(name=name, description=name, controller=controller, recovers=False, **given, **rest)


def stepping(change):
    """A controller whose answers are changed."""

    class Changed(OpenLoop):
        def step(self, state, observation):
            return change(self, *super().step(state, observation), observation)

    return Changed


def nothing(task, seed):
    return None


def nan_plan(task, seed):
    return Plan(np.full((30, 13, 2), np.nan), np.zeros((30, 2, 3)))


def goal_alone(task, seed):
    """Start and goal, and nothing between."""
    found = find_plan(task, seed=seed)
    return replace(found, shapes=found.shapes[[0, -1]], poses=found.poses[[0, -1]], q=None)


def of_another_cable(task, seed):
    found = find_plan(task, seed=seed)
    return replace(found, shapes=found.shapes[:, ::2], q=None)


def goal_overwritten(task, seed):
    """The goal moved to the start, by whatever means arrays have."""
    goal = task.goal
    try:
        goal.setflags(write=True)
    except ValueError:
        object.__setattr__(task, "goal", task.start)
    else:
        goal[:] = task.start
    return find_plan(task, seed=seed)


def cable_overwritten(task, seed):
    object.__setattr__(task.cable, "keypoints", 3)
    return find_plan(task, seed=seed)


def obstacles_removed(task, seed):
    object.__setattr__(task.scene, "obstacles", ())
    object.__setattr__(task, "start", task.goal)
    return find_plan(task, seed=seed)


def deep(task, seed):
    return deep(task, seed + 1)


def greedy(task, seed):
    return [np.ones((20_000, 20_000)) for _ in range(1000)]


def killed(task, seed):
    os.kill(os.getpid(), signal.SIGKILL)


def fault(task, seed):
    os.kill(os.getpid(), signal.SIGSEGV)


def interrupted(task, seed):
    raise KeyboardInterrupt


def generator(task, seed):
    raise GeneratorExit


def chatty(task, seed):
    print("x" * 1_000_000)
    raise ValueError("\x1b[31mred\nand on" + "y" * 100_000)


def deaf(task, seed):
    """Catches whatever would end it."""
    while True:
        try:
            while True:
                pass
        except BaseException:
            pass


def elsewhere(task, seed):
    """A thread of its own that never ends, and a plan that is none."""
    threading.Thread(target=threading.Event().wait).start()
    return "plan"


def shut(task, seed):
    os.closerange(0, 3)
    sys.stdout = sys.stderr = None
    raise OSError("no answer")


def results_written(task, seed):
    for path in Path.cwd().rglob("results.csv"):
        path.write_text("success\nTrue\n")
    raise InputError("nothing")


class Shapeless(OpenLoop):
    def init(self, task, plan):
        return None


class Unmade(OpenLoop):
    def __init__(self):
        raise OSError("no licence")


class Leaving(OpenLoop):
    def init(self, task, plan):
        os._exit(0)


class Moving(OpenLoop):
    """Moves what it was shown to the goal."""

    def init(self, task, plan):
        self.goal = task.goal
        return super().init(task, plan)

    def step(self, state, observation):
        np.copyto(observation.keypoints, self.goal)
        action, state = super().step(state, observation)
        return 0 * action, replace(state, progress=1.0) if hasattr(state, "progress") else state


NOTHING = method("nothing", nothing)
NAN_PLAN = method("nan-plan", nan_plan)
GOAL_ALONE = method("goal-alone", goal_alone)
ANOTHER_CABLE = method("another-cable", of_another_cable)
GOAL_OVERWRITTEN = method("goal-overwritten", goal_overwritten)
CABLE_OVERWRITTEN = method("cable-overwritten", cable_overwritten)
OBSTACLES_REMOVED = method("obstacles-removed", obstacles_removed)
DEEP = method("deep", deep)
GREEDY = method("greedy", greedy)
KILLED = method("killed", killed)
FAULT = method("fault", fault)
INTERRUPTED = method("interrupted", interrupted)
GENERATOR = method("generator", generator)
CHATTY = method("chatty", chatty)
DEAF = method("deaf", deaf)
ELSEWHERE = method("elsewhere", elsewhere)
SHUT = method("shut", shut)
RESULTS_WRITTEN = method("results-written", results_written)
SHAPELESS = method("shapeless", controller=Shapeless)
UNMADE = method("unmade", controller=Unmade)
LEAVING = method("leaving", controller=Leaving)
MOVING = method("moving", controller=Moving)
NAN_ACTIONS = method("nan-actions", controller=stepping(lambda self, action, state, seen: (np.nan * action, state)))
HUGE_ACTIONS = method("huge-actions", controller=stepping(lambda self, action, state, seen: (1e9 * action, state)))
BACKWARDS = method("backwards", controller=stepping(lambda self, action, state, seen: (-action, state)))
NO_ACTION = method("no-action", controller=stepping(lambda self, action, state, seen: (None, state)))
NO_STATE = method("no-state", controller=stepping(lambda self, action, state, seen: (action, None)))
ONE_GRIPPER = method("one-gripper", controller=stepping(lambda self, action, state, seen: (action[:1], state)))
WORDS = method("words", controller=stepping(lambda self, action, state, seen: ("left a bit", state)))
ALONE = method("alone", controller=stepping(lambda self, action, state, seen: action))
