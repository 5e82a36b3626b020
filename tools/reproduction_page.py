"""What `cableway reproduce --size full` left, as a page of the documentation with its pictures.

    .venv/bin/python tools/reproduction_page.py [FOLDER]

Writes `docs/results/reproduction.md` and `docs/images/reproduction-*.png` from FOLDER (runs/reproduce unless given).
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from pictures import IMAGES, ROOT
from PIL import Image

from cableway.files import write_atomically

PIXELS = 1400
"""Most pixels across a picture."""


def small(picture: Path, out: Path) -> None:
    """The picture with 256 colours and no wider than `PIXELS`."""
    image = Image.open(picture).convert("RGB")
    image.thumbnail((PIXELS, image.height))
    image = image.quantize(kmeans=1)
    write_atomically(out, lambda file: image.save(file, format="png", optimize=True))


def main() -> None:
    """Write page and pictures."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/reproduce")
    text = (folder / "reproduction.md").read_text()
    for name in re.findall(r"!\[([\w.-]+)\]", text):
        small(folder / name, IMAGES / f"reproduction-{name}")
    text = re.sub(r"!\[([\w.-]+)\.png\]\([\w.-]+\)", r"![\1](../images/reproduction-\1.png)", text)
    write_atomically(ROOT / "docs" / "results" / "reproduction.md", lambda file: file.write(text.encode()))


if __name__ == "__main__":
    main()
