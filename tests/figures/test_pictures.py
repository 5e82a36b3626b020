"""Laws of the pictures: what is drawn is where it is, at its size, and no picture is blank."""

from __future__ import annotations

import io
import itertools
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import cast
from xml.etree import ElementTree

import matplotlib.image
import numpy as np
import problems
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from problems import beside_disc
from recorded import moved_aside, moved_plan, perfect_rollout

from cableway.core.errors import InputError, PlanningError
from cableway.core.quantities import place, quantity
from cableway.figures import palette, style
from cableway.figures.learning import horizon_figure, learning_figure
from cableway.figures.plan import alternatives_figure, attempt_figure, plan_figure, spread_rows
from cableway.figures.rollout import rollout_figure, stacked_errors
from cableway.figures.scene import cable_path, draw_cable, smooth, task_figure
from cableway.figures.stages import tasks_over_time_figure
from cableway.planning.planner import plan
from cableway.records import Attempt, PaperStages
from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.verification import verify_plan, verify_rollout

PLANNED, PLAN = moved_plan()
STAGES = cast(PaperStages, PLAN.stages)


def pixels(figure: Figure) -> np.ndarray:
    """The picture (height, width, 3) with colours from 0 to 1, top row first, one pixel to the dot."""
    figure.set_dpi(300)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=figure.dpi)
    file.seek(0)
    return matplotlib.image.imread(file)[..., :3]


def colour_at(figure: Figure, ax: Axes, x: float, y: float) -> np.ndarray:
    """The colour of the picture at a point of the scene [m]."""
    picture = pixels(figure)
    column, row = ax.transData.transform((x, y))
    return picture[int(picture.shape[0] - row), int(column)]


def is_colour(found: np.ndarray, wanted: str) -> bool:
    return bool(np.abs(found - to_rgb(wanted)).max() < 0.02)


BLINDNESS = {
    "none": np.eye(3),
    "protanopia": np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]]),
    "deuteranopia": np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]),
    "tritanopia": np.array([[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]]),
}
"""On linear RGB (Machado, Oliveira and Fernandes 2009, full severity)."""


