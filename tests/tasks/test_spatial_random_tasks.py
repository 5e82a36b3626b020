"""Laws of random tasks in space: ends keep margins, something stands in the way, a seed makes the same file."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from cableway.core.errors import FileFormatError, InputError, TaskError, UnknownNameError
from cableway.geometry.spatial_convex import signed_distance
from cableway.motion.spatial import SpatialBodies
from cableway.scene.files.loading import load_task
from cableway.scene.files.presets import preset_names
from cableway.scene.files.saving import task_text
from cableway.scene.spatial.obstacles import Cuboid, Prism
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.spatial.validity import unbounded
from cableway.scene.task import ENDS
from cableway.tasks.space.generation import (
    CLEARANCE,
    LENGTH,
    SPATIAL_KINDS,
    STABILITY,
    random_cable,
    random_spatial_task,
)
from cableway.tasks.space.obstacles import scene_of, yu_scene

SEEDS = {"space-clutter": 0, "space-dense": 10, "window": 6, "lift": 11, "extruded": 4, "yu": 5}
"""That are drawn quickly."""


@pytest.fixture(scope="module", params=list(SPATIAL_KINDS))
def task(request: pytest.FixtureRequest) -> SpatialTask:
    return random_spatial_task(SEEDS[request.param], request.param)


def test_ends_keep_their_margins(task: SpatialTask):
    for end in ENDS:
        kept = task.kept(end)
        assert kept["cable_clearance"] >= CLEARANCE - 2e-4  # at its stations; between them it may be a little nearer
        assert kept["gripper_clearance"] >= CLEARANCE - 1e-9
        assert kept["stability"] >= STABILITY
        assert 2 * task.grippers.radius < kept["span"] < 0.97 * LENGTH


def test_something_stands_in_the_straight_way(task: SpatialTask):
    rows = task.rod.between(task.start[None], task.goal[None], np.linspace(0, 1, 1000))
    stations, poses = task.rod.shapes(rows)
    world = unbounded(task.scene.world.solids)
    cable = signed_distance(stations, world)[0].min() - task.cable.radius
    assert min(cable, signed_distance(poses[..., :3], world)[0].min() - task.grippers.radius) < 0


def test_a_seed_makes_the_same_file(task: SpatialTask, tmp_path: Path):
    kind, _, seed = task.name.rpartition("-")
    assert task_text(random_spatial_task(int(seed), kind)) == task_text(task)
    path = tmp_path / "task.yaml"
    task.save(path)
    assert load_task(path) == task


def test_weights_reach_from_light_to_heavy():
    cables = [random_cable(np.random.default_rng(seed)) for seed in range(60)]
    assert {cable.preset for cable in cables} == {None, *preset_names()}
    weights = [cable.weight for cable in cables if cable.preset is None]
    assert 2 <= min(weights) < 4
    assert 50 < max(weights) <= 100


def test_lifted_cables_begin_and_end_close_to_the_table():
    task = random_spatial_task(0, "lift")
    for end in ENDS:
        lowest = min(
            task.stations(end)[:, 2].min() - task.cable.radius,
            task.gripper_poses(end)[:, 2].min() - task.grippers.radius,
        )
        assert 0.008 < lowest < 0.051


@pytest.mark.parametrize("kind", ["space-clutter", "lift"])
def test_hands_have_room_at_both_ends(kind: str):
    task = random_spatial_task(5001, kind, body="2f-85")
    assert task.name == f"{kind}-2f-85-5001"
    assert task.grippers.body == "2f-85"
    hands = SpatialBodies.of(task.bodies, task.cable.radius)
    stations, poses = task.rod.shapes(np.array([task.start, task.goal]))
    away = hands.hull_gaps(poses, stations, task.scene.world, task.cable.length, np.full(3, 1.0))[0]
    assert (away.min(axis=(0, 1)) >= [CLEARANCE, CLEARANCE, task.cable.radius + CLEARANCE / 2]).all()
    if kind == "lift":
        assert (hands.hulls.placed(poses)[..., 2].min(axis=1) < 0.051).any()


def test_windows_are_as_wide_as_asked():
    for seed, width in ((0, None), (2, None), (0, 0.1)):
        left, right, below, above = random_spatial_task(seed, "window", width=width).scene.obstacles
        assert isinstance(left, Cuboid)
        assert isinstance(right, Cuboid)
        wide = right.center[1] - right.size[1] / 2 - left.center[1] - left.size[1] / 2
        assert wide == pytest.approx(width or (0.35, 0.25, 0.18)[seed] * LENGTH, abs=1e-4)
        assert above.center[2] - above.size[2] / 2 - below.center[2] - below.size[2] / 2 == pytest.approx(wide)


def test_the_catalogue_is_extruded_with_heights_and_without():
    low, endless = (random_spatial_task(seed, "extruded").scene.obstacles for seed in (4, 15))
    assert [each.section.vertices.tolist() for each in low] == [each.section.vertices.tolist() for each in endless]
    assert all(isinstance(each, Prism) and each.section.height is None for each in endless)
    assert all(each.section.height for each in low)


def test_yus_scenes_are_theirs_moved_to_the_origin():
    place = Path(str(resources.files("cableway.tasks.space"))) / "yu"
    assert "Mingrui Yu" in (place / "LICENSE").read_text()
    for number, count in enumerate((7, 2, 2, 19)):
        given, scene = json.loads((place / f"scene_{number}.json").read_text()), yu_scene(number)
        assert len(scene.obstacles) == count
        np.testing.assert_allclose(scene.size, np.subtract(*(given["workspace"][key] for key in ("high", "low"))))
        for box, obstacle in zip(given["boxes"], scene.obstacles, strict=True):
            np.testing.assert_allclose(np.add(obstacle.center, given["workspace"]["low"]), box["center"], atol=1e-4)
            np.testing.assert_allclose(obstacle.size, box["size"], atol=1e-4)
    with pytest.raises(FileFormatError, match="not a scene with workspace"):
        scene_of({"boxes": []}, "scene.json")


def test_what_is_asked_wrongly_is_said():
    with pytest.raises(UnknownNameError, match="known: extruded, lift"):
        random_spatial_task(0, "clutter")
    with pytest.raises(InputError, match="seed must not be negative"):
        random_spatial_task(-1, "lift")
    with pytest.raises(TaskError, match=r"grippers\.body must be one of disc, 2f-85,"):
        random_spatial_task(0, "lift", body="claw")
    with pytest.raises(InputError, match="width is not for lift"):
        random_spatial_task(0, "lift", width=0.1)
    with pytest.raises(InputError, match=r"width of window must be from 0\.05 to 0\.3 m"):
        random_spatial_task(0, "window", width=0.5)
