"""Robots that are wired wrongly: how every run ends, and how near anything comes to an obstacle.

    .venv/bin/python studies/wrong_robots.py [--tasks single-obstacle-2,maze-1]

Every mistake is tried with every controller on the simulator, from the task's own start.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

import cableway as cw
from cableway.control.jacobian import JacobianFeedback
from cableway.control.open_loop import OpenLoop
from cableway.control.rod_mpc import RodMPC
from cableway.tracking import track

MISTAKES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "y reversed": lambda action: action * [1, -1, 1],
    "x reversed": lambda action: action * [-1, 1, 1],
    "angle reversed": lambda action: action * [1, 1, -1],
    "y and angle reversed": lambda action: action * [1, -1, -1],
    "turned by 180 degrees": lambda action: action * [-1, -1, 1],
    "x and y exchanged": lambda action: action[:, [1, 0, 2]],
    "left and right exchanged": lambda action: action[::-1].copy(),
    "y of the left reversed": lambda action: action * [[1, -1, 1], [1, 1, 1]],
    "right turned by 180 degrees": lambda action: action * [[1, 1, 1], [-1, -1, 1]],
    "neither moves": lambda action: 0 * action,
    "the left does not move": lambda action: action * [[0], [1]],
    "the right does not move": lambda action: action * [[1], [0]],
}


class Wrong(cw.CableSimulator):
    """The simulator behind a mistake."""

    mistake: Callable[[np.ndarray], np.ndarray]

    def step(self, action: np.ndarray) -> cw.Observation:
        """See `Plant.step`."""
        return super().step(self.mistake(action))


def main() -> None:
    """Print a line a run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", default="single-obstacle-2,maze-1")
    for name in parser.parse_args().tasks.split(","):
        task = cw.load_task(name)
        plan = cw.plan(task, seed=0)
        for controller in (OpenLoop(), JacobianFeedback(), RodMPC()):
            for text, mistake in MISTAKES.items():
                plant = Wrong(task)
                plant.mistake = mistake
                rollout = track(plant, controller, plan)
                success = cw.summarize(task, plan, rollout).success
                figures = f"clearance {1000 * rollout.least_clearance:.1f} mm, success {success}"
                ending = f"{rollout.outcome} after {rollout.times[-1]:.1f} s, {figures}: {rollout.detail}"
                print(f"{name}, {type(controller).__name__}, {text}: {ending}", flush=True)


if __name__ == "__main__":
    main()
