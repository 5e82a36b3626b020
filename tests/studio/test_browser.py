"""The page in Chromium: what is dragged moves, what is let go is planned, pages do not disturb each other."""

from __future__ import annotations

import io
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from spatial_problems import ball_task

from cableway.figures import palette
from cableway.geometry import rotations
from cableway.rendering.cell import arm_capsules
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.cell import Way
from cableway.studio.obstacles import knobs, middle_of
from cableway.studio.session import Session
from cableway.studio.studio import Studio
from cableway.studio.view.look import mixed, rgb
from cableway.studio.view.space import GIZMO

sync_api = pytest.importorskip("playwright.sync_api", reason="studio in a browser: Playwright is not installed")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="studio in a browser: there is no Chromium")

SOFTWARE = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
"""WebGL without graphics hardware."""

SIZE: Any = {"width": 1000, "height": 560}
PATIENCE = 120.0
"""Time [s] to wait for a page: drawn by a processor that others use, too, one takes a minute."""


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Studio]:
    studio = Studio("single-obstacle-2", out=tmp_path_factory.mktemp("saved"))
    yield studio
    studio.stop()


@pytest.fixture(scope="module")
def context() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(SOFTWARE))
        context = browser.new_context(viewport=SIZE)
        context.set_default_timeout(1000 * PATIENCE)  # of everything, page loads included
        yield context
        browser.close()


def until(true: Callable[[], Any], page: Any) -> Any:
    end = time.monotonic() + PATIENCE
    while not (found := true()):
        assert time.monotonic() < end, f"still not: {true}"
        page.wait_for_timeout(50)
    return found


def opened(context: Any, studio: Studio) -> tuple[Any, Session, list[str]]:
    """A page, the session behind it, and what goes wrong in it."""
    page, wrong = context.new_page(), []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    known = studio.sessions
    page.goto(studio.address)
    session = until(lambda: next((each for each in studio.sessions if each not in known), None), page)
    page.get_by_text("A verified plan").wait_for(timeout=1000 * PATIENCE)
    looked: list[Any] = [None]

    def rests() -> bool:
        """Whether the camera does: it is placed once more when the panels are there."""
        page.wait_for_timeout(1000)
        looked.append(pixel(studio, page, 0.0, 0.0))
        return looked[-2] == looked[-1]

    until(rests, page)
    return page, session, wrong


def pixel(studio: Studio, page: Any, x: float, y: float, height: float = 0.0) -> tuple[float, float]:
    """Where on a page a place [m] is seen, by the camera that its connection reports."""
    clients = studio.server.viser.get_clients()
    camera = clients[max(clients)].camera
    w, a, b, c = camera.wxyz
    turn = np.array([
        [1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b)],
        [2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a)],
        [2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)],
    ])  # fmt: skip
    right, down, ahead = turn.T @ (np.array([x, y, height]) - camera.position)
    box = page.locator("canvas").first.bounding_box()
    scale = box["height"] / 2 / np.tan(camera.fov / 2) / ahead
    return box["x"] + box["width"] / 2 + scale * right, box["y"] + box["height"] / 2 + scale * down


def patch(page: Any, at: tuple[float, float]) -> np.ndarray:
    """The colours of a place on the page and of the two pixels about it."""
    picture = imread(io.BytesIO(page.screenshot(timeout=1000 * PATIENCE)))[:, :, :3] * 255
    x, y = round(at[0]), round(at[1])
    return picture[y - 2 : y + 3, x - 2 : x + 3].reshape(-1, 3)


def looks(page: Any, at: tuple[float, float], color: str) -> bool:
    return bool(np.abs(patch(page, at) - rgb(color)).max(axis=1).min() < 30)


@pytest.fixture(scope="module")
def first(studio: Studio, context: Any) -> tuple[Any, Session, list[str]]:
    return opened(context, studio)


