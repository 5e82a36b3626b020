"""Without a display, and without graphics for MuJoCo, there are pictures and a video all the same."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

RUN = """
import sys
from pathlib import Path
from recorded import moved_plan
import cableway as cw
from cableway.control.open_loop import OpenLoop
from cableway.figures.rollout import rollout_figure
from cableway.figures.style import save_figure
from cableway.figures.video import write_video

folder, (task, plan) = Path(sys.argv[1]), moved_plan(rows=5)
rollout = cw.track(cw.CableSimulator(task), OpenLoop(), plan)
save_figure(rollout_figure(task, rollout), folder / "rollout.png")
write_video(folder / "rollout.mp4", task, rollout)
"""


def headless(code: str, *arguments: str, **variables: str) -> None:
    """Run code in a new process that finds no display."""
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR", "MUJOCO_GL", "PYOPENGL_PLATFORM", "MPLBACKEND")
    environment = {name: value for name, value in os.environ.items() if name not in hidden} | variables
    command, here = [sys.executable, "-c", code, *arguments], Path(__file__).parent
    done = subprocess.run(command, cwd=here, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_run_is_drawn_and_filmed_without_a_display(tmp_path: Path):
    headless(RUN, str(tmp_path))
    assert (tmp_path / "rollout.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "rollout.mp4").read_bytes()[4:8] == b"ftyp"


@pytest.mark.parametrize("graphics", ["osmesa", "no such thing"])
def test_the_plant_steps_whatever_graphics_are_named(graphics: str):
    code = (
        "import os; from problems import free; import cableway as cw\n"
        "cw.CableSimulator(free()).reset(); assert os.environ['MUJOCO_GL'] == " + repr(graphics)
    )
    headless(code, MUJOCO_GL=graphics)


def test_the_command_begins_no_process_to_ask_about_graphics():
    """Ctrl-c would end it with a traceback."""
    code = (
        "import sys; from cableway.cli import main; begun = []\n"
        "sys.addaudithook(lambda event, _: begun.append(event) if event == 'subprocess.Popen' else None)\n"
        "assert main(['run', 'no such file']) == 2; assert 'mujoco' in sys.modules; assert not begun, begun"
    )
    headless(code)
