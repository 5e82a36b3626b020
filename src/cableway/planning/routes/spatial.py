"""Ways through space: a path of a point on a grid, the cable sliding along one, and proof that there is none."""

from __future__ import annotations

import heapq
import math

import numpy as np
from jaxtyping import Float

from cableway.core.compiled import kernel
from cableway.core.errors import PlanningError
from cableway.core.time_limit import checkpoint
from cableway.geometry import polyline, rotations
from cableway.geometry.catenary import hanging
from cableway.geometry.spatial_convex import SpatialWorld, signed_distance
from cableway.motion.spatial import SpatialProblem
from cableway.rod.spatial_inverse import fit_sequence

MOST_NODES = 150_000
"""Of a grid; the spacing grows where there would be more."""

SPACING = 0.05
"""Of the grid, in lengths of the cable."""

COMFORT, SHYNESS = 0.25, 4.0
"""Clearance in lengths of the cable below which a way costs more, and how much more where it touches."""

SLIDE_STEP = 0.05
"""Advance of the sliding cable from shape to shape, in its lengths."""

WINDOW, SMOOTHINGS = 0.25, 2
"""Of the means that round the corners of that curve, in lengths of the cable, and how often they are taken."""

HEAVY = 60.0
"""Weight gamma above which a cable hangs between its ends rather than take the shapes of a curve."""

NARROW = 0.02
"""Room in lengths of the cable below which no place counts as narrower."""

X = np.array([1.0, 0.0, 0.0])

RELAXED = math.sqrt(3) / 2
"""Greatest distance of a point of a cell from its centre, in spacings."""


def grid_path(
    problem: SpatialProblem, start: Float[np.ndarray, "3"], goal: Float[np.ndarray, "3"], radius: float
) -> Float[np.ndarray, "P 3"]:
    """The shortest way of a ball over the 26 neighbours of a grid's nodes, at some distance where there is room [m].

    Raises:
        PlanningError: There is none on this grid.
    """
    grid = _Grid(problem.world, SPACING * problem.rod.length)
    comfort = radius + COMFORT * problem.rod.length
    found = grid.path(start, goal, radius - grid.spacing / 2, comfort)  # a narrow way may lie between its nodes
    if not len(found):
        raise PlanningError(
            f"no path of a ball of {1000 * radius:.1f} mm leads from start to goal on a grid of "
            f"{1000 * grid.spacing:.0f} mm"
        )
    return np.vstack([start, found[1:-1], goal])


def slid_shapes(problem: SpatialProblem, radius: float, *, reverse: bool = False) -> Float[np.ndarray, "t 12"]:
    """Equilibria near those of a cable that slides from start to goal along one curve, its right end leading.

    The curve is the start cable, a path from its leading end to the trailing end of the goal cable, and the goal cable.
    A light rod is rolled evenly on the way, so that it arrives as the goal is rolled. A heavy one (`HEAVY`) keeps few
    shapes of such a curve, and hangs between its ends instead.

    Args:
        problem: The problem.
        radius: Distance [m] that the path keeps where the leading gripper is to pass.
        reverse: Whether the left end leads.

    Raises:
        PlanningError: There is no such path.
    """
    rod = problem.rod
    first, last = rod.at_keypoints(rod.shapes(np.array([problem.start, problem.goal]))[0])
    if reverse:
        first, last = first[::-1], last[::-1]
    path = grid_path(problem, first[-1], last[0], radius)
    curve = _smoothed(polyline.remove_repeated(np.vstack([first, path, last])), WINDOW * rod.length)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    travel = arc[-1] - rod.length
    along = np.linspace(0, rod.length, rod.keypoints)
    count = max(4, math.ceil(travel / (SLIDE_STEP * rod.length)))
    shapes = [
        np.stack([np.interp(share * travel + along, arc, column) for column in curve.T], axis=1)
        for share in np.linspace(0, 1, count + 1)
    ]
    if reverse:
        shapes = [shape[::-1] for shape in shapes]
    shapes = np.array(shapes)
    if rod.weight > HEAVY:
        q = fit_sequence(rod, _hung(problem, shapes[1:-1]), None, problem.start)
    else:
        q = fit_sequence(rod, shapes[1:-1], _orientations(problem, shapes)[1:-1], problem.start)
    return np.vstack([problem.start, q, problem.goal])


