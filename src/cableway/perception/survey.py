"""What stands on a table, by depth cameras: obstacles with heights, and what no camera saw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_closing, binary_dilation, binary_opening

from cableway.core.checks import Bounds, Checked, NotNegative, Positive
from cableway.core.errors import InputError
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.depth import DepthView, Relief, relief
from cableway.perception.outlines import convex_parts, hull, things
from cableway.scene.obstacles import Polygon, to_shapely
from cableway.scene.scene import Scene
from cableway.scene.task import Task

CELL = 0.003
"""Side of the cells [m] in which points are counted: two pixels of 1.4 mm, and more than the error of a point."""

NOISE = 4.0
"""Standard deviations of the table's heights above which something stands there."""

TALL = 95.0
"""Percentile of the heights of its points that is an obstacle's: noise takes some above its top."""

VERTEX = 0.001
"""Distance [m] by which an outline is simplified, and grown by as much."""

MITRE = 2.0
"""How far a corner may stand out where an outline is grown, in that distance; a right angle's is 1.4."""

GRID = 1e-5
"""Outlines are whole numbers of it [m]."""

AROUND = 3
"""Pixels about cable, grippers and arms that may show them as well: half the window of the depths, and one."""

LEAST_AREA = 1e-6
"""Of an outline [m^2]: a square millimetre."""

CABLE = 2.0
"""Heights, in the lowest of an obstacle, from which on what has the cable's colour is an obstacle."""


@dataclass(frozen=True, kw_only=True)
class SurveyConfig(Checked):
    """What counts as an obstacle.

    Attributes:
        margin: By which outlines and heights are more than what was seen [m].
        lowest: Height from which on something is an obstacle [m]; more where depths are that uncertain, see `Survey`.
            Above a cable, which is none.
        smallest: Something of less area than a square of this side is none, and what no camera saw may hold one where a
            disc of this diameter has room [m].
        notch: How deep free space may be that an outline covers, where what stands there is not convex [m].

    Raises:
        InputError: A value is out of range.
    """

    margin: NotNegative[float] = 0.004
    lowest: Positive[float] = 0.012
    smallest: Annotated[float, Bounds(2 * CELL, 1.0)] = 0.012
    notch: Positive[float] = 0.008


@dataclass(frozen=True, eq=False)
class Survey:
    """What was seen of a table.

    Attributes:
        obstacles: What stands there.
        hidden: Parts of the table that no camera saw and that have room for an obstacle: they may hold one.
        seen: Share of the table that was seen.
        specks: Things too small to count.
        lowest: Height from which on things were found [m].
        off: Of each camera, how far depths and calibration disagreed about the height of the table, which was mended
            [m].
    """

    obstacles: tuple[Polygon, ...]
    hidden: tuple[Polygon, ...]
    seen: float
    specks: int
    lowest: float
    off: tuple[float, ...]

    def scene(self, like: Scene, *, hidden: bool = True) -> Scene:
        """A scene with what was found, of the size and with the walls of another one.

        Args:
            like: The other one.
            hidden: Whether what no camera saw stands there as well.
        """
        return Scene(like.size, (*self.obstacles, *(self.hidden if hidden else ())), like.wall_height)

    def beyond(self, scene: Scene, near: float) -> tuple[Polygon, ...]:
        """What of the obstacles is not of those of a scene, or within a distance of them [m].

        Args:
            scene: What is known to stand there.
            near: The distance; what is left and less wide than half of it is none.
        """
        known = shapely.union_all([to_shapely(each) for each in scene.obstacles]).buffer(near)
        found = []
        for each in self.obstacles:
            rest = to_shapely(each).difference(known)
            for part in shapely.get_parts(rest):
                outline = _outline(shapely.get_coordinates(part), 0.0, scene.size)
                if outline is not None and not part.buffer(-near / 4).is_empty:
                    found.append(Polygon(vertices=outline, height=each.height))
        return tuple(found)


def survey(
    views: Sequence[DepthView],
    workspace: tuple[float, float],
    known: shapely.Geometry | None = None,
    config: SurveyConfig | None = None,
) -> Survey:
    """Find what stands on a table.

    Args:
        views: What depth cameras show of it at one time.
        workspace: Its width and height [m].
        known: Where nothing else can stand, seen or not, as where the grippers are [m].
        config: What counts; by default the defaults.

    Raises:
        InputError: There is no view, too little of the table is seen, or depths and calibration disagree about it.
    """
    config = SurveyConfig() if config is None else config
    if not views:
        raise InputError("a survey needs one view of the table at least")
    reliefs = [relief(view, workspace) for view in views]
    lowest = max(config.lowest, *(NOISE * each.noise for each in reliefs))
    clouds = [_points(view, each, workspace, lowest) for view, each in zip(views, reliefs, strict=True)]
    points = np.concatenate([cloud[cloud[:, 2] >= lowest] for cloud in clouds])
    table = np.concatenate([cloud[cloud[:, 2] < lowest] for cloud in clouds])
    standing, flat = _counts(points, workspace), _counts(table, workspace)
    there = _closed(standing > flat, 1)
    seen = _closed(there | (flat > 0), 2)
    free = seen & ~there
    wide, depth = _disc(config.smallest / 2 / CELL), config.notch / CELL
    found = things(there, 1)
    large = [thing for thing in found if thing.sum() >= (config.smallest / CELL) ** 2]
    parts = [part for thing in large for part in convex_parts(thing, free, depth)]
    obstacles = [_obstacle(points[part[_cells(points, part.shape)]], workspace, config.margin) for part in parts]
    doubt = ~seen if known is None else ~seen & ~_covered(known, seen.shape)
    patches = things(binary_opening(doubt, wide), 1)
    hidden = [_patch(part, workspace) for patch in patches for part in convex_parts(patch, free, depth)]
    return Survey(
        tuple(each for each in obstacles if each is not None),
        tuple(each for each in hidden if each is not None),
        float(seen.mean()),
        len(found) - len(large),
        lowest,
        tuple(each.off for each in reliefs),
    )


