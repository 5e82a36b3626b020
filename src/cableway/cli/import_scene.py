"""`cableway import`: a scene from a drawing, a model or a height image."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cableway.cli.options import Maybe, Options, option
from cableway.cli.terminal import Terminal, pairs
from cableway.core.errors import InputError
from cableway.core.quantities import limit_text, size_text

if TYPE_CHECKING:
    from cableway.workflow.importing import ImportConfig

SCENE = "imported.yaml"
"""What it leaves by default; the picture beside it is called alike."""


@dataclass(frozen=True, kw_only=True)
class Import(Options):
    """Make a task from outlines in SVG or DXF, a MuJoCo model or a height image, and a picture of what was understood;
    `--out` is a folder or a .yaml file. SVG and DXF need pip install 'cableway[import]', height images
    'cableway[vision]'."""

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """A file that ends in .svg, .dxf, .xml (MuJoCo) or .png (heights as grey levels)."""

    task: Maybe[str] = None
    """A task with start, goal, cable and grippers; by default, start and goal are drawn at random where a cable of
    0.3 m has room."""

    unit: Annotated[str | None, option(metavar="{m,dm,cm,mm,um,in,ft}")] = None
    """Of a drawing's coordinates; by default, as the file says."""

    frame: Annotated[str | None, option(metavar="NAME")] = None
    """Id or label (SVG), layer or handle (DXF) of the outline that is the edge of the workspace; by default, the page
    of an SVG, and what holds all outlines of a DXF with 15 cm about them."""

    workspace: Annotated[str | None, option(metavar="X,Y,WIDTH,HEIGHT")] = None
    """Left and lower edge and size of the workspace in the file [m]; what is outside is left out."""

    tolerance: float = 0.0005
    """By how much obstacles may be off what is drawn, where it is round or not convex [m]."""

    table: Maybe[float] = None
    """Height of the table in a model [m]; by default, 0."""

    pixel: Maybe[float] = None
    """Side of a pixel of a height image [m]."""

    step: Maybe[float] = None
    """Height of a grey level [m]."""

    lowest: Annotated[str | None, option(metavar="HEIGHT,...")] = None
    """Height from which on something is an obstacle [m]; further, ascending ones begin a higher layer each."""

    def execute(self) -> int:
        """Carry the command out and return its exit status: 1 where start or goal of the task are in an obstacle."""
        from cableway.core.files import only_writer
        from cableway.figures.imported import imported_figure
        from cableway.figures.style import save_figure
        from cableway.scene.files.loading import load_planar_task
        from cableway.scene.files.saving import save_task
        from cableway.workflow.importing import as_task, understood

        config = self._config()
        like = None if self.task is None else load_planar_task(self.task)
        drawing, found = understood(self.file, config)
        path = self.target("import", SCENE, ".yml")
        name = re.sub(r"[^\w .+-]", "-", self.file.stem).lstrip(" .+-") or "imported"
        draft = as_task(found, name, self.file.name, like, self.seed or 0)
        with only_writer(path.parent):
            save_task(draft, path)
            save_figure(imported_figure(draft, found, drawing.unit), path.with_suffix(".png"))
        report: dict[str, Any] = {
            "unit": drawing.unit,
            "workspace": list(found.scene.size),
            "corner": list(found.corner),
            "outlines": len(found.outlines),
            "obstacles": len(found.scene.obstacles),
            "left_out": [str(each) for each in found.left_out],
            "faults": [str(fault) for fault in draft.faults()],
            "task": str(path),
        }
        most, some = 12, "" if len(found.outlines) == 1 else "s"
        rows = [
            ("unit", drawing.unit),
            ("workspace", f"{size_text(found.scene.size)}, from {', '.join(map(limit_text, found.corner))} on"),
            ("obstacles", f"{len(found.scene.obstacles)}, convex, from {len(found.outlines)} outline{some}"),
            *(("left out", each) for each in report["left_out"][:most]),
            *([("left out", f"and {len(found.left_out) - most} more")] if len(found.left_out) > most else []),
            *(("not possible", fault) for fault in report["faults"][:3]),
            ("files", f"{path}, {path.with_suffix('.png').name}"),
        ]
        Terminal(self).result(report, pairs(rows))
        return 1 if report["faults"] else 0

    def _config(self) -> ImportConfig:
        from cableway.workflow.importing import ImportConfig

        workspace = None
        if self.workspace is not None:
            numbers = _numbers("workspace", self.workspace)
            if len(numbers) != 4:
                raise InputError(f"--workspace must be X,Y,WIDTH,HEIGHT, got {self.workspace!r}")
            workspace = (numbers[0], numbers[1], numbers[2], numbers[3])
        return ImportConfig(
            unit=self.unit,
            tolerance=self.tolerance,
            workspace=workspace,
            frame=self.frame,
            table=self.table,
            pixel=self.pixel,
            step=self.step,
            lowest=() if self.lowest is None else _numbers("lowest", self.lowest),
        )


def _numbers(name: str, text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--{name} must be numbers separated by commas, got {text!r}") from None
