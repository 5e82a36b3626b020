"""`cableway see --depth`: what stands on the table, as the obstacles of a task."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cableway.cli.terminal import Terminal, pairs
from cableway.core.quantities import quantity

if TYPE_CHECKING:
    from cableway.cli.see import See
    from cableway.perception.survey import Survey
    from cableway.scene.task import Draft, Task

SCENE, PICTURE = "seen.yaml", "seen.png"
"""What it leaves."""


def see_scene(options: See, color: tuple[float, float, float]) -> int:
    """Carry the command out and return its exit status: 1 where start or goal of the task are in what was found."""
    from cableway.core.files import only_writer
    from cableway.figures.style import save_figure
    from cableway.figures.survey import survey_figure
    from cableway.perception.calibration_file import load_camera
    from cableway.perception.capture import depth_picture, picture
    from cableway.perception.segmentation import CableColor, cable_mask
    from cableway.perception.survey import depth_view, held, survey
    from cableway.scene.files.loading import load_planar_task
    from cableway.scene.files.saving import save_task

    assert options.depth is not None
    assert options.task is not None
    task, sources = load_planar_task(options.task), options.source.split(",")
    hides = [None] * len(sources) if options.hides is None else options.hides.split(",")
    images, views = [picture(Path(source)) for source in sources], []
    files = zip(options.calibration.split(","), options.depth.split(","), images, hides, strict=True)
    for calibration, depth, image, hiding in files:
        mask = None if hiding is None else picture(Path(hiding)).max(axis=2) > 0
        cable = cable_mask(image, CableColor(color=color))
        views.append(depth_view(load_camera(calibration), depth_picture(Path(depth)), cable, mask))
    found, folder = survey(views, task.scene.size, held(task)), options.folder("see")
    draft = _as_task(task, found, options.hidden == "stands")
    with only_writer(folder):
        save_task(draft, folder / SCENE)
        save_figure(survey_figure(draft, found, images, [view.camera for view in views]), folder / PICTURE)
    report = _report(found, draft)
    options.keep("see", {**report, "folder": str(folder)})
    files_told = ("files", f"{folder / SCENE}, {PICTURE}")
    Terminal(options).result({**report, "folder": str(folder)}, pairs([*_rows(found, report, options), files_told]))
    return 1 if report["faults"] else 0


def _as_task(task: Task, found: Survey, hidden: bool) -> Draft:
    """The task with what was found, whether or not a cable can do it."""
    description = (
        f"{task.name} with what depth images show on the table, {quantity(found.lowest)} and more high. "
        f"{100 * (1 - found.seen):.1f}% of the table was not seen; that is {'an obstacle' if hidden else 'free'}."
    )
    scene = found.scene(task.scene, hidden=hidden)
    return replace(task.unchecked(), name=f"{task.name}-seen", description=description, scene=scene)


def _report(found: Survey, draft: Draft) -> dict[str, Any]:
    return {
        "obstacles": len(found.obstacles),
        "heights": [obstacle.height for obstacle in found.obstacles],
        "specks": found.specks,
        "lowest": found.lowest,
        "seen": found.seen,
        "hidden": len(found.hidden),
        "off": list(found.off),
        "faults": [str(fault) for fault in draft.faults()],
    }


def _rows(found: Survey, report: dict[str, Any], options: See) -> list[tuple[str, str]]:
    doubtful = "obstacles, too" if options.hidden == "stands" else "taken to be FREE"
    rows = [
        ("obstacles", f"{len(found.obstacles)}, and {found.specks} specks left out"),
        ("found from", f"{quantity(found.lowest)} on; what is lower was not looked for"),
        ("not seen", f"{100 * (1 - found.seen):.1f}% of the table; parts with room for something, {len(found.hidden)}, "
         f"are {doubtful}"),
        ("table", ", ".join(f"{1000 * off:+.0f} mm" for off in found.off) + " off by the depths, mended"),
    ]  # fmt: skip
    return [*rows, *(("not possible", fault) for fault in report["faults"][:3])]
