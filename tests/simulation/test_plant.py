"""The plant: what an action does, what is measured, what is refused, and that it can always start again."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from cableway.core.errors import InputError, PressedError, SimulationError
from cableway.geometry import polyline, se2
from cableway.geometry.groups import SE2
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Box
from cableway.scene.scene import Scene
from cableway.scene.task import Plug, Task
from cableway.simulation.perturbations.grasp import GraspConfig, GraspedCable
from cableway.simulation.plant import CableSimulator, PlantConfig

STILL = np.zeros((2, 3))


def moves(seed: int, steps: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, [0.002, 0.002, 0.02], (steps, 2, 3))


def run(plant: CableSimulator, actions: np.ndarray) -> np.ndarray:
    return np.array([plant.step(action).keypoints for action in actions])


def test_starts_at_the_tasks_start(task_at):
    task = task_at()
    plant = CableSimulator(task)
    observation, truth = plant.reset(), plant.measure()
    assert observation.time == 0.0
    assert plant.control_step == 0.1
    np.testing.assert_allclose(observation.keypoints, task.start, atol=1e-6)
    np.testing.assert_allclose(observation.poses, task.cable.rod.shapes(task.start_equilibrium[None])[1][0], atol=1e-12)
    assert truth.centreline.shape == (task.cable.rod.hinges + 2, 2)
    assert truth.clearance == pytest.approx(task.scene.clearance(truth.centreline[None], task.cable.radius)[0])


def test_grippers_go_where_they_are_told(task_at):
    plant = CableSimulator(task_at())
    start = plant.reset().poses
    actions = moves(0, 15)
    for k, action in enumerate(actions):
        observation = plant.step(action)
        assert observation.time == pytest.approx(0.1 * (k + 1))
        np.testing.assert_allclose(observation.poses, start + actions[: k + 1].sum(axis=0), atol=3e-4)


def test_keypoints_lie_on_the_centreline_at_equal_arc_length_and_length_is_kept(task_at):
    plant = CableSimulator(task_at())
    run(plant, moves(1, 10))
    truth = plant.measure()
    np.testing.assert_allclose(truth.keypoints, polyline.resample(truth.centreline, 13), atol=1e-12)
    assert polyline.length(truth.centreline) == pytest.approx(0.3, abs=1e-12)
    np.testing.assert_allclose(truth.poses[:, :2], truth.centreline[[0, -1]], atol=1e-12)


def test_a_slow_rigid_translation_keeps_the_shape(task_at):
    plant = CableSimulator(task_at())
    start = plant.reset().keypoints
    end = run(plant, np.tile([0.004, -0.003, 0.0], (20, 2, 1)))[-1]
    np.testing.assert_allclose(end - start, np.tile([0.08, -0.06], (13, 1)), atol=2e-4)


def test_a_mirrored_task_runs_mirrored(task_at, bent):
    """Reflection at y = 0.35 turns (x, y, theta) into (x, 0.7 - y, -theta)."""
    task = task_at(scene=Scene((0.7, 0.7), (Box(center=(0.35, 0.45), size=(0.1, 0.1), angle=0.3),)))
    mirror = Scene((0.7, 0.7), (Box(center=(0.35, 0.25), size=(0.1, 0.1), angle=-0.3),))
    shape = task.start * [1, -1] + [0, 0.7]
    other = dataclasses.replace(task, scene=mirror, start=shape, goal=shape)
    actions = np.concatenate([np.tile([0.0, 0.004, 0.0], (5, 2, 1)), moves(2, 10)])
    one, two = CableSimulator(task), CableSimulator(other)
    lowest = []
    for action in actions:
        observation, reflected = one.step(action), two.step(action * [1, -1, -1])
        np.testing.assert_allclose(reflected.keypoints * [1, -1] + [0, 0.7], observation.keypoints, atol=1e-5)
        lowest.append(one.measure().clearance)
    assert min(lowest) < 0, "the obstacle is to take part"


def test_read_from_the_other_end_it_is_the_same_cable(task_at):
    task = task_at()
    other = dataclasses.replace(task, start=task.start[::-1], goal=task.goal[::-1])
    one, two = CableSimulator(task), CableSimulator(other)
    for action in moves(3, 15):
        np.testing.assert_allclose(two.step(action[::-1]).keypoints[::-1], one.step(action).keypoints, atol=2e-5)


@pytest.mark.parametrize("stiffness", [3e-5, 1e-3, 2e-2])
def test_a_frictionless_cable_moves_alike_whatever_its_stiffness(task_at, stiffness):
    nominal, other = CableSimulator(task_at()), CableSimulator(task_at(cable=Cable(bending_stiffness=stiffness)))
    actions = np.concatenate([moves(4, 10), np.tile(STILL, (15, 1, 1))])
    np.testing.assert_allclose(run(other, actions)[-1], run(nominal, actions)[-1], atol=1e-3)


def test_a_thick_cable_does_not_push_itself_straight(task_at):
    """Capsules that overlap along the cable do not collide: radius changes nothing but contact with others."""
    nominal, thick = CableSimulator(task_at()), CableSimulator(task_at(cable=Cable(radius=0.02)))
    actions = moves(4, 5)
    np.testing.assert_allclose(run(thick, actions), run(nominal, actions), atol=1e-4)


def test_five_milliseconds_are_as_good_as_one(task_at):
    coarse, fine = (CableSimulator(task_at(), PlantConfig(time_step=dt)) for dt in (0.005, 0.001))
    actions = moves(5, 20)
    off = np.linalg.norm(run(coarse, actions) - run(fine, actions), axis=-1)
    assert off.mean() < 1e-4
    assert off.max() < 1e-3


def until_refused(
    plant: CableSimulator, action: np.ndarray, after: Callable[[], object] = lambda: None, most: int = 40
) -> str:
    """Repeat an action until the plant raises; the message."""
    for _ in range(most):
        try:
            plant.step(action)
        except SimulationError as error:
            return str(error)
        after()
    raise AssertionError(f"{most} steps were taken without complaint")


# ---------------------------------------------------------------- contact
def over_a_corner(cable: Cable, along: float) -> tuple[np.ndarray, Scene]:
    """A slightly bent cable along x, and a box whose lower corner is 0.5 mm above its surface."""
    q = np.array([0.35, 0.3, 0.0, -10.0, 0.0, -1.5])
    touch = polyline.point_at(cable.rod.shapes(q[None])[0][0], np.array([along * cable.length]))[0]
    centre = touch + np.array([0.0, cable.radius + 5e-4 + 0.1 / np.sqrt(2)])
    return q, Scene((0.7, 0.7), (Box(center=tuple(centre), size=(0.1, 0.1), angle=np.pi / 4),))


@pytest.mark.parametrize("along", [0.5, 0.8])
@pytest.mark.parametrize("stiffness", [3e-5, 1e-3, 2e-2])
def test_pushed_5_mm_over_a_corner_it_stays_out_by_a_millimetre(task_at, drive, along, stiffness):
    cable = Cable(bending_stiffness=stiffness)
    plant = CableSimulator(task_at(*over_a_corner(cable, along), cable))
    start = polyline.point_at(plant.measure().centreline, np.array([along * cable.length]))[0, 1]
    rows = drive(plant, plant.reset().poses + np.array([0.0, 0.0055, 0.0]), 2, wait=10)
    assert -1e-3 < min(row.clearance for row in rows) < 0
    assert -3e-4 < rows[-1].clearance <= 1e-6, "at rest it touches"
    below = polyline.point_at(rows[-1].centreline, np.array([along * cable.length]))[0, 1]
    assert below < start + 0.002, "the grippers rose by 5.5 mm, the cable below the corner did not"


def test_in_a_narrow_corridor_it_stays_between_the_walls(task_at):
    """Pushed together by 20 mm between two boxes, it presses against both."""
    cable = Cable()
    q = np.array([0.35, 0.35, 0.0, -20.0, 0.0, 0.8])
    shape = cable.rod.shapes(q[None])[0][0]
    low, high = shape[:, 1].min() - cable.radius - 1e-3, shape[:, 1].max() + cable.radius + 1e-3
    walls = tuple(Box(center=(0.35, y), size=(0.5, 0.1)) for y in (low - 0.05, high + 0.05))
    plant = CableSimulator(task_at(q, Scene((0.7, 0.7), walls), cable))
    inwards = np.array([[0.002, 0.0, 0.0], [-0.002, 0.0, 0.0]])
    least = []
    for k in range(15):
        plant.step(inwards if k < 5 else STILL)
        least.append(plant.measure().clearance)
    assert -1e-3 < min(least) < 0
    line = plant.measure().centreline
    assert low < line[:, 1].min()
    assert line[:, 1].max() < high


def test_squeezed_at_full_speed_it_is_not_pressed_into_the_walls(task_at):
    """The middle of a nearly straight cable then moves several millimetres in a time step."""
    q = np.array([0.35, 0.35, 0.0, -2.0, 0.0, 0.1])
    walls = tuple(Box(center=(0.35, 0.35 + side * 0.065), size=(0.5, 0.1)) for side in (-1, 1))
    task = task_at(q, Scene((0.7, 0.7), walls), Cable())

    def deepest(config: PlantConfig) -> float:
        plant, least = CableSimulator(task, config), []
        for k in range(10):
            plant.step(np.array([[0.006, 0.0, 0.0], [-0.006, 0.0, 0.0]]) if k < 3 else STILL)
            least.append(plant.measure().clearance)
        return -min(least)

    assert 0 < deepest(PlantConfig()) < 1e-3
    assert deepest(PlantConfig(pressed=1.0)) > 1e-3


def test_contact_in_the_middle_of_a_step_is_not_missed(task_at):
    """Clearance is the least over all time steps, not that at the end: touch and go back in two steps."""
    plant = CableSimulator(task_at(*over_a_corner(Cable(), 0.5)))
    up = np.tile([0.0, 0.004, 0.0], (2, 1))
    plant.step(up)
    plant.step(-up)
    truth = plant.measure()
    assert truth.clearance < 0 < plant.task.scene.clearance(truth.centreline[None], plant.cable.radius)[0]


def test_a_gripper_led_into_a_wall_stands_there_until_it_is_led_back(task_at):
    """It is reported where it stands, and as a contact; what it was led too far must be taken back first."""
    plant = CableSimulator(task_at())
    start, ahead = plant.reset().poses, np.tile([-0.012, 0.0, 0.0], (2, 1))
    free = round((start[0, 0] - plant.task.grippers.radius) / 0.012 - 0.5)
    for _ in range(free):
        plant.step(ahead)
        assert plant.measure().gripper_clearance > 0
    for _ in range(2):
        reported = plant.step(ahead).poses
        assert plant.measure().gripper_clearance <= 0
        assert 0 < reported[0, 0] - plant.task.grippers.radius < 0.001
    state = plant.state()
    backed = [plant.step(-ahead).poses for _ in range(3)]
    assert backed[0][0, 0] - plant.task.grippers.radius < 0.001, "it is still commanded into the wall"
    np.testing.assert_allclose(backed[-1], plant.commanded, atol=1e-4)
    assert plant.measure().gripper_clearance > 0
    plant.restore(state)
    np.testing.assert_array_equal([plant.step(-ahead).poses for _ in range(3)], backed)


def test_a_gripper_that_holds_the_cable_askew_is_reported_where_a_wall_stops_its_end(task_at):
    grasp = GraspConfig(left=(0.004, 0.0, 0.05))
    plant, ahead = GraspedCable(CableSimulator(task_at()), grasp), np.tile([-0.012, 0.0, 0.0], (2, 1))
    reported = [plant.reset().poses, *(plant.step(ahead).poses for _ in range(22))]
    assert plant.measure().gripper_clearance <= 0
    ends = SE2.compose(reported[-1], grasp.offsets(0.0))
    np.testing.assert_allclose(ends, plant.measure().poses, atol=1e-4)
    assert np.abs(reported[-1] - reported[-2])[0].max() < 1e-9 < np.abs(reported[-1] - reported[-2])[1].max()


def test_a_cable_pressed_deeper_than_its_radius_in_one_step_is_refused_with_how_deep(task_at):
    """So a step of which there is no record, as the plant stays as it was, still says what it touched."""
    plant = CableSimulator(task_at(*over_a_corner(Cable(), 0.96)))
    with pytest.raises(PressedError, match="mm into an obstacle") as refused:
        plant.step(np.tile([0.0, 0.02, 0.0], (2, 1)))
    assert refused.value.clearance < -plant.cable.radius
    assert plant.measure().clearance > 0


# ---------------------------------------------------------------- refusals
@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(6), r"shape \(2, 3\), got \(6,\)"),
        (np.full((2, 3), np.nan), "finite"),
        (np.full((2, 3), np.inf), "finite"),
        (np.array([[0.0, 0.2, 0.0], [0.0, 0.0, 0.0]]), "left gripper's step of 200 mm exceeds"),
        (np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -3.0]]), "right gripper's turn of 172 degrees exceeds"),
    ],
)
def test_a_bad_action_is_refused_and_changes_nothing(task_at, action, message):
    plant, untouched = CableSimulator(task_at()), CableSimulator(task_at())
    with pytest.raises(SimulationError, match=message):
        plant.step(action)
    np.testing.assert_array_equal(run(plant, moves(6, 3)), run(untouched, moves(6, 3)))


def test_pulled_past_its_length_it_says_so_and_can_start_again(task_at):
    plant = CableSimulator(task_at())
    first = plant.reset()
    outwards = se2.direction(plant.measure().poses[:, 2].mean())
    pull = np.zeros((2, 3))
    pull[:, :2] = np.outer([-0.01, 0.01], outwards)
    assert "farther than the cable is long" in until_refused(plant, pull)
    again = plant.reset()
    np.testing.assert_array_equal(again.keypoints, first.keypoints)
    run(plant, moves(7, 3))


def test_held_straight_it_can_be_moved():
    """Its grippers are just as far apart as it is long, but for rounding."""
    start = np.column_stack([0.8 + 0.025 * np.arange(13), np.full(13, 0.8)])
    task = Task(name="straight", scene=Scene(size=(2.0, 2.0)), cable=Cable(), start=start, goal=start + [0.0, 0.2])
    plant, aside = CableSimulator(task), np.tile([0.0037, 0.0091, 0.0], (2, 1))
    run(plant, np.tile(aside, (20, 1, 1)))
    np.testing.assert_allclose(plant.measure().keypoints, start + 20 * aside[0, :2], atol=5e-4)


def test_twisted_beyond_what_it_can_follow_it_says_that_it_slipped(task_at, bent):
    """Taut between the grippers, an end cannot turn: the grasp is lost, and the plant is as before that step."""
    taut = bent * [1, 1, 1, 0, 0, 0] + [0, 0, 0, 0, 0, 0.05]
    plant = CableSimulator(task_at(taut))
    turn = np.array([[0.0, 0.0, 0.4], [0.0, 0.0, 0.4]])
    last = [plant.reset().keypoints]
    assert "slipped" in until_refused(plant, turn, lambda: last.append(plant.measure().keypoints))
    np.testing.assert_array_equal(plant.measure().keypoints, last[-1])


def test_an_overlap_at_the_start_is_refused(task_at):
    task = task_at(*over_a_corner(Cable(), 0.5))
    with pytest.raises(SimulationError, match=r"overlaps the scene by 4\.5 mm at the start"):
        CableSimulator(task, cable=Cable(radius=0.009))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"time_step": 0.003}, "must divide the control step 0.1 s, got 0.003"),
        ({"time_step": 0.05}, "at most"),
        ({"control_step": 1 / 30}, "must divide the control step 0.0333333 s, got 0.005"),
        ({"control_step": 0.001}, "divide"),
        ({"control_step": 2.0}, "control_step must be at most 1 s"),
        ({"largest_step": np.nan}, "largest_step"),
    ],
)
def test_a_bad_configuration_is_refused(values, message):
    with pytest.raises(InputError, match=message):
        PlantConfig(**values)


# ---------------------------------------------------------------- a cable that is not the task's
@pytest.mark.parametrize("factor", [0.97, 1.01])
def test_a_cable_of_another_length_starts_between_the_same_grippers(task_at, factor):
    task = task_at()
    plant = CableSimulator(task, cable=Cable(length=0.3 * factor))
    nominal = CableSimulator(task).reset()
    observation = plant.reset()
    np.testing.assert_allclose(observation.poses, nominal.poses, atol=1e-8)
    assert 1e-4 < np.abs(observation.keypoints - nominal.keypoints).max() < 0.02
    np.testing.assert_allclose(plant.step(STILL).keypoints, observation.keypoints, atol=1e-6)


def test_a_cable_that_cannot_lie_there_is_refused(task_at):
    with pytest.raises(InputError, match="farther than the cable is long"):
        CableSimulator(task_at(), cable=Cable(length=0.2))
    with pytest.raises(InputError, match="10 keypoints, the task's 13"):
        CableSimulator(task_at(), cable=Cable(keypoints=10))


def test_what_is_not_modelled_is_said(task_at):
    task: Task = task_at(cable=Cable(friction=0.4))
    task = dataclasses.replace(task, plug=Plug(length=0.04, width=0.012))
    notes = " ".join(CableSimulator(task).unmodelled)
    assert "lies flat on the table" in notes
    assert "plug" in notes
    assert CableSimulator(task_at()).unmodelled == ()


# ---------------------------------------------------------------- state
def test_the_same_actions_give_the_same_run(task_at):
    plant = CableSimulator(task_at())
    first = run(plant, moves(8, 10))
    plant.reset()
    np.testing.assert_array_equal(run(plant, moves(8, 10)), first)
    np.testing.assert_array_equal(run(CableSimulator(task_at()), moves(8, 10)), first)


def test_a_restored_state_goes_on_bit_for_bit(task_at):
    """In contact, too."""
    task = task_at(*over_a_corner(Cable(), 0.5))
    plant, other = CableSimulator(task), CableSimulator(task)
    run(plant, np.tile([0.0, 0.002, 0.0], (2, 2, 1)))
    state, truth = plant.state(), plant.measure()
    branch = run(plant, moves(9, 6))
    for again in (plant, other):
        again.restore(state)
        assert again.time == pytest.approx(0.2)
        assert again.measure().clearance == truth.clearance
        np.testing.assert_array_equal(run(again, moves(9, 6)), branch)


def test_what_is_returned_is_not_the_plants_own(task_at):
    plant = CableSimulator(task_at())
    observation, truth = plant.reset(), plant.measure()
    for array in (observation.keypoints, observation.poses, truth.keypoints, truth.poses, truth.centreline):
        array += 1.0
    np.testing.assert_allclose(plant.measure().keypoints, plant.task.start, atol=1e-6)
