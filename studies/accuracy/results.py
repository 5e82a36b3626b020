"""The experiments, their results in files, and the table of `docs/results/simulator.md`."""

from __future__ import annotations

import json
import os
import platform
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from accuracy import contact, motions, on_a_table, shapes
from cableway.core.files import write_atomically
from cableway.core.provenance import commit, versions

EXPERIMENTS: dict[str, Callable[[int], dict[str, Any]]] = {
    "after-motions": shapes.after_motions,
    "along-plans": shapes.along_plans,
    "gentle-poses": shapes.gentle_poses,
    "any-poses": shapes.any_poses,
    "closed-form": shapes.closed_form,
    "links": shapes.by_links,
    "time-step": motions.by_time_step,
    "lag": motions.by_damping_time,
    "corners": contact.corners,
    "corridors": contact.corridors,
    "squeezes": contact.squeezes,
    "plans": contact.plans,
    "friction": on_a_table.friction,
}

SETTLED = {
    "after-motions": "after random motions of `cableway collect`",
    "along-plans": "along the catalogue's plans",
    "gentle-poses": "between any poses with no bend sharper than two links, 25 mm",
    "any-poses": "between any poses",
}
"""Experiments on settled shapes, and where they settle."""

BEGIN, END = "<!-- made by studies/simulator_accuracy.py -->\n", "<!-- end -->\n"
"""Lines of the document between which the table stands."""


def made(name: str, seed: int, folder: Path) -> dict[str, Any]:
    """An experiment's `result` and where it comes from, from its file; made, and the file written, if it is missing."""
    path = folder / f"{name}-{seed}.json"
    if not path.exists():
        about = {"seed": seed, "versions": versions(), "commit": commit() or "", "machine": machine()}
        content = about | {"result": EXPERIMENTS[name](seed)}
        write_atomically(path, lambda file: file.write(json.dumps(content).encode()))
    return json.loads(path.read_text())


def data(experiments: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """What the page shows, as plain data: the table's cells, and where they come from."""
    lines = table({name: each["result"] for name, each in experiments.items()}).splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if not line.startswith("|---")]
    first = next(iter(experiments.values()))
    return {
        **{key: first[key] for key in ("seed", "versions", "machine")},
        "commits": dict(Counter(each["commit"] for each in experiments.values())),
        "sections": [{"title": "The simulator", "tables": [{"title": "figures", "rows": rows}]}],
    }