def test_an_obstacle_is_dragged_and_planned_for_and_the_plan_scrubbed(studio: Studio, first: Any):
    page, session, wrong = first
    before, plan = session.draft.scene.obstacles[0], session.planning.plans[0]
    x, y = middle_of(before)
    start, end = pixel(studio, page, x, y, 0.01), pixel(studio, page, x + 0.03, y - 0.02, 0.01)
    inside = knobs(before) + 0.2 * (middle_of(before) - knobs(before))
    corner = inside[1] + 0.2 * (inside[0] - inside[1])
    left = pixel(studio, page, *corner, 0.01)  # the obstacle is to leave it
    until(lambda: looks(page, start, palette.OBSTACLE) and looks(page, left, palette.OBSTACLE), page)
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=8)
    page.mouse.up()
    until(lambda: session.planning.status == "found" and session.planning.plans[0] is not plan, page)
    moved = session.draft.scene.obstacles[0]
    np.testing.assert_allclose(middle_of(moved) - (x, y), (0.03, -0.02), atol=0.004)
    until(lambda: not looks(page, left, palette.OBSTACLE), page)
    there = pixel(studio, page, *(corner + middle_of(moved) - (x, y)), 0.01)
    until(lambda: looks(page, there, mixed(palette.BLUE, 0.72)), page)  # the colour of what is selected
    plan = session.planning.plans[0]
    view = pixel(studio, page, 0.0, 0.0)
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    page.get_by_text("0.3 s: cable").wait_for(timeout=1000 * PATIENCE)
    for _ in range(3):
        page.keyboard.press("ArrowLeft")
    page.get_by_text("0.0 s: cable").wait_for(timeout=1000 * PATIENCE)
    assert pixel(studio, page, 0.0, 0.0) == view  # which viser's page turns by these keys
    cable = pixel(studio, page, *plan.shapes[0, plan.shapes.shape[1] // 2], 0.006)
    # A slow page is drawn coarsely, and the cable is two pixels wide: it is darker than the table, by how much is open.
    until(lambda: patch(page, cable).max(axis=1).min() < 215, page)
    page.get_by_role("tab", name="Run").click()
    page.get_by_label("Cameras").first.click()
    page.get_by_role("option", name="above", exact=True).click()
    page.get_by_role("button", name="Run").click()

    def running() -> Any:
        return session.running

    until(lambda: running() is not None and len(running().seen) > 2, page)
    assert running().eyes.cameras == ("above",)
    page.get_by_text("What the cameras see").wait_for(timeout=1000 * PATIENCE)
    page.get_by_role("button", name="Stop").click()
    until(lambda: not running().live, page)
    assert running().run.rollout.steps >= 2
    page.get_by_text("The run was cancelled.").wait_for(timeout=1000 * PATIENCE)
    page.get_by_role("tab", name="Plan").click()
    assert wrong == []


def test_another_page_has_a_task_of_its_own_which_outlives_its_connection(studio: Studio, context: Any, first: Any):
    _, session, _ = first
    other, second, wrong = opened(context, studio)
    second.set_obstacle(0, None)
    assert len(session.draft.scene.obstacles) == 1
    other.reload()
    other.get_by_text("A verified plan").wait_for(timeout=1000 * PATIENCE)
    assert second.draft.scene.obstacles == ()
    other.bring_to_front()
    before = studio.pages_of(second)
    studio.server.disconnect_all()
    until(lambda: studio.pages_of(second) and studio.pages_of(second) != before, other)
    assert len(studio.sessions) == 2

    def undone() -> bool:
        """The page hears keys once it has been told of them."""
        other.keyboard.press("Control+z")
        other.wait_for_timeout(500)
        return len(second.draft.scene.obstacles) == 1

    until(undone, other)
    assert wrong == []
    other.close()


def test_a_gripper_is_led_by_its_arrows_in_space_and_arms_are_shown(studio: Studio, first: Any):
    pytest.importorskip("coal")
    page, session, wrong = first
    page.bring_to_front()
    until(lambda: list(studio.server.viser.get_clients()) == list(studio.pages_of(session)), page)
    session.open(ball_task())
    until(lambda: session.planning.status == "found", page)
    goal = ball_task().gripper_poses("goal")[0, :3]
    until(lambda: looks(page, pixel(studio, page, *goal), mixed(palette.GOAL, 0.55)), page)  # the camera is at rest
    before = ball_task().gripper_poses("start")[0]
    up = rotations.rotate(before[3:], np.array([0.0, 0.0, 1.0]))
    page.mouse.click(*pixel(studio, page, *before[:3]))
    arrow, to = (before[:3] + (0.8 * GIZMO * 0.8 + far) * up for far in (0.0, 0.05))
    at = pixel(studio, page, *arrow)
    until(lambda: patch(page, at).min() < 180, page)  # the arrow is there
    page.mouse.move(*at)
    page.mouse.down()
    page.mouse.move(*pixel(studio, page, *to), steps=8)
    page.mouse.up()
    until(lambda: session.planning.status == "found" and session.can_undo, page)
    moved = session.draft.gripper_poses("start")[0] - before
    np.testing.assert_allclose(moved[:3], 0.05 * up, atol=0.008)
    page.get_by_text("A verified plan").wait_for(timeout=1000 * PATIENCE)
    page.keyboard.press("Control+z")
    until(lambda: np.array_equal(session.draft.start, ball_task().start), page)
    page.get_by_role("button", name="cylinder").wait_for()
    assert not page.get_by_text("Bend the start").is_visible()
    session.draw("cell-clutter", 1)  # the arms of a cell, which show the table through them
    until(lambda: session.planning.status == "found" and session.planning.plans[0].joints is not None, page)
    task, plan = session.draft.checked(), session.planning.plans[0]
    way = Way.of_record(plan.metadata)
    assert way is not None
    for (_, others), color in zip(
        arm_capsules(task, CellKinematics(task, way), plan.joints[0]), (palette.LEFT, palette.RIGHT), strict=True
    ):
        base = others.ends[0].mean(axis=0)
        most, least = np.argmax(rgb(color)), np.argmin(rgb(color))
        until(lambda at=base, a=most, b=least: np.ptp(patch(page, pixel(studio, page, *at))[12][[a, b]]) > 30, page)
    page.get_by_text("Show the arms").click()
    until(lambda: np.ptp(patch(page, pixel(studio, page, *base))[12]) < 30, page)
    assert wrong == []


def test_ctrl_c_ends_the_command(tmp_path: Path):
    command = [sys.executable, "-m", "cableway", "studio", "multi-obstacle-1", "--port", "0", "--no-browser"]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("http://127.0.0.1:")
        process.send_signal(signal.SIGINT)
        assert process.stderr.read() == "cableway: interrupted\n"
        assert process.wait(10) == 130