def lab(colour: str, seen: np.ndarray) -> np.ndarray:
    """CIE L*a*b* of a colour as somebody sees it; a distance of 2 is just noticed."""
    rgb = np.array(to_rgb(colour))
    linear = np.clip(seen @ np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4), 0, 1)
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ linear
    x, y, z = np.where((t := xyz / [0.9505, 1, 1.089]) > 0.008856, np.cbrt(t), 7.787 * t + 16 / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("seen", BLINDNESS.values(), ids=BLINDNESS.keys())
@pytest.mark.parametrize(
    "together",
    [palette.SERIES, (palette.START, palette.GOAL, palette.INK), (palette.LEFT, palette.RIGHT, palette.PIVOT)],
)
def test_colours_that_stand_together_are_told_apart_by_the_colour_blind(together: tuple[str, ...], seen: np.ndarray):
    seen_as = [lab(colour, seen) for colour in together]
    apart = [np.linalg.norm(a - b) for k, a in enumerate(seen_as) for b in seen_as[:k]]
    assert min(apart) > 15


def not_blank(figure: Figure) -> bool:
    picture = pixels(figure)
    drawn = np.abs(picture - 1.0).max(axis=2) > 0.02
    return 0.02 < drawn.mean() < 0.9


@pytest.fixture(scope="module")
def task() -> Task:
    return beside_disc()


def test_obstacle_start_and_goal_are_drawn_where_they_are(task: Task):
    figure = task_figure(task)
    ax = figure.axes[0]
    start, goal = smooth(task.start), smooth(task.goal)
    assert is_colour(colour_at(figure, ax, 0.34, 0.36), palette.OBSTACLE)
    assert is_colour(colour_at(figure, ax, 0.34 + 0.065, 0.36), palette.OBSTACLE)
    assert is_colour(colour_at(figure, ax, 0.34 + 0.075, 0.36), "white")
    assert is_colour(colour_at(figure, ax, *start[36]), palette.START)
    assert is_colour(colour_at(figure, ax, *goal[36]), palette.GOAL)
    assert is_colour(colour_at(figure, ax, *task.start[0]), palette.INK)


@pytest.mark.parametrize("size", [(0.7, 0.7), (1.4, 0.7), (0.7, 1.0)])
def test_a_metre_is_as_long_upward_as_it_is_across(task: Task, size: tuple[float, float]):
    figure = task_figure(replace(task, scene=Scene(size=size)))
    pixels(figure)
    origin, across, up = figure.axes[0].transData.transform([(0, 0), (0.1, 0), (0, 0.1)])
    assert across[0] - origin[0] == pytest.approx(up[1] - origin[1], rel=1e-6)


def test_a_cable_covers_its_length_times_its_thickness():
    line = np.array([[0.1, 0.2], [0.2, 0.2], [0.4, 0.2]])
    (left, bottom), (right, top) = cable_path(line, 0.01).get_extents().get_points()
    assert (left, right, bottom, top) == pytest.approx((0.09, 0.41, 0.19, 0.21))


def test_a_cable_that_closes_on_itself_has_a_hole(task: Task):
    figure = task_figure(replace(task, scene=Scene()))
    turn = np.linspace(0, 2 * np.pi, 60)
    draw_cable(figure.axes[0], 0.35 + 0.1 * np.column_stack([np.cos(turn), np.sin(turn)]), 0.02, palette.BAD)
    assert is_colour(colour_at(figure, figure.axes[0], 0.46, 0.35), palette.BAD)
    assert is_colour(colour_at(figure, figure.axes[0], 0.35, 0.35), "white")


def test_the_picture_of_a_plan_shows_its_parts():
    figure = plan_figure(PLANNED, PLAN)
    assert not_blank(figure)
    initial, shapes = figure.axes[0], figure.axes[1]
    names = [text.get_text() for text in initial.get_legend().get_texts()]  # pyright: ignore[reportOptionalMemberAccess]
    assert {"start", "goal", "pivot path", "keypoint paths", "traversed passage", "obstacle"} <= set(names)
    assert is_colour(colour_at(figure, initial, *STAGES.pivot[20]), palette.PIVOT)
    line = smooth(PLAN.shapes[-1])
    along = (line[31] - line[30]) / np.linalg.norm(line[31] - line[30])
    beside = line[30] + 0.0021 * np.array([-along[1], along[0]])
    assert is_colour(colour_at(figure, shapes, *beside), palette.GOAL), "the last shape has the colour of the goal"


def test_the_curves_of_a_plan_are_its_clearance_and_its_gripper_motion():
    clearance, motion = plan_figure(PLANNED, PLAN).axes[-2:]
    least = 1000 * float(PLANNED.scene.clearance(smooth(PLAN.shapes), PLANNED.cable.radius).min())
    cable = next(line for line in clearance.lines if str(line.get_label()).startswith("cable"))
    assert np.min(cable.get_ydata()) == pytest.approx(least)
    assert cable.get_label() == f"cable, least {quantity(least / 1000)}"
    moves = np.linalg.norm(np.diff(PLAN.poses[:, 0, :2], axis=0), axis=1) / PLANNED.grippers.max_step
    left = next(line for line in motion.lines if line.get_label() == "left, move")
    np.testing.assert_allclose(left.get_ydata(), 100 * moves)


@pytest.mark.parametrize("reached", ["nothing", "stages", "shapes"])
def test_a_failed_attempt_is_drawn_as_far_as_it_got(task: Task, reached: str):
    attempt = {
        "nothing": Attempt("no way for the pivot"),
        "stages": Attempt("no shapes", stages=STAGES),
        "shapes": Attempt("the rod snaps " * 20, shapes=PLAN.shapes),
    }[reached]
    figure = attempt_figure(task, attempt)
    assert not_blank(figure)
    said = " ".join(text.get_text() for text in figure.texts)
    assert attempt.reason.split()[0] in said
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert ("the closest attempt" in titles) == (reached == "shapes")
    assert (f"{task.name}: no initial trajectory" in titles) == (reached == "nothing")


@pytest.mark.parametrize("size", [(40.0, 0.7), (0.7, 40.0)])
def test_a_corridor_is_drawn_however_long_it_is(size: tuple[float, float]):
    """Beside it the curves have the room that they need."""
    hall = replace(PLANNED, scene=Scene(size))
    for figure in (plan_figure(hall, PLAN), rollout_figure(hall, perfect_rollout(hall, PLAN))):
        curves = [ax for ax in figure.axes if ax.lines and ax.get_aspect() == "auto"]
        assert len(curves) >= 2
        assert all(min(ax.bbox.width, ax.bbox.height) > 0.5 * figure.dpi for ax in curves)


def rings(ax: Axes) -> np.ndarray:
    """Places of the rings [m]; each is drawn twice, with a white edge and with a red one."""
    return np.array([(*line.get_xdata(), *line.get_ydata()) for line in ax.lines if line.get_gid() == "mark"])[1::2]


def test_a_gap_that_is_too_narrow_is_marked():
    """The ring is in the gap, at the place that the reason names."""
    task = problems.slit(0.011)
    with pytest.raises(PlanningError) as caught:
        plan(task)
    attempt = caught.value.attempt
    (at,) = rings(attempt_figure(task, attempt).axes[0])
    assert tuple(at) == attempt.at
    assert f"at {place(at)}" in attempt.reason
    assert 0 < task.scene.signed_distance(at) < 0.007


def test_what_does_not_verify_is_marked_where_it_is(task: Task):
    """A plan through an obstacle is marked at the overlap, in the row where that is deepest, and the row is red."""
    moved = replace(PLANNED, scene=Scene(obstacles=(Disc(center=tuple(PLAN.shapes[6, 6]), radius=0.01),)))
    verdict = verify_plan(PLAN, moved)
    worst = next(check for check in verdict.failures() if check.name == "cable clearance")
    assert worst.at is not None
    assert moved.scene.signed_distance(np.array(worst.at)) < 0.001, "in the obstacle, or on it"
    attempt = Attempt(str(verdict), PLAN.shapes, PLAN.poses, verdict)
    ax = attempt_figure(moved, attempt).axes[1]
    assert np.linalg.norm(rings(ax) - worst.at, axis=1).min() < 0.001
    red = [line.get_xydata() for line in ax.lines if line.get_color() == palette.BAD and line.get_gid() != "mark"]
    assert worst.row is not None
    assert any(np.allclose(line, smooth(PLAN.shapes[round(worst.row)])) for line in red)


def test_a_contact_in_a_rollout_is_marked_where_it_was():
    rollout = perfect_rollout(PLANNED, PLAN)
    moved = replace(PLANNED, scene=Scene(obstacles=(Disc(center=tuple(PLAN.shapes[6, 6]), radius=0.01),)))
    touched = replace(rollout, clearance=moved.scene.clearance(rollout.centreline, moved.cable.radius))
    verdict = verify_rollout(touched, moved)
    figure = rollout_figure(moved, touched, failure="contact", verdict=verdict)
    away = np.linalg.norm(rings(figure.axes[0]) - PLAN.shapes[6, 6], axis=1)
    assert away.min() <= 0.011
    said = [text.get_text() for text in figure.texts]
    assert said[0] == "Failed: contact"
    assert any("the cable and obstacles[0]" in text for text in said)
    assert not len(rings(rollout_figure(moved, touched).axes[0]))


def test_a_goal_that_was_missed_is_marked_where_the_cable_is_farthest_from_it():
    missed = moved_aside(perfect_rollout(PLANNED, PLAN), 0.02)
    verdict = verify_rollout(missed, PLANNED)
    off = np.linalg.norm(missed.keypoints[-1] - PLANNED.goal, axis=1)
    farthest = missed.keypoints[-1, int(np.argmax(off))]
    figure = rollout_figure(PLANNED, missed, failure="the goal was missed", verdict=verdict)
    assert np.linalg.norm(rings(figure.axes[0]) - farthest, axis=1).min() < 1e-9


def test_the_picture_of_a_rollout_shows_errors_and_clearance():
    rollout = moved_aside(perfect_rollout(PLANNED, PLAN), 0.004)
    figure = rollout_figure(PLANNED, rollout)
    assert not_blank(figure)
    _, errors, clearance, *_ = figure.axes
    goal = next(line for line in errors.lines if str(line.get_label()).startswith("to the goal"))
    stacked = 1000 * np.linalg.norm(rollout.keypoints - PLANNED.goal, axis=(1, 2))
    np.testing.assert_allclose(goal.get_ydata(), np.maximum(stacked, 0.1))
    assert any(np.allclose(line.get_ydata(), 30.0) for line in errors.lines), "the line of success"
    recorded = next(line for line in clearance.lines if str(line.get_label()).startswith("cable"))
    np.testing.assert_allclose(recorded.get_ydata(), 1000 * rollout.clearance)


def test_errors_are_stacked_over_all_keypoints():
    rollout = moved_aside(perfect_rollout(PLANNED, PLAN), 0.004)
    to_goal, to_reference = stacked_errors(PLANNED, rollout)
    assert to_reference[0] == 0.0
    assert to_reference[-1] == pytest.approx(0.004 * np.sqrt(PLANNED.cable.keypoints))
    assert to_goal[-1] == pytest.approx(np.linalg.norm(rollout.keypoints[-1] - PLANNED.goal))


def test_a_rollout_of_a_single_row_can_be_drawn():
    whole = perfect_rollout(PLANNED, PLAN)
    rows = ("times", "keypoints", "observed", "poses", "centreline", "reference", "clearance", "gripper_clearance")
    short = replace(
        whole,
        **{name: getattr(whole, name)[:1] for name in rows},
        **{name: getattr(whole, name)[:0] for name in ("actions", "solve_time", "status")},
    )
    assert not_blank(rollout_figure(PLANNED, short))


def test_rows_shown_begin_and_end_with_the_motion_and_are_spread_over_it():
    rows = spread_rows(PLAN.shapes, 12)
    assert rows[0] == 0
    assert rows[-1] == len(PLAN.shapes) - 1
    assert len(rows) <= 12
    assert (np.diff(rows) > 0).all()
    slow_then_fast = np.concatenate([np.repeat(PLAN.shapes[:1], 100, axis=0), PLAN.shapes])
    assert (spread_rows(slow_then_fast, 12)[1:-1] > 99).all(), "standing still is not shown again and again"
    assert spread_rows(np.repeat(PLAN.shapes[:1], 5, axis=0), 12).tolist() == [0, 4]


@pytest.mark.parametrize("ending", style.FORMATS)
def test_the_same_plan_gives_the_same_file(ending: str, tmp_path: Path):
    """In another process, too, whose hashes of texts are others."""
    for name in ("a", "b"):
        style.save_figure(plan_figure(PLANNED, PLAN), tmp_path / f"{name}{ending}")
    code = (
        "import sys; from pathlib import Path; from recorded import moved_plan\n"
        "from cableway.figures import plan, style\n"
        "style.save_figure(plan.plan_figure(*moved_plan()), Path(sys.argv[1]))"
    )
    subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / f"c{ending}")], cwd=Path(__file__).parents[1], check=True,
        env={**os.environ, "PYTHONHASHSEED": "7"},
    )  # fmt: skip
    contents = [path.read_bytes() for path in sorted(tmp_path.iterdir())]
    assert len(contents) == 3
    assert len(set(contents)) == 1


