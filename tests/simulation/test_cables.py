"""Cables that are not the nominal one: each effect against a reference or a limit case."""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest
from accuracy import on_a_table
from scipy.integrate import solve_bvp

from cableway.scene.cable import Cable
from cableway.scene.files.presets import preset_names
from cableway.simulation.chain import Chain
from cableway.simulation.links import middle_link
from cableway.simulation.plant import CableSimulator
from cableway.simulation.table import GRAVITY

TIME_STEP = 0.005
HINGE = mujoco.mjtJoint.mjJNT_HINGE
STRAIGHT = np.array([0.35, 0.35, 0.0, 0.0, 0.0, 0.0])
ARCHED = np.array([0.35, 0.35, 0.4, -20.0, 2.0, 3.0])


def line(start: np.ndarray, end: np.ndarray, steps: int) -> np.ndarray:
    """Rod coordinates along a straight line of equilibria, without the first."""
    return start + np.linspace(0, 1, steps + 1)[1:, None] * (end - start)


def lead(chain: Chain, rows: np.ndarray, wait: int = 0) -> np.ndarray:
    """Lead a chain along gripper poses of rod coordinates, wait, and return its centrelines."""
    poses = chain.rod.shapes(rows)[1]
    return chain.polylines(chain.advance(np.concatenate([poses, np.repeat(poses[-1:], wait, axis=0)])))


def released(chain: Chain, grippers: tuple[int, ...] = (1,)) -> mujoco.MjData:
    """The chain as it is now, let go by some grippers."""
    data = mujoco.MjData(chain.model)
    mujoco.mj_setState(chain.model, data, chain.save(), mujoco.mjtState.mjSTATE_INTEGRATION)
    data.eq_active[list(grippers)] = 0
    return data


def run(chain: Chain, data: mujoco.MjData, seconds: float) -> np.ndarray:
    """Simulate and return the chain coordinates after each time step."""
    rows = []
    for _ in range(round(seconds / TIME_STEP)):
        mujoco.mj_step(chain.model, data)
        rows.append(data.qpos.copy())
    return np.array(rows)


def curvature(chain: Chain, coordinates: np.ndarray) -> np.ndarray:
    """Curvature [1/m] at each hinge."""
    return np.diff(chain.link_angles(coordinates[None])[0]) * chain.rod.hinges / chain.rod.length


# ---------------------------------------------------------------- stiffness and rest curvature along the length
def clamped_rod(cable: Cable, q: np.ndarray) -> np.ndarray:
    """Keypoints of the continuous rod between the grippers of q: theta' = kappa_0 + M/EI, M' = F_x sin - F_y cos.

    In units of L and of the stiffness EI; solved by collocation, starting from the uniform rod.
    """
    stations, poses = cable.rod.shapes(q[None])
    shares = np.linspace(0, 1, len(stations[0]))
    ends = np.column_stack([poses[0, :, :2] / cable.length, poses[0, :, 2]])

    def derivative(s, y, force):
        bend = cable.along("rest_curvature", s) * cable.length + y[3] / cable.along("stiffness_profile", s)
        return np.array([np.cos(y[2]), np.sin(y[2]), bend, force[0] * np.sin(y[2]) - force[1] * np.cos(y[2])])

    def boundary(left, right, force):
        return np.concatenate([left[:3] - ends[0], right[:3] - ends[1]])

    points = stations[0] / cable.length
    steps = np.gradient(points, axis=0)
    angle = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    angle += 2 * np.pi * np.round((ends[0, 2] - angle[0]) / (2 * np.pi))
    guess = np.vstack([points.T, angle, np.gradient(angle, shares)])
    solution = solve_bvp(derivative, boundary, shares, guess, p=np.zeros(2), tol=1e-8, max_nodes=5000)
    assert solution.success
    return solution.sol(np.linspace(0, 1, cable.keypoints))[:2].T * cable.length


@pytest.mark.parametrize(
    "changes",
    [
        {"stiffness_profile": (0.5, 2.0)},
        {"stiffness_profile": (1.0, 3.0, 1.0)},
        {"rest_curvature": (0.0, 0.0, 20.0, 20.0)},
        {"stiffness_profile": (2.0, 0.5), "rest_curvature": (-4.0, 4.0)},
    ],
)
def test_a_cable_that_is_not_uniform_takes_the_shape_of_the_continuous_rod(changes):
    """And second order in the number of hinges, 24 against 48."""
    errors = []
    for keypoints in (13, 49):
        cable = Cable(keypoints=keypoints, **changes)
        chain = Chain(cable, None, TIME_STEP)
        chain.place(ARCHED)
        settled = chain.keypoints(chain.polylines(chain.coordinates[None]))[0]
        every = (keypoints - 1) // 12
        errors.append(np.linalg.norm(settled - clamped_rod(cable, ARCHED), axis=1)[::every].mean())
        uniform = chain.rod.at_keypoints(chain.rod.shapes(ARCHED[None])[0])[0]
        assert np.linalg.norm(settled - uniform, axis=1).max() > 2e-3, "the effect is visible"
    assert errors[0] < 2e-4
    assert errors[1] < errors[0] / 3


