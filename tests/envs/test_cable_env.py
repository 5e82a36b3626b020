"""The environment keeps Gymnasium's rules, tells the truth, and its expert knows what to do."""

from __future__ import annotations

import re
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

import cableway.envs  # noqa: F401
from cableway.benchmark.suites import frozen_episodes
from cableway.core.errors import InputError, UnknownNameError
from cableway.envs.cable import SETTLED, CableEnv
from cableway.outcome import SUCCESS_ERROR
from cableway.perception.placement import camera_at
from cableway.perception.segmentation import cable_mask
from cableway.perception.views import View, axis_points
from cableway.tasks.generation import FIRST_SEED
from cableway.tracking.photographer import ORANGE, EyesConfig

ID = "cableway/Cable-v0"
TASK = "single-obstacle-2"
SEED = re.compile(r"-(\d+)")
ASIDE = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], np.float32)


@pytest.fixture(scope="module")
def led() -> tuple[list[tuple[dict[str, Any], float, bool, bool, dict[str, Any]]], CableEnv]:
    """An episode that the expert leads."""
    env = CableEnv(TASK, expert="rod-mpc", perturbations="hard", render_mode="rgb_array")
    _, info = env.reset(seed=3)
    steps = []
    while not steps or not steps[-1][2]:
        steps.append(env.step(info["expert_action"]))
        info = steps[-1][-1]
        assert len(steps) < 300
    return steps, env


def test_gymnasium_finds_nothing_wrong():
    images = EyesConfig(cameras=("front", "above"), picture=(64, 48))
    check_env(gymnasium.make(ID, task=TASK, images=images, render_mode="rgb_array").unwrapped)


def test_the_expert_leads_the_cable_to_its_goal(led: tuple[list[Any], CableEnv]):
    steps, env = led
    infos = [step[-1] for step in steps]
    assert [info["success"] for info in infos] == [False] * (len(steps) - 1) + [True]
    assert all(info["error"] < SUCCESS_ERROR for info in infos[-SETTLED:])
    assert not infos[-SETTLED - 1]["error"] < SUCCESS_ERROR
    assert min(info["clearance"] for info in infos) > 0
    assert sum(step[1] for step in steps) == pytest.approx(2.0, abs=0.05), "all of the way, and 1 for success"
    seen = steps[-1][0]
    assert np.linalg.norm(seen["keypoints"] - seen["goal"]) < 2 * SUCCESS_ERROR
    np.testing.assert_allclose(seen["grippers"][:, :2], seen["goal_grippers"][:, :2], atol=0.02)
    picture = env.render()
    assert picture is not None
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10


def test_an_expert_that_is_not_followed_waits_for_the_cable():
    """What it wants is the same after the grippers stood still, and it is not asked to catch up."""
    env = CableEnv(TASK, expert="open-loop")
    _, info = env.reset(seed=0)
    for _ in range(20):  # past the hold at the start
        _, _, _, _, info = env.step(info["expert_action"])
    wanted = info["expert_action"]
    assert np.abs(wanted).max() > 0.05
    for _ in range(30):
        _, _, _, _, info = env.step(np.zeros((2, 3)))
    np.testing.assert_allclose(info["expert_action"], wanted, atol=1e-6)


def test_pictures_show_the_cable_where_it_is():
    env = CableEnv(TASK, images=EyesConfig(cameras=("left", "above"), picture=(320, 240)))
    seen, _ = env.reset(seed=0)
    camera = camera_at("above", env._task.scene.size, (320, 240))
    for _ in range(2):
        picture, truth = seen["images"][1], env._truth.keypoints
        assert env.observation_space.contains(seen)
        points = axis_points(View(camera, cable_mask(picture, ORANGE)), env._task.cable.radius)
        assert len(points) > 30
        assert np.linalg.norm(points[:, None] - env._truth.centreline, axis=2).min(axis=1).max() < 0.01
        assert np.median(np.linalg.norm(points[:, None] - truth, axis=2).min(axis=0)) < 0.005
        for _ in range(10):
            seen, *_ = env.step(ASIDE)


