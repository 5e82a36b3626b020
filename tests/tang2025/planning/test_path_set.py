"""A path set joins start and goal keypoints by paths of one homotopy class that stay in free space."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cableway.core.errors import InputError, UnknownNameError
from cableway.geometry import polyline
from cableway.planning.config import PivotConfig
from cableway.planning.routes import band
from cableway.planning.routes.passages import crossings, find_passages, traversed_passages
from cableway.planning.routes.pivot import pivot_keypoint, plan_pivot_path
from cableway.records import Passage
from cableway.scene.obstacles import Box, Disc, Obstacle, Polygon
from cableway.scene.task import Task
from cableway.tang2025.planning.config import PathSetConfig
from cableway.tang2025.planning.path_set import PathSet, generate_path_set
from tests.problems import HIGH_ARC, LOW_ARC, beside_disc, doorway, free, task_between


def narrow_doorway() -> Task:
    """A wall of 1 cm with a gap of 22 mm."""
    obstacles: tuple[Obstacle, ...] = (
        Box(center=(0.15, 0.36), size=(0.3, 0.01)),
        Box(center=(0.511, 0.36), size=(0.378, 0.01)),
    )
    return task_between(LOW_ARC, HIGH_ARC, obstacles, name="narrow-doorway")


def clutter() -> Task:
    """Small obstacles all over, two of which overlap, and one that the goal cable goes round."""
    obstacles: tuple[Obstacle, ...] = (
        Disc(center=(0.2, 0.35), radius=0.02),
        Disc(center=(0.33, 0.33), radius=0.015),
        Box(center=(0.45, 0.38), size=(0.1, 0.01), angle=0.7),
        Polygon(vertices=np.array([[0.1, 0.42], [0.16, 0.43], [0.12, 0.46]])),
        Disc(center=(0.34, 0.34), radius=0.015),
        Disc(center=(0.33, 0.52), radius=0.01),
    )
    return task_between(LOW_ARC, HIGH_ARC, obstacles, name="clutter")


def beside_the_start() -> Task:
    """Walls 1 mm beside the start cable on both sides, which leave the way up only at its ends."""
    obstacles: tuple[Obstacle, ...] = (Box(center=(0.35, 0.1745), size=(0.12, 0.005)),)
    return task_between(LOW_ARC, HIGH_ARC, obstacles, name="beside-the-start")


TASKS = {
    "free": free,
    "beside-disc": beside_disc,
    "doorway": doorway,
    "narrow-doorway": narrow_doorway,
    "clutter": clutter,
    "beside-the-start": beside_the_start,
}


def pivot_of(task: Task) -> np.ndarray:
    middle = pivot_keypoint(task.cable.keypoints)
    return plan_pivot_path(task.scene, task.start[middle], task.goal[middle], task.cable.radius, PivotConfig())


def path_set_of(task: Task, **config: object) -> PathSet:
    made = PathSetConfig(**config)  # pyright: ignore[reportArgumentType]
    return generate_path_set(task, pivot_of(task), find_passages(task.scene), made)


def crossing_word(path: np.ndarray, rays: np.ndarray) -> list[int]:
    """Signed crossings of a path with rays along +x, in order, neighbours that cancel taken out.

    Two paths with common ends are homotopic exactly if the loop of the two has the empty word.
    """
    events: list[tuple[float, int]] = []
    for k, (x, y) in enumerate(rays, start=1):
        far = np.array([[x, y], [x + 10.0, y]])
        events += [(arc, k * int(sign)) for arc, sign in zip(*crossings(path, far), strict=True)]
    word: list[int] = []
    for _, letter in sorted(events):
        if word and word[-1] == -letter:
            word.pop()
        else:
            word.append(letter)
    return word


def rays_of(task: Task) -> np.ndarray:
    """The origin of one ray for each obstacle; no two at the same height."""
    points = band.reference_points(task.scene.world)
    return points + 1e-6 * np.arange(len(points))[:, None]


def along(cable: np.ndarray, first: int, last: int, pieces: int = 6) -> np.ndarray:
    """The cable's curve from one keypoint to another."""
    curve = polyline.spline(cable, pieces)
    a, b = first * pieces, last * pieces
    return curve[a : b + 1] if a <= b else curve[b : a + 1][::-1]