def _hung(problem: SpatialProblem, shapes: Float[np.ndarray, "t n 3"]) -> Float[np.ndarray, "t n 3"]:
    """The cable hanging between its ends, moved so that it goes through the shapes where there is least room."""
    hung = hanging(shapes[:, [0, -1]], problem.rod.length, problem.rod.keypoints)
    room = np.maximum(signed_distance(shapes, problem.world)[0], NARROW * problem.rod.length)
    share = room**-4 / np.sum(room**-4, axis=1, keepdims=True)
    return hung + np.sum(share[..., None] * (shapes - hung), axis=1, keepdims=True)


def _orientations(problem: SpatialProblem, shapes: Float[np.ndarray, "t n 3"]) -> Float[np.ndarray, "t 2 4"]:
    """Of the grippers at sliding shapes, without twist but that of start and goal, rolled evenly from one to the other.

    Frames go from row to row and from end to end by the least turns between tangents.
    """
    rod, count = problem.rod, len(shapes)
    ends = rod.end_poses(np.array([problem.start, problem.goal]))[..., 3:]
    steps = np.diff(shapes, axis=1)
    tangents = steps / np.maximum(np.linalg.norm(steps, axis=2, keepdims=True), 1e-12)
    left = np.empty((count, 4))
    left[0] = rotations.product(rotations.least_turn(rotations.rotate(ends[0, 0], X), tangents[0, 0]), ends[0, 0])
    for row in range(1, count):
        left[row] = rotations.product(rotations.least_turn(tangents[row - 1, 0], tangents[row, 0]), left[row - 1])
    back = rotations.to_vector(rotations.product(rotations.conjugate(left[-1]), ends[1, 0]))
    share = np.linspace(0, 1, count)
    left = rotations.product(left, rotations.from_vector(np.multiply.outer(share * back[0], X)))
    right = left
    for link in range(1, tangents.shape[1]):
        right = rotations.product(rotations.least_turn(tangents[:, link - 1], tangents[:, link]), right)
    first, last = (q[9] / rod.twist for q in (problem.start, problem.goal))
    twist = first + share * (last - first)
    return np.stack([left, rotations.product(right, rotations.from_vector(np.multiply.outer(twist, X)))], axis=1)


