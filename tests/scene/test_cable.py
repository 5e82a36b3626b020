"""Cables: what is read and kept, values along the length, and cables drawn from ranges."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cableway.core.errors import InputError, TaskError
from cableway.scene.cable import PROFILES, Cable
from cableway.scene.files.loading import cable_from_preset
from cableway.scene.files.presets import preset_names, preset_ranges, preset_values


def test_values_along_the_length_are_linear_between_those_given():
    cable = Cable(stiffness_profile=(1, 3, 2), rest_curvature=np.array([4.0]))  # pyright: ignore[reportArgumentType]
    np.testing.assert_allclose(cable.along("stiffness_profile", np.array([0, 0.25, 0.5, 1])), [1, 2, 3, 2])
    np.testing.assert_array_equal(cable.along("rest_curvature", np.array([0, 0.3, 1])), [4, 4, 4])
    assert isinstance(hash(cable), int)


@pytest.mark.parametrize(
    ("changes", "alike"),
    [
        ({}, True),
        ({"friction": 1.0, "drag": 1.0, "bending_stiffness": 1.0}, True),
        ({"rest_curvature": (3.0,), "stiffness_profile": (2.0, 2.0)}, True),
        ({"rest_curvature": (3.0, 0.0)}, False),
        ({"stiffness_profile": (2.0, 1.0)}, False),
        ({"yield_curvature": 9.0}, False),
    ],
)
def test_which_cables_bend_as_the_uniform_rod(changes, alike):
    assert Cable(**changes).bends_as_rod is alike


def test_a_cable_drawn_lies_within_the_ranges_of_its_preset():
    for name in preset_names():
        cable, ranges = cable_from_preset(name, keypoints=10), preset_ranges(name)
        low, high = np.inf, -np.inf
        for seed in range(20):
            drawn = cable.sample(seed)
            assert {f for f in cable.as_dict() if getattr(drawn, f) != getattr(cable, f)} == set(ranges)
            for field, limits in ranges.items():
                values = np.atleast_1d(getattr(drawn, field))
                assert limits[0] <= values.min()
                assert values.max() <= limits[1]
                assert len(values) == (3 if field in PROFILES else 1)
            low, high = min(low, drawn.friction), max(high, drawn.friction)
        assert high - low > 0.5 * np.ptp(ranges["friction"])


def test_values_of_a_preset_lie_within_its_ranges():
    for name in preset_names():
        values = preset_values(name)
        assert all(low <= values[f] <= high for f, (low, high) in preset_ranges(name).items() if f in values)


def test_the_same_seed_gives_the_same_cable():
    cable = cable_from_preset("usb")
    assert cable.sample(3) == cable.sample(3) != cable.sample(4)
    rng = np.random.default_rng(3)
    assert cable.sample(rng) == cable.sample(3)
    assert cable.sample(rng) != cable.sample(3)


def test_ranges_of_ones_own():
    drawn = Cable().sample(0, {"length": (0.29, 0.31), "drag": (2.0, 2.0)})
    assert 0.29 <= drawn.length <= 0.31
    assert drawn == dataclasses.replace(Cable(), length=drawn.length, drag=2.0)


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("ranges", "said"),
    [
        (None, "preset None has no ranges"),
        ({"lenght": (0.2, 0.3)}, "there is no range for 'lenght'; known: length, "),
        ({"keypoints": (3, 9)}, "there is no range for 'keypoints'"),
        ({"friction": (0.5, 0.2)}, "ranges.friction must be two ascending numbers"),
        ({"friction": 0.5}, "ranges.friction must be two numbers"),
        ({"friction": (0.1, np.nan)}, r"ranges.friction\[1\] must be not negative and finite"),
        ({"damping_time": (0.0, 0.2)}, r"ranges.damping_time\[0\] must be positive"),
        ({"friction": (-0.2, -0.1)}, r"ranges.friction\[0\] must be not negative"),
    ],
)
def test_ranges_that_cannot_be_drawn_from_are_refused(ranges, said):
    with pytest.raises(InputError, match=said):
        Cable().sample(0, ranges)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"stiffness_profile": 2.0}, "cable.stiffness_profile must be a list of numbers, got 2.0"),
        ({"stiffness_profile": ()}, "cable.stiffness_profile must be a list of 1 to 200 numbers, got 0"),
        ({"rest_curvature": ("1",)}, r"cable.rest_curvature\[0\] must be a number, got '1'"),
    ],
)
def test_values_along_the_length_that_are_none_are_refused(changes, said):
    with pytest.raises(TaskError, match=said):
        Cable(**changes)