@pytest.mark.parametrize("name", TASKS)
def test_contract_ends_homotopy_clearance_spacing(name: str):
    """Ends exact; each path homotopic to start cable + pivot + goal cable; the radius kept; points evenly spaced."""
    task = TASKS[name]()
    path_set = path_set_of(task)
    middle = pivot_keypoint(task.cable.keypoints)
    assert path_set.paths.shape == (13, PathSetConfig().waypoints, 2)
    assert np.array_equal(path_set.paths[:, 0], task.start)
    assert np.array_equal(path_set.paths[:, -1], task.goal)
    assert task.scene.clearance(path_set.paths, task.cable.radius).min() >= 0
    for i, path in enumerate(path_set.paths):
        loop = np.vstack([along(task.start, i, middle), path_set.pivot, along(task.goal, middle, i), path[::-1]])
        assert crossing_word(loop, rays_of(task)) == []
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        assert np.ptp(steps) < 0.05 * steps.mean()


def test_the_word_tells_a_path_on_the_wrong_side():
    """The check above can fail: a way round the other side of the disc has another word."""
    task = beside_disc()
    path_set = path_set_of(task)
    mirrored = path_set.paths[6] * [-1, 1] + [2 * 0.34, 0]
    other = np.vstack([path_set.paths[6], mirrored[::-1]])
    assert crossing_word(other, rays_of(task)) != []


def test_without_obstacles_paths_are_nearly_straight():
    path_set = path_set_of(free())
    straight = np.linalg.norm(path_set.paths[:, -1] - path_set.paths[:, 0], axis=1)
    assert np.all(polyline.length(path_set.paths) < 1.1 * straight)


def test_the_same_input_gives_the_same_paths():
    task = doorway()
    assert np.array_equal(path_set_of(task).paths, path_set_of(task).paths)


def test_paths_spread_in_a_passage_but_not_beyond_what_fits():
    """A door of 90 mm, met face on: the paths take up most of it, in the order of the keypoints, inside the margin."""
    task, config = doorway(), PathSetConfig()
    path_set = path_set_of(task)
    door = path_set.passages[np.argmin(np.linalg.norm(np.diff(path_set.passages, axis=1), axis=2))]
    places = []
    for path in path_set.paths:
        arcs, _ = crossings(path, door)
        places.append(float(np.linalg.norm(polyline.point_at(path, arcs[:1])[0] - door[0])))
    width = float(np.linalg.norm(door[1] - door[0]))
    free_width = min(width - 2 * (task.cable.radius + config.margin), config.spread * task.cable.length)
    assert width == pytest.approx(0.09)
    assert 0.6 * free_width < np.ptp(places) <= free_width + 2e-3
    assert all(b > a for a, b in pairwise(places)) or all(b < a for a, b in pairwise(places))


def test_a_smaller_spread_gives_narrower_paths():
    task = doorway()
    widths = []
    for spread in (0.02, 0.5):
        path_set = path_set_of(task, spread=spread)
        door = path_set.passages[0]
        points = [polyline.point_at(path, crossings(path, door)[0][:1])[0] for path in path_set.paths]
        widths.append(np.linalg.norm(np.ptp(points, axis=0)))
    assert widths[0] < 0.5 * widths[1]


def test_a_margin_is_kept_where_there_is_room():
    task = doorway()
    near, far = (
        task.scene.clearance(path_set_of(task, margin=margin).paths, task.cable.radius).min()
        for margin in (0.002, 0.02)
    )
    assert far > 0.015
    assert far > near