def test_the_same_rest_curvature_everywhere_cannot_be_seen_between_grippers():
    straight, curled = (Chain(Cable(rest_curvature=(k,)), None, TIME_STEP) for k in (0.0, 8.0))
    ends = ARCHED, ARCHED + np.array([0.02, 0.0, 0.3, 6.0, -4.0, -2.0])
    rows = []
    for chain in (straight, curled):
        chain.place(ends[0])
        rows.append(lead(chain, line(*ends, 60), 20))
    np.testing.assert_allclose(rows[1], rows[0], atol=1e-5)


def test_let_go_it_curls_to_its_rest_curvature():
    cable = Cable(rest_curvature=(2.0, 8.0))
    chain = Chain(cable, None, TIME_STEP)
    chain.place(ARCHED)
    data = released(chain)
    run(chain, data, 2.0)
    hinges = (np.arange(chain.rod.hinges) + 0.5) / chain.rod.hinges
    np.testing.assert_allclose(curvature(chain, data.qpos), 2.0 + 6.0 * hinges, atol=0.01)


# ---------------------------------------------------------------- plasticity
@pytest.mark.parametrize(("bent", "kept"), [(4.0, 0.0), (9.0, 4.0), (-9.0, -4.0)])
def test_bent_beyond_yield_it_keeps_what_is_beyond(bent, kept):
    """Bent to an arc, straightened and let go: a set of |kappa| - 5 1/m, or none below yield."""
    cable = Cable(yield_curvature=5.0)
    chain = Chain(cable, None, TIME_STEP)
    chain.place(STRAIGHT)
    arc = STRAIGHT + np.array([0, 0, 0, 0, 0, bent * cable.length])
    lead(chain, np.concatenate([line(STRAIGHT, arc, 300), line(arc, STRAIGHT, 300)]), 200)
    data = released(chain)
    run(chain, data, 2.0)
    np.testing.assert_allclose(curvature(chain, data.qpos), kept, atol=0.1)


# ---------------------------------------------------------------- friction
@pytest.mark.parametrize("angle", [0.0, np.pi / 8, 1.0])
def test_a_loose_cable_slides_only_when_pushed_by_more_than_its_friction(angle):
    """On a table tilted so that gravity along it is a: at rest for a < mu g, else it accelerates by a - mu g."""
    chain = Chain(Cable(friction=0.3), None, TIME_STEP)
    chain.place(STRAIGHT)
    threshold = 0.3 * GRAVITY
    for push, acceleration in ((0.9 * threshold, 0.0), (2.0 * threshold, threshold)):
        chain.model.opt.gravity[:2] = push * np.cos(angle), push * np.sin(angle)
        data = released(chain, (0, 1))
        moved = np.linalg.norm(run(chain, data, 0.5)[-1, :2] - chain.coordinates[:2])
        assert moved == pytest.approx(acceleration * 0.5**2 / 2, rel=0.08, abs=2e-6)


def test_friction_does_what_weight_on_a_table_does():
    """A soft cable is led there and back, in the plane and in space: they agree to a tenth of what friction changes."""
    cable = Cable(friction=0.4, bending_stiffness=1e-4)
    there = line(ARCHED, ARCHED + np.array([0.02, 0.01, 0.1, 4.0, -3.0, 1.0]), 4)
    poses = cable.rod.shapes(np.concatenate([ARCHED[None], there, there[-2::-1], ARCHED[None]]))[1]
    reference, lifted = on_a_table.spatial_keypoints(cable, ARCHED, poses)
    with_friction, without = (
        on_a_table.planar_keypoints(each, ARCHED, poses) for each in (cable, dataclasses.replace(cable, friction=0.0))
    )
    effect = np.abs(without - reference).max()
    assert effect > 1e-3
    assert np.abs(with_friction - reference).max() < 0.1 * effect
    assert lifted < 2e-4


def test_friction_goes_with_the_weight():
    """Half the coefficient and twice the weight: the same, but for the inertia; half of both: much less."""
    rows = line(ARCHED, ARCHED + np.array([0.02, 0.01, 0.1, 4.0, -3.0, 1.0]), 80)
    ends = []
    for friction, density in ((0.4, 0.03), (0.2, 0.06), (0.2, 0.03)):
        chain = Chain(Cable(friction=friction, linear_density=density, bending_stiffness=1e-4), None, TIME_STEP)
        chain.place(ARCHED)
        ends.append(lead(chain, rows, 40)[-1])
    assert np.abs(ends[1] - ends[0]).max() < 0.1 * np.abs(ends[2] - ends[0]).max()


