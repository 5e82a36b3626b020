"""The model card: what a model file says of itself, as a page to read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cableway.core.files import write_atomically
from cableway.tang2025.models.checkpoint import read_card

MAIN_PACKAGES = ("cableway", "jax", "equinox", "optax", "mujoco", "numpy")
"""Packages whose versions the page shows; the file holds all."""


def write_card(model_file: Path, page: Path | None = None) -> Path:
    """Write the card in a model's file as Markdown, by custom beside it.

    Args:
        model_file: The model.
        page: The page; the model's file with the ending `.md` if not given.

    Returns:
        The page.

    Raises:
        FileFormatError: The file is missing, damaged, no model, or of another version.
    """
    page = Path(model_file).with_suffix(".md") if page is None else page
    content = card_text(Path(model_file).stem, read_card(model_file)).encode()
    write_atomically(page, lambda file: file.write(content))
    return page


def card_text(name: str, card: dict[str, Any]) -> str:
    """A card as Markdown."""
    data = card["data"]
    last = card["history"][-1]
    lines = [
        f"# {name}",
        "",
        f"A deformation model of kind `{card['kind']}` with {card['parameters']} parameters: from the keypoints of a",
        "planar cable, the poses of the two grippers at its ends and their motion in one control step of 0.1 s, it",
        "predicts how every keypoint moves. Written by `cableway train` from the figures in the model's file.",
        "",
        "## Error on held-out episodes",
        "",
        "Open loop, stacked over all keypoints (L2 over 2n numbers) [mm]: median / mean / 95th percentile / worst.",
        "",
        *error_table(card["errors"]),
        "",
        "## Data",
        "",
        f"{data['transitions']} simulated transitions, split by episode: {data['training_transitions']} to train on,",
        f"{data['held_out_transitions']} held out. SHA-256 of the arrays: `{data['sha256']}`.",
        "",
        *_settings(data["metadata"].get("config", {})),
        "",
        "## Training",
        "",
        f"{last['epoch']} epochs, last loss {last['loss']:.4g}, one-step error on the held-out episodes "
        f"{last['validation_error']:.3f} mm (mean).",
        "",
        *_settings({"model": card["model"], "training": card["training"]}),
        "",
        "Versions: " + ", ".join(f"{key} {card['versions'].get(key, '?')}" for key in MAIN_PACKAGES) + ".",
        "",
        "## Limits",
        "",
        *_limits(data["metadata"]),
        "",
    ]
    return "\n".join(lines)


def _limits(metadata: dict[str, Any]) -> list[str]:
    """What the model was not trained for."""
    if "sets" in metadata:
        return [
            f"Trained on {len(metadata['sets'])} data sets together, whose settings are in the file. The model is not",
            "given which one it is. A cable unlike theirs is predicted worse than the table says.",
        ]
    ranges = metadata.get("config", {}).get("ranges")
    if ranges:
        return [
            f"Trained on cables that differ in {', '.join(ranges)} within the ranges above. The model is not given",
            "which one it is. A cable outside the ranges is predicted worse than the table says.",
        ]
    return [
        "Trained on one uniform cable without friction, contact or measurement noise. Other lengths are served by",
        "scaling; a cable that lags longer or shorter than the one above, is stiffer on one side, curved at rest or",
        "rubs on the table is predicted worse than the table says.",
    ]


def error_table(errors: dict[str, list[dict[str, Any]]]) -> list[str]:
    """Rows of a Markdown table: horizons down, models across."""
    names = list(errors)
    horizons = [row["horizon"] for row in errors[names[0]]]
    lines = [
        "| steps | " + " | ".join(names) + " | windows |",
        "|" + "---|" * (len(names) + 2),
    ]
    for i, horizon in enumerate(horizons):
        rows = [errors[name][i] for name in names]
        cells = [" / ".join(f"{row[key]:.2f}" for key in ("median", "mean", "p95", "worst")) for row in rows]
        lines.append(f"| {horizon} | " + " | ".join(cells) + f" | {rows[0]['count']} |")
    return lines


def _settings(settings: dict[str, Any], indent: str = "") -> list[str]:
    """Nested settings as a nested list."""
    lines: list[str] = []
    for key, value in settings.items():
        if isinstance(value, dict):
            lines += [f"{indent}- {key}:", *_settings(value, indent + "  ")]
        else:
            lines.append(f"{indent}- {key}: {value}")
    return lines