def test_a_passage_that_the_goal_straddles_changes_nothing():
    """Its keypoints are on both sides already; a passage on the way there does change the paths."""
    task = free()
    pivot = pivot_of(task)
    near_the_end, half_way = polyline.point_at(pivot, float(polyline.length(pivot)) * np.array([0.95, 0.5]))
    aside = (task.goal[10] - near_the_end) / np.linalg.norm(task.goal[10] - near_the_end)
    straddled = Passage(np.array([near_the_end - 0.02 * aside, task.goal[10] + 0.02 * aside]), (0, 1))
    on_the_way = Passage(np.array([half_way - [0.03, 0.0], half_way + [0.03, 0.0]]), (0, 1))
    assert len(traversed_passages((straddled, on_the_way), pivot)) == 2
    alone, with_straddled, with_other = (
        generate_path_set(task, pivot, passages, PathSetConfig()).paths
        for passages in ((), (straddled,), (on_the_way,))
    )
    assert np.array_equal(with_straddled, alone)
    assert np.abs(with_other - alone).max() > 0.01


@pytest.mark.parametrize("kind", ["homotopic", "transfer"])
def test_start_at_goal_gives_paths_of_length_zero(kind: str):
    task = task_between(LOW_ARC, LOW_ARC, (Disc(center=(0.34, 0.4), radius=0.07),))
    path_set = path_set_of(task, kind=kind)
    assert np.array_equal(path_set.paths[:, 0], task.start)
    assert polyline.length(path_set.paths).max() < 1e-6


def test_transfer_is_linear_where_there_is_no_passage():
    """x_i(sigma) = x_p(sigma) + linear offset: the paper's equation, at equal shares of the pivot's length."""
    task = free()
    pivot = np.linspace(task.start[6], task.goal[6], 5)
    path_set = generate_path_set(task, pivot, (), PathSetConfig(kind="transfer", waypoints=11))
    for i in range(13):
        assert path_set.paths[i] == pytest.approx(np.linspace(task.start[i], task.goal[i], 11), abs=1e-12)


def test_transfer_fills_the_passage_up_to_the_obstacles():
    """The paper's p_w = min(p_d, alpha L) with p_d the smaller: the outer paths touch both sides of the door."""
    task = doorway()
    config = PathSetConfig(kind="transfer", waypoints=2001)
    pivot = pivot_of(task)
    path_set = generate_path_set(task, pivot, find_passages(task.scene), config)
    door = next(p for p, _ in traversed_passages(find_passages(task.scene), pivot) if p.width < 0.0901)
    line = door.ends + np.outer([-1.0, 1.0], 0.01 * (door.ends[1] - door.ends[0]))
    points = np.array([polyline.point_at(path, crossings(path, line)[0][:1])[0] for path in path_set.paths])
    assert np.linalg.norm(np.ptp(points, axis=0)) == pytest.approx(door.width, abs=1e-3)
    assert points.min(axis=0) == pytest.approx(door.ends.min(axis=0), abs=2e-3)


def test_a_pivot_that_does_not_fit_the_task_is_refused():
    task = free()
    with pytest.raises(InputError, match="from keypoint 6 of the start"):
        generate_path_set(task, task.start[[0, 6]], (), PathSetConfig())


def test_an_unknown_kind_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match="'linear'; known: homotopic, transfer"):
        PathSetConfig(kind="linear")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("name", "value", "wanted"),
    [
        ("waypoints", 4, "from 8 to 10000, got 4"),
        ("margin", -0.1, "finite and not negative, got -0.1"),
        ("spread", 1.5, "from 0 to 1, got 1.5"),
        ("shrink", 2.0, "from 0 to 1, got 2.0"),
    ],
)
def test_a_config_value_out_of_range_is_named(name: str, value: float, wanted: str):
    with pytest.raises(InputError, match=rf"path_set\.{name} must be {wanted}"):
        PathSetConfig(**{name: value})
