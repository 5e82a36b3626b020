"""The reproduction puts the right results beside the paper's numbers, failures included."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from recorded import moved_aside, moved_plan, perfect_rollout

from cableway.benchmark.episode import Result
from cableway.benchmark.suites import get_suite, kind_of
from cableway.benchmark.summary import machine
from cableway.figures.stages import followers_figure
from cableway.figures.style import save_figure
from cableway.planning.config import PlannerConfig
from cableway.scene.files.loading import load_cell, task_names
from cableway.tang2025.control.mpc_config import MPCConfig
from cableway.tang2025.reproduction import between_arms, case_studies, paper, reproduction
from cableway.tang2025.reproduction.page import (
    Picture,
    Section,
    median_worst,
    reproduction_page,
    reproduction_text,
    spread,
)

ABOUT = {
    "versions": {"cableway": "0"}, "commit": "a" * 40, "commits": {"a" * 40: 3}, "machine": machine(), "size": "quick",
    "configuration": {"data_seeds": [1, 2]},
}  # fmt: skip


def result(suite: str, task: str, error: float, method: str = "cableway", clearance: float | None = 0.008) -> Result:
    return Result(
        suite=suite, episode=f"{task}-{error}", method=method, task=task, plant="laid", seed=0, digest="", made_by="",
        outcome="", success=error < 0.03, shape_error=error, clearance=clearance,
    )  # fmt: skip


def rows(section: Section, table: int = 0) -> dict[str, dict[str, str]]:
    """The rows of a table by their first cell, each cell by its title."""
    titles, *lines = section.tables[table].rows
    return {line[0]: dict(zip(titles[1:], line[1:], strict=True)) for line in lines}


def test_our_configuration_of_the_paper_has_the_papers_values():
    found = rows(reproduction.hyperparameters())
    assert [cells["paper"] for cells in found.values()] == [value for _, value, _ in paper.HYPERPARAMETERS]
    ours = "our configuration of the paper"
    assert found["time steps T"][ours] == f"{PlannerConfig.paper().deformation.steps}" == "50"
    assert found["MPC horizon H"][ours] == f"{MPCConfig.paper().horizon}" == "5"
    assert all(cells["paper"] == cells[ours] for cells in found.values())


def test_simulated_tasks_count_failures_of_both():
    results = {
        "cableway": [result("paper", "maze-1", 0.001), result("paper", "maze-1", 0.05)],
        "tang2025": [result("paper", "maze-1", 0.9, "tang2025", clearance=None)],
    }
    found = rows(reproduction.simulated({"paper": results}))["maze-1"]
    assert found["paper, error [cm]"] == "< 2"
    assert found["ours: success"] == "1/2"
    assert found["least clearance [cm]"] == "0.80"
    assert found["the paper's configuration: success"] == "0/1"


def test_tasks_between_arms_say_in_which_cell_and_what_was_moved():
    suite = between_arms.SUITE
    fallen = replace(result(suite, "real-single+dual-ur5e", 0.0, clearance=None), outcome="no plan", shape_error=None)
    missed = [result(suite, "maze-1+dual-ur5e", 0.05), result(suite, "maze-1+dual-ur5e", 0.001, clearance=0.004)]
    found = rows(between_arms.between_arms({suite: {"cableway": [*missed, replace(fallen, success=False)]}}))
    maze, single = found["maze-1"], found["real-single"]
    assert maze["cell"] == "dual-ur5e"
    assert maze["start, goal moved by [mm]"] == "-, 5.76"
    assert (maze["paper, error [cm]"], single["paper, error [cm]"]) == ("< 2", spread(paper.SUMMARY["real-single"][0]))
    assert (maze["planned and verified"], maze["success"], maze["least clearance [cm]"]) == ("2/2", "1/2", "0.40")
    assert list(single.values())[1:] == ["-, -", "1.86 ± 0.75", "0/1", "0/1", "-", "-"]


def test_every_task_of_the_catalogue_stands_between_arms_among_obstacles_of_5_cm():
    episodes = get_suite(between_arms.SUITE).episodes("standard")
    assert {kind_of(episode.task) for episode in episodes} == set(task_names())
    assert all(sum(other.task == episode.task for other in episodes) == 3 for episode in episodes)
    for reference in {episode.task for episode in episodes}:
        cell = load_cell(reference.partition("+")[2])
        assert (cell.obstacle_height, cell.tool) == (0.05, "2f-85")


def test_unconstrained_control_is_told_by_cable_and_by_method():
    usb = [result("lab-unconstrained", f"open-near-{k}~usb-0.34", error) for k, error in enumerate((0.001, 0.003))]
    rubber = [result("lab-unconstrained", "open-far-9~rubber-0.34", 0.04)]
    other = [replace(each, method="broyden", shape_error=0.02) for each in usb]
    section = reproduction.unconstrained({"lab-unconstrained": {"cableway": usb + rubber, "broyden": other}})
    cables, methods = rows(section), rows(section, 1)
    assert (cables["usb"]["simulated: n"], cables["usb"]["below 3 cm"]) == ("2", "2/2")
    assert cables["usb"]["mean ± SD [cm]"] == "0.20 ± 0.10"
    assert cables["usb"]["95% of the mean"] == "0.10 to 0.30"
    assert cables["rubber"]["below 3 cm"] == "0/1"
    assert cables["paracord"]["simulated: n"] == "0"
    assert methods["broyden"]["hardware: mean ± SD, paper [cm]"] == spread(paper.CONTROL_BY_METHOD["broyden"])
    assert methods["cableway"]["simulated: n"] == "2"


def test_the_summary_takes_the_papers_cables_together_and_the_others_apart():
    usual = [result("lab-constrained", "real-single~usb-0.34", 0.001 * k) for k in range(1, 19)]
    cotton = [result("lab-constrained", "real-single~cotton-0.22", 0.05, clearance=-0.001)]
    drawn = [result("lab-drawn", "real-single~cotton-0.22", 0.01), result("lab-drawn", "real-maze~usb-0.17", 0.02)]
    found = {"lab-constrained": {"cableway": usual + cotton}, "lab-drawn": {"cableway": drawn}}
    lines = reproduction.summary(found).tables[0].rows
    single = [line for line in lines if line[0] == "real-single"]
    assert [line[1] for line in single] == ["as in the paper", "all seven, drawn", "cotton"]
    assert [line[5] for line in single] == [f"{reproduction.TRIALS}/{reproduction.TRIALS}", "1/1", "0/1"]
    assert single[2][-1] == "-0.10"


def test_pages_hold_every_section_and_escape_what_they_show():
    section = reproduction.hyperparameters()
    picture = Picture("one.png", "(a) A < B. " + "word " * 30)
    odd = Section("<b>A & B</b>", "word " * 60, section.tables, (picture,))
    page, text = reproduction_page([section, odd], ABOUT), reproduction_text([section, odd], ABOUT)
    assert "&lt;b&gt;A &amp; B&lt;/b&gt;" in page
    assert 'src="one.png"' in page
    assert "http" not in page.split("</style>")[-1]
    assert "`cableway reproduce --size quick`, commit aaaaaaaaaa (episodes: commit aaaaaaaaaa)." in " ".join(
        text.split()
    )
    assert "](one.png)\n\n*(a) A < B. word" in text
    assert "(a) A &lt; B. word" in page
    assert max(map(len, (line for line in text.splitlines() if line.startswith("word")))) <= 120


def test_figures_of_nothing_are_a_dash():
    assert median_worst([]) == "-"
    assert median_worst([1.0, 3.0, 2.0]) == "2.00 / 3.00"


@pytest.fixture(scope="module")
def stages(tmp_path_factory: pytest.TempPathFactory) -> tuple[Section, Path]:
    folder = tmp_path_factory.mktemp("stages")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduction, "STAGED", ("single-obstacle-2",))
        return reproduction.planning(folder, save_figure), folder


def test_the_stages_of_planning_are_drawn_and_one_end_leads(stages: tuple[Section, Path]):
    section, folder = stages
    (line,) = section.tables[0].rows[1:]
    assert 0.0 < float(line[1]) <= 1.0
    assert (folder / section.pictures[0].file).stat().st_size > 20_000


def test_cables_that_follow_one_plan_are_drawn_with_their_errors():
    task, plan = moved_plan()
    perfect = perfect_rollout(task, plan)
    figure = followers_figure(task, {"true": perfect, "aside": moved_aside(perfect, 0.02)})
    lines = {line.get_label(): np.asarray(line.get_ydata(), float) for line in figure.axes[1].get_lines()}
    assert lines["aside"][-1] == pytest.approx(20.0 * np.sqrt(len(task.goal)), rel=0.05)
    assert lines["true"][-1] < 0.05 * lines["aside"][-1]


def test_error_and_clearance_over_time_count_what_succeeded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A run each, drawn whether it succeeded or not."""
    task, plan = moved_plan()
    perfect = perfect_rollout(task, plan)
    done = {name: SimpleNamespace(task=task, rollout=perfect, success=name != "maze-1") for name in task_names()}
    monkeypatch.setattr(case_studies, "solve", lambda task: done[task.name])
    drawn: list[Figure] = []
    section = case_studies.over_time(tmp_path, lambda figure, path: drawn.append(figure), lambda words, share: None)
    assert f"{len(done) - 1} of {len(done)} succeed" in section.text
    curves, snapshots = drawn
    assert len(curves.axes) == 2 * len(done)
    assert [ax.get_title(loc="left") for ax in snapshots.axes] == [task.name] * len(done)
    assert [picture.file for picture in section.pictures] == ["over-time.png", "snapshots.png"]