def test_vector_graphics_have_the_width_of_two_columns_and_need_no_font(tmp_path: Path):
    """Letters are outlines in SVG, and embedded TrueType, not type 3, in PDF."""
    for ending in (".svg", ".pdf"):
        style.save_figure(plan_figure(PLANNED, PLAN), tmp_path / f"plan{ending}")
    drawing = ElementTree.parse(tmp_path / "plan.svg").getroot()
    assert float(drawing.attrib["width"].removesuffix("pt")) == pytest.approx(72 * style.DOUBLE)
    kinds = {element.tag.partition("}")[2] for element in drawing.iter()}
    assert {"path", "use"} <= kinds
    assert "text" not in kinds
    page = (tmp_path / "plan.pdf").read_bytes()
    start = int(page.rstrip().splitlines()[-2])
    assert page[start:].startswith(b"xref")
    assert b"/FontFile2" in page
    assert b"/Type3" not in page
    assert b"Date" not in page


def test_a_picture_in_another_format_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match=r"plan.jpg: .* ends in .png, .svg, .pdf"):
        style.save_figure(plan_figure(PLANNED, PLAN), tmp_path / "plan.jpg")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("figure", "letters"),
    [
        (lambda: plan_figure(PLANNED, PLAN), "abcd"),
        (lambda: rollout_figure(PLANNED, perfect_rollout(PLANNED, PLAN)), "abc"),
        (lambda: alternatives_figure(PLANNED, [PLAN.shapes] * 5), "abcde"),
        (lambda: learning_figure((3.0, 2.0), (2.0, 1.0)), "ab"),
        (lambda: tasks_over_time_figure([(PLANNED, perfect_rollout(PLANNED, PLAN))] * 6), "abcdef"),
    ],
)
def test_panels_have_letters_in_the_order_of_reading(figure: Callable[[], Figure], letters: str):
    drawn = figure()
    where = {}
    for ax in drawn.axes:
        where |= {text.get_text(): ax.get_position() for text in ax.texts if text.get_gid() == style.LETTER}
    assert "".join(where) == letters
    corners = [(-round(box.y1, 3), round(box.x0, 3)) for box in where.values()]
    assert corners == sorted(corners) or letters == "abc", "a rollout has a scene on the left, b above c on the right"


