"""The pictures of `docs/simulator.md`, drawn from results alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from accuracy import shapes
from cableway.figures import palette, style
from cableway.geometry import polyline

Results = dict[str, dict[str, Any]]

HEIGHT = 1.8
"""Height [inch] of a panel."""


def settled(results: Results) -> Figure:
    """Settled shapes beside the elastica, and the error against the sharpest bend."""
    figure, (left, right) = _panels(2, above=0.55)
    style.title(left, "settled (dots), elastica, worst keypoint")
    for place, (line, dots) in enumerate(_shown(results["any-poses"])):
        middle = (line.max(axis=0) + line.min(axis=0)) / 2
        offset = np.array([0.36 * (place % 2), -0.19 * (place // 2)]) - middle
        left.plot(*polyline.spline(line + offset, 8).T, color=palette.MUTED, linewidth=1.2)
        left.plot(*(dots + offset).T, "o", color=palette.START, markersize=3.2)
        text = f"{1000 * np.linalg.norm(dots - line, axis=1).max():.2f} mm"
        left.text(
            *(offset + middle - [0.0, 0.09]), text, ha="center", va="center", fontsize=style.NOTE, color=palette.MUTED
        )
    left.set_aspect("equal", anchor="NW")
    left.set_axis_off()
    for name, colour, label in (
        ("any-poses", palette.GOAL, "any gripper poses"),
        ("along-plans", palette.PATHS, "along plans"),
        ("after-motions", palette.START, "after random motions"),
    ):
        worst = 1000 * shapes.errors(results[name]).max(axis=1)
        radius = 1000 * np.array(results[name]["radius"])
        right.loglog(radius, worst, "o", color=colour, markersize=3.5, alpha=0.7, label=label)
    _limit(right, 1.0, "required")
    style.curve_axes(right, "radius of the sharpest bend [mm]", "distance to the elastica [mm]")
    _plain_ticks(right.xaxis, [10, 20, 50, 100, 200, 500])
    _plain_ticks(right.yaxis, [0.03, 0.1, 0.3, 1])
    style.title(right, "worst keypoint of each shape", legend=True)
    style.letter_panels(left, right)
    return figure


def closed_form(results: Results) -> Figure:
    """Parallel ends pushed together: shapes, and the worst keypoint."""
    result = results["closed-form"]
    figure, (left, right) = _panels(2)
    style.title(left, "pushed together: settled (dots), closed form")
    for plant, exact in zip(result["plant"], result["elastica"], strict=True):
        left.plot(*polyline.spline(np.array(exact), 8).T, color=palette.MUTED, linewidth=1.2)
        left.plot(*np.array(plant).T, "o", color=palette.START, markersize=3.2)
    left.set_aspect("equal", anchor="NW")
    style.curve_axes(left, "x/L", "y/L")
    style.title(right, "worst keypoint")
    off = 100 * np.linalg.norm(np.array(result["plant"]) - result["elastica"], axis=-1).max(axis=1)
    right.plot(result["shortening"], off, "o-", color=palette.START, markersize=4)
    _limit(right, 0.3, "required")
    style.curve_axes(right, "pushed together by d/L", "distance [% of L]")
    right.set_ylim(0, None)
    style.letter_panels(left, right)
    return figure


def convergence(results: Results) -> Figure:
    """The error against the number of links and against the time step."""
    links, steps = results["links"], results["time-step"]
    figure, (left, right) = _panels(2, 0.85)
    style.title(left, "links")
    hinges, errors = np.array(links["hinges"]), 1000 * np.array(links["errors"])
    left.loglog(hinges, np.median(errors, axis=1), "o-", color=palette.START, markersize=4, label="median")
    left.loglog(hinges, errors.max(axis=1), "o-", color=palette.GOAL, markersize=4, label="worst shape")
    slope = np.median(errors[0]) * (hinges / hinges[0]) ** -2.0
    left.loglog(hinges, 0.7 * slope, "--", color=palette.MUTED, linewidth=1, label="second order")
    style.curve_axes(left, "hinges N", "mean over keypoints [mm]")
    _plain_ticks(left.xaxis, hinges)
    _plain_ticks(left.yaxis, [0.01, 0.03, 0.1, 0.3, 1])
    style.name_curves(left)
    style.title(right, f"time step, against {1000 * steps['time_step'][-1]:g} ms")
    sizes, off = 1000 * np.array(steps["time_step"][:-1]), 1000 * np.array(steps["to_finest"][:-1])
    for values, colour, label in (
        (off.mean(axis=1), palette.START, "mean"),
        (np.percentile(off, 95, axis=1), palette.PATHS, "95%"),
        (off.max(axis=1), palette.GOAL, "worst"),
    ):
        right.loglog(sizes, values, "o-", color=colour, markersize=4, label=label)
    slope = 0.7 * off[0].mean() * sizes / sizes[0]
    right.loglog(sizes, slope, "--", color=palette.MUTED, linewidth=1, label="first order")
    style.curve_axes(right, "time step [ms]", "distance of keypoints [mm]")
    _plain_ticks(right.xaxis, sizes)
    _plain_ticks(right.yaxis, [0.001, 0.01, 0.1, 1])
    style.name_curves(right)
    style.letter_panels(left, right)
    return figure


def lag(results: Results) -> Figure:
    """How far the moving cable is behind its equilibrium, and how it comes to rest."""
    result = results["lag"]
    taus = np.array(result["damping_time"])
    moving = [1000 * np.concatenate(rows) for rows in result["moving"]]
    figure, (left, right) = _panels(2, 0.85)
    style.title(left, "lag at full speed")
    for share, colour, label in (
        (50, palette.START, "median"),
        (95, palette.PATHS, "95%"),
        (100, palette.GOAL, "worst"),
    ):
        values = [np.percentile(each, share) for each in moving]
        left.loglog(taus, values, "o-", color=colour, markersize=4, label=label)
    style.curve_axes(left, "damping time τ [s]", "mean over keypoints [mm]")
    _plain_ticks(left.xaxis, taus)
    _plain_ticks(left.yaxis, [0.03, 0.1, 0.3, 1, 3, 10])
    style.name_curves(left)
    style.title(right, "left alone: median lag")
    slow = [place for place, tau in enumerate(taus) if tau >= result["control_step"]]
    for place, colour in zip(slow, style.TIME(np.linspace(0, 1, len(slow))), strict=True):
        tau, rows = taus[place], np.array(result["resting"][place])
        share = np.median(rows / rows[:, :1], axis=0)
        times = result["control_step"] * np.arange(len(share)) / tau
        right.semilogy(times, share, color=colour, linewidth=1.4, label=f"τ = {tau:g} s")
    times = np.linspace(0, 6, 50)
    right.semilogy(times, np.exp(-times), "--", color=palette.MUTED, linewidth=1, label="exp(-t/τ)")
    right.set_xlim(0, 6)
    right.set_ylim(3e-3, 1.2)
    style.curve_axes(right, "t/τ", "share of the first")
    style.legend_right(right)
    style.letter_panels(left, right)
    return figure


def contact(results: Results) -> Figure:
    """Penetration at corners and in corridors."""
    figure, panels = _panels(3)
    squeezes = results["squeezes"]
    stiffnesses = [f"{value:g}" for value in results["corners"]["stiffness"]]
    widths = [f"{1000 * value:g}" for value in results["corridors"]["width"]]
    speeds = [f"{10_000 * speed:.0f}" for speed in squeezes["speed"]]
    texts = (
        ("corners", "against a corner", "stiffness EI [N m²]", stiffnesses),
        ("corridors", "sideways in a corridor", "width [mm]", widths),
        ("squeezes", "squeezed in 30 mm", "speed of each gripper [mm/s]", speeds),
    )
    highest = 1050 * max(max(row) for name, *_ in texts for row in results[name]["deepest"])
    for ax, (name, title, label, ticks) in zip(panels, texts, strict=True):
        style.title(ax, title)
        _strips(ax, [1000 * np.array(row) for row in results[name]["deepest"]])
        _limit(ax, 1.0, "required")
        style.curve_axes(ax, label, "deepest penetration [mm]" if ax is panels[0] else "")
        ax.set_xticks(range(len(ticks)), ticks)
        ax.set_ylim(0, highest)
    style.letter_panels(*panels)
    return figure


PICTURES: dict[str, Callable[[Results], Figure]] = {
    "settled": settled,
    "closed-form": closed_form,
    "convergence": convergence,
    "lag": lag,
    "contact": contact,
}


def _panels(count: int, beside: float = 0.0, above: float = 0.28) -> tuple[Figure, list[Axes]]:
    """Panels across two columns, each with so many inches for a legend right of it and for title and legend above."""
    left, below = 0.5, 0.42
    figure = style.new_figure(style.DOUBLE, below + HEIGHT + above)
    pitch = style.DOUBLE / count
    return figure, [
        style.add_axes(figure, left + k * pitch, below, pitch - left - 0.1 - beside, HEIGHT) for k in range(count)
    ]


def _shown(result: dict[str, Any]) -> list[tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]]:
    """Elastica and keypoints of six shapes from the best to the worst, with the elastica's ends level."""
    order = np.argsort(shapes.errors(result).max(axis=1))
    shown = []
    for row in order[np.linspace(0, len(order) - 1, 6).astype(int)]:
        line, dots = np.array(result["elastica"][row]), np.array(result["plant"][row])
        x, y = line[-1] - line[0]
        turn = np.array([[x, -y], [y, x]]) / np.hypot(x, y)
        shown.append((line @ turn, dots @ turn))
    return shown


def _strips(ax: Axes, rows: Sequence[Float[np.ndarray, "k"]]) -> None:
    """One column of points for each row, spread sideways by rank so that none hides another, and its median."""
    for place, values in enumerate(rows):
        spread = 0.5 * ((np.arange(len(values)) * 0.618) % 1 - 0.5)
        ax.plot(place + spread, values, "o", color=palette.START, markersize=2.8, alpha=0.6)
        ax.plot([place - 0.3, place + 0.3], [np.median(values)] * 2, color=palette.INK, linewidth=1.5)


def _limit(ax: Axes, value: float, text: str) -> None:
    ax.axhline(value, color=palette.BAD, linewidth=1, linestyle="--")
    ax.annotate(
        text, (0, value), xycoords=("axes fraction", "data"), xytext=(3, 3), textcoords="offset points",
        fontsize=style.NOTE, color=palette.BAD,
    )  # fmt: skip


def _plain_ticks(axis: Any, values: Sequence[float] | np.ndarray) -> None:
    axis.set_major_locator(FixedLocator(list(values)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
