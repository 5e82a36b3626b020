"""The paper's robot, simulated: the catalogue between two UR5e with 2F-85, among obstacles 5 cm high."""

from __future__ import annotations

from cableway.benchmark.suites import kind_of
from cableway.benchmark.summary import Results
from cableway.benchmark.tables import Table, number
from cableway.outcome import Outcome
from cableway.planning.moved_ends import set_up
from cableway.scene.task import ENDS
from cableway.tang2025.reproduction import paper
from cableway.tang2025.reproduction.page import Row, Section, median_worst, spread, successes

SUITE = "paper-cell"
"""The catalogue between two arms; which cell each task stands in is part of its list."""

UNPLANNED = (Outcome.NO_PLAN, Outcome.INFEASIBLE, Outcome.TIMED_OUT, Outcome.INTERRUPTED, Outcome.CRASHED)
"""Outcomes of episodes that may have had no plan."""


def between_arms(results: Results) -> Section:
    """The catalogue between two UR5e with 2F-85, obstacles 5 cm high, in closed loop."""
    rows: list[Row] = [
        ("task", "cell", "start, goal moved by [mm]", "paper, error [cm]", "planned and verified", "success",
         "error, median / worst [cm]", "least clearance [cm]")
    ]  # fmt: skip
    found = results[SUITE]["cableway"]
    for task in dict.fromkeys(result.task for result in found):
        those = [result for result in found if result.task == task]
        planned = sum(result.shape_error is not None or result.outcome not in UNPLANNED for result in those)
        errors = [100 * result.shape_error for result in those if result.shape_error is not None]
        least = [100 * result.clearance for result in those if result.clearance is not None]
        name, cell = kind_of(task), task.partition("+")[2]
        rows.append((name, cell, _moved(name, cell), _paper(name), f"{planned}/{len(those)}", successes(those),
                     median_worst(errors), number(min(least)) if least else "-"))  # fmt: skip
    return Section("Between two arms", TEXT, (Table("between two arms", tuple(rows)),))


TEXT = (
    "The paper's robot is two UR5e with parallel grippers; here it is simulated, with a 2F-85 on each arm and "
    "obstacles 5 cm high, so that hands and links have to keep off them. The cell sets that height. Where the bodies "
    "or the arms cannot hold a designed end, it is moved to the nearest shape found. Of the paper's errors those with "
    "± are from hardware, the bounds from its simulation without arms. The arms take hold of the cable, lead it in "
    "closed loop under our default method, and let go, where there is room. The cable lies in space on a table with "
    "friction; it is uniform, coiled or limp, in turn, 2 to 5% longer or shorter than planned for, held askew, "
    "measured 0.1 s late and with noise. Every plan is verified by other code, joints and links included. The least "
    "clearance is that of anything: of cable and hands from obstacles and each other, of links from these, the table "
    "and their own arm."
)
"""What is ours in the section."""


def _moved(name: str, cell: str) -> str:
    """By how much the start and the goal of a task of the catalogue are moved in a cell [mm]."""
    moved = set_up(name, cell, move=True).moved
    return ", ".join(number(1000 * moved[end]) if end in moved else "-" for end in ENDS)


def _paper(task: str) -> str:
    """The paper's error [cm] in a task of the catalogue, on hardware where it is from there."""
    if task in paper.SUMMARY:
        return spread(paper.SUMMARY[task][0])
    return f"< {paper.SIMULATED[task]:g}" if task in paper.SIMULATED else "-"
