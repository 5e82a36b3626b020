"""Suites are what was frozen: as long as their sizes, without repetition, and each task still the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cableway.benchmark.conditions import CONDITIONS, condition_of
from cableway.benchmark.suites import (
    SIZES,
    SPACE_SUITES,
    SUITES,
    episode_name,
    frozen_episodes,
    get_suite,
    kind_of,
    make_task,
)
from cableway.core.errors import TaskError, UnknownNameError
from cableway.simulation.perturbations.variants import VARIANTS, named_perturbation, variant


@pytest.mark.parametrize("name", SUITES)
def test_a_list_has_all_episodes_of_every_size_and_none_twice(name: str):
    suite, episodes = SUITES[name], frozen_episodes(name)
    for size, count in zip(SIZES, suite.sizes, strict=True):
        assert suite.episodes(size) == episodes[:count]
        assert len(episodes[:count]) == count
    assert len({episode.name for episode in episodes}) == len(episodes)
    assert {episode.plant for episode in episodes} <= set(VARIANTS)
    assert list(suite.sizes) == sorted(suite.sizes)


def test_a_larger_size_begins_with_the_smaller_one():
    suite = get_suite("clutter")
    quick, standard, own = suite.episodes("quick"), suite.episodes("standard"), suite.episodes("standard", own=True)
    assert standard[: len(quick)] == quick
    assert own[: len(standard)] == standard
    assert len(own) == 250


def test_suites_in_space_hold_tasks_in_space_and_a_window_its_width():
    for name in SPACE_SUITES:
        assert all(episode.in_space for episode in frozen_episodes(name))
    assert not any(episode.in_space for episode in frozen_episodes("clutter"))
    (wide,) = {kind_of(episode.task) for episode in frozen_episodes("windows")[::3]}
    assert wide == "window 119 mm"
    changed = replace(frozen_episodes("yu")[0], task="yu-1")
    with pytest.raises(TaskError, match="yu-1 has the digest"):
        changed.load()


def test_unknown_names_list_what_there_is():
    with pytest.raises(UnknownNameError, match="clutter"):
        get_suite("cluter")
    with pytest.raises(UnknownNameError, match=", ".join(sorted(SIZES))):
        get_suite("clutter").episodes("small")


@pytest.mark.parametrize("name", SUITES)
def test_the_first_task_and_the_first_in_each_cell_are_still_those_that_were_frozen(name: str):
    of_cells = {episode.task.partition("+")[2]: episode for episode in reversed(frozen_episodes(name))}
    for episode in of_cells.values():
        episode.load()


def test_every_condition_is_known_and_can_be_photographed():
    episodes = frozen_episodes("eyes")
    assert {episode.condition for episode in episodes} == set(CONDITIONS)
    assert all(condition.seen(3).seed == 3 for condition in CONDITIONS.values())
    with pytest.raises(UnknownNameError, match="two-low"):
        condition_of("two-high")


def test_a_task_can_be_put_into_a_cell():
    task = make_task("single-obstacle-2+dual-ur5e")
    assert task.cell is not None
    assert task.grippers.body is not None


def test_a_task_that_comes_out_otherwise_is_noticed():
    episode = replace(frozen_episodes("clutter")[0], task="clutter-1")
    with pytest.raises(TaskError, match="clutter-1 has the digest"):
        episode.load()


def test_another_cable_begins_in_the_same_shape_scaled():
    short, usual = make_task("real-single~hdmi-0.25"), make_task("real-single")
    assert short.cable.length == 0.25
    assert short.cable.preset == "hdmi"
    for mine, its in ((short.start, usual.start), (short.goal, usual.goal)):
        scale = short.cable.length / usual.cable.length
        np.testing.assert_allclose(mine - mine.mean(axis=0), scale * (its - its.mean(axis=0)), atol=1e-3)


@pytest.mark.parametrize("name", VARIANTS)
def test_a_plant_is_the_same_for_the_same_task_and_can_be_built(name: str):
    task = make_task("real-single") if name == "drawn" else make_task("single-obstacle-2")
    first, again = named_perturbation(name, task), named_perturbation(name, task)
    assert first == again
    plant = first.build(task, seed=0)
    assert np.isfinite(plant.reset().poses).all()
    assert plant.task == (first.known_task(task) if first.revealed == 0 else task)
    assert (plant.task is task) == (not name.endswith("obstacles-moved"))


def test_plants_of_two_seeds_differ_only_where_they_should():
    task = make_task("real-single")
    assert named_perturbation("drawn", task, 0).cable != named_perturbation("drawn", task, 1).cable
    assert named_perturbation("hard", task, 0) == named_perturbation("hard", task, 1)
    with pytest.raises(UnknownNameError, match="very-hard"):
        named_perturbation("harder", task)


@pytest.mark.parametrize("number", [3, 300])
def test_limp_cables_are_as_limp_as_their_name_says(number: int):
    task = make_task("clutter-300")
    plant = named_perturbation(f"limp-{number}", task)
    assert plant.cable is not None
    assert plant.table is not None
    load = plant.table.friction * plant.cable.linear_density * 9.81 * plant.cable.length**3
    assert load / plant.cable.bending_stiffness == pytest.approx(number, rel=0.01)


def test_a_plant_can_be_named_as_in_old_files():
    with pytest.warns(DeprecationWarning, match="the plant 'seen-late' is now 'frames-late'"):
        assert variant("seen-late") is VARIANTS["frames-late"]
    with pytest.warns(DeprecationWarning, match="the episode 'clutter-20002-seen-late' is now"):
        assert episode_name("clutter-20002-seen-late") in {episode.name for episode in frozen_episodes("sensing")}
    assert episode_name("sensing/cableway/clutter-20002-moved-late") == "sensing/cableway/clutter-20002-moved-late"
