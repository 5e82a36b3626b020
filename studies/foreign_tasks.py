"""Planning on tasks of a generator that shares nothing with the planner or the package's own generators.

    .venv/bin/python studies/foreign_tasks.py [--seeds 0:500] [--out runs/foreign_tasks.csv]

Start and goal are what an own chain of straight links settles to between random ends (SLSQP on its bending energy), if
its Hessian says that it stays there; obstacles are random convex hulls and discs that keep 2 mm from both. Nothing asks
whether a way exists. Each task's outcome is a line of the file at once; the same command goes on after an
interrupt. Times are of the processor. Prints Markdown.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path

import numpy as np
import shapely
from scipy.linalg import null_space
from scipy.optimize import minimize

import cableway as cw
from cableway.benchmark.tables import Table
from cableway.core.errors import CablewayError

LINKS = 80
LEAST_MARGIN = 3.0
"""Least eigenvalue of the Hessian, times the number of links squared, from which a shape counts as stable."""
LEAST_CLEARANCE = 0.002
"""Clearance [m] of start and goal."""
FIELDS = ("seed", "length", "keypoints", "obstacles", "clearance", "start_margin", "goal_margin", "outcome", "seconds",
          "detail")  # fmt: skip


def main() -> None:
    """Plan, write a line a task, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:500")
    parser.add_argument("--out", type=Path, default=Path("runs/foreign_tasks.csv"))
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    rows = list(csv.DictReader(given.out.read_text().splitlines())) if given.out.exists() else []
    done = {int(row["seed"]) for row in rows}
    with given.out.open("a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        if file.tell() == 0:
            writer.writeheader()
        for seed in range(*map(int, given.seeds.split(":"))):
            if seed not in done:
                writer.writerow(planned(seed))
                file.flush()
    summarize([row for row in csv.DictReader(given.out.read_text().splitlines()) if row["outcome"]])


def planned(seed: int) -> dict[str, object]:
    """One task's line."""
    values, margins = drawn(np.random.default_rng(seed))
    line: dict[str, object] = {
        "seed": seed, "length": values["cable"].length, "keypoints": values["cable"].keypoints,
        "obstacles": len(values["scene"].obstacles), "clearance": round(values.pop("clearance"), 4),
        "start_margin": round(margins[0], 1), "goal_margin": round(margins[1], 1), "detail": "",
    }  # fmt: skip
    begun = time.process_time()
    try:
        task = cw.Task(name=f"foreign-{seed}", **values)
    except CablewayError as error:
        return line | {"outcome": "refused", "detail": str(error)}
    try:
        cw.plan(task)
        line["outcome"] = "solved"
    except CablewayError as error:
        line |= {"outcome": "no plan", "detail": str(error)}
    return line | {"seconds": round(time.process_time() - begun, 2)}


def summarize(rows: list[dict[str, str]]) -> None:
    """Print each task that was not solved, and the table."""
    for row in rows:
        if row["outcome"] != "solved":
            print(f"{row['seed']}: {row['outcome']}: {row['detail']}")
    solved = [row for row in rows if row["outcome"] == "solved"]
    times = np.array([float(row["seconds"]) for row in rows if row["seconds"]])
    thin = sum(min(float(row["start_margin"]), float(row["goal_margin"])) < 20 for row in rows)
    narrow = sum(float(row["clearance"]) < 0.005 for row in rows)
    titles = ("tasks", "solved", "median [s]", "p95 [s]", "worst [s]", "an end's margin below 20", "below 5 mm of room")
    figures = (f"{value:.2f}" for value in (np.median(times), np.quantile(times, 0.95), times.max()))
    line = (f"{len(rows)}", f"{len(solved)}", *figures, f"{thin}", f"{narrow}")
    print("\n" + Table("", (titles, line)).markdown())


def drawn(rng: np.random.Generator) -> tuple[dict, tuple[float, float]]:
    """A task's arguments, and the stability margins of its ends."""
    length = round(float(rng.uniform(0.15, 0.6)), 3)
    cable = cw.Cable(
        length=length, radius=round(float(rng.uniform(0.002, 0.005)), 4), keypoints=int(rng.choice([10, 13, 17, 21]))
    )
    grippers = cw.Grippers(radius=round(float(rng.uniform(0.003, 0.008)), 4))
    size = np.round(length * rng.uniform(2.0, 3.5, 2), 2)
    (start, first), (goal, second) = (placed(rng, cable, grippers, size) for _ in range(2))
    ends = [thick(shape, cable, grippers) for shape in (start, goal)]
    obstacles, outlines = [], []
    for _ in range(int(rng.integers(2, 9))):
        outline, obstacle = hull_or_disc(rng, length, size)
        clear = min(outline.distance(end) for end in ends) > LEAST_CLEARANCE
        if clear and all(outline.distance(other) > 0.3 * length for other in outlines):
            obstacles.append(obstacle)
            outlines.append(outline)
    clearance = min([outline.distance(end) for outline in outlines for end in ends], default=np.inf)
    scene = cw.Scene(size=(float(size[0]), float(size[1])), obstacles=tuple(obstacles))
    values = {"cable": cable, "grippers": grippers, "scene": scene, "clearance": clearance,
              "start": at_equal_arcs(start, cable), "goal": at_equal_arcs(goal, cable)}  # fmt: skip
    return values, (first, second)


def placed(rng: np.random.Generator, cable: cw.Cable, grippers: cw.Grippers, size: np.ndarray) -> tuple:
    """Joints [m] of a stable shape inside the workspace, and its margin."""
    while True:
        joints, margin = settled(rng)
        if margin < LEAST_MARGIN or not shapely.LineString(joints).is_simple:
            continue
        joints = joints * cable.length
        gap = np.linalg.norm(joints[-1] - joints[0])
        apart = np.linalg.norm(joints[:, None] - joints, axis=2)
        apart[np.abs(np.subtract.outer(range(LINKS + 1), range(LINKS + 1))) < LINKS // 6] = np.inf
        if gap < 3 * grippers.radius or gap > 0.97 * cable.length or apart.min() < 2 * cable.radius + LEAST_CLEARANCE:
            continue
        low, high = joints.min(0), joints.max(0)
        room = size - (high - low) - 2 * (max(cable.radius, grippers.radius) + LEAST_CLEARANCE)
        if (room > 0).all():
            corner = max(cable.radius, grippers.radius) + LEAST_CLEARANCE
            return joints - low + corner + rng.uniform(0, 1, 2) * room, margin


def settled(rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Joints of a chain of length 1 that has settled between the ends of a random curve, and its margin."""
    s = (np.arange(LINKS) + 0.5) / LINKS
    waves = rng.normal(0, 1, (3, 2)) * np.array([[1.6], [0.8], [0.4]])
    angles = rng.uniform(0, 2 * np.pi) + sum(
        a * np.sin(np.pi * k * s) + b * np.cos(np.pi * k * s) for k, (a, b) in enumerate(waves, 1)
    )
    end = np.array([np.cos(angles).mean(), np.sin(angles).mean()])
    first, last = angles[0], angles[-1]

    def full(free: np.ndarray) -> np.ndarray:
        return np.concatenate([[first], free, [last]])

    def energy(free: np.ndarray) -> tuple[float, np.ndarray]:
        bends = np.diff(full(free))
        return 0.5 * LINKS * bends @ bends, LINKS * (bends[:-1] - bends[1:])

    def gap(free: np.ndarray) -> np.ndarray:
        every = full(free)
        return np.array([np.cos(every).mean(), np.sin(every).mean()]) - end

    def gap_slope(free: np.ndarray) -> np.ndarray:
        return np.array([-np.sin(free), np.cos(free)]) / LINKS

    closed = {"type": "eq", "fun": gap, "jac": gap_slope}
    found = minimize(energy, angles[1:-1], jac=True, method="SLSQP", constraints=[closed],
                     options={"maxiter": 400, "ftol": 1e-13})  # fmt: skip
    free = found.x
    joints = np.concatenate(
        [[[0.0, 0.0]], np.cumsum(np.column_stack([np.cos(full(free)), np.sin(full(free))]), axis=0)]
    )
    return joints / LINKS, margin_of(energy(free)[1], gap_slope(free), free)


def margin_of(slope: np.ndarray, closure: np.ndarray, free: np.ndarray) -> float:
    """Least eigenvalue of the Lagrangian's Hessian along the closure, times the links squared; -1 if not settled."""
    loads = np.linalg.lstsq(closure.T, -slope, rcond=None)[0]
    if np.abs(slope + closure.T @ loads).max() > 1e-2:
        return -1.0
    count = len(free)
    bending = LINKS * (2 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1))
    hessian = bending - np.diag(loads[0] * np.cos(free) + loads[1] * np.sin(free)) / LINKS
    null = null_space(closure)
    return float(np.linalg.eigvalsh(null.T @ hessian @ null)[0]) * LINKS


def at_equal_arcs(joints: np.ndarray, cable: cw.Cable) -> np.ndarray:
    """The keypoints of a chain."""
    arc, wanted = np.linspace(0, 1, len(joints)), np.linspace(0, 1, cable.keypoints)
    return np.column_stack([np.interp(wanted, arc, column) for column in joints.T]).round(5)


def thick(joints: np.ndarray, cable: cw.Cable, grippers: cw.Grippers) -> shapely.Geometry:
    """Cable and gripper discs."""
    discs = shapely.MultiPoint(joints[[0, -1]]).buffer(grippers.radius)
    return shapely.union(shapely.LineString(joints).buffer(cable.radius), discs)


def hull_or_disc(rng: np.random.Generator, length: float, size: np.ndarray) -> tuple[shapely.Geometry, object]:
    """The outline of an obstacle, and the obstacle."""
    center, reach = rng.uniform(0.1, 0.9, 2) * size, float(rng.uniform(0.04, 0.15)) * length
    if rng.random() < 0.4:
        x, y = center.round(4).tolist()
        return shapely.Point(x, y).buffer(reach, 64), cw.Disc(center=(x, y), radius=reach)
    points = center + rng.normal(0, 0.6 * reach, (6, 2))
    hull = shapely.MultiPoint(np.clip(points, 0.0, size).round(4)).convex_hull
    corners = np.array(hull.exterior.coords)[:-1]
    return hull, cw.Polygon(vertices=corners)


if __name__ == "__main__":
    main()
