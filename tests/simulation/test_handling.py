"""Arms that take hold of the cable where it lies and let go of it: what they hold, what they miss, what they lose."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import cableway as cw
from cableway.control.open_loop import OpenLoop
from cableway.core.errors import GraspError, SimulationError
from cableway.outcome import Outcome
from cableway.robot.cell_kinematics import CellKinematics
from cableway.robot.grasping import RISE
from cableway.scene.cell import Way
from cableway.simulation.handling import HandlingPlant
from cableway.simulation.perturbations.faults import FaultConfig
from cableway.simulation.perturbations.grasp import HOLD, GraspConfig
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.table_plant import TableConfig
from cableway.tracking import track

TASK = cw.random_task(6, "cell")
PLAN = cw.plan(TASK, seed=0)
COARSE = TableConfig(segments=12, time_step=0.005, friction=0.0)
OPENING = PLAN.metadata["arms"]["opening"]


def plant_of(**grasp: object) -> HandlingPlant:
    config = GraspConfig(**grasp)  # pyright: ignore[reportArgumentType]
    plant = Perturbation(grasp=config, table=COARSE).build(TASK, plan=PLAN).plant
    assert isinstance(plant, HandlingPlant)
    return plant


def held(plant: HandlingPlant, opening: float = OPENING[0]) -> HandlingPlant:
    """The plant once its arms hold the cable; they are lowered in three steps here, which is fast."""
    assert PLAN.approach is not None
    plant.take_hold(PLAN.approach[[0, 5, 10, -1]], opening)
    return plant


def gripped(plant: HandlingPlant) -> list[bool]:
    names = ("left", "right", "left clip", "right clip")
    return [bool(plant._data.eq_active[plant.model.equality(name).id]) for name in names]


def heights(plant: HandlingPlant) -> np.ndarray:
    way = Way.of_record(PLAN.metadata)
    assert way is not None
    return CellKinematics(TASK, way).heights(plant._drive.state()[None, :, 6:12])[0]


def test_the_cable_is_held_where_it_lay_and_let_go_where_it_is():
    plant = plant_of()
    before = plant.measure()
    assert gripped(plant) == [True, True, False, False], "held from the start, unless it is to be grasped"
    held(plant)
    assert gripped(plant) == [True, True, False, False]
    after = plant.measure()
    assert plant.time == 0
    np.testing.assert_allclose(after.centreline, before.centreline, atol=5e-4)
    np.testing.assert_allclose(after.poses, before.poses, atol=5e-4)
    assert 0.003 < after.gripper_clearance < before.gripper_clearance, "open hands have less room"
    up = np.array([[0.0, 0.004, 0.0]] * 2)
    for _ in range(3):
        plant.step(up)
    lay = plant.measure().centreline
    assert lay[0, 1] > after.centreline[0, 1] + 0.005, "the cable comes with the hands"
    assert PLAN.approach is not None
    commanded = plant._drive.state()[:, :6]
    moved = plant.let_go(commanded + np.linspace(0, 1, 4)[:, None, None] * (PLAN.approach[0] - PLAN.approach[-1]), 0.05)
    assert gripped(plant) == [False, False, True, True]
    assert moved == np.linalg.norm(plant.measure().centreline - lay, axis=1).max() < 0.01
    np.testing.assert_allclose(heights(plant), TASK.cable.radius + RISE, atol=0.01)


def test_the_same_grasp_is_the_same_bit_for_bit_and_there_is_one():
    plant = held(plant_of())
    first = plant.measure()
    plant.step(np.zeros((2, 3)))
    with pytest.raises(SimulationError, match="hold the cable already"):
        held(plant)
    plant.reset()
    assert gripped(plant) == [True, True, False, False]
    np.testing.assert_array_equal(held(plant).measure().centreline, first.centreline)


@pytest.mark.parametrize(
    ("grasp", "opening", "said"),
    [
        ({"left": (0.010, 0.0, 0.0)}, 0.05, ""),
        ({"left": (0.012, 0.0, 0.0)}, 0.05, "the left gripper missed the cable, whose end is 11.9 mm ahead"),
        ({"right": (0.0, -0.005, 0.1)}, 0.02, ""),
        (
            {"right": (0.0, -0.007, 0.1)},
            0.02,
            "the right gripper missed the cable, .* -6.9 mm to the left, turned by 5",
        ),
    ],
)
def test_a_hand_holds_only_what_is_between_its_fingers(grasp: dict[str, object], opening: float, said: str):
    plant = plant_of(**grasp)
    if not said:
        held(plant, opening)
        apart = plant.measure().poses - plant._reached
        assert np.linalg.norm(apart[:, :2]) == pytest.approx(np.linalg.norm([each[:2] for each in grasp.values()]), 0.1)
        return
    with pytest.raises(GraspError, match=said):
        held(plant, opening)
    assert gripped(plant) == [False, False, True, True], "nothing was gripped"


def test_a_bent_cable_that_no_clip_holds_springs_away_from_the_hands_and_when_they_open():
    with pytest.raises(GraspError, match="missed the cable"):
        held(plant_of(clips=False))
    plant = plant_of(clips=False)
    still = plant._drive.state()[:, :6]
    assert plant.let_go(still[None], OPENING[1]) > 0.03


def test_a_hand_that_is_pulled_too_hard_loses_the_cable_and_the_plant_stays_as_it_was():
    outward = np.zeros((2, 3))
    outward[:, :2] = PLAN.poses[0, :, :2] - PLAN.poses[0, ::-1, :2]
    outward *= 0.01 / np.linalg.norm(outward[0])
    plant, states = plant_of(), []

    def pull() -> None:
        for _ in range(40):
            states.append(plant.state())
            plant.step(outward)

    with pytest.raises(
        GraspError, match=rf"gripper lost the cable, which pulls with \d.* N and is held with {HOLD:g} N"
    ):
        pull()
    np.testing.assert_array_equal(plant.state().physics, states[-1].physics)
    assert np.linalg.norm(np.diff(plant.measure().poses[:, :2], axis=0)) > 0.95 * TASK.cable.length, "it was taut"


@pytest.mark.parametrize(
    ("grasp", "grasped", "said"),
    [
        (GraspConfig(left=(0.015, 0.0, 0.0)), False, "the left gripper missed the cable"),
        (GraspConfig(hold=0.06), True, r"lost the cable, .* \(step \d+, t = \d.\d s\)"),
    ],
)
def test_a_run_ends_where_a_hand_misses_or_loses_the_cable(grasp: GraspConfig, grasped: bool, said: str):
    """Also behind sensors and faults."""
    plant = Perturbation(grasp=grasp, faults=FaultConfig(wrapped=True), table=COARSE).build(TASK, plan=PLAN)
    rollout = track(plant, OpenLoop(), PLAN)
    assert rollout.outcome is Outcome.NOT_HELD
    assert rollout.metadata["hands"]["grasped"] is grasped
    assert "let_go" not in rollout.metadata["hands"]
    assert (len(rollout.times) == 1) is not grasped
    assert re.search(said, rollout.detail)


def test_without_an_approach_the_cable_is_in_the_hands_from_the_start():
    plan = replace(PLAN, approach=None)
    plant = Perturbation(grasp=GraspConfig(hold=0.06), table=COARSE).build(TASK, plan=plan)
    rollout = track(plant, OpenLoop(), plan)
    assert rollout.outcome is Outcome.NOT_HELD
    assert "hands" not in rollout.metadata
