"""Contact: how deep a cable is pressed into a corner or a corridor's wall, and whether a verified plan touches."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from accuracy.leading import GENTLE_BEND, LEAST_STABILITY, catalogue_plan, plant_at, random_shape
from cableway.control.open_loop import OpenLoop
from cableway.core.errors import SimulationError
from cableway.geometry import polyline, se2
from cableway.scene.cable import Cable
from cableway.scene.files.loading import task_names
from cableway.scene.grippers import Grippers
from cableway.scene.obstacles import Box
from cableway.scene.scene import Scene
from cableway.simulation.plant import CableSimulator
from cableway.tracking import track

BEYOND = 0.005
"""How far [m] the grippers move beyond contact."""

STIFFNESSES = (3e-5, 1e-3, 2e-2)
"""Bending stiffnesses EI [N m^2], from a thread to a hose; the middle one is the default."""

WIDTHS = (0.024, 0.028, 0.030, 0.032, 0.036, 0.040)
"""Of corridors [m]; the default cable is 8 mm thick."""

SQUEEZES = (0.001, 0.002, 0.003, 0.006, Grippers.max_step)
"""Speeds of squeezing grippers [m in a control step]; the fastest take less than one control step."""

APPROACH = 0.5 * Grippers.max_step
"""Distance [m] from contact at the start; it is met at the grippers' full speed."""

SEARCH = 0.0005
"""Steps [m] in which the contact is looked for beforehand."""

WAITING = 10
"""Control steps after the motion."""

END_STATIONS = [0, 1, 2, 3, -4, -3, -2, -1]
"""Stations next to the grippers, which are to stay clear: it is the cable that is pressed, not a gripper."""


def corners(seed: int, cases: int = 40) -> dict[str, Any]:
    """A cable between random gripper poses, moved sideways against the corner of a box, for each stiffness.

    Returns:
        `stiffness`; for each of them lists over the cases of `deepest` and `resting` penetration [m], the last after
        `WAITING` steps (negative: clear), and why the plant `refused`, for those it did.
    """
    rows = []
    for stiffness in STIFFNESSES:
        rng = np.random.default_rng(seed)
        rows.append([_corner(Cable(bending_stiffness=stiffness), rng) for _ in range(cases)])
    return {"stiffness": STIFFNESSES, **_summary(rows)}


def corridors(seed: int, cases: int = 40) -> dict[str, Any]:
    """A bent cable in a corridor, moved sideways against a wall.

    Returns:
        As `corners`, with `width` [m] in place of the stiffness; the stiffnesses take turns.
    """
    rows = []
    for width in WIDTHS:
        rng = np.random.default_rng(seed)
        rows.append([_sideways(cable, width, rng) for cable in _cables(cases)])
    return {"width": WIDTHS, **_summary(rows)}


def squeezes(seed: int, cases: int = 40) -> dict[str, Any]:
    """A cable in a corridor of 30 mm, pushed together by both grippers, slowly and fast.

    Returns:
        As `corridors`, with `speed` [m in a control step] in place of the width.
    """
    rows = []
    for speed in SQUEEZES:
        rng = np.random.default_rng(seed)
        rows.append([_squeezed(cable, speed, rng) for cable in _cables(cases)])
    return {"speed": SQUEEZES, **_summary(rows)}


def plans(seed: int) -> dict[str, Any]:
    """Verified plans of the whole catalogue, followed by the nominal cable with nothing correcting it.

    Returns:
        `task`, `clearance` [m]: least of the cable's surface over the run, `gripper_clearance` and `outcome`.
    """
    found: dict[str, list[Any]] = {"task": [], "clearance": [], "gripper_clearance": [], "outcome": []}
    for name in task_names():
        task, plan = catalogue_plan(name, seed)
        rollout = track(CableSimulator(task), OpenLoop(), plan, seed=seed)
        found["task"].append(name)
        found["clearance"].append(float(rollout.clearance.min()))
        found["gripper_clearance"].append(float(rollout.gripper_clearance.min()))
        found["outcome"].append(rollout.metadata["outcome"])
    return found


