"""The experiments, their results in files, and the table of `docs/simulator.md`."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from accuracy import contact, motions, shapes
from cableway.files import write_atomically
from cableway.provenance import versions

EXPERIMENTS: dict[str, Callable[[int], dict[str, Any]]] = {
    "after-motions": shapes.after_motions,
    "along-plans": shapes.along_plans,
    "any-poses": shapes.any_poses,
    "closed-form": shapes.closed_form,
    "links": shapes.by_links,
    "time-step": motions.by_time_step,
    "lag": motions.by_damping_time,
    "corners": contact.corners,
    "corridors": contact.corridors,
    "squeezes": contact.squeezes,
    "plans": contact.plans,
}

BEGIN, END = "<!-- made by tools/simulator_accuracy.py -->\n", "<!-- end -->\n"
"""Lines of the document between which the table stands."""


def result(name: str, seed: int, folder: Path) -> dict[str, Any]:
    """The result of an experiment from its file; made, and the file written, if it is missing."""
    path = folder / f"{name}-{seed}.json"
    if not path.exists():
        content = {"seed": seed, "versions": versions(), "machine": machine(), "result": EXPERIMENTS[name](seed)}
        write_atomically(path, lambda file: file.write(json.dumps(content).encode()))
    return json.loads(path.read_text())["result"]


def machine() -> str:
    """The class of machine, without its name."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"


def table(results: dict[str, dict[str, Any]]) -> str:
    """The figures of the document, in Markdown."""
    lines = ["| what | asked for | median | 95% | worst | n |", "|---|---|---|---|---|---|"]
    return "\n".join([*lines, *_shape_rows(results), *_motion_rows(results), *_contact_rows(results)]) + "\n"


def _row(what: str, asked: str, values: Any, scale: float = 1000.0, unit: str = "mm", mean: bool = False) -> str:
    """A line of the table: the distribution of `values`, the first column being their mean where that was asked for."""
    values = scale * np.asarray(values)
    middle = f"mean {values.mean():.3f}" if mean else f"{np.median(values):.3f}"
    cells = [what, asked, middle, f"{np.percentile(values, 95):.3f}", f"{values.max():.3f} {unit}", str(values.size)]
    return "| " + " | ".join(cells) + " |"


def _shape_rows(results: dict[str, dict[str, Any]]) -> list[str]:
    motion, wide = results["after-motions"], results["any-poses"]
    gentle = np.array(wide["radius"]) >= 0.025
    form, links = results["closed-form"], results["links"]
    order = -np.polyfit(np.log(links["hinges"]), np.log(links["errors"]), 1)[0]
    off = np.linalg.norm(np.array(form["plant"]) - form["elastica"], axis=-1).max(axis=1)
    to_half = np.array(form["shortening"]) <= 0.5
    return [
        _row("settled after a random motion, all keypoints", "mean ≤ 0.3", shapes.errors(motion), mean=True),
        _row("the same, worst keypoint of a shape", "≤ 1", shapes.errors(motion).max(axis=1)),
        _row("settled between any poses, all keypoints", "mean ≤ 0.3", shapes.errors(wide), mean=True),
        _row("the same, worst keypoint, no bend sharper than 25 mm", "≤ 1", shapes.errors(wide)[gentle].max(axis=1)),
        _row("the same, worst keypoint, the sharper ones", "", shapes.errors(wide)[~gentle].max(axis=1)),
        _row("closed form, pushed together by up to L/2, worst keypoint", "≤ 0.3% of L", off[to_half], 100, "% of L"),
        _row("closed form, pushed together by 0.6 L, worst keypoint", "≤ 0.3% of L", off[~to_half], 100, "% of L"),
        f"| order of convergence in the links, 24 to 96 | 2 | {np.median(order):.3f} | | "
        f"{order.min():.3f} | {order.size} |",
    ]


def _motion_rows(results: dict[str, dict[str, Any]]) -> list[str]:
    steps, lag = results["time-step"], results["lag"]
    coarse = steps["to_half"][steps["time_step"].index(0.005)]
    moving = zip(lag["damping_time"], lag["moving"], strict=True)
    return [
        _row("5 ms against 0.5 ms, random motions, all keypoints", "mean ≤ 0.1, worst ≤ 1", coarse, mean=True),
        *(_row(f"mean lag at full speed, τ = {tau:g} s", "", np.concatenate(rows)) for tau, rows in moving),
    ]


def _contact_rows(results: dict[str, dict[str, Any]]) -> list[str]:
    corners, corridors, squeezes = results["corners"], results["corridors"], results["squeezes"]
    free, names = 1000 * np.array(results["plans"]["clearance"]), results["plans"]["task"]
    rows = [("corner", f"EI = {value:g} N m²", row) for value, row in _groups(corners, "stiffness")]
    rows += [(f"corridor of {1000 * value:g} mm", "sideways", row) for value, row in _groups(corridors, "width")]
    rows += [
        ("corridor of 30 mm", f"squeezed at {10_000 * value:g} mm/s", row) for value, row in _groups(squeezes, "speed")
    ]
    refused = sum(len(row) for each in (corners, corridors, squeezes) for row in each["refused"])
    cases = refused + sum(len(values) for *_, values in rows)
    return [
        *(_row(f"penetration, {what}, {how}", "≤ 1", values) for what, how, values in rows),
        f"| of these cases, refused by the plant | | | | {refused} | {cases} |",
        _row("penetration on the verified plans of the catalogue", "0", np.maximum(0.0, -free), 1.0),
        f"| least clearance on them | > 0 | {np.median(free):.3f} | | {free.min():.3f} mm | {len(names)} |",
    ]


def _groups(result: dict[str, Any], key: str) -> list[tuple[float, list[float]]]:
    return list(zip(result[key], result["deepest"], strict=True))


def fill_in(document: Path, text: str) -> None:
    """Put the table between its marks in the document."""
    before, _, rest = document.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    write_atomically(document, lambda file: file.write((before + BEGIN + "\n" + text + "\n" + END + after).encode()))
