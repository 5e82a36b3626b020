"""What `cableway reproduce --size full` left, as a page of the documentation with its pictures.

    .venv/bin/python studies/reproduction_page.py [FOLDER]

Writes `docs/results/reproduction.md`, its data beside it and `docs/images/reproduction-*.png` from FOLDER
(runs/reproduce unless given).
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from pictures import IMAGES, ROOT, save_small
from PIL import Image

from cableway.core.files import write_bytes, write_text


def main() -> None:
    """Write page, data and pictures."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/reproduce")
    text = (folder / "reproduction.md").read_text()
    for name in re.findall(r"!\[([\w.-]+)\]", text):
        save_small(Image.open(folder / name), IMAGES / f"reproduction-{name}")
    text = re.sub(r"!\[([\w.-]+)\.png\]\([\w.-]+\)", r"![\1](../images/reproduction-\1.png)", text)
    results = ROOT / "docs" / "results"
    write_text(results / "reproduction.md", text)
    write_bytes(results / "reproduction.json", (folder / "reproduction.json").read_bytes())


if __name__ == "__main__":
    main()