def _corner(cable: Cable, rng: np.random.Generator) -> dict[str, Any]:
    """Against a corner that points at a random place of the cable, about square to it, on either side."""
    while True:
        q = random_shape(cable.rod, rng, GENTLE_BEND)
        q[:2] = 0.5
        stations = cable.rod.shapes(q[None])[0][0]
        at = rng.uniform(0.15, 0.85) * cable.length
        before, point, after = polyline.point_at(stations, np.array([at - 0.01, at, at + 0.01]))
        across = np.array([before[1] - after[1], after[0] - before[0]]) / np.linalg.norm(after - before)
        across *= rng.choice([-1.0, 1.0])
        turn = np.arctan2(across[1], across[0]) + rng.uniform(-0.3, 0.3)
        centre = point + (cable.radius + APPROACH) * across + 0.05 * np.sqrt(2) * se2.direction(turn)
        scene = Scene((1.0, 1.0), (Box(center=tuple(centre), size=(0.1, 0.1), angle=float(turn + np.pi / 4)),))
        ends = stations[END_STATIONS] + (APPROACH + BEYOND) * across
        if _clear(scene, cable, stations) > APPROACH / 2 and scene.signed_distance(ends).min() > cable.radius:
            return _pressed(q, cable, scene, np.tile([*across, 0.0], (2, 1)))


def _cables(count: int) -> list[Cable]:
    return [Cable(bending_stiffness=STIFFNESSES[k % len(STIFFNESSES)]) for k in range(count)]


def _sideways(cable: Cable, width: float, rng: np.random.Generator) -> dict[str, Any]:
    """Towards the wall that the cable bulges to, so that it touches before its ends do."""
    while True:
        q, scene = _in_corridor(cable, width, rng)
        heights = cable.rod.shapes(q[None])[0][0, :, 1]
        ends = heights[END_STATIONS]
        up, down = heights.max() - ends.max(), ends.min() - heights.min()
        if max(up, down) > BEYOND + 0.0005:
            return _pressed(q, cable, scene, np.tile([0.0, 1.0 if up > down else -1.0, 0.0], (2, 1)))


def _squeezed(cable: Cable, speed: float, rng: np.random.Generator) -> dict[str, Any]:
    q, scene = _in_corridor(cable, 0.030, rng)
    return _pressed(q, cable, scene, np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]), speed)


def _in_corridor(cable: Cable, width: float, rng: np.random.Generator) -> tuple[Float[np.ndarray, "6"], Scene]:
    """A random stable shape that is free by 1 mm in the middle of a corridor along x."""
    boxes = (Box(center=(0.5, 0.5 + side * (width / 2 + 0.05)), size=(0.9, 0.1)) for side in (-1, 1))
    scene = Scene((1.0, 1.0), tuple(boxes))
    while True:
        q = np.array([0.5, 0.5, rng.normal(0, 0.05), rng.uniform(-39, 0), rng.normal(0, 2), rng.normal(0, 0.4)])
        heights = cable.rod.shapes(q[None])[0][0, :, 1]
        q[1] += 0.5 - (heights.max() + heights.min()) / 2
        if cable.rod.stability(q[None])[0][0] < LEAST_STABILITY:
            continue
        if _clear(scene, cable, cable.rod.shapes(q[None])[0][0]) > 0.001:
            return q, scene


def _clear(scene: Scene, cable: Cable, stations: Float[np.ndarray, "s 2"]) -> float:
    return float(scene.clearance(stations[None], cable.radius)[0])


def _pressed(
    q: Float[np.ndarray, "6"],
    cable: Cable,
    scene: Scene,
    direction: Float[np.ndarray, "2 3"],
    speed: float = Grippers.max_step,
) -> dict[str, Any]:
    """Lead the grippers in a direction, at most `speed` in a control step, to `BEYOND` past contact, and wait."""
    plant = plant_at(q, cable, scene)
    way = 0.0
    try:
        while plant.measure().clearance > 0:
            plant.step(SEARCH * direction)
            way += SEARCH
        plant.reset()
        count = int(np.ceil((way + BEYOND) / speed))
        seen = []
        for action in [(way + BEYOND) / count * direction] * count + [0 * direction] * WAITING:
            plant.step(action)
            seen.append(plant.measure())
    except SimulationError as error:
        return {"refused": str(error)}
    return {"deepest": -min(each.clearance for each in seen), "resting": -seen[-1].clearance}


def _summary(rows: list[list[dict[str, Any]]]) -> dict[str, Any]:
    """Lists over the groups of cases."""
    taken = [[case for case in row if "refused" not in case] for row in rows]
    return {
        **{name: [[case[name] for case in row] for row in taken] for name in ("deepest", "resting")},
        "refused": [[case["refused"] for case in row if "refused" in case] for row in rows],
    }