def _smoothed(curve: Float[np.ndarray, "P 3"], window: float) -> Float[np.ndarray, "P 3"]:
    """The curve with points evenly spaced, each the mean of those within half a window [m], ends kept."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    count = max(8, math.ceil(8 * arc[-1] / window))
    out = np.stack([np.interp(np.linspace(0, arc[-1], count + 1), arc, column) for column in curve.T], axis=1)
    for _ in range(SMOOTHINGS):
        padded = np.vstack([2 * out[0] - out[4:0:-1], out, 2 * out[-1] - out[-2:-6:-1]])
        out = np.stack([np.convolve(column, np.full(9, 1 / 9), mode="valid") for column in padded.T], axis=1)
    return out


def blocked(problem: SpatialProblem, clearance: float) -> str:
    """What certainly cannot pass from start to goal with a clearance [m], in words; "" where all may.

    A ball whose centre goes through a cell of the grid keeps its distance somewhere in it, so the cell's centre keeps
    it but for half a diagonal; where such cells do not join, there is no way.
    """
    grid = _Grid(problem.world, SPACING * problem.rod.length)
    stations, poses = problem.rod.shapes(np.array([problem.start, problem.goal]))
    middle = stations[:, stations.shape[1] // 2]
    balls = [("the middle of the cable", middle, problem.radius)]
    names = ("the left gripper", "the right gripper")
    balls += sorted(
        (
            (names[side], poses[:, side, :3] + rotations.rotate(poses[:, side, 3:], at), float(radius))
            for side, at, radius in zip(*problem.bodies.inner_balls, strict=True)
        ),
        key=lambda ball: names.index(ball[0]),
    )
    for name, (start, goal), radius in balls:
        ends = signed_distance(np.array([start, goal]), problem.world)[0].min()
        wanted = min(radius + clearance, float(ends)) - RELAXED * grid.spacing
        if not len(grid.path(start, goal, wanted, wanted)):
            return f"{name} cannot pass from start to goal with a clearance of {1000 * clearance:.1f} mm"
    return ""


class _Grid:
    """Cells of a workspace, and how far their centres are from everything."""

    def __init__(self, world: SpatialWorld, spacing: float) -> None:
        low, high = world.arrays[10]
        spacing = max(spacing, float(np.prod(high - low) / MOST_NODES) ** (1 / 3))
        self.shape = np.maximum(2, np.ceil((high - low) / spacing).astype(np.int64))
        self.spacing, self._low, self._world = spacing, low, world
        self._distance: np.ndarray | None = None

    def path(self, start: np.ndarray, goal: np.ndarray, radius: float, comfort: float) -> Float[np.ndarray, "P 3"]:
        """Centres of cells from the one of `start` to the one of `goal`; none where there is no way."""
        ceiling = max(comfort, radius) + self.spacing
        if self._distance is None:
            axes = [low + self.spacing * (np.arange(n) + 0.5) for low, n in zip(self._low, self.shape, strict=True)]
            nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
            self._distance = signed_distance(nodes, self._world)[0]
        cells = [
            np.clip(((point - self._low) / self.spacing).astype(np.int64), 0, self.shape - 1) for point in (start, goal)
        ]
        checkpoint()
        distance = np.minimum(self._distance, ceiling)
        found = _search(distance, cells[0], cells[1], radius, comfort, SHYNESS)
        return self._low + self.spacing * (found + 0.5)


@kernel
def _search(distance, start, goal, radius, comfort, shyness):
    """A* over the cells of `distance` (a, b, c) that keep a radius, and start and goal: their indices (P, 3)."""
    nx, ny, nz = distance.shape
    cost = np.full(distance.shape, np.inf)
    before = np.full((nx, ny, nz, 3), -1)
    cost[start[0], start[1], start[2]] = 0.0
    heap = [(0.0, start[0], start[1], start[2])]
    while len(heap) > 0:
        _, i, j, k = heapq.heappop(heap)
        if i == goal[0] and j == goal[1] and k == goal[2]:
            break
        here = cost[i, j, k]
        for a in range(max(0, i - 1), min(nx, i + 2)):
            for b in range(max(0, j - 1), min(ny, j + 2)):
                for c in range(max(0, k - 1), min(nz, k + 2)):
                    at_goal = a == goal[0] and b == goal[1] and c == goal[2]
                    if distance[a, b, c] < radius and not at_goal:
                        continue
                    length = math.sqrt(float((a - i) ** 2 + (b - j) ** 2 + (c - k) ** 2))
                    near = 0.0
                    if comfort > radius:
                        near = min(1.0, max(0.0, (comfort - distance[a, b, c]) / (comfort - radius)))
                    value = here + length * (1.0 + shyness * near * near)
                    if value < cost[a, b, c]:
                        cost[a, b, c] = value
                        before[a, b, c, 0], before[a, b, c, 1], before[a, b, c, 2] = i, j, k
                        left = math.sqrt(float((a - goal[0]) ** 2 + (b - goal[1]) ** 2 + (c - goal[2]) ** 2))
                        heapq.heappush(heap, (value + left, a, b, c))
    if cost[goal[0], goal[1], goal[2]] == np.inf:
        return np.zeros((0, 3), np.int64)
    count, i, j, k = 1, goal[0], goal[1], goal[2]
    while before[i, j, k, 0] >= 0:
        i, j, k = before[i, j, k, 0], before[i, j, k, 1], before[i, j, k, 2]
        count += 1
    path = np.empty((count, 3), np.int64)
    i, j, k = goal[0], goal[1], goal[2]
    for row in range(count - 1, -1, -1):
        path[row, 0], path[row, 1], path[row, 2] = i, j, k
        i, j, k = before[i, j, k, 0], before[i, j, k, 1], before[i, j, k, 2]
    return path
