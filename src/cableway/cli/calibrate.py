"""`cableway calibrate`: a camera by pictures of a ChArUco board."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from cableway.cli.options import Maybe, Options
from cableway.cli.terminal import Terminal, pairs
from cableway.core.errors import InputError

CAMERA = "camera.json"
"""What it leaves."""


@dataclass(frozen=True, kw_only=True)
class Calibrate(Options):
    """Find a camera's lens and place by pictures of a ChArUco board. Needs pip install 'cableway[vision]'."""

    pictures: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER")]
    """Pictures of the board in some ten poses, near and slanted to all sides; the one on the table is not among
    them."""

    table: Annotated[Path, tyro.conf.arg(metavar="PICTURE")]
    """A picture of the board flat on the table."""

    place: Annotated[str, tyro.conf.arg(metavar="X,Y,THETA")] = "0,0,0"
    """Where the upper left corner of its drawing lies then [m], and the angle of its first row [rad]."""

    board: Annotated[str, tyro.conf.arg(metavar="ACROSSxDOWN")] = "7x5"
    """Squares in a row, and rows."""

    square: float = 0.03
    """Side of a square [m], measured on the print."""

    marker: float = 0.022
    """Side of a marker [m]."""

    dictionary: str = "DICT_4X4_50"
    """OpenCV's name of the markers."""

    out: Maybe[Path] = None
    """A file ending in .json, or a folder for camera.json; by default, runs/calibrate."""

    seed: tyro.conf.Suppress[None] = None
    """Nothing is drawn."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.perception.calibration_file import save_camera
        from cableway.perception.capture import frames, picture
        from cableway.perception.charuco import Board, calibrate

        across, down = self._numbers("board", self.board, "x", 2)
        x, y, angle = self._numbers("place", self.place, ",", 3)
        board = Board(
            across=int(across), down=int(down), square=self.square, marker=self.marker, dictionary=self.dictionary
        )
        images = [frame.image for frame in frames(str(self.pictures))]
        found = calibrate(images, picture(self.table), board, (x, y, angle))
        report = {
            "lens_residual": found.lens_residual,
            "table_residual": found.table_residual,
            "pictures": found.pictures,
            "corners": found.corners,
        }
        path = self.target("calibrate", CAMERA)
        path.parent.mkdir(parents=True, exist_ok=True)
        save_camera(path, found.camera, **report)
        rows = [
            ("pictures that counted", f"{found.pictures} of {len(images) + 1}"),
            ("residual of the lens", f"{found.lens_residual:.2f} pixels"),
            ("residual on the table", f"{found.table_residual:.2f} pixels"),
            ("file", str(path)),
        ]
        Terminal(self).result({**report, "file": str(path)}, pairs(rows))
        return 0

    def _numbers(self, name: str, text: str, by: str, count: int) -> list[float]:
        try:
            numbers = [float(part) for part in text.split(by)]
        except ValueError:
            numbers = []
        if len(numbers) != count:
            raise InputError(f"--{name} must be {count} numbers with {by!r} between them, got {text!r}")
        return numbers