def test_names_at_the_ends_of_curves_are_apart_and_in_their_order():
    curves = {f"model {k}": [1.0, 2.0, 10.0 + 0.001 * k] for k in range(6)}
    figure = horizon_figure((1, 2, 3), curves, {})
    (ax,) = figure.axes
    places = {text.get_text(): text.get_window_extent() for text in ax.texts}
    assert sorted(curves, key=lambda name: places[name].y0) == list(curves)
    ordered = [places[name] for name in curves]
    assert all(low.y1 - 2 <= high.y0 for low, high in itertools.pairwise(ordered))
    assert ordered[0].x1 < figure.bbox.x1


def test_drawing_leaves_matplotlibs_window_system_alone():
    code = (
        "import sys; from recorded import moved_plan; from cableway.figures.plan import plan_figure\n"
        "plan_figure(*moved_plan()); print('matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[1], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize("errors", [(0.62, 0.615, 0.611), (0.9, 0.5, 0.3), (7.0, 3.0, 0.8), (500.0, 3.0, 0.1)])
def test_a_logarithmic_axis_has_plain_numbers_however_short_it_is(errors: tuple[float, ...]):
    figure = learning_figure(errors, errors)
    figure.canvas.draw()
    axis = figure.axes[1].yaxis
    low, high = axis.get_view_interval()
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    shown = [tick.label1.get_text() for tick in ticks if low <= tick.get_loc() <= high and tick.label1.get_text()]
    assert len({float(text) for text in shown}) >= 2
    assert all("e" not in text for text in shown)


def test_the_colour_of_time_of_pages_is_that_of_pictures():
    for share in np.linspace(0.0, 1.0, 7):
        page = np.array(palette.rgb(palette.color_of_time(share)))
        np.testing.assert_allclose(page, 255 * np.array(style.TIME(share)[:3]), atol=2)  # of which Matplotlib has 256
