"""A start and a goal for a scene that has none."""

from __future__ import annotations

import numpy as np

from cableway.core.errors import InputError, TaskError
from cableway.motion.validity import first_fault
from cableway.scene.cable import Cable
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.tasks.generation import LEAST_WAY
from cableway.tasks.motion import LEAST_STABILITY, LONGEST_SPAN
from cableway.tasks.setup import MARGIN

DRAWS = 4000
"""Shapes drawn before a scene is given up."""

LOAD_MEAN, LOAD_SPREAD = (-10.0, 0.0, 0.0), (14.0, 7.0, 3.5)
"""Of the load (a_x, a_y, m) of a shape, as in random motions."""


def with_free_ends(name: str, scene: Scene, seed: int, cable: Cable | None = None, description: str = "") -> Task:
    """A task in a scene, start and goal drawn where the cable has room; whether a way joins them is not known.

    Args:
        name: Of the task.
        scene: The scene.
        seed: Of the draw.
        cable: By default, that of a task which states none.
        description: Of the task.

    Raises:
        InputError: There is no room for the cable.
    """
    cable, rng = Cable() if cable is None else cable, np.random.default_rng(seed)
    rod, found, least = cable.rod, list[np.ndarray](), LEAST_WAY * cable.length
    for _ in range(DRAWS):
        pose = [*rng.uniform(0, scene.size), rng.uniform(-np.pi, np.pi)]
        q = np.array([*pose, *rng.uniform(0, 1.2) * rng.normal(LOAD_MEAN, LOAD_SPREAD)])
        room = (scene.world, cable.radius + MARGIN)
        if first_fault(rod, q[None], stability=LEAST_STABILITY, most_span=LONGEST_SPAN * rod.length, room=room):
            continue
        keypoints = rod.at_keypoints(rod.shapes(q[None])[0])[0].round(6)
        if found and np.linalg.norm(keypoints - found[0], axis=1).mean() < least:
            continue
        try:
            task = Task(name=name, scene=scene, cable=cable, start=(found or [keypoints])[0], goal=keypoints,
                        description=description)  # fmt: skip
        except TaskError:
            continue
        if found:
            return task
        found.append(keypoints)
    raise InputError(
        f"in {DRAWS} draws no start and goal with room for a cable of {cable.length:g} m were found: give --task"
    )
