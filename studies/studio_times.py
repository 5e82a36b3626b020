"""How soon the studio answers: until its page is open, while a gripper is dragged, until a plan is on the screen.

    .venv/bin/python studies/studio_times.py [COUNT]

Drives Chromium by Playwright, drawn by the processor, on `multi-obstacle-1`. COUNT obstacles are let go, 30 by default.
"""

from __future__ import annotations

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from cableway.studio.obstacles import middle_of
from cableway.studio.studio import Studio

TASK = "multi-obstacle-1"
SOFTWARE = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
PATIENCE = 120_000
DRAGGED = 4.0
"""Time [s] for which a gripper is dragged."""


def pixel(studio: Studio, page: Any, x: float, y: float) -> tuple[float, float]:
    """Where a place on the table [m] is seen: the page looks along y and down, and not aside."""
    camera = next(iter(studio.server.viser.get_clients().values())).camera
    ahead = camera.look_at - camera.position
    ahead = ahead / np.linalg.norm(ahead)
    ray = np.array([x, y, 0.01]) - camera.position
    down = np.cross(ahead, [1.0, 0.0, 0.0])
    box = page.locator("canvas").first.bounding_box()
    scale = box["height"] / 2 / np.tan(camera.fov / 2) / (ray @ ahead)
    return box["x"] + box["width"] / 2 + scale * ray[0], box["y"] + box["height"] / 2 + scale * (ray @ down)


def opened(browser: Any) -> float:
    """Time [s] from the command to its page."""
    command = [sys.executable, "-m", "cableway", "studio", TASK, "--port", "0", "--no-browser"]
    since = time.perf_counter()
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        page = browser.new_page()
        page.goto(process.stderr.readline().split()[0])
        page.get_by_text("Undo").wait_for(timeout=PATIENCE)
        took = time.perf_counter() - since
        page.close()
        process.terminate()
    return took


def followed(studio: Studio, page: Any) -> float:
    """Shapes a second that are sent to the page while a gripper is dragged."""
    (session,) = studio.sessions
    x, y = session.draft.gripper_poses("start")[0, :2]
    at, shapes = pixel(studio, page, x, y), []
    forget = session.listen(lambda: shapes.append(session.moment.shapes["start"]))
    page.mouse.move(*at)
    page.mouse.down()
    since, step = time.perf_counter(), 0
    while (now := time.perf_counter() - since) < DRAGGED:
        step += 1
        page.mouse.move(at[0] + 12 * np.sin(3 * now), at[1] + 12 * np.sin(2 * now))
    page.mouse.up()
    forget()
    distinct = len({q.tobytes() for q in shapes if q is not None})
    print(f"  {step / DRAGGED:.0f} moves of the hand a second")
    page.keyboard.press("Control+z")
    return distinct / DRAGGED


def planned(studio: Studio, page: Any, count: int) -> list[float]:
    """Times [s] from letting go of an obstacle until its plan is said on the page."""
    (session,), took = studio.sessions, []
    for number in range(count):
        page.get_by_text("A verified plan").wait_for(timeout=PATIENCE)
        x, y = middle_of(session.draft.scene.obstacles[1])
        by = 0.01 if number % 2 else -0.01
        page.mouse.move(*pixel(studio, page, x, y))
        page.mouse.down()
        page.mouse.move(*pixel(studio, page, x + by, y + by), steps=5)
        page.get_by_text("Let go to plan").wait_for(timeout=PATIENCE)
        since = time.perf_counter()
        page.mouse.up()
        page.get_by_text("A verified plan").wait_for(timeout=PATIENCE)
        took.append(time.perf_counter() - since)
    return took


def main(count: int) -> None:
    """Measure and print."""
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        found = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=found, args=list(SOFTWARE))
        print(f"page open after {opened(browser):.1f} s")
        studio = Studio(TASK, out=Path(folder))
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(studio.address)
        page.get_by_text("A verified plan").wait_for(timeout=PATIENCE)
        page.wait_for_timeout(5000)
        print(f"{followed(studio, page):.0f} shapes a second while a gripper is dragged")
        took = planned(studio, page, count)
        print(f"plan on the page after {statistics.median(took):.2f} s (median of {count}, most {max(took):.2f} s)")
        browser.close()
        studio.stop()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 30)
