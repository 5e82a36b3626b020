"""What frames leave unexplained."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.estimation.surprise import Surprise

START = np.column_stack([np.linspace(0.1, 0.4, 13), np.full(13, 0.3)])


def seen(ways: list[float], off: list[float]) -> Surprise:
    """After frames of a cable that goes so far [m] from one to the next, and is seen so far [m] off there."""
    surprise, at = Surprise.none(START, 0.3), 0.0
    for way, error in zip(ways, off, strict=True):
        at += way
        expected = START + [0.0, at]
        surprise = surprise.updated(expected + [0.0, error], expected, np.zeros_like(START), expected)
    return surprise


def test_frames_that_come_early_and_late_by_turns_are_jitter() -> None:
    assert seen([0.01] * 4, [0.0, -0.01, 0.0, -0.01]).jitter == pytest.approx(0.01)


def test_a_short_way_does_not_say_when_the_frame_of_a_long_one_was_taken() -> None:
    """6 mm off is six steps of 1 mm: the next frame, after 20 mm and where it should be, did not come 120 mm late."""
    assert seen([0.001, 0.001, 0.02], [0.0, 0.006, 0.0]).jitter < 0.007
