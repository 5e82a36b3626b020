"""The cost over the horizon: its derivative, its terms, and the box of actions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from quasi_static import outward, straight_plan, task_for

from cableway.core.errors import InputError
from cableway.geometry import convex
from cableway.rod.planar import PlanarRod
from cableway.scene.obstacles import Box, Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Grippers, Task
from cableway.tang2025.control import terms
from cableway.tang2025.control.horizon import ActionBox, HorizonCost, Target
from cableway.tang2025.control.mpc_config import MPCConfig

PLAN = straight_plan(PlanarRod(0.3))
FREE = task_for(PLAN)
H = 5


def crowded() -> Task:
    """A disc 3 mm from the middle of the planned cable's surface, a box 2 mm from the right gripper's."""
    line = PLAN.shapes[0]
    normal = outward(line)
    beside = line[6] + normal * (0.004 + 0.003 + 0.01)
    ahead = line[-1] + (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2]) * (0.004 + 0.002 + 0.005)
    angle = float(PLAN.poses[0, 1, 2])
    return task_for(
        PLAN,
        (
            Disc(center=(beside[0], beside[1]), radius=0.01),
            Box(center=(ahead[0], ahead[1]), size=(0.01, 0.02), angle=angle),
        ),
    )


def linear_shapes(actions: np.ndarray, derivative: np.ndarray) -> np.ndarray:
    return PLAN.shapes[0] + derivative @ actions.ravel()


@pytest.mark.parametrize("config", [MPCConfig(soft_span=0.1), MPCConfig.paper()], ids=["ours", "paper"])
def test_derivative_matches_finite_differences(config: MPCConfig) -> None:
    rng = np.random.default_rng(0)
    task = crowded()
    cost = HorizonCost(task, config)
    by_actions = rng.normal(size=(H, 13, 2, 6 * H)) * 0.3
    target = Target(PLAN.shapes[1 : H + 1], PLAN.poses[1 : H + 1], np.diff(PLAN.poses[: H + 1], axis=0))
    actions = rng.normal(size=(H, 2, 3)) * 1e-4

    def parts(actions: np.ndarray) -> list[terms.Term]:
        return cost.terms(linear_shapes(actions, by_actions), PLAN.poses[0], actions, target)

    found = parts(actions)
    assert all(len(residual) > 0 for residual, _ in found[:5]), "a term has nothing to test"
    rows = [derivative(by_actions) for _, derivative in found]
    step = 1e-7
    for k in range(actions.size):
        nudge = np.zeros(actions.size)
        nudge[k] = step
        nudge = nudge.reshape(actions.shape)
        for plus, minus, row in zip(parts(actions + nudge), parts(actions - nudge), rows, strict=True):
            numeric = (plus[0] - minus[0]) / (2 * step)
            np.testing.assert_allclose(row[:, k], numeric, rtol=2e-4, atol=2e-4 * (1 + np.abs(row).max(initial=0.0)))


def test_the_cost_is_zero_on_the_plan() -> None:
    cost = HorizonCost(FREE, MPCConfig())
    actions = np.diff(PLAN.poses[: H + 1], axis=0)
    target = Target(PLAN.shapes[1 : H + 1], PLAN.poses[1 : H + 1], actions)
    for residual, _ in cost.terms(target.shapes, PLAN.poses[0], actions, target):
        np.testing.assert_allclose(residual, 0.0, atol=1e-12)


@pytest.mark.parametrize("profile", ["hinge", "barrier"])
def test_clearance_cost_starts_smoothly_and_grows_inward(profile: terms.Profile) -> None:
    world = convex.pack([np.array([[0.3, 0.3]])], [0.05], (0.7, 0.7))
    radius, threshold = 0.004, 0.005
    phi = np.array([0.006, 0.0049999, 0.003, 0.001, 0.0002, 0.0, -0.003])
    points = np.column_stack([0.3 + 0.05 + radius + phi, np.full(len(phi), 0.3)])
    residual, by_points, near = terms.clearance(points, world, radius, threshold, 0.01, profile)
    np.testing.assert_array_equal(near, np.arange(1, len(phi)))
    assert residual[0] == pytest.approx(0.0, abs=1e-2 * residual[1])
    assert np.isfinite(residual).all()
    assert (np.diff(residual) > 0).all()
    assert (by_points[:, 0] < 0).all(), "moving away must lessen the cost"


def test_the_barrier_is_that_of_the_paper_near_contact() -> None:
    world = convex.pack([], [], (0.7, 0.7))
    residual, _, _ = terms.clearance(np.array([[0.0006, 0.3]]), world, 0.0, 0.005, 0.01, "barrier")
    assert 0.5 * residual[0] ** 2 == pytest.approx(0.01 / 0.0006**2, rel=0.25)


def test_points_between_keypoints_are_seen() -> None:
    line = PLAN.shapes[0]
    between = (line[5] + line[6]) / 2
    task = replace(
        FREE,
        scene=Scene(obstacles=(Disc(center=(between[0], between[1] + 0.0115), radius=0.003),)),
        start=PLAN.shapes[0] - [0.0, 0.01],
    )
    target = Target(PLAN.shapes[[0] * H], PLAN.poses[[0] * H], np.zeros((H, 2, 3)))
    sizes = {}
    for pieces in (1, 4):
        cost = HorizonCost(task, MPCConfig(pieces=pieces))
        sizes[pieces] = len(cost.terms(target.shapes, PLAN.poses[0], target.actions, target)[3][0])
    assert sizes[4] > sizes[1]


def test_the_box_lies_inside_the_allowed_disc_and_contains_the_wanted_step() -> None:
    rng = np.random.default_rng(2)
    grippers = Grippers()
    wanted = rng.normal(size=(H, 2, 3)) * 0.003
    wanted[0] = 0.0
    box = ActionBox.around(wanted, grippers)
    for _ in range(200):
        actions = box.actions(box.bound * rng.choice([-1.0, 1.0], box.bound.size))
        assert np.linalg.norm(actions[..., :2], axis=-1).max() <= grippers.max_step * (1 + 1e-12)
        assert np.abs(actions[..., 2]).max() <= grippers.max_turn * (1 + 1e-12)
    assert (np.abs(box.unknowns(wanted)) <= box.bound).all()
    np.testing.assert_allclose(box.actions(box.unknowns(wanted)), wanted, atol=1e-15)


def test_at_full_planned_speed_there_is_room_to_correct() -> None:
    grippers = Grippers()
    wanted = np.zeros((1, 2, 3))
    wanted[..., :2] = 0.7 * grippers.max_step * np.array([0.6, 0.8])
    box = ActionBox.around(wanted, grippers)
    room = box.bound[:2] * grippers.max_step
    assert room[0] >= 0.85 * grippers.max_step
    assert room[1] >= 0.3 * grippers.max_step


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("horizon", 0, "horizon must be whole and positive, got 0"),
        ("tracking_weight", float("nan"), "tracking_weight must be finite and positive, got nan"),
        ("obstacle_weight", -1.0, "obstacle_weight must be finite and not negative, got -1.0"),
        ("offset_gain", 1.5, "offset_gain must be from 0 to 1, got 1.5"),
        ("profile", "wall", "unknown profile 'wall'; known: barrier, hinge"),
    ],
)
def test_settings_out_of_range_are_refused(field: str, value: float | str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        MPCConfig(**{field: value})  # pyright: ignore[reportArgumentType]
