"""The model card: what a model file says of itself, as a page to read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cableway.core.files import write_text
from cableway.core.templates import render
from cableway.tang2025.models.checkpoint import read_card

MAIN_PACKAGES = ("cableway", "jax", "equinox", "optax", "mujoco", "numpy")
"""Packages whose versions the page shows; the file holds all."""


def write_card(model_file: Path) -> Path:
    """Write the card in a model's file as Markdown beside it.

    Returns:
        The page, the model's file with the ending `.md`.

    Raises:
        FileFormatError: The file is missing, damaged, no model, or of another version.
    """
    page = Path(model_file).with_suffix(".md")
    write_text(page, card_text(Path(model_file).stem, read_card(model_file)))
    return page


def card_text(name: str, card: dict[str, Any]) -> str:
    """A card as Markdown."""
    values = {"name": name, "card": card, "packages": MAIN_PACKAGES, "zip": zip}
    return render("card.md.jinja", "cableway.tang2025.models", **values) + "\n"
