"""What a `cableway bench` left, as a page of the documentation.

    .venv/bin/python studies/benchmark_page.py FOLDER NAME TITLE [NOTE]

Writes `docs/results/NAME.md` from `tables.md` and `summary.json` in FOLDER; with `--data` also `docs/results/NAME.json`
with all figures and their intervals, and `docs/images/benchmark-NAME-success.png`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from pictures import IMAGES, ROOT, save_small
from PIL import Image

from cableway.core.files import write_atomically, write_json


def made_by(about: dict[str, Any], note: str) -> str:
    """How the figures came about."""
    ran, machine = about["configuration"], about["machine"]
    command = f"cableway bench {ran['suites']} --size {about['size']} --methods {ran['methods']}"
    versions = ", ".join(f"{package} {version}" for package, version in about["versions"].items())
    return (
        f"Made by `{command}{' --episodes ...' if ran['episodes'] else ''}`. {note}\n\n"
        f"Versions: {versions}. Machine: {machine['cores']} shared cores, {machine['processor']}, no GPU, ten million "
        f"additions in a plain Python loop in {machine['ten_million_additions']} s. Every task's seed and digest is in "
        "`src/cableway/benchmark/frozen`; the table's columns are defined in [the benchmark](../benchmark.md"
        "#what-is-measured)."
    )


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("name")
    parser.add_argument("title")
    parser.add_argument("note", nargs="?", default="")
    parser.add_argument("--data", action="store_true")
    given = parser.parse_args()
    about = json.loads((given.folder / "summary.json").read_text())
    tables = (given.folder / "tables.md").read_text().strip()
    page = f"# Benchmark: {given.title}\n\n{made_by(about, given.note)}\n\n{tables}\n"
    results = ROOT / "docs" / "results"
    write_atomically(results / f"{given.name}.md", lambda file: file.write(page.encode()))
    if given.data:
        write_json(results / f"{given.name}.json", about)
        save_small(Image.open(given.folder / "success.png"), IMAGES / f"benchmark-{given.name}-success.png")


if __name__ == "__main__":
    main()
