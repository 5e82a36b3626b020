"""Scenes from elsewhere, as tasks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cableway.core.errors import InputError
from cableway.core.quantities import limit_text
from cableway.drawings.arrangement import Arrangement, arranged
from cableway.drawings.records import TOLERANCE, UNITS, Drawing, Rectangle
from cableway.scene.task import Draft, Task
from cableway.tasks.free_ends import with_free_ends

KINDS = {".svg": "drawing", ".dxf": "drawing", ".xml": "model", ".mjcf": "model", ".png": "height image"}
"""What is read, by the ending of the file."""


@dataclass(frozen=True, kw_only=True)
class ImportConfig:
    """How a file is understood.

    Attributes:
        unit: Of a drawing, one of `UNITS`; by default, as the file says.
        tolerance: By how much obstacles may be off what is drawn [m].
        workspace: Left and lower edge, width and height of the workspace in the file [m]; by default, the page, or what
            holds everything.
        frame: Id, label, layer or handle of the outline in a drawing that is the edge of the workspace.
        table: Height of the table in a model [m].
        pixel: Side of a pixel of a height image [m].
        step: Height of a grey level [m].
        lowest: Ascending heights [m] from which on something is an obstacle, and a higher one.

    Raises:
        InputError: A value is out of range.
    """

    unit: str | None = None
    tolerance: float = TOLERANCE
    workspace: Rectangle | None = None
    frame: str | None = None
    table: float | None = None
    pixel: float | None = None
    step: float | None = None
    lowest: Sequence[float] = ()

    def __post_init__(self) -> None:
        if self.unit is not None and self.unit not in UNITS:
            raise InputError(f"--unit must be one of {', '.join(UNITS)}, got {self.unit!r}")
        if not 1e-5 <= self.tolerance <= 0.1:
            raise InputError(f"--tolerance must be from 1e-05 to 0.1, got {self.tolerance:g}")
        if self.workspace is not None and not all(abs(each) < 1000 for each in self.workspace):
            raise InputError(f"--workspace must be four numbers below 1000, got {self.workspace}")
        if self.table is not None and not abs(self.table) < 100:
            raise InputError(f"--table must be from -100 to 100, got {self.table:g}")
        for name, most in (("pixel", 1.0), ("step", 1.0)):
            value = getattr(self, name)
            if value is not None and not 0 < value <= most:
                raise InputError(f"--{name} must be above 0 and at most {most:g}, got {value:g}")
        ascending = all(a < b for a, b in zip(self.lowest, self.lowest[1:], strict=False))
        if self.lowest and not (ascending and self.lowest[0] > 0 and self.lowest[-1] < 50):
            raise InputError(f"--lowest must be ascending heights above 0, got {', '.join(map(str, self.lowest))}")


FOR = {
    "unit": "drawing",
    "frame": "drawing",
    "table": "model",
    "pixel": "height image",
    "step": "height image",
    "lowest": "height image",
}
"""What an option is for."""


def understood(path: Path, config: ImportConfig) -> tuple[Drawing, Arrangement]:
    """What is drawn in a file, and the scene that it makes.

    Args:
        path: An SVG, DXF, MuJoCo XML or PNG file.
        config: How it is understood.

    Raises:
        CablewayError: The file is of another kind, cannot be read, or makes no scene; see the readers.
    """
    kind = KINDS.get(path.suffix.lower())
    if kind is None:
        raise InputError(f"{path}: it must end in one of {', '.join(KINDS)}")
    for name, of in FOR.items():
        if of != kind and getattr(config, name):
            raise InputError(f"--{name} is for a {of}, and {path} is a {kind}")
    with np.errstate(all="ignore"):  # readers refuse what is not finite where it becomes an outline
        drawing = _read(path, config)
    try:
        return drawing, arranged(drawing, config.tolerance, config.workspace)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _read(path: Path, config: ImportConfig) -> Drawing:
    if path.suffix.lower() == ".svg":
        from cableway.drawings.svg import read_svg

        return read_svg(path, config.tolerance, config.unit, config.frame)
    if path.suffix.lower() == ".dxf":
        from cableway.drawings.dxf import read_dxf

        return read_dxf(path, config.tolerance, config.unit, config.frame)
    if path.suffix.lower() == ".png":
        return _heights(path, config)
    from cableway.simulation.standing import read_model

    return read_model(path, config.tolerance, config.table or 0.0)


def _heights(path: Path, config: ImportConfig) -> Drawing:
    from cableway.perception.heights import height_image, standing

    if config.pixel is None or config.step is None or not config.lowest:
        missing = [name for name in ("pixel", "step", "lowest") if not getattr(config, name)]
        raise InputError(f"{path}: a height image needs --{' and --'.join(missing)}")
    return standing(height_image(path, config.step), config.pixel, config.lowest, config.tolerance)


def as_task(found: Arrangement, name: str, source: str, like: Task | None, seed: int) -> Draft:
    """A task in a scene.

    Args:
        found: The scene.
        name: Of the task.
        source: What it is from.
        like: Has start, goal, cable and grippers, whether or not they fit in; by default, a start and a goal are drawn.
        seed: Of that draw.

    Raises:
        InputError: There is no room for a start and a goal.
    """
    corner = ", ".join(limit_text(each) for each in found.corner)
    said = f"Obstacles from {source}; the origin is at ({corner}) there."
    if like is not None:
        return replace(like.unchecked(), name=name, description=said, scene=found.scene)
    return with_free_ends(name, found.scene, seed, description=f"{said} Start and goal are drawn, by seed {seed}.")
