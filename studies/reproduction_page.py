"""What `cableway reproduce --size full` left, as a page of the documentation with its pictures.

    .venv/bin/python studies/reproduction_page.py [FOLDER] [--note TEXT | --pictures | --arms]

Writes `docs/results/reproduction.md`, its data beside it and `docs/images/reproduction-*.png` from FOLDER
(runs/reproduce unless given); TEXT stands before the first section. With `--pictures` the pictures alone, those that
need no episodes of a benchmark made anew in FOLDER: some ten minutes of one core. With `--arms` nothing is written, but
the section "Between two arms" printed as far as its episodes are in FOLDER, where `cableway bench paper-cell --size
standard --out FOLDER` leaves them, too.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from pictures import IMAGES, ROOT, save, save_small
from PIL import Image

from cableway.benchmark.episode import jobs_of
from cableway.benchmark.methods import DEFAULT
from cableway.benchmark.runner import read_result
from cableway.benchmark.suites import get_suite
from cableway.core.files import write_bytes, write_text
from cableway.tang2025.reproduction import between_arms, case_studies, reproduction
from cableway.tang2025.reproduction.page import Section

TRANSITIONS, TUNING = 10000, 25000
"""Of each data set that models are compared on, and fine-tuned on, as of `--size full`."""


def sections(folder: Path) -> list[Section]:
    """Those that have pictures, with these in the folder."""

    def progress(words: str, share: float) -> None:
        print(f"{100 * share:3.0f}% {words}", flush=True)

    return [
        reproduction.planning(folder, save),
        case_studies.over_time(folder, save, progress),
        reproduction.prediction(folder, TRANSITIONS, TUNING, progress, save),
        case_studies.without_obstacles(folder, save, progress),
        case_studies.mazes(folder, 1, progress, save),
        case_studies.one_plan(folder, save),
        case_studies.tracking(folder, save),
        case_studies.insertion(folder, 1, progress, save),
    ]


def print_arms(folder: Path) -> None:
    """The section of the tasks between two arms."""
    jobs = jobs_of(DEFAULT, get_suite(between_arms.SUITE).episodes("standard"))
    results = [result for job in jobs if (result := read_result(job, folder)) is not None]
    section = between_arms.between_arms({between_arms.SUITE: {DEFAULT: results}})
    print(section.text, *(table.markdown() for table in section.tables), sep="\n\n")


def main() -> None:
    """Write page, data and pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("runs/reproduce"))
    parser.add_argument("--note", default="", metavar="TEXT")
    parser.add_argument("--pictures", action="store_true")
    parser.add_argument("--arms", action="store_true")
    given = parser.parse_args()
    if given.arms:
        print_arms(given.folder)
        return
    if given.pictures:
        for section in sections(given.folder):
            for picture in section.pictures:
                write_bytes(IMAGES / f"reproduction-{picture.file}", (given.folder / picture.file).read_bytes())
            for table in section.tables:
                print(table.markdown())
        return
    text = (given.folder / "reproduction.md").read_text()
    for name in re.findall(r"\]\(([\w.-]+\.png)\)", text):
        save_small(Image.open(given.folder / name), IMAGES / f"reproduction-{name}")
    text = re.sub(r"\]\(([\w.-]+\.png)\)", r"](../images/reproduction-\1)", text)
    if given.note:
        text = text.replace("\n\n## ", f"\n\n{given.note}\n\n## ", 1)
    results = ROOT / "docs" / "results"
    write_text(results / "reproduction.md", text)
    write_bytes(results / "reproduction.json", (given.folder / "reproduction.json").read_bytes())


if __name__ == "__main__":
    main()
