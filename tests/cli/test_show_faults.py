"""Laws of `show` on tasks that no cable can do: it draws them, marks what is wrong where it is, and returns 2."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
import yaml
from commands import Command
from matplotlib.colors import to_rgb

from cableway.core.errors import TaskError
from cableway.figures import palette
from cableway.figures.scene import task_figure
from cableway.scene.files.loading import load_task

Content = dict[str, Any]


def straight(x: float, y: float, length: float = 0.3, keypoints: int = 13) -> list[list[float]]:
    return [[x + length * k / (keypoints - 1), y] for k in range(keypoints)]


def possible() -> Content:
    """A task of a straight cable that is moved up past a disc."""
    return {
        "cableway": 1,
        "name": "possible",
        "workspace": {"size": [0.7, 0.6]},
        "cable": {"length": 0.3, "radius": 0.004},
        "grippers": {"radius": 0.012},
        "obstacles": [{"type": "disc", "center": [0.35, 0.3], "radius": 0.05}],
        "start": straight(0.2, 0.1),
        "goal": straight(0.2, 0.5),
    }


def overlapping_disc(content: Content) -> None:
    content["start"] = straight(0.2, 0.3 - 0.05 - 0.004 + 0.0001)


def overlapping_box(content: Content) -> None:
    content["obstacles"] = [{"type": "box", "center": [0.35, 0.1], "size": [0.02, 0.02]}]


def gripper_in_wall(content: Content) -> None:
    content["start"] = straight(0.01, 0.1)


def outside(content: Content) -> None:
    content["goal"] = straight(0.5, 0.5)


def far_outside(content: Content) -> None:
    content["goal"] = straight(40.0, 0.5)


def too_long(content: Content) -> None:
    content["start"] = straight(0.2, 0.1, 0.33)


def uneven(content: Content) -> None:
    content["start"][6][0] += 0.01


def too_few(content: Content) -> None:
    content["start"] = straight(0.2, 0.1, keypoints=9)


def a_single_keypoint(content: Content) -> None:
    content["start"] = [[0.2, 0.1]]


def curled(content: Content, turns: float) -> None:
    angles = 2 * np.pi * turns * np.linspace(0, 1, 13)
    radius = 0.3 / (2 * np.pi * turns)
    content["start"] = (np.array([0.1, 0.15]) + radius * np.column_stack([np.cos(angles), np.sin(angles)])).tolist()


def crossing(content: Content) -> None:
    """A loop between two straight parts."""
    turn = np.concatenate([[0], np.cumsum(np.full(8, 2 * np.pi / 8)), np.full(3, 2 * np.pi)])
    steps = 0.025 * np.column_stack([np.cos(turn), np.sin(turn)])
    content["start"] = np.vstack([[0.1, 0.08], [0.1, 0.08] + np.cumsum(steps, axis=0)]).tolist()


def discs_overlapping(content: Content) -> None:
    curled(content, 0.96)


def touching_itself(content: Content) -> None:
    content["cable"]["radius"] = 0.02
    curled(content, 0.9)


def bent_sharply(content: Content) -> None:
    content["cable"]["min_bend_radius"] = 0.06
    curled(content, 0.85)


def no_equilibrium(content: Content) -> None:
    content["start"] = {"grippers": [[0.2, 0.1, 0.0], [0.49, 0.1, 3.0]], "bend": "left"}


def too_far_apart(content: Content) -> None:
    content["goal"] = {"grippers": [[0.1, 0.5, 0.0], [0.6, 0.5, 0.0]], "bend": "left"}


def poses_elsewhere(content: Content) -> None:
    content["start"] = {"grippers": [[0.2, 0.13, 0.0], [0.5, 0.1, 0.0]], "keypoints": straight(0.2, 0.1)}


def plugged(content: Content) -> None:
    content["plug"] = {"length": 0.04, "width": 0.012}


def plug_in_obstacle(content: Content) -> None:
    plugged(content)
    content["obstacles"] = [{"type": "box", "center": [0.535, 0.1], "size": [0.01, 0.02]}]


def port_elsewhere(content: Content) -> None:
    plugged(content)
    content["port"] = {"position": [0.65, 0.3], "angle": 0.0, "depth": 0.02, "standoff": 0.02}


def obstacle_outside(content: Content) -> None:
    content["obstacles"].append({"type": "box", "center": [0.69, 0.3], "size": [0.06, 0.1]})


CASES: list[tuple[Callable[[Content], None], str, tuple[float, float] | None]] = [
    (overlapping_disc, r"start overlaps obstacles\[0\] \(disc .*\) by 0.10 mm", (0.35, 0.25)),
    (overlapping_box, r"start overlaps obstacles\[0\] \(box .*\) by 14.0 mm", (0.35, 0.1)),
    (gripper_in_wall, "start has its left gripper in the left wall by 2.0 mm", (0.0, 0.1)),
    (outside, r"goal\[9\] at \(725, 500\) mm lies outside the workspace", (0.725, 0.5)),
    (far_outside, r"goal\[0\] at \(40000, 500\) mm lies outside the workspace", (40.0, 0.5)),
    (too_long, "start is 330 mm long, more than 2% off cable.length 300 mm", (0.365, 0.1)),
    (uneven, "start is not at equal arc length: keypoints 6 and 7", (0.3685, 0.1)),
    (too_few, "start has 9 keypoints, not the 13 of cable.keypoints", None),
    (a_single_keypoint, "start has 1 keypoints, not the 13 of cable.keypoints", None),
    (crossing, "start crosses itself", None),
    (discs_overlapping, "start has its grippers .* mm apart, less than two of grippers.radius, 24 mm", None),
    (touching_itself, "start touches itself near", None),
    (bent_sharply, "start bends to a radius of 56.* mm at keypoint", None),
    (no_equilibrium, "start.bend asks for a bend to the left, but no stable shape", (0.345, 0.1)),
    (too_far_apart, "goal.grippers are 500 mm apart, farther than the cable is long", (0.35, 0.5)),
    (poses_elsewhere, "start.grippers do not fit the keypoints: the left pose is 30.0 mm", (0.2, 0.13)),
    (plug_in_obstacle, r"start has its plug in obstacles\[0\] \(box .*\) by", (0.534, 0.094)),
    (port_elsewhere, "goal must have its right end at", (0.5, 0.5)),
    (obstacle_outside, r"obstacles\[1\] \(box .*\) reaches outside the workspace", (0.7, 0.3)),
]  # fmt: skip


def write(change: Callable[[Content], None]) -> Path:
    content = possible()
    change(content)
    path = Path("mine.yaml")
    path.write_text(yaml.safe_dump(content))
    return path


def test_the_task_of_which_all_these_are_changes_is_possible(cableway: Command):
    assert cableway("show", write(lambda content: None)).status == 0


@pytest.mark.parametrize(("change", "sentence", "at"), CASES, ids=[case[0].__name__ for case in CASES])
def test_what_is_wrong_is_said_marked_and_drawn(
    cableway: Command, change: Callable[[Content], None], sentence: str, at: tuple[float, float] | None
):
    path = write(change)
    with pytest.raises(TaskError, match=sentence) as caught:
        load_task(path)
    found = caught.value
    if at is not None:
        assert found.at == pytest.approx(at, abs=0.001)
    done = cableway("show", path)
    assert done.status == 2
    assert done.err.startswith(f"cableway: {found}")
    assert done.err.endswith("drawn in runs/possible/task.png\n")
    picture = matplotlib.image.imread("runs/possible/task.png")[..., :3]
    red = np.abs(picture - to_rgb(palette.BAD)).max(axis=2) < 0.03
    assert red.sum() > 300, "the sentence, and the ring where there is a place"
    figure = task_figure(found.draft, found.faults)
    said = " ".join(text.get_text() for text in figure.texts)
    assert all(word in said for word in found.sentence.split())
    rings = [line for line in figure.axes[0].lines if line.get_gid() == "mark"]
    assert bool(rings) == any(fault.at is not None for fault in found.faults)


def test_all_that_is_wrong_is_marked_at_once(cableway: Command):
    def everything(content: Content) -> None:
        overlapping_disc(content)
        obstacle_outside(content)
        outside(content)

    path = write(everything)
    with pytest.raises(TaskError) as caught:
        load_task(path)
    assert [fault.place for fault in caught.value.faults] == [("obstacles", 1), ("start",), ("goal", 9)]
    assert "(and 2 more faults); drawn in" in cableway("show", path).err


@pytest.mark.parametrize("command", ["plan", "run"])
def test_other_commands_refuse_it_with_the_same_sentence(cableway: Command, command: str):
    """And point to the command that draws it, where that does."""
    path = write(overlapping_disc)
    done = cableway(command, path)
    assert done.status == 2
    assert "start overlaps obstacles[0]" in done.err
    assert not Path("runs").exists()
    pointer = re.search(r"; (cableway show \S+) draws it\n$", done.err)
    assert pointer is not None
    assert "drawn in runs/possible/task.png" in cableway(*pointer[1].split()[1:]).err


def test_a_file_that_means_no_task_at_all_is_not_drawn(cableway: Command):
    def wordy(content: Content) -> None:
        content["start"][0][0] = "left"

    path = write(wordy)
    for command in ("show", "plan"):
        done = cableway(command, path)
        assert done.status == 2
        assert "draws it" not in done.err
    assert not Path("runs").exists()


def test_a_description_is_no_formula(cableway: Command):
    def formula(content: Content) -> None:
        content["description"] = r"costs $5 or \frac{1}{0} $"

    assert cableway("show", write(formula)).status == 0
