"""Limits that a start or goal does not keep: they rise from what it keeps, and nowhere else is less enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import problems
import pytest

from cableway.planning.planner import plan
from cableway.planning.routes.infeasibility import find_blockage
from cableway.scene.obstacles import Box, Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.verification import VerificationLimits, verify_plan
from cableway.verification.ends import CLEARANCE_WAY, STABILITY_WAY, Ends

NEAR_SNAPPING = np.array([0.35, 0.14, 0.0, -29.0, 0.5, 0.0])
"""An S with stability margin 10."""


def beside_its_start(gap: float) -> Task:
    """Free space but for a bar `gap` [m] above the start's highest point."""
    task = problems.moved()
    top = float(task.start[:, 1].max()) + task.cable.radius + gap
    x = float(task.start[np.argmax(task.start[:, 1]), 0])
    return replace(task, scene=Scene(obstacles=(Box(center=(x, top + 0.005), size=(0.03, 0.01)),)))


def test_the_limit_rises_with_the_way_from_an_end_that_keeps_less():
    """In proportion, up to the limit; an end that keeps it asks for nothing less; in contact nothing is asked for."""
    ends = Ends(np.array([[0.0, 0.02, 0.05, 0.1], [0.1, 0.08, 0.05, 0.0]]), 0.3)
    risen = 5 + 15 * np.array([0.0, 0.02, 0.05]) / (STABILITY_WAY * 0.3)
    np.testing.assert_allclose(ends.stability(20.0, np.array([5.0, 30.0])), [*risen, 20.0])
    np.testing.assert_allclose(ends.stability(20.0, np.array([30.0, 30.0])), 20.0)
    np.testing.assert_allclose(ends.stability(20.0, np.array([-3.0, 30.0]))[0], 0.0)


@pytest.mark.parametrize("gap", [0.001, 0.003])
def test_a_start_beside_an_obstacle_is_planned_from(gap):
    """The plan goes away from the obstacle; its verdict says what was asked for at the nearest place."""
    task = beside_its_start(gap)
    found = plan(task)
    verdict = verify_plan(found, task)
    check = next(check for check in verdict.checks if check.name == "cable clearance")
    assert verdict.passed, str(verdict)
    assert check.value < 0.004
    assert check.limit < 0.004


def test_an_obstacle_passed_as_near_on_the_way_is_refused():
    """What may be near at the start may not be near farther on."""
    task = problems.moved()
    found = plan(task)
    away = np.linalg.norm(found.shapes - found.shapes[0], axis=2).max(1)
    back = np.linalg.norm(found.shapes - found.shapes[-1], axis=2).max(1)
    row = int(np.argmax(np.minimum(away, back)))
    assert min(away[row], back[row]) > CLEARANCE_WAY
    middle, next_one = found.shapes[row, 6:8]
    along = (next_one - middle) / np.linalg.norm(next_one - middle)
    for side in (1, -1):
        center = middle + side * (0.006 + task.cable.radius + 0.002) * np.array([-along[1], along[0]])
        beside = replace(task, scene=Scene(obstacles=(Disc(center=(center[0], center[1]), radius=0.006),)))
        assert "cable clearance" in {check.name for check in verify_plan(found, beside).failures()}


def test_a_start_near_snapping_is_planned_from():
    """Its margin is half of what plans keep; the plan's rises from there."""
    task = problems.task_between(NEAR_SNAPPING, problems.MOVED_ARC, name="near-snapping")
    margin = float(task.cable.rod.stability(task.start_equilibrium[None])[0][0])
    assert 5 < margin < VerificationLimits().stability
    assert verify_plan(plan(task), task).passed


def test_nothing_is_called_blocked_because_its_start_keeps_less():
    """A gripper that starts 1 mm from a bar is not in a way too narrow for its clearance."""
    task = problems.moved()
    x, y, angle = plan(task).poses[0, 0]
    bars = [
        Box(
            center=(float(x + 0.01 * side * np.sin(angle)), float(y - 0.01 * side * np.cos(angle))),
            size=(0.02, 0.01),
            angle=float(angle),
        )
        for side in (1, -1)
    ]
    task = replace(task, scene=Scene(obstacles=tuple(bars)))
    assert find_blockage(task, 0.004) is None
