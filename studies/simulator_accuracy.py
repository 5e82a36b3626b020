"""How accurate the simulator is: `docs/results/simulator.md` with its data, and the pictures of `docs/simulator.md`.

    .venv/bin/python studies/simulator_accuracy.py [FOLDER]

Some ten minutes on one core. An experiment whose result is in FOLDER (runs/simulator unless given) is not made
again, so an interrupted call goes on where it was; for a new measurement empty the folder.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from accuracy.pictures import PICTURES
from accuracy.results import EXPERIMENTS, data, fill_in, made, table
from pictures import save

from cableway.benchmark.summary import commits_text
from cableway.core.files import write_json

SEED = 0
DOCS = Path(__file__).resolve().parents[1] / "docs"


def main() -> None:
    """Make what is missing, then the pictures and the table."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/simulator")
    experiments = {}
    for name in EXPERIMENTS:
        start = time.perf_counter()
        experiments[name] = made(name, SEED, folder)
        print(f"{name:14} {time.perf_counter() - start:6.1f} s", flush=True)
    results = {name: each["result"] for name, each in experiments.items()}
    about = data(experiments)
    for name, draw in PICTURES.items():
        save(draw(results), DOCS / "images" / f"simulator-{name}.png")
    fill_in(DOCS / "results" / "simulator.md", f"Made at {commits_text(about['commits'])}.\n\n{table(results)}")
    write_json(DOCS / "results" / "simulator.json", about)


if __name__ == "__main__":
    main()
