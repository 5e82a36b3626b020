"""Whatever is asked of it, the plant either does what it says or refuses in a sentence, and can always start again.

`python -m pytest -s tests/simulation/test_abuse.py` says what became of the thousand sequences.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from cableway.core.errors import CablewayError, InputError, SimulationError
from cableway.geometry import polyline
from cableway.records import Measurement
from cableway.scene.cable import Cable
from cableway.scene.files.loading import load_task
from cableway.simulation.plant import CableSimulator

SEQUENCES = 1000
LENGTH = 4
"""Actions in a sequence."""

TASKS = ("maze-1", "multi-obstacle-1", "single-obstacle-2", "insertion")

POISON: list[Any] = [
    np.full((2, 3), np.nan), np.full((2, 3), np.inf), np.full((2, 3), 1e308), np.zeros((3, 2)), np.zeros(6), [],
    np.zeros((1, 2, 3)), np.zeros((2, 3)) + 0.001j, None, "north", [[0, 0, 0], [0, 0]], [["a"] * 3] * 2, {}, object(),
    np.array([[0.0, 0.0, np.nan], [0.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 0.0], [-np.inf, 0.0, 0.0]]),
]  # fmt: skip


REFUSALS = (
    "must be an array", "must have shape", "must be finite", "step of", "turn of", "farther than", "slipped", "pressed",
    "diverged",
)  # fmt: skip


def held(actions: np.ndarray) -> Iterator[np.ndarray]:
    yield from np.repeat(actions[None], LENGTH, axis=0)


def into_a_wall(rng: np.random.Generator, truth: Measurement) -> Iterator[Any]:
    direction = rng.normal(size=2)
    move = rng.uniform(0.005, 0.05) * direction / np.linalg.norm(direction)
    yield from held(np.tile([*move, 0.0], (2, 1)))


def pulled_apart(rng: np.random.Generator, truth: Measurement) -> Iterator[Any]:
    along = truth.poses[1, :2] - truth.poses[0, :2]
    move = rng.uniform(0.002, 0.03) * along / np.linalg.norm(along)
    yield from held(np.array([[*-move, 0.0], [*move, 0.0]]))


def pushed_together(rng: np.random.Generator, truth: Measurement) -> Iterator[Any]:
    for action in pulled_apart(rng, truth):
        yield -action


def twisted(rng: np.random.Generator, truth: Measurement) -> Iterator[Any]:
    yield from held(np.array([[0.0, 0.0, angle] for angle in rng.uniform(-0.5, 0.5, 2)]))


def thrown_about(rng: np.random.Generator, truth: Measurement) -> Iterator[Any]:
    for _ in range(LENGTH):
        yield 10 ** rng.uniform(-4, -1) * rng.normal(size=(2, 3)) * [1, 1, 8]


def beyond_all_bounds(rng: np.random.Generator, truth: Measurement) -> Iterator[Any]:
    for _ in range(LENGTH):
        yield 10 ** rng.uniform(-2, 300) * rng.normal(size=(2, 3))


def poisoned(rng: np.random.Generator, truth: Measurement) -> Iterator[Any]:
    for _ in range(LENGTH):
        yield POISON[rng.integers(len(POISON))] if rng.integers(2) else rng.normal(0, 0.003, (2, 3))


ABUSES = (
    into_a_wall, pulled_apart, pushed_together, twisted, thrown_about, beyond_all_bounds, poisoned,
)  # fmt: skip


@pytest.fixture(scope="module")
def plants() -> dict[str, CableSimulator]:
    """One plant for each task, which has to bear it all."""
    return {name: CableSimulator(load_task(name)) for name in TASKS}


def check(plant: CableSimulator) -> float:
    """What is measured is finite, of the cable's length, and not nearer to anything than the clearance returned."""
    truth, scene, cable = plant.measure(), plant.task.scene, plant.cable
    for array in (truth.keypoints, truth.poses, truth.centreline):
        assert np.isfinite(array).all()
    assert polyline.length(truth.centreline) == pytest.approx(cable.length, abs=1e-9)
    np.testing.assert_allclose(truth.keypoints, polyline.resample(truth.centreline, cable.keypoints), atol=1e-9)
    assert truth.clearance >= -cable.radius
    depth = scene.overlap(truth.centreline, cable.radius)[0]
    assert truth.clearance <= -depth + 1e-4, "Shapely, to 0.1 mm, finds no deeper overlap than was reported"
    return truth.clearance