def machine() -> str:
    """The class of machine, without its name."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"


def table(results: dict[str, dict[str, Any]]) -> str:
    """The figures of the document, in Markdown."""
    rows = [*_shape_rows(results), *_motion_rows(results), *_contact_rows(results), *_friction_rows(results)]
    head = ["| what [mm] | required | mean | median | 95% | worst | n |", "|---|---|---|---|---|---|---|"]
    return "\n".join([*head, *rows]) + "\n"


def _row(what: str, asked: str, values: Any, scale: float = 1000.0) -> str:
    """A line of the table: the distribution of `values`, the last figure being the greatest."""
    values = scale * np.asarray(values)
    return _line(what, asked, values.mean(), np.median(values), np.percentile(values, 95), values.max(), values.size)


def _line(what: str, asked: str, mean: float, median: float, high: float, worst: float, count: int) -> str:
    figures = [f"{value:.3f}" for value in (mean, median, high, worst)]
    return "| " + " | ".join([what, asked, *figures, str(count)]) + " |"


def _shape_rows(results: dict[str, dict[str, Any]]) -> list[str]:
    wide, form, links = results["any-poses"], results["closed-form"], results["links"]
    sharp, wide_worst = np.array(wide["radius"]) < 0.025, shapes.errors(wide).max(axis=1)
    order = -np.polyfit(np.log(links["hinges"]), np.log(links["errors"]), 1)[0]
    off = np.linalg.norm(np.array(form["plant"]) - form["elastica"], axis=-1).max(axis=1)
    to_half = np.array(form["shortening"]) <= 0.5
    rows = []
    for name, where in SETTLED.items():
        error = shapes.errors(results[name])
        asked = ("", "") if name == "any-poses" else ("mean ≤ 0.3", "≤ 1")
        rows.append(_row(f"settled {where}: all keypoints", asked[0], error))
        rows.append(_row(f"settled {where}: worst keypoint of a shape", asked[1], error.max(axis=1)))
    return [
        *rows,
        _row("of these, the shapes with sharper bends: all keypoints", "", shapes.errors(wide)[sharp]),
        _row("of these, the shapes with sharper bends: worst keypoint of a shape", "", wide_worst[sharp]),
        _row("between any poses, the elastica gripped h²κ/12 aside: all keypoints", "", wide["aside"]),
        _row("closed form, pushed together by up to 0.5 L: worst keypoint [% of L]", "≤ 0.3", off[to_half], 100),
        _row("closed form, pushed together by 0.6 L: worst keypoint [% of L]", "≤ 0.3", off[~to_half], 100),
        _line(
            "order of convergence in the links, 24 to 96 (95%: 5%; worst: least)", "2", order.mean(),
            float(np.median(order)), float(np.percentile(order, 5)), order.min(), order.size,
        ),
    ]  # fmt: skip


def _motion_rows(results: dict[str, dict[str, Any]]) -> list[str]:
    steps, lag = results["time-step"], results["lag"]
    coarse = steps["to_half"][steps["time_step"].index(0.005)]
    moving = zip(lag["damping_time"], lag["moving"], strict=True)
    return [
        _row("5 ms against 0.5 ms, random motions, all keypoints", "mean ≤ 0.1, worst ≤ 1", coarse),
        *(_row(f"mean lag at full speed, τ = {tau:g} s", "", np.concatenate(rows)) for tau, rows in moving),
    ]


def _contact_rows(results: dict[str, dict[str, Any]]) -> list[str]:
    corners, corridors, squeezes = results["corners"], results["corridors"], results["squeezes"]
    free = 1000 * np.array(results["plans"]["clearance"])
    rows = [("corner", f"EI = {value:g} N m²", row) for value, row in _groups(corners, "stiffness")]
    rows += [(f"corridor of {1000 * value:g} mm", "sideways", row) for value, row in _groups(corridors, "width")]
    rows += [
        ("corridor of 30 mm", f"squeezed at {10_000 * speed:.0f} mm/s", row)
        for speed, row in zip(squeezes["speed"], squeezes["deepest"], strict=True)
    ]
    refused = sum(len(row) for each in (corners, corridors, squeezes) for row in each["refused"])
    cases = refused + sum(len(values) for *_, values in rows)
    resting = [value for each in (corners, corridors, squeezes) for row in each["resting"] for value in row]
    least = free.mean(), float(np.median(free)), float(np.percentile(free, 5)), free.min(), len(free)
    return [
        *(_row(f"penetration, {what}, {how}", "≤ 1", values) for what, how, values in rows),
        _row("all of them, one second later, at rest", "≤ 1", np.maximum(0.0, resting)),
        f"| of these {cases} cases, refused by the plant | | | | | {refused} | |",
        _row("penetration on the verified plans of the catalogue", "0", np.maximum(0.0, -free), 1.0),
        _line("least clearance on them (95%: 5%; worst: least)", "> 0", *least),
    ]


def _friction_rows(results: dict[str, dict[str, Any]]) -> list[str]:
    columns, rows = (results["friction"][key] for key in ("cable", "number", "off", "effect")), []
    for name, number, off, effect in zip(*columns, strict=True):
        rows.append(_row(f"friction, {name}, μgρL³/EI = {number:.0f}: moving, from a chain in space", "", off))
        rows.append(_row("the same, at rest one second later", "", np.array(off)[:, -1]))
        rows.append(_row("the same cable without friction: from the chain in space", "", effect))
    return [
        *rows,
        _row("how far the chain in space leaves the table", "", results["friction"]["lifted"]),
    ]


def _groups(result: dict[str, Any], key: str) -> list[tuple[float, list[float]]]:
    return list(zip(result[key], result["deepest"], strict=True))


def fill_in(document: Path, text: str) -> None:
    """Put the table between its marks in the document."""
    before, _, rest = document.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    write_atomically(document, lambda file: file.write((before + BEGIN + "\n" + text + "\n" + END + after).encode()))