def depth_view(
    camera: CalibratedCamera,
    depth: Float[np.ndarray, "h w"],
    cable: Bool[np.ndarray, "h w"],
    hides: Bool[np.ndarray, "h w"] | None = None,
) -> DepthView:
    """What a depth camera shows, with some pixels more about cable, grippers and arms.

    Args:
        camera: The camera.
        depth: Of each pixel [m], 0 where it is not known.
        cable: Which pixels show the cable, see `segmentation.cable_mask`.
        hides: Which pixels show grippers and arms; None where there are none.

    Raises:
        InputError: An array is not as large as the camera's picture.
    """
    hides = np.zeros_like(cable) if hides is None else binary_dilation(hides, iterations=AROUND)
    return DepthView(camera, depth, binary_dilation(cable, iterations=AROUND), hides)


def held(task: Task) -> shapely.Geometry:
    """Where cable and grippers are on the table at a task's start [m], so that nothing else stands there."""
    low = [body for body in task.bodies if body.heights[0] < 2 * task.cable.radius]
    poses = task.gripper_poses("start")
    at = [hull(body.placed(poses[body.side])).buffer(body.rounding) for body in low]
    return shapely.union_all([shapely.LineString(task.start).buffer(task.cable.radius), *at])


def _points(view: DepthView, relief: Relief, workspace: tuple[float, float], lowest: float) -> Float[np.ndarray, "k 3"]:
    """What is seen over the workspace [m]; the cable, where it is not far too high, as if it were the table."""
    points = relief.points.copy()
    with np.errstate(invalid="ignore"):
        points[..., 2][view.cable & (points[..., 2] < CABLE * lowest)] = 0.0
    points = points[np.isfinite(points[..., 2])]
    return points[((points[:, :2] >= 0) & (points[:, :2] <= workspace)).all(axis=1)]


def _cells(points: Float[np.ndarray, "k 3"], shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Row, along x, and column, along y, of the cell of each point."""
    at = np.minimum((points[:, :2] / CELL).astype(int), np.array(shape) - 1)
    return at[:, 0], at[:, 1]


def _counts(points: Float[np.ndarray, "k 3"], workspace: tuple[float, float]) -> Int[np.ndarray, "k l"]:
    """Points in each cell."""
    shape = (math.ceil(workspace[0] / CELL), math.ceil(workspace[1] / CELL))
    counts = np.zeros(shape, int)
    np.add.at(counts, _cells(points, shape), 1)
    return counts


def _obstacle(points: Float[np.ndarray, "k 3"], workspace: tuple[float, float], margin: float) -> Polygon | None:
    """What has these points [m] on its sides and top."""
    height = float(np.percentile(points[:, 2], TALL)) + margin
    outline = _outline(points[:, :2], margin, workspace)
    return None if outline is None else Polygon(vertices=outline, height=round(height, 4))


def _patch(part: Bool[np.ndarray, "k l"], workspace: tuple[float, float]) -> Polygon | None:
    """Cells that nobody saw."""
    at = np.argwhere(part)
    outline = _outline(CELL * np.concatenate([at, at + (0, 1), at + (1, 0), at + (1, 1)]), 0.0, workspace)
    return None if outline is None else Polygon(vertices=outline)


def _outline(
    points: Float[np.ndarray, "k 2"], margin: float, workspace: tuple[float, float]
) -> Float[np.ndarray, "k 2"] | None:
    """Vertices of a convex outline about points [m] that stays inside the workspace; None where it has no area."""
    grown = hull(points).simplify(VERTEX).buffer(margin + VERTEX, join_style="mitre", mitre_limit=MITRE)
    cut = shapely.set_precision(grown.intersection(shapely.box(0.0, 0.0, *workspace)), GRID)
    outline = shapely.convex_hull(cut)
    if not isinstance(outline, shapely.Polygon) or outline.area < LEAST_AREA:
        return None
    return shapely.get_coordinates(outline.exterior)[:-1]


def _covered(area: shapely.Geometry, shape: tuple[int, int]) -> Bool[np.ndarray, "k l"]:
    """Which cells have their middle in an area [m]."""
    rows, columns = (np.indices(shape) + 0.5) * CELL
    return shapely.contains_xy(area, rows.ravel(), columns.ravel()).reshape(shape)


def _disc(radius: float) -> Bool[np.ndarray, "k k"]:
    """The cells of a disc of a radius [cells]."""
    at = np.arange(-math.floor(radius), math.floor(radius) + 1)
    return at[:, None] ** 2 + at**2 <= radius**2


def _closed(mask: Bool[np.ndarray, "k l"], times: int) -> Bool[np.ndarray, "k l"]:
    """Without gaps of twice so many cells; beyond the edge it goes on as at the edge."""
    inner = (slice(times, -times),) * 2
    return binary_closing(np.pad(mask, times, mode="edge"), iterations=times)[inner]
