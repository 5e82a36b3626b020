"""How evenly a run in real time sends its commands: `python studies/real_time.py [--repeats 3]`.

`track_in_real_time` leads the simulated cable of single-obstacle-2 along its plan, at several rates of the robot, with
the machine as it is and with a computing process on every core beside it. The simulator runs in a thread of the same
process, which makes it harder than a robot would. Then a controller hangs for two seconds: asleep, in a loop of Python,
and in compiled code that keeps the interpreter's lock. Periods in milliseconds: median, 95th percentile, worst.
"""

from __future__ import annotations

import argparse
import multiprocessing
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

import cableway as cw
from cableway.core.executors import cores
from cableway.geometry.groups import SE2
from cableway.records import Observation

TASK = "single-obstacle-2"
RATES = (10.0, 50.0, 125.0)
HANG = 2.0
"""[s]."""

HANGS_AT = 30
"""Control step."""


class SimulatedRobot:
    """The simulated cable, led every 0.1 s, in a thread, to what was sent last; each command is noted."""

    def __init__(self, task: cw.Task) -> None:
        self.task, self._over = task, threading.Event()
        self._cable = cw.CableSimulator(task)
        self._message = self._cable.reset()
        self._target = self._reached = self._message.poses
        self.sent: list[tuple[float, np.ndarray]] = []
        threading.Thread(target=self._work).start()

    def send(self, poses: np.ndarray) -> None:
        """See `tracking.Robot`."""
        self._target = poses
        self.sent.append((time.monotonic(), poses))

    def observe(self) -> Observation:
        """See `tracking.Robot`."""
        return self._message

    def stop(self) -> None:
        """See `tracking.Robot`."""
        self._over.set()
        self.sent.append((time.monotonic(), self._target))

    def _work(self) -> None:
        due = time.monotonic()
        while not self._over.is_set():
            motion, limits = SE2.minus(self._target, self._reached), self.task.grippers
            far = np.linalg.norm(motion[:, :2], axis=1).max()
            motion *= min(
                1.0, limits.max_step / max(far, 1e-9), limits.max_turn / max(np.abs(motion[:, 2]).max(), 1e-9)
            )
            self._message, self._reached = self._cable.step(motion), SE2.plus(self._reached, motion)
            due += 0.1
            self._over.wait(max(0.0, due - time.monotonic()))


class Hanging(cw.RodMPC):
    """The default controller, which hangs once."""

    def __init__(self, hang: Callable[[], Any]) -> None:
        super().__init__()
        self._hang, self._asked = hang, 0

    def step(self, state: Any, observation: Observation | None) -> Any:
        """See `Controller.step`."""
        self._asked += 1
        if self._asked == HANGS_AT:
            self._hang()
        return super().step(state, observation)


def in_python() -> None:
    """Compute in Python, which gives way to other threads."""
    until = time.monotonic() + HANG
    while time.monotonic() < until:
        pass


def in_compiled_code() -> None:
    """Compute in one call that does not give way."""
    begun = time.monotonic()
    sum(range(10**7))
    sum(range(round(10**7 * HANG / (time.monotonic() - begun))))


@contextmanager
def load(processes: int) -> Iterator[None]:
    """So many computing processes beside this one."""
    others = [multiprocessing.Process(target=spin, daemon=True) for _ in range(processes)]
    for other in others:
        other.start()
    try:
        yield
    finally:
        for other in others:
            other.terminate()
            other.join()


def spin() -> None:
    """Compute until ended."""
    while True:
        pass


def run(plan: cw.Plan, rate: float, controller: cw.RodMPC) -> tuple[cw.Rollout, SimulatedRobot]:
    """One run."""
    robot = SimulatedRobot(cw.load_task(TASK))
    rollout = cw.track_in_real_time(robot, controller, plan, rate=rate, deadline=0.05)
    return rollout, robot


def periods(values: Sequence[float]) -> str:
    """Median / 95th percentile / worst [ms]."""
    return " / ".join(f"{1000 * value:.1f}" for value in np.percentile(values, [50, 95, 100]))


def evenness(plan: cw.Plan, rate: float, repeats: int, busy: int) -> str:
    """A row of the table of rates."""
    commands: list[float] = []
    control: list[float] = []
    late = missed = steps = 0
    with load(busy):
        for _ in range(repeats):
            rollout, robot = run(plan, rate, cw.RodMPC())
            commands += np.diff([when for when, _ in robot.sent]).tolist()
            timing = rollout.metadata["timing"]
            control.append(timing["control_period"]["worst"])
            late += timing["late"]
            missed += rollout.metadata["watchdog"]["late"]
            steps += rollout.steps
    cells = (
        f"{rate:g} Hz", f"{busy} processes" if busy else "nothing", str(len(commands)), periods(commands), str(late),
        f"{1000 * max(control):.1f}", f"{missed} of {steps}",
    )  # fmt: skip
    return "| " + " | ".join(cells) + " |"


def hanging(plan: cw.Plan, name: str, hang: Callable[[], Any]) -> str:
    """A row of the table of hangs."""
    rollout, robot = run(plan, 50.0, Hanging(hang))
    times = np.array([when for when, _ in robot.sent])
    places = np.array([poses for _, poses in robot.sent])[:, :, :2]
    late = np.flatnonzero(np.char.startswith(rollout.status, "late"))
    moving = np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=1) > 1e-5
    gap, rest = 1000 * np.diff(times).max(), "-"
    if len(late):
        begun, ended = times[0] + rollout.times[late[0]], times[0] + rollout.times[late[-1]]
        within = (times[1:] > begun) & (times[1:] < ended)
        rest = f"{times[1:][within & moving].max(initial=begun) - begun:.2f}"
    return f"| {name} | {gap:.0f} | {len(late)} | {rest} | {rollout.outcome} |"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=3)
    repeats = parser.parse_args().repeats
    plan = cw.plan(cw.load_task(TASK))
    run(plan, 50.0, cw.RodMPC())  # compiles
    print("| rate | beside it | n | period [ms] | late | worst control period [ms] | deadlines missed |")
    print("|---|---|---|---|---|---|---|")
    for busy in (0, cores()):
        for rate in RATES:
            print(evenness(plan, rate, repeats, busy), flush=True)
    print("\n| the controller hangs for 2 s | longest gap [ms] | steps missed | last motion after [s] | outcome |")
    print("|---|---|---|---|---|")
    for name, hang in (
        ("asleep", lambda: time.sleep(HANG)),
        ("in Python", in_python),
        ("in compiled code that keeps the lock", in_compiled_code),
    ):
        print(hanging(plan, name, hang), flush=True)


if __name__ == "__main__":
    main()