def test_a_seed_makes_an_episode():
    images = EyesConfig(cameras=("above",), picture=(64, 48), strangers=("cable",))
    env = CableEnv(kind="open-near", perturbations=("nominal", "hard", "noise-2"), images=images)
    first, info = env.reset(seed=7)
    moved = env.step(ASIDE)
    again, same = env.reset(seed=7)
    assert same == info
    np.testing.assert_equal(again, first)
    assert (first["images"] != moved[0]["images"]).any()
    without = CableEnv(kind="open-near", perturbations=("nominal", "hard", "noise-2")).reset(seed=7)[0]
    np.testing.assert_equal(without, {key: value for key, value in first.items() if key != "images"})
    np.testing.assert_equal(env.step(ASIDE)[0], moved[0])
    assert env.reset()[1]["task"] != info["task"]


def test_contact_ends_an_episode_and_is_no_success():
    env = CableEnv(TASK)
    env.reset(seed=0)
    steps = [env.step(ASIDE)]
    while not steps[-1][2]:
        steps.append(env.step(ASIDE))
        assert len(steps) < 200
    _, reward, _, _, info = steps[-1]
    assert info["failure"] == "the cable or a gripper touched something"
    assert info["clearance"] <= 0
    assert not info["success"]
    assert reward < -0.9


def test_an_obstacle_that_appears_is_on_the_map_once_it_is_known():
    env = CableEnv(TASK, perturbations="fault-appears")
    before, _ = env.reset(seed=1)
    maps = [env.step(np.zeros((2, 3)))[0]["clearance"] for _ in range(40)]
    np.testing.assert_array_equal(maps[0], before["clearance"])
    assert (maps[-1] < maps[0] - 0.01).any()
    assert (maps[-1] <= maps[0]).all()


def test_random_tasks_are_none_of_the_benchmark():
    class Least:
        """Draws the least of all."""

        def integers(self, most: int) -> int:
            return 0

        def choice(self, among: Any) -> Any:
            return among[0]

    env = CableEnv(kind="open-near")
    env.np_random = Least()  # pyright: ignore[reportAttributeAccessIssue]
    _, info = env.reset()
    assert info["task"] == f"open-near-{FIRST_SEED}"
    assert all(
        int(number) < FIRST_SEED for each in frozen_episodes("unconstrained") for number in SEED.findall(each.task)
    )


def test_clearance_is_that_of_the_scene():
    env = CableEnv(TASK)
    seen, _ = env.reset(seed=0)
    (obstacle,) = env._task.scene.solids
    size = seen["workspace"]
    row, column = (np.array(obstacle.centroid.coords[0])[::-1] / size[::-1] * len(seen["clearance"])).astype(int)
    assert seen["clearance"][row, column] < 0
    assert seen["clearance"][0, 0] > 0


def test_episodes_go_on_side_by_side():
    envs = SyncVectorEnv([lambda: CableEnv(kind="open-near")] * 2)
    seen, _ = envs.reset(seed=[1, 2])
    assert seen["keypoints"].shape == (2, 13, 2)
    _, rewards, _, _, info = envs.step(np.stack([ASIDE, -ASIDE]))
    assert rewards.shape == (2,)
    assert info["error"].shape == (2,)


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ({"kind": "heap"}, UnknownNameError, "kind of random task"),
        ({"perturbations": "soft"}, UnknownNameError, "plant"),
        ({"perturbations": ()}, InputError, "one plant at least"),
        ({"expert": "me"}, UnknownNameError, "controller"),
        ({"render_mode": "human"}, UnknownNameError, "render_mode"),
    ],
)
def test_what_is_not_known_is_refused(given: dict[str, Any], error: type[Exception], said: str):
    with pytest.raises(error, match=said):
        CableEnv(**given)


def test_bad_options_and_actions_are_refused():
    env = CableEnv(TASK)
    with pytest.raises(InputError, match="no option 'cable'"):
        env.reset(options={"cable": 1})
    with pytest.raises(InputError, match="insertion has a port"):
        env.reset(options={"task": "insertion"})
    env.reset(options={"task": "maze-1"})
    for action in (np.zeros(6), np.full((2, 3), np.nan)):
        with pytest.raises(InputError, match=r"\(2, 3\) finite numbers"):
            env.step(action)
