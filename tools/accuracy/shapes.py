"""Settled shapes: against the elastica between random poses, against the closed form, and for more and more links."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float

from accuracy.elastica import clamped_shape, pushed_together
from accuracy.leading import (
    GENTLE_BEND,
    MIDDLE,
    catalogue_plan,
    led,
    line_to,
    motion_of_collect,
    plant_at,
    random_shape,
)
from cableway.rod.inverse import equilibria_at
from cableway.scene.cable import Cable
from cableway.scene.loading import task_names
from cableway.simulation.plant import CableSimulator

SHORTENINGS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""Of the closed form, in lengths of the cable."""

LINKS = {24: 13, 36: 37, 48: 49, 72: 73, 96: 97}
"""Keypoints that make a chain of so many hinges."""

LEADING, SETTLING = 60, 40
"""Control steps of a motion, and those for which the plant is then left alone: 40 damping times."""


def after_motions(seed: int, pairs: int = 100) -> dict[str, Any]:
    """The plant left to settle after random motions of `cableway collect`, beside the elastica between the grippers.

    Returns:
        Lists over the pairs: `plant` and `elastica`, 13 keypoints [m]; `radius` of the sharpest bend [m].
    """
    cable, rng = Cable(), np.random.default_rng(seed)
    return _listed([_settled(cable, *motion_of_collect(cable.rod, LEADING, rng)) for _ in range(pairs)])


def along_plans(seed: int, stops: int = 10) -> dict[str, Any]:
    """The same at `stops` rows, evenly spaced, of each of the catalogue's verified plans."""
    rows = []
    for name in task_names():
        task, plan = catalogue_plan(name, seed)
        plant = CableSimulator(task)
        places = np.linspace(0, plan.steps, stops + 1).astype(int)
        rows += [_led_beside(plant, plan.poses[a : b + 1]) for a, b in pairwise(places)]
    return _listed(rows)


def any_poses(seed: int, pairs: int = 100) -> dict[str, Any]:
    """The same after lines of stable shapes to random gripper poses; see `leading.random_shape`."""
    rod, rng = Cable().rod, np.random.default_rng(seed)
    lines = (line_to(random_shape(rod, rng), rod, rng) for _ in range(pairs))
    return _listed([_settled(Cable(), line[0], rod.shapes(line)[1]) for line in lines])


def by_links(seed: int, pairs: int = 30) -> dict[str, Any]:
    """The error at the same rod coordinates, gently bent, for chains of more and more links.

    Returns:
        `hinges`, and `errors` (hinges, pairs): mean distance [m] of the 13 keypoints to the elastica's.
    """
    rod, rng = Cable().rod, np.random.default_rng(seed)
    lines = [line_to(random_shape(rod, rng, GENTLE_BEND), rod, rng) for _ in range(pairs)]
    cables = [Cable(keypoints=keypoints) for keypoints in LINKS.values()]
    found = (_listed([_settled(cable, line[0], cable.rod.shapes(line)[1]) for line in lines]) for cable in cables)
    return {"hinges": list(LINKS), "errors": [errors(each).mean(axis=1).tolist() for each in found]}


def _settled(
    cable: Cable, q: Float[np.ndarray, "6"], poses: Float[np.ndarray, "k 2 3"]
) -> tuple[np.ndarray, np.ndarray, float]:
    return _led_beside(plant_at(q, cable), poses)


def _led_beside(plant: CableSimulator, poses: Float[np.ndarray, "k 2 3"]) -> tuple[np.ndarray, np.ndarray, float]:
    """13 keypoints of the plant, led and settled, and of the elastica, and the elastica's sharpest bend."""
    cable = plant.cable
    *_, last = led(plant, poses, SETTLING)
    elastica, radius = clamped_shape(cable.length, poses[-1], last.centreline, cable.keypoints)
    stride = (cable.keypoints - 1) // 12
    return last.keypoints[::stride], elastica[::stride], radius


def _listed(rows: list[tuple[np.ndarray, np.ndarray, float]]) -> dict[str, Any]:
    plant, elastica, radius = zip(*rows, strict=True)
    return {"plant": np.array(plant).tolist(), "elastica": np.array(elastica).tolist(), "radius": list(radius)}


def errors(shapes: dict[str, Any]) -> Float[np.ndarray, "pairs n"]:
    """Distance [m] of each keypoint to the elastica's."""
    return np.linalg.norm(np.array(shapes["plant"]) - shapes["elastica"], axis=-1)


def closed_form(seed: int) -> dict[str, Any]:
    """Parallel ends pushed together further and further; nothing is drawn at random.

    Returns:
        `shortening`, and for each of them keypoints of `plant` and `elastica` in lengths of the cable.
    """
    cable = Cable()
    rod = cable.rod
    poses = np.zeros((1 + len(SHORTENINGS), 2, 3))
    poses[:, :, :2] = MIDDLE
    poses[:, 1, 0] += cable.length * (1 - np.array([0.01, *SHORTENINGS]))
    bent_left = [q for q in equilibria_at(rod, poses[0]) if rod.shapes(q[None])[0][0, rod.hinges, 1] > MIDDLE[1]]
    plant, found = plant_at(bent_left[0], cable), []
    for start, end in pairwise(poses):
        way = start + np.linspace(0, 1, LEADING + 1)[:, None, None] * (end - start)
        *_, last = led(plant, way, SETTLING)
        found.append(((last.keypoints - MIDDLE) / cable.length).tolist())
    exact = [pushed_together(shortening, cable.keypoints).tolist() for shortening in SHORTENINGS]
    return {"shortening": SHORTENINGS, "plant": found, "elastica": exact}
