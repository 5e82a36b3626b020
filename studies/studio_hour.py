"""Random clicking and dragging on a page of the studio: does it fail, and does its memory grow?

    .venv/bin/python studies/studio_hour.py [MINUTES] [SEED] [TASK]

Drives Chromium by Playwright: 60 minutes, seed 0 and `multi-obstacle-1` by default. Says what went wrong in the
server's log and in the browser's console, and the memory of the server, its planner and the page at first, after each
quarter of the time, and at last.
"""

from __future__ import annotations

import logging
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Error, sync_playwright

from cableway.studio.studio import Studio

TASK = "multi-obstacle-1"
SOFTWARE = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
SIZE: Any = {"width": 1280, "height": 800}
BEGUN = 60.0
"""Time [s] after which memory counts: by then all is loaded."""

OPENING = ("...", "Download", "Make a video")
"""In the names of buttons that open a window of the system, which nobody closes here."""

NOT_OURS = ("passive event listener", "showSaveFilePicker")
"""In messages of viser's page that are none of ours: a warning, and that nobody chose a file for a picture of it."""


class Wrong(logging.Handler):
    """Collects what is logged as an error."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep it."""
        self.said.append(self.format(record))


def drag(page: Any, rng: random.Random) -> None:
    """From somewhere on the table to near there: an obstacle, a gripper, a knob, or the view."""
    x, y = rng.uniform(300, 980), rng.uniform(120, 700)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + rng.uniform(-120, 120), y + rng.uniform(-120, 120), steps=rng.randint(1, 6))
    page.mouse.up()


def click(page: Any, rng: random.Random) -> None:
    """Somewhere on the page."""
    page.mouse.click(rng.uniform(0, SIZE["width"]), rng.uniform(0, SIZE["height"]))


def press(page: Any, rng: random.Random) -> None:
    """A key that means something."""
    page.keyboard.press(rng.choice(["ArrowRight", "ArrowLeft", "Space", "Control+z", "Control+y", "Delete", "Escape"]))


def button(page: Any, rng: random.Random) -> None:
    """One of the buttons and tabs that there are now, but for those that open a window of the system."""
    buttons = page.locator("button:visible:enabled, [role=tab]:visible").all()
    chosen = rng.choice(buttons) if buttons else None
    if chosen is not None and not any(each in (chosen.text_content(timeout=2000) or "") for each in OPENING):
        chosen.click(timeout=2000)


def above(page: Any, rng: random.Random) -> None:
    """The whole table again, and the first task now and then, so that there is something to grasp."""
    page.get_by_text(re.compile("Look (from above|at all of it)")).click(timeout=2000)
    if rng.random() < 0.3:
        page.reload()
        page.get_by_text("Undo").wait_for(timeout=60_000)


DEEDS: dict[Callable[[Any, random.Random], None], float] = {drag: 5, click: 1, press: 3, button: 3, above: 0.5}
"""What is done, and how often."""


def memory() -> dict[str, float]:
    """[MB] of this process, of its planners, and of the browser; what processes share counts once."""
    listed = subprocess.run(["ps", "-eo", "pid=,ppid=,args="], capture_output=True, text=True, check=True).stdout
    rows = [(int(pid), int(above), " ".join(rest)) for pid, above, *rest in map(str.split, listed.splitlines())]
    ours, found = {os.getpid()}, {"server": 0.0, "planners": 0.0, "browser": 0.0}
    while more := {pid for pid, above, _ in rows if above in ours} - ours:
        ours |= more
    for pid, _, said in rows:
        if pid in ours:
            kind = "server" if pid == os.getpid() else "browser" if "chrom" in said else "planners"
            found[kind] += size_of(pid) if kind != "planners" or "multiprocessing" in said else 0.0
    return found


def size_of(pid: int) -> float:
    """Proportional set size [MB] of a process; 0 where it has gone."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except OSError:
        return 0.0
    return int(text.split("Pss:")[1].split()[0]) / 1024


def play(page: Any, rng: random.Random, seconds: float) -> tuple[Counter[str], list[dict[str, float]]]:
    """Do things for a time; how often each was done, and the memory once all was loaded and after each quarter."""
    begin, done, sizes = time.monotonic(), Counter[str](), []
    due = [min(BEGUN, seconds / 8), *(seconds * quarter / 4 for quarter in range(1, 4))]
    while (passed := time.monotonic() - begin) < seconds:
        (deed,) = rng.choices(list(DEEDS), list(DEEDS.values()))
        try:
            deed(page, rng)
            done[deed.__name__] += 1
        except Error:  # what was to be clicked has gone meanwhile
            done["missed"] += 1
        page.wait_for_timeout(rng.uniform(0, 300))
        if len(sizes) < len(due) and passed > due[len(sizes)]:
            sizes.append(memory())
    return done, [*sizes, memory()]


def main(minutes: float, seed: int, task: str) -> int:
    """Play and print; 1 where something went wrong."""
    wrong, console = Wrong(), []
    logging.getLogger().addHandler(wrong)
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        found = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=found, args=list(SOFTWARE))
        studio = Studio(task, out=Path(folder))
        page = browser.new_page(viewport=SIZE)

        def hear(said: str) -> None:
            if not any(each in said for each in NOT_OURS):
                console.append(said)

        page.on("pageerror", lambda error: hear(str(error)))
        page.on("console", lambda said: hear(said.text) if said.type == "error" else None)
        page.goto(studio.address)
        page.get_by_text("A verified plan").wait_for(timeout=120_000)
        done, sizes = play(page, random.Random(seed), 60 * minutes)
        browser.close()
        studio.stop()
    deeds = ", ".join(f"{count} x {name}" for name, count in done.most_common())
    print(f"{task}, {minutes:g} minutes, seed {seed}: {deeds}")
    print("memory [MB]: " + ", ".join(f"{kind} {' '.join(f'{each[kind]:.0f}' for each in sizes)}" for kind in sizes[0]))
    for name, said in (("server", wrong.said), ("browser", console)):
        print(f"errors in the {name}: {len(said)}")
        for text, count in Counter(said).most_common(5):
            print(f"  {count} x {text}")
    return 1 if wrong.said or console else 0


if __name__ == "__main__":
    minutes, seed, task = (*sys.argv[1:], *("60", "0", TASK)[len(sys.argv) - 1 :])
    sys.exit(main(float(minutes), int(seed), task))
