"""Settled shapes: against the elastica between random poses, against the closed form, and for more and more links."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

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
from cableway.scene.files.loading import task_names
from cableway.simulation.plant import CableSimulator

SHORTENINGS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""Of the closed form, in lengths of the cable."""

LINKS = {24: 13, 36: 37, 48: 49, 72: 73, 96: 97}
"""Keypoints that make a chain of so many hinges."""

LEADING, SETTLING = 60, 40
"""Control steps of a motion, and those for which the plant is then left alone: 40 damping times."""


class _Settled(NamedTuple):
    plant: Float[np.ndarray, "13 2"]
    elastica: Float[np.ndarray, "13 2"]
    radius: float
    aside: Float[np.ndarray, "13"]


def after_motions(seed: int, pairs: int = 100) -> dict[str, Any]:
    """The plant left to settle after random motions of `cableway collect`, beside the elastica between the grippers.

    Returns:
        Lists over the pairs: `plant` and `elastica`, 13 keypoints [m]; `radius` of the sharpest bend [m]; `aside`, the
        distances [m] of the keypoints where both are compared as `on_the_curve` says.
    """
    cable, rng = Cable(), np.random.default_rng(seed)
    return _listed([_settled(cable, *motion_of_collect(cable.rod, LEADING, rng)) for _ in range(pairs)])


def along_plans(seed: int, stops: int = 10) -> dict[str, Any]:
    """The same at `stops` rows, evenly spaced, of each of the catalogue's verified plans, without friction."""
    rows = []
    for name in task_names():
        task, plan = catalogue_plan(name, seed)
        plant = CableSimulator(task, cable=replace(task.cable, friction=0.0))
        places = np.linspace(0, plan.steps, stops + 1).astype(int)
        rows += [_led_beside(plant, plan.poses[a : b + 1]) for a, b in pairwise(places)]
    return _listed(rows)


def any_poses(seed: int, pairs: int = 100, sharpest: float = np.inf) -> dict[str, Any]:
    """The same after lines of stable shapes to random gripper poses; see `leading.random_shape`."""
    rod, rng = Cable().rod, np.random.default_rng(seed)
    lines = (line_to(random_shape(rod, rng, sharpest), rod, rng) for _ in range(pairs))
    return _listed([_settled(Cable(), line[0], rod.shapes(line)[1]) for line in lines])


def gentle_poses(seed: int, pairs: int = 100) -> dict[str, Any]:
    """The same between poses that bend the cable by at most `leading.GENTLE_BEND` from link to link."""
    return any_poses(seed, pairs, GENTLE_BEND)


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


def _settled(cable: Cable, q: Float[np.ndarray, "6"], poses: Float[np.ndarray, "k 2 3"]) -> _Settled:
    return _led_beside(plant_at(q, cable), poses)


def _led_beside(plant: CableSimulator, poses: Float[np.ndarray, "k 2 3"]) -> _Settled:
    """13 keypoints of the plant, led and settled, and of the elastica, and the elastica's sharpest bend."""
    cable, held = plant.cable, poses[-1]
    *_, last = led(plant, poses, SETTLING)
    elastica, radius = clamped_shape(cable.length, held, last.centreline, cable.keypoints)
    curve = on_the_curve(last.centreline)[:: cable.rod.hinges // (cable.keypoints - 1)]
    ends = np.column_stack([held[:, :2] + curve[[0, -1]] - last.centreline[[0, -1]], held[:, 2]])
    aside = np.linalg.norm(curve - clamped_shape(cable.length, ends, last.centreline, cable.keypoints)[0], axis=1)
    stride = (cable.keypoints - 1) // 12
    return _Settled(last.keypoints[::stride], elastica[::stride], radius, aside[::stride])


def on_the_curve(line: Float[np.ndarray, "v 2"]) -> Float[np.ndarray, "links 2"]:
    """The ends of a chain and the middles of its whole links, moved onto the smooth curve that bends as it does.

    Links of length h that turn by h kappa from one to the next touch an arc that is shorter than they are. The arc of
    the same length runs h^2 kappa/12 outside of their middles, and so it does at the ends, in the grippers.
    """
    links = np.diff(line, axis=0)
    lengths = np.linalg.norm(links, axis=1)
    angles = np.unwrap(np.arctan2(links[:, 1], links[:, 0]))
    bends = np.diff(angles)
    middle_bends = np.concatenate(
        [[1.5 * bends[0] - 0.5 * bends[1]], (bends[1:] + bends[:-1]) / 2, [1.5 * bends[-1] - 0.5 * bends[-2]]]
    )
    points = np.concatenate([line[:1], (line[1:-2] + line[2:-1]) / 2, line[-1:]])
    outward = np.column_stack([np.sin(angles), -np.cos(angles)])
    return points + (lengths.max() / 12 * middle_bends)[:, None] * outward


def _listed(rows: list[_Settled]) -> dict[str, Any]:
    columns = zip(_Settled._fields, zip(*rows, strict=True), strict=True)
    return {name: np.array(values).tolist() for name, values in columns}


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