def snapshot(plant: CableSimulator) -> tuple[Any, ...]:
    state = plant.state()
    return (*map(bytes, (state.chain, state.commanded)), state.steps, state.clearance, state.gripper_clearance)


def outcome(plant: CableSimulator, action: Any) -> str:
    """ "done", or the kind of refusal; checks that a refusal changes nothing."""
    before = snapshot(plant)
    try:
        plant.step(action)
    except SimulationError as error:
        message = str(error)
        assert len(message) > 20
        assert "\n" not in message
        assert snapshot(plant) == before
        return next((kind for kind in REFUSALS if kind in message), message)
    return "done"


def test_a_thousand_abuses(plants, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gentle = np.tile([1e-4, -1e-4, 1e-3], (2, 1))
    fresh = {}
    for name, plant in plants.items():
        plant.reset()
        fresh[name] = snapshot(plant), plant.step(gentle).keypoints
    outcomes: Counter[str] = Counter()
    pressed = 0
    for number in range(SEQUENCES):
        rng = np.random.default_rng([2026, number])
        name, abuse = TASKS[rng.integers(len(TASKS))], ABUSES[number % len(ABUSES)]
        plant = plants[name]
        plant.reset()
        for action in abuse(rng, plant.measure()):
            found = outcome(plant, action)
            outcomes[found] += 1
            if found == "done":
                pressed += check(plant) < -1e-3
        plant.reset()
        assert snapshot(plant) == fresh[name][0]
        if number % 10 == 0:
            np.testing.assert_array_equal(plant.step(gentle).keypoints, fresh[name][1], err_msg=f"{number}")
    print(f"\n{SEQUENCES} sequences, {pressed} steps with more than 1 mm of penetration reported; {dict(outcomes)}")
    assert outcomes["done"] > SEQUENCES
    assert sum(outcomes.values()) - outcomes["done"] > SEQUENCES
    assert outcomes.keys() <= {"done", *REFUSALS}
    assert pressed > 0, "some pressed the cable deeper than a millimetre, which was reported"
    assert not list(tmp_path.iterdir())


def test_a_cable_that_does_not_fit_is_refused_or_lies_free():
    """Another radius and length than the task's: the plant is clear of everything at its start, or there is none."""
    refused: Counter[str] = Counter()
    for number in range(20):
        rng = np.random.default_rng(number)
        task = load_task(TASKS[number % len(TASKS)])
        cable = Cable(length=task.cable.length * rng.uniform(0.8, 1.6), radius=rng.uniform(0.002, 0.03))
        try:
            plant = CableSimulator(task, cable=cable)
        except (InputError, SimulationError) as error:
            refused["overlaps" if "the cable overlaps the scene by" in str(error) else str(error)] += 1
        else:
            assert check(plant) >= 0
    assert 0 < refused.total() < 20
    assert refused["overlaps"] > 0


def test_a_branched_run_and_its_trunk_go_their_own_ways(plants):
    """Two futures of one state: what one does leaves no trace in the other, refusals included."""
    plant: CableSimulator = plants["maze-1"]
    rng = np.random.default_rng(0)
    plant.reset()
    for _ in range(5):
        plant.step(rng.normal(0, 0.002, (2, 3)))
    fork = plant.state()
    left, right = rng.normal(0, 0.002, (2, 6, 2, 3))
    alone = [plant.step(action).keypoints for action in left]
    plant.restore(fork)
    other = [plant.step(action).keypoints for action in right]
    with pytest.raises(CablewayError):
        plant.step(np.full((2, 3), 9.0))
    plant.restore(fork)
    np.testing.assert_array_equal([plant.step(action).keypoints for action in left], alone)
    assert np.abs(np.array(other) - alone).max() > 1e-3
