"""Tasks made in Python, and tasks written to a file and read again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import cableway
from cableway.core.errors import InputError, TaskError
from cableway.geometry import polyline, se2
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.clearance import body_clearance
from cableway.scene.files.loading import load_task, task_names
from cableway.scene.files.saving import save_task
from cableway.scene.grippers import Grippers, Plug, Port
from cableway.scene.obstacles import Box, Disc, Polygon
from cableway.scene.scene import Scene
from cableway.scene.task import RESUMED_STABILITY, RESUMED_TENSION, Task
from cableway.scene.validity import SPLINE_PIECES
from cableway.tasks.generation import random_task

LINE = np.column_stack([np.linspace(0.2, 0.5, 13), np.full(13, 0.1)])


def task(**changes: Any) -> Task:
    values: dict[str, Any] = {
        "name": "made",
        "scene": Scene(),
        "cable": Cable(),
        "start": LINE,
        "goal": LINE + np.array([0, 0.4]),
    }
    return Task(**{**values, **changes})


def test_a_task_keeps_copies_of_its_arrays():
    start = LINE.copy()
    made = task(start=start)
    start[:] = 0.0
    np.testing.assert_array_equal(made.start, LINE)


def test_tasks_are_equal_by_value():
    assert task() == task(scene=Scene((0.7, 0.7)), grippers=Grippers())
    assert task() != task(description="other")
    assert task() != task(goal=LINE + np.array([0, 0.3]))
    assert task() != "made"


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"name": ""}, r"^name must be letters, digits, spaces or any of \. _ \+ -, got ''$"),
        ({"name": "a/b"}, "^name must be letters"),
        ({"name": None}, "^name must be letters"),
        ({"start": LINE[:, 0]}, r"^start must be rows of 2 numbers, got an array of shape \(13,\)$"),
        ({"goal": [["a", "b"]] * 13}, "^goal must be rows of 2 numbers, got"),
        ({"goal": np.where(LINE == 0.1, np.nan, LINE)}, r"^goal\[0\]\[1\] must be finite, got nan$"),
        ({"goal_poses": np.zeros((3, 3))}, r"^goal_poses must be two poses \(x, y, theta\), got 3$"),
        ({"start_poses": np.zeros((2, 3))}, "^start_poses do not fit the keypoints: the left pose is 224 mm and 0"),
        ({"start_poses": [[0.2, 0.1, np.nan], [0.5, 0.1, 0]]}, r"^start_poses\[0\]\[2\] must be finite, got nan$"),
        ({"port": Port(position=(0.1, 0.1), angle=0, standoff=0, depth=0)}, "^port needs a plug$"),
    ],
)
def test_a_task_that_is_none_is_refused(changes: dict[str, Any], said: str):
    with pytest.raises(TaskError, match=said):
        task(**changes)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Cable(length=float("nan")), r"^cable\.length must be positive and finite, got nan$"),
        (lambda: Cable(radius=-1), r"^cable\.radius must be positive, got -1\.0$"),
        (lambda: Cable(keypoints=12.0), r"^cable\.keypoints must be a whole number, got 12\.0$"),  # pyright: ignore
        (lambda: Cable(keypoints=201), r"^cable\.keypoints must be from 3 to 200, got 201$"),
        (lambda: Cable(friction=float("inf")), r"^cable\.friction must be not negative and finite, got inf$"),
        (lambda: Cable(length="long"), r"^cable\.length must be a number, got 'long'$"),  # pyright: ignore
        (lambda: Grippers(max_turn=0.0), r"^grippers\.max_turn must be positive, got 0\.0$"),
        (lambda: Grippers(separation=-0.1), r"^grippers\.separation must be not negative, got -0\.1$"),
        (lambda: Plug(length=0.0, width=0.1), r"^plug\.length must be positive, got 0\.0$"),
        (lambda: Port(position=(0, 0), angle=0, standoff=-1, depth=0), r"^port\.standoff must be not negative, got"),
    ],
)
def test_parts_that_are_none_are_refused(make: Any, said: str):
    with pytest.raises(TaskError, match=said):
        make()


def test_stated_poses_may_turn_fully():
    poses = np.array([[0.2, 0.1, 2 * np.pi], [0.5, 0.1, 0.1]])
    np.testing.assert_array_equal(task(start_poses=poses).start_poses, poses)


def test_the_fit_of_a_start_is_the_rod_nearest_to_it():
    q, distance = task().start_equilibrium, task().equilibrium_distances[0]
    np.testing.assert_allclose(q, [0.35, 0.1, 0, 0, 0, 0], atol=1e-6)
    assert distance < 1e-9


def test_the_top_of_the_package_has_the_tasks():
    assert cableway.load_task is load_task
    assert (cableway.Task, cableway.Scene, cableway.Cable) == (Task, Scene, Cable)


# ------------------------------------------------------------------------------------------------ saving
@pytest.mark.parametrize("name", task_names())
def test_the_catalogue_is_saved_and_read_unchanged(tmp_path: Path, name: str):
    before = load_task(name)
    save_task(before, tmp_path / "task.yaml")
    assert load_task(tmp_path / "task.yaml") == before


def full_task(**changes: Any) -> Task:
    """Every field is there, with numbers that have no short decimal form."""
    rod = PlanarRod(1 / 3, 10)
    q = np.array([[0.35, 0.15, 0.1, 4.0, 2.0, 1.0], [0.35, 0.55, -0.1, 2.0, 4.0, -1.0]])
    stations, poses = rod.shapes(q)
    start, goal = rod.at_keypoints(stations)
    before = poses[1, 1, :2] + (0.04 + 1 / 30) * se2.direction(poses[1, 1, 2])
    obstacles = (
        Box(center=(1 / 3, 0.37), size=(np.pi / 30, 0.03), angle=-1e-7),
        Polygon(vertices=np.array([[0.1, 0.3], [0.1 + 1 / 7, 0.3], [0.15, 0.4]])),
        Disc(center=(0.6, 0.1), radius=1 / 70),
    )
    values: dict[str, Any] = {
        "name": "made 1",
        "description": "First: with 'quotes', # and é.",
        "scene": Scene((0.7, 2 / 3), obstacles),
        "cable": Cable(
            length=1 / 3,
            radius=0.003,
            keypoints=10,
            bending_stiffness=1e-5 / 3,
            stiffness_profile=(1 / 3, 1.0, 3.0),
            rest_curvature=(-1 / 7, 2.0),
            yield_curvature=20 / 3,
            friction=0.1,
            drag=1 / 9,
        ),
        "grippers": Grippers(
            radius=0.005,
            max_step=0.01,
            max_turn=0.1,
            separation=0.02,
            max_acceleration=1 / 3,
            max_turn_acceleration=10 / 3,
            max_jerk=20 / 3,
            max_turn_jerk=200 / 3,
        ),
        "start": start,
        "goal": goal,
        "start_poses": poses[0],
        "goal_poses": poses[1],
        "plug": Plug(length=0.04, width=0.01),
        "port": Port(position=tuple(before), angle=float(poses[1, 1, 2]), standoff=1 / 30, depth=0.0),
    }
    return Task(**{**values, **changes})


def test_every_field_is_saved_to_the_last_digit(tmp_path: Path):
    before = full_task()
    save_task(before, tmp_path / "task.yaml")
    after = load_task(tmp_path / "task.yaml")
    assert after == before
    assert after.start.tobytes() == before.start.tobytes()


def test_a_shape_that_the_rod_found_is_saved_as_it_is(tmp_path: Path):
    path = tmp_path / "bent.yaml"
    poses = "[[0.2, 0.1, 0.5], [0.45, 0.1, -0.5]]"
    path.write_text(f"cableway: 1\nstart: {{grippers: {poses}, bend: left}}\ngoal: {LINE.tolist()}\n")
    before = load_task(path)
    save_task(before, tmp_path / "again.yaml")
    after = load_task(tmp_path / "again.yaml")
    assert after == before
    np.testing.assert_array_equal(after.start_poses, [[0.2, 0.1, 0.5], [0.45, 0.1, -0.5]])


def test_a_preset_of_ones_own_is_not_saved_but_its_values_are(tmp_path: Path):
    save_task(task(cable=Cable(preset="mine", friction=0.2)), tmp_path / "task.yaml")
    assert load_task(tmp_path / "task.yaml").cable == Cable(friction=0.2)


@settings(deadline=None, derandomize=True, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.text(st.characters(exclude_categories=["Cs"])) | st.sampled_from(["1e3", "on", "~", "0x1F", ".5", "a: b", "#"])
)
def test_any_description_comes_back(tmp_path: Path, text: str):
    save_task(task(description=text), tmp_path / "task.yaml")
    assert load_task(tmp_path / "task.yaml").description == text


def test_a_file_is_saved_whole_or_not_at_all(tmp_path: Path):
    save_task(task(), tmp_path / "sub" / "task.yaml")
    before = (tmp_path / "sub" / "task.yaml").read_bytes()
    broken = task()
    object.__setattr__(broken, "description", object())
    with pytest.raises(Exception, match="cannot represent an object"):
        save_task(broken, tmp_path / "sub" / "task.yaml")
    assert (tmp_path / "sub" / "task.yaml").read_bytes() == before
    assert [path.name for path in (tmp_path / "sub").iterdir()] == ["task.yaml"]
    assert issubclass(TaskError, InputError)


GAP = 0.004
"""[m] between the line and the disc beside it."""


@pytest.mark.parametrize("depth", [0.003, 0.0005, -0.0005])
def test_a_cable_that_touches_something_is_resumed_from_just_beside_it(depth):
    """The start is moved off, by little more than the overlap."""
    disc = Disc(center=(0.35, 0.1 + Cable().radius + GAP + 0.02), radius=0.02)
    measured = LINE + [0.0, GAP + depth]
    resumed = task(scene=Scene(obstacles=(disc,))).resumed_from(measured)
    assert float(resumed.scene.clearance(resumed.start[None], resumed.cable.radius)[0]) > 0.0008
    assert np.linalg.norm(resumed.start - measured, axis=1).max() < depth + 0.003


@pytest.fixture(scope="module")
def made():
    """A task with hands whose fingers are short."""
    return next(made for seed in range(9) if (made := random_task(seed, "posts")).grippers.body == "2f-85")


@pytest.mark.parametrize("side", [-1, 1])
def test_a_hand_in_a_post_is_resumed_from_just_beside_it(made, side):
    """A gripper pose is known as well as the end of the cable is seen."""
    x, y, angle = made.gripper_poses("start")[0]
    center = np.array([x, y]) + side * (0.0635 + 0.02 - 0.004) * se2.direction(angle + np.pi / 2)
    post = Disc(center=(float(center[0]), float(center[1])), radius=0.02, height=0.09)
    seen = made.in_scene(Scene((0.8, 0.8), (post,), 0.001))
    resumed = seen.resumed_from(made.start)
    before, after = (
        min(body_clearance(body, each.gripper_poses("start")[None], seen.scene)[0] for body in made.grippers.pieces)
        for each in (seen, resumed)
    )
    assert before < 0 < after
    assert np.linalg.norm(resumed.start - made.start, axis=1).max() < 0.01


def test_a_cable_deep_in_something_is_not_resumed():
    """Moving it off would be a motion of its own."""
    disc = Disc(center=(0.35, 0.1 + Cable().radius + GAP + 0.1), radius=0.1)
    with pytest.raises(TaskError, match="start overlaps"):
        task(scene=Scene(obstacles=(disc,))).resumed_from(LINE + [0.0, 0.05])


def test_a_task_is_resumed_with_the_cable_as_it_turned_out_to_be():
    """5% shorter and curled: start and goal become shapes of that cable, near what is seen and wanted."""
    cable = Cable().estimated(0.285, (0.4, -0.3, 0.0, 0.0, 0.6, -0.8, 0.0, 0.0))
    q = np.array([[0.35, 0.12, 0.1, -4.0, 8.0, 1.0]])
    seen = cable.rod.at_keypoints(cable.rod.shapes(q)[0])[0]
    resumed = task().resumed_from(seen, cable)
    assert resumed.cable is cable
    np.testing.assert_allclose(resumed.start, seen, atol=1e-6)
    assert max(resumed.equilibrium_distances) < 1e-3
    assert 0 < np.linalg.norm(resumed.goal - task().goal, axis=1).max() < 0.03


def test_a_start_about_to_snap_is_made_a_little_more_stable():
    cable = Cable().estimated(0.3, (0.0,) * 8)
    q = np.array([0.35, 0.2, 0.0, -33.0, 6.0, 0.0])
    margin = cable.rod.stability(q[None])[0][0]
    assert 0 < margin < RESUMED_STABILITY - 2
    seen = cable.rod.at_keypoints(cable.rod.shapes(q[None])[0])[0]
    resumed = task().resumed_from(seen, cable)
    assert cable.rod.stability(resumed.start_equilibrium[None])[0][0] > RESUMED_STABILITY - 1
    assert np.linalg.norm(resumed.start - seen, axis=1).max() < 0.01


def test_a_cable_that_touches_itself_is_refused_before_any_search():
    """A loop whose ends lie 6 mm apart, which is less than the cable is thick."""
    angles = np.linspace(0, 1.93 * np.pi, 13)
    radius = 0.3 / (1.93 * np.pi)
    loop = np.array([0.35, 0.35]) + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    gap = np.linalg.norm(loop[-1] - loop[0])
    thin, thick = (Cable(radius=share * gap / 2) for share in (0.9, 1.1))
    grippers = Grippers(radius=0.001, separation=0.001)
    task(start=loop, cable=thin, grippers=grippers)
    with pytest.raises(TaskError, match=r"start touches itself near \([\d.]+, [\d.]+\) mm.*twice cable\.radius"):
        task(start=loop, cable=thick, grippers=grippers)


@pytest.mark.parametrize("load", [(-24.0, -62.0, -3.0), (-38.0, -31.0, 0.0)])
def test_a_start_that_would_snap_is_resumed_from_the_nearest_shape_that_does_not(load):
    """Between the same grippers the stable one is more than 30 mm away."""
    rod, q = Cable().rod, np.array([0.35, 0.35, 0.0, *load])
    assert rod.stability(q[None])[0][0] < 0
    seen = rod.at_keypoints(rod.shapes(q[None])[0])[0]
    resumed = task().resumed_from(seen)
    assert rod.stability(resumed.start_equilibrium[None])[0][0] > RESUMED_STABILITY - 1
    assert np.linalg.norm(resumed.start - seen, axis=1).max() < 0.015


def test_a_cable_that_is_pulled_taut_is_resumed_from_where_it_is_less_so():
    """What bends lies between the outermost keypoints, where a spline through them takes a shorter way."""
    rod = Cable().rod
    seen = rod.at_keypoints(rod.shapes(np.array([[0.35, 0.35, -1.7, 570.0, 0.0238, -0.0002]]))[0])[0]
    assert polyline.arc_length(polyline.spline(seen, SPLINE_PIECES))[-1] < 0.98 * 0.3
    np.testing.assert_array_equal(task(start=seen).start, seen)
    resumed = task().resumed_from(seen)
    assert resumed.start_equilibrium[3] == pytest.approx(RESUMED_TENSION, rel=0.02)
    assert np.linalg.norm(resumed.start - seen, axis=1).max() < 0.006
    with pytest.raises(TaskError, match="start is 290 mm long"):
        task(start=LINE * [290 / 300, 1.0] + [0.02, 0.0])


@pytest.mark.parametrize("name", ["start", "goal"])
def test_a_task_cannot_be_overwritten_in_place(name: str):
    """Whoever is given a task to solve cannot move its goal to where the cable is."""
    with pytest.raises(ValueError, match="read-only"):
        getattr(task(), name)[:] = 0.0