def test_with_no_friction_left_it_moves_as_on_no_table():
    nominal, faint = (Chain(Cable(friction=mu), None, TIME_STEP) for mu in (0.0, 1e-6))
    rows = []
    for chain in (nominal, faint):
        chain.place(ARCHED)
        rows.append(lead(chain, line(ARCHED, ARCHED + np.array([0.02, 0.0, 0.1, 4.0, -3.0, 1.0]), 60), 20))
    np.testing.assert_allclose(rows[1], rows[0], atol=1e-7)


# ---------------------------------------------------------------- drag
def test_a_deflected_cable_comes_back_by_its_drag():
    """One end free, the first mode of a beam decays with c L^4/(EI 1.8751^4) + tau."""
    cable = Cable(drag=1.0)
    chain = Chain(cable, None, TIME_STEP)
    chain.place(STRAIGHT)
    data = released(chain)
    hinges = (np.arange(chain.rod.hinges) + 0.5) / chain.rod.hinges
    first, ratio = 1.8751, 0.7341
    bends = (
        np.cosh(first * hinges) + np.cos(first * hinges) - ratio * (np.sinh(first * hinges) + np.sin(first * hinges))
    )
    middle = middle_link(chain.rod)
    angles = STRAIGHT[2] + np.concatenate([[0.0], np.cumsum(0.005 * bends / chain.rod.hinges)])
    data.qpos[2] = angles[middle]
    data.qpos[3:] = np.concatenate([np.diff(angles)[middle:], -np.diff(angles)[:middle][::-1]])
    lines = chain.polylines(data.qpos[None])
    data.qpos[:2] += chain.polylines(chain.coordinates[None])[0, 0] - lines[0, 0]
    tips = chain.polylines(run(chain, data, 2.0))[:, -1, 1] - STRAIGHT[1]
    measured = 1.0 / np.log(tips[round(0.5 / TIME_STEP)] / tips[round(1.5 / TIME_STEP)])
    expected = cable.drag * cable.length**4 / (cable.bending_stiffness * first**4) + cable.damping_time
    assert measured == pytest.approx(expected, rel=0.08)


def test_drag_delays_but_does_not_move_the_equilibrium():
    ends = ARCHED, ARCHED + np.array([0.02, 0.0, 0.1, 6.0, -4.0, -2.0])
    behind, left = [], []
    for drag in (0.0, 40.0, 120.0):
        chain = Chain(Cable(drag=drag), None, TIME_STEP)
        chain.place(ends[0])
        rows = chain.keypoints(lead(chain, line(*ends, 100), 2400))
        wanted = chain.rod.at_keypoints(chain.rod.shapes(ends[1][None])[0])[0]
        off = np.linalg.norm(rows - wanted, axis=-1).max(axis=1)
        behind.append(off[99])
        left.append(off[-1])
    assert 1.2 * behind[0] < behind[1] < behind[2] / 1.2
    assert max(left) < 1e-4


# ---------------------------------------------------------------- all together
ALL = {"friction": 0.4, "drag": 1.0, "yield_curvature": 5.0, "stiffness_profile": (0.5, 2.0)}


@pytest.mark.parametrize("changes", [{"yield_curvature": 5.0}, {"friction": 0.4}, ALL])
def test_a_set_and_what_friction_holds_are_part_of_the_state(task_at, changes):
    """Led there and back the cable does not lie as it began; restored, it does, and goes on bit for bit."""
    plant, other = (CableSimulator(task_at(), cable=Cable(**changes)) for _ in range(2))
    bend = np.array([[0.004, 0.0, 0.05], [-0.004, 0.0, -0.05]])
    back = [*(-bend for _ in range(6)), *(0 * bend for _ in range(20))]
    start, began = plant.state(), plant.measure().keypoints
    for _ in range(6):
        plant.step(bend)
    bent, there = plant.state(), plant.measure().keypoints
    branches = []
    for each in (plant, plant, other):
        each.restore(bent)
        np.testing.assert_array_equal(each.measure().keypoints, there)
        branches.append([each.step(action).keypoints for action in back])
    np.testing.assert_array_equal(branches[1], branches[0])
    np.testing.assert_array_equal(branches[2], branches[0])
    assert np.abs(branches[0][-1] - began).max() > 5e-5
    plant.restore(start)
    np.testing.assert_array_equal(plant.measure().keypoints, began)
    np.testing.assert_array_equal([plant.step(bend).keypoints for _ in range(6)][-1], there)


def test_a_plant_of_every_preset_drawn_at_random_runs(task_at):
    """Only its stiffness, damping and what the table does differ, so it starts near the task's start and stays near."""
    task = task_at()
    for name in preset_names():
        cable = dataclasses.replace(task.cable, preset=name).sample(seed=1)
        plant = CableSimulator(task, cable=cable)
        observation = [plant.step(np.tile([0.004, 0.0, 0.0], (2, 1))) for _ in range(3)][-1]
        assert 1e-4 < np.abs(observation.keypoints - [0.012, 0.0] - task.start).max() < 0.03
