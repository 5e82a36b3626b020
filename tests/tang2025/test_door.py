"""Laws of the wing's door: its map from the paper's equations leads to names that exist, and no equation is missing."""

from __future__ import annotations

import re
from pkgutil import resolve_name

from cableway import tang2025

MAP = (tang2025.__doc__ or "").partition("is:\n")[2].partition("`docs/")[0]


def test_every_name_of_the_map_exists():
    names = re.findall(r"`([\w.]+)`", MAP)
    assert len(names) > 20
    for name in names:
        assert resolve_name(name if name.startswith("cableway.") else f"cableway.tang2025.{name}") is not None


def test_the_map_has_the_papers_equations_in_order():
    numbers = []
    for first, joint, last in re.findall(r"\((\d+)\)(?:( to |, )\((\d+)\))?", MAP):
        numbers += range(int(first), int(last) + 1) if joint == " to " else [int(n) for n in (first, last) if n]
    assert numbers == list(range(1, 26))
