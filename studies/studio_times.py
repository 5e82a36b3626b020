"""How soon the studio answers: until its page is open, while a gripper is dragged, until a plan is on the screen.

    .venv/bin/python studies/studio_times.py [COUNT]

Drives Chromium by Playwright, drawn by the processor, on `multi-obstacle-1`, where COUNT obstacles are let go, 30 by
default; then on a task in space.
"""

from __future__ import annotations

import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from cableway.geometry import rotations
from cableway.studio.obstacles import middle_of
from cableway.studio.studio import Studio

TASK = "multi-obstacle-1"
SPACE: Any = ("space-clutter", 1)
"""Kind and seed of the task in space."""

SOFTWARE = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
PATIENCE = 120_000
DRAGGED = 4.0
"""Time [s] for which a gripper is dragged."""

COUNT = """time => new Promise(counted => {
  let count = -1;
  const end = performance.now() + time;
  const next = now => { count += 1; now < end ? requestAnimationFrame(next) : counted(count); };
  next(0);
})"""
"""Counts the pictures that a browser shows in a time [ms]."""

SHOWN = """text => new Promise(shown => {
  const look = () => requestAnimationFrame(document.body.textContent.includes(text) ? shown : look);
  look();
})"""
"""Until the page has been drawn with a text. Playwright's own waiting looks only every half second after a while."""


def pixel(studio: Studio, page: Any, place: Any) -> tuple[float, float]:
    """Where a place on the table or in space [m] is seen."""
    camera = next(iter(studio.server.viser.get_clients().values())).camera
    x, y, *z = place
    right, down, ahead = rotations.matrices(camera.wxyz).T @ (np.array([x, y, *(z or [0.01])]) - camera.position)
    box = page.locator("canvas").first.bounding_box()
    scale = box["height"] / 2 / np.tan(camera.fov / 2) / ahead
    return box["x"] + box["width"] / 2 + scale * right, box["y"] + box["height"] / 2 + scale * down


def opened(browser: Any) -> tuple[float, float]:
    """Times [s] from the command until it serves, and until its page is there."""
    command = [sys.executable, "-m", "cableway", "studio", TASK, "--port", "0", "--no-browser"]
    since = time.perf_counter()
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        page = browser.new_page()
        address = process.stderr.readline().split()[0]
        serves = time.perf_counter() - since
        page.goto(address)
        page.get_by_text("Undo").wait_for(timeout=PATIENCE)
        took = time.perf_counter() - since
        page.close()
        process.terminate()
    return serves, took


def followed(studio: Studio, page: Any) -> float:
    """Shapes a second that are sent to the page while a gripper is dragged."""
    (session,) = studio.sessions
    pose = session.draft.gripper_poses("start")[0]
    at, shapes = pixel(studio, page, pose[: 3 if len(pose) > 3 else 2]), []
    forget = session.listen(lambda: shapes.append(session.moment.shapes["start"]))
    page.mouse.move(*at)
    page.mouse.down()
    since, step, ours = time.perf_counter(), 0, time.process_time()
    while (now := time.perf_counter() - since) < DRAGGED:
        step += 1
        page.mouse.move(at[0] + 12 * np.sin(3 * now), at[1] + 12 * np.sin(2 * now))
    ours = time.process_time() - ours
    page.mouse.up()
    forget()
    distinct = len({q.tobytes() for q in shapes if q is not None})
    print(f"  {step / DRAGGED:.0f} moves of the hand a second taken by the browser")
    print(f"  {1000 * ours / max(distinct, 1):.0f} ms of the server's processor a shape, reading the hand included")
    page.keyboard.press("Control+z")
    return distinct / DRAGGED


def drawn(studio: Studio, page: Any) -> tuple[float, float]:
    """Pictures a second that the browser draws where one node moves and nothing is computed, and what the page's script
    takes of each [s]; the rest is the processor's that draws in place of graphics hardware.
    """
    (client,) = studio.server.viser.get_clients().values()
    node = client.scene.add_icosphere("/nudged", radius=0.002, position=(0.1, 0.1, 0.0))
    over = threading.Event()

    def nudge() -> None:
        while not over.wait(0.01):
            node.position = (0.1 + 0.01 * (time.perf_counter() % 1), 0.1, 0.0)
            client.flush()

    nudging = threading.Thread(target=nudge)
    nudging.start()
    tools = page.context.new_cdp_session(page)
    tools.send("Performance.enable")
    before = _busy(tools)
    count = page.evaluate(COUNT, 1000 * DRAGGED)
    took = _busy(tools) - before
    over.set()
    nudging.join()
    node.remove()
    return count / DRAGGED, took / max(count, 1)


def _busy(tools: Any) -> float:
    """Time [s] for which the page's thread has been busy."""
    return next(
        each["value"] for each in tools.send("Performance.getMetrics")["metrics"] if each["name"] == "TaskDuration"
    )


def planned(studio: Studio, page: Any, count: int) -> tuple[list[float], list[float]]:
    """Times [s] from letting go of an obstacle until the server has its plan, and until the page says so."""
    (session,) = studio.sessions
    made: list[float] = []
    server: list[float] = []
    took: list[float] = []
    forget = session.listen(lambda: session.planning.status == "found" and made.append(time.perf_counter()))
    for number in range(count):
        page.get_by_text("A verified plan").wait_for(timeout=PATIENCE)
        x, y = middle_of(session.draft.scene.obstacles[1])
        by = 0.01 if number % 2 else -0.01
        page.mouse.move(*pixel(studio, page, (x, y)))
        page.mouse.down()
        page.mouse.move(*pixel(studio, page, (x + by, y + by)), steps=5)
        page.get_by_text("Let go to plan").wait_for(timeout=PATIENCE)
        made.clear()
        since = time.perf_counter()
        page.mouse.up()
        page.evaluate(SHOWN, "A verified plan")
        took.append(time.perf_counter() - since)
        server.append(made[0] - since)
    forget()
    return server, took


def main(count: int) -> None:
    """Measure and print."""
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        found = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=found, args=list(SOFTWARE))
        serves, took = opened(browser)
        print(f"page open after {took:.1f} s, {serves:.1f} s of which until the command serves it")
        studio = Studio(TASK, out=Path(folder))
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(studio.address)
        page.get_by_text("A verified plan").wait_for(timeout=PATIENCE)
        page.wait_for_timeout(5000)
        pictures, script = drawn(studio, page)
        print(f"{pictures:.0f} pictures a second where nothing is computed")
        print(f"  {1000 * script:.0f} ms of the page's script a picture")
        print(f"{followed(studio, page):.0f} shapes a second while a gripper is dragged")
        server, waits = planned(studio, page, count)
        print(f"plan on the page after {statistics.median(waits):.2f} s (median of {count}, most {max(waits):.2f} s)")
        print(f"  {statistics.median(server):.2f} s of which until the server has it (median)")
        (session,) = studio.sessions
        session.draw(*SPACE)
        page.get_by_text(f"{SPACE[0]}-{SPACE[1]}").wait_for(timeout=PATIENCE)
        page.get_by_text("A verified plan").wait_for(timeout=PATIENCE)
        page.wait_for_timeout(5000)
        print("in space:")
        pictures, script = drawn(studio, page)
        print(f"{pictures:.0f} pictures a second where nothing is computed")
        print(f"  {1000 * script:.0f} ms of the page's script a picture")
        print(f"{followed(studio, page):.0f} shapes a second while a gripper is dragged")
        browser.close()
        studio.stop()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 30)
