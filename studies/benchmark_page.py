"""What a `cableway bench` left, as a page of the documentation with its data beside it.

    .venv/bin/python studies/benchmark_page.py FOLDER NAME TITLE [NOTE]

Writes `docs/results/NAME.md` and `docs/results/NAME.json` from `summary.json` in FOLDER; with `--picture` also
`docs/images/benchmark-NAME-success.png`. Without FOLDER, `-`, the page is made anew from the data that is there.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from pictures import IMAGES, ROOT, save

from cableway.benchmark.summary import commits_text, success_shares
from cableway.benchmark.tables import markdown
from cableway.core.files import write_json, write_text
from cableway.figures.benchmark import success_figure


def made_by(about: dict[str, Any], note: str, name: str) -> str:
    """How the figures came about."""
    ran, machine = about["configuration"], about["machine"]
    command = f"cableway bench {ran['suites']} --size {about['size']} --methods {ran['methods']}"
    versions = ", ".join(f"{package} {version}" for package, version in about["versions"].items())
    return (
        f"Made by `{command}{' --episodes ...' if ran['episodes'] else ''}`, {commits_text(about['commits'])}. "
        f"{note}\n\n"
        f"All figures with their intervals: [{name}.json]({name}.json). "
        f"Versions: {versions}. Machine: {machine['cores']} shared cores, {machine['processor']}, no GPU, ten million "
        f"additions in a plain Python loop in {machine['ten_million_additions']} s. Every task's seed and digest is in "
        "`src/cableway/benchmark/frozen`; the table's columns are defined in [the benchmark](../benchmark.md"
        "#what-is-measured)."
    )


def main() -> None:
    """Write page and data."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("name")
    parser.add_argument("title")
    parser.add_argument("note", nargs="?", default="")
    parser.add_argument("--picture", action="store_true")
    given = parser.parse_args()
    page, data = (ROOT / "docs" / "results" / f"{given.name}.{ending}" for ending in ("md", "json"))
    again = given.folder == Path("-")
    about = json.loads((data if again else given.folder / "summary.json").read_text())
    write_text(page, f"# Benchmark: {given.title}\n\n{made_by(about, given.note, given.name)}\n\n{markdown(about)}")
    if not again:
        write_json(data, about)
    if given.picture:
        save(success_figure(success_shares(about)), IMAGES / f"benchmark-{given.name}-success.png")


if __name__ == "__main__":
    main()
