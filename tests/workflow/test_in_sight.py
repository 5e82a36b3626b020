"""Arms are led the way that leaves the cable in sight of cameras, where there is room for that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cableway.geometry import polyline
from cableway.perception import kernels
from cableway.perception.placement import camera_at
from cableway.perception.views import View, seen_of
from cableway.planning.planner import plan as find_plan
from cableway.records import Plan
from cableway.rendering.cell import CellScene, Label
from cableway.rendering.picture import labels
from cableway.scene.cell import Way
from cableway.scene.task import Task
from cableway.tasks.generation import random_task
from cableway.tracking.photographer import LOOK, EyesConfig
from cableway.verification import VerificationLimits, verify_plan
from cableway.workflow.in_sight import in_sight
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

LIMITS = VerificationLimits()


@pytest.fixture(scope="module")
def planned() -> tuple[Task, Plan]:
    task = random_task(20129, "cell-clutter")
    return task, find_plan(task, seed=63)


def hidden_in_pictures(plan: Plan, task: Task, places: tuple[str, ...]) -> float:
    """Share of the cable that meshes of arms hide, over a few rows."""
    way, shares = Way.of_record(plan.metadata), []
    assert plan.joints is not None
    scene = CellScene(task, way, LOOK)
    for row in np.linspace(0, plan.steps, 6).round().astype(int):
        line = polyline.resample(plan.shapes[row], 33)
        mesh = scene.mesh(line, joints=plan.joints[row])
        bare, seen = mesh.where(mesh.labels != Label.CABLE), np.zeros(33, bool)
        for place in places:
            camera = camera_at(place, task.scene.size)
            hiding = labels(bare, camera.pinhole) > Label.TABLE
            seen |= seen_of(View(camera, np.ones_like(hiding), hiding), line, task.cable.radius) == kernels.SEEN
        shares.append(1 - seen.mean())
    return float(np.mean(shares))


def test_more_of_the_cable_is_in_sight_as_pictures_have_it(planned: tuple[Task, Plan]) -> None:
    task, plan = planned
    sides = ("left", "right")
    led = in_sight(plan, task, sides, LIMITS)
    record = led.metadata["in_sight"]
    assert record["hidden"] < record["before"] - 0.05
    assert hidden_in_pictures(led, task, sides) < hidden_in_pictures(plan, task, sides) - 0.05
    assert Way.of_record(led.metadata) != Way.of_record(plan.metadata)
    np.testing.assert_array_equal(led.poses, plan.poses)
    assert led.verdict is not None
    assert led.verdict.passed
    assert verify_plan(led, task, LIMITS).passed


def test_a_plan_whose_cable_is_seen_as_well_stays_as_it_is(planned: tuple[Task, Plan]) -> None:
    task, plan = planned
    led = in_sight(plan, task, ("left", "right"), LIMITS)
    assert in_sight(led, task, ("left", "right"), LIMITS) is led
    held = task.held(Way.of_record(plan.metadata))
    assert in_sight(plan, held, ("left", "right"), LIMITS) is plan, "the arms hold the cable already"
    assert in_sight(replace(plan, joints=None, metadata={}), task, ("above",), LIMITS).metadata == {}


def test_the_report_says_what_stays_hidden(planned: tuple[Task, Plan]) -> None:
    """And a plan that the user gives is followed as it is."""
    task, plan = planned
    options = SolveOptions(eyes=EyesConfig(cameras=("left", "right")), seed=63, track=False, plan=plan)
    given = solve(task, options).plan
    assert given is not None
    assert Way.of_record(given.metadata) == Way.of_record(plan.metadata)
    run = solve(task, replace(options, plan=None))
    assert any(note.startswith("The arms hold the cable so that they hide") for note in run.report.notes)
    assert run.report.plan_verdict is not None
    assert run.report.plan_verdict.passed
