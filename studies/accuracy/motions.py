"""Moving cables: how much the time step matters, and how far a cable is behind its equilibrium."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from accuracy.leading import GENTLE_BEND, led, line_to, motion_of_collect, plant_at, random_shape
from cableway.scene.cable import Cable
from cableway.scene.task import CONTROL_STEP

TIME_STEPS = (0.01, 0.005, 0.0025, 0.001, 0.0005, 0.00025)
"""[s]; the last one is the reference of the order, 0.5 ms that of the promise."""

DAMPING_TIMES = (0.02, 0.05, 0.1, 0.2, 0.5, 1.5)
"""tau [s]; the last is about the paper's."""

RELAXING = 40
"""Control steps for which a cable is observed after its motion."""


def by_time_step(seed: int, motions: int = 20, steps: int = 100) -> dict[str, Any]:
    """The same random motions, those of `cableway collect`, with different time steps.

    Returns:
        `time_step` [s]; for each of them `to_finest` and `to_half`, the distances [m] of all keypoints after all
        control steps to those with the finest time step and with 0.5 ms.
    """
    cable, rng = Cable(), np.random.default_rng(seed)
    drawn = [motion_of_collect(cable.rod, steps, rng) for _ in range(motions)]
    seen = {}
    for time_step in TIME_STEPS:
        plants = (plant_at(q, cable, time_step=time_step) for q, _ in drawn)
        runs = (led(plant, poses) for plant, (_, poses) in zip(plants, drawn, strict=True))
        seen[time_step] = np.array([each.keypoints for run in runs for each in run])

    def distances(reference: float) -> list[list[float]]:
        return [np.linalg.norm(rows - seen[reference], axis=-1).ravel().round(9).tolist() for rows in seen.values()]

    return {"time_step": TIME_STEPS, "to_finest": distances(TIME_STEPS[-1]), "to_half": distances(0.0005)}


def by_damping_time(seed: int, motions: int = 20) -> dict[str, Any]:
    """Cables moved along lines of equilibria as fast as a gripper may move, then left alone.

    Returns:
        `damping_time` [s]; for each of them `moving`, one list per motion: mean distance [m] of the keypoints to the
        equilibrium after each control step; and `resting`, the same after the motion, where it starts at its end.
    """
    moving, resting = [], []
    for damping_time in DAMPING_TIMES:
        rng = np.random.default_rng(seed)
        runs = [_lag(Cable(damping_time=damping_time), rng) for _ in range(motions)]
        moving.append([lag[:-RELAXING].tolist() for lag in runs])
        resting.append([lag[-RELAXING - 1 :].tolist() for lag in runs])
    return {"damping_time": DAMPING_TIMES, "control_step": CONTROL_STEP, "moving": moving, "resting": resting}


def _lag(cable: Cable, rng: np.random.Generator) -> Float[np.ndarray, "k"]:
    rod = cable.rod
    q = line_to(random_shape(rod, rng, GENTLE_BEND), rod, rng)
    stations, poses = rod.shapes(q)
    wanted = rod.at_keypoints(stations)[1:]
    wanted = np.concatenate([wanted, np.repeat(wanted[-1:], RELAXING, axis=0)])
    seen = np.array([each.keypoints for each in led(plant_at(q[0], cable), poses, RELAXING)])
    return np.linalg.norm(seen - wanted, axis=-1).mean(axis=1)
