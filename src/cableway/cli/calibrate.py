"""`cableway calibrate`: a camera by pictures of a ChArUco board, on the table or in a gripper."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from cableway.cli.options import Maybe, Options, option
from cableway.cli.terminal import Terminal, pairs
from cableway.core.errors import InputError

if TYPE_CHECKING:
    from cableway.perception.charuco import Board
    from cableway.perception.hand_eye import HandEye
    from cableway.perception.table_pose import Calibration

CAMERA = "camera.json"
"""What it leaves."""

MOST = 320
"""Pictures of a film that count: the sharpest ones of as many equal parts of it."""

MOST_ON_TABLE = 20
"""The same of a film of the board on the table."""


@dataclass(frozen=True, kw_only=True)
class Calibrate(Options):
    """Find a camera's lens and place by pictures of a ChArUco board. Needs pip install 'cableway[vision]'."""

    pictures: Annotated[tyro.conf.Positional[Path | None], option(metavar="FOLDER|FILM")] = None
    """Pictures of the board in twenty poses or more, near and slanted to all sides, without that of it on the table.
    With --table, a film of it does as well."""

    print_board: Annotated[Path | None, option(metavar="FILE.pdf")] = None
    """Write the board to a file in its true size, to print it, and nothing else."""

    table: Annotated[Path | None, option(metavar="PICTURE|FOLDER|FILM")] = None
    """A picture of the board flat on the table; or a folder or a film of it slid about there, all over the table, which
    tells better how that is tilted: it is at --place in the first picture. This or --poses."""

    poses: Annotated[Path | None, option(metavar="FILE.csv")] = None
    """Where the gripper that held the board was: a row for each picture, with the columns picture, its name in the
    folder, x, y, z [m], rx, ry, rz, the rotation vector [rad]. This or --table."""

    place: Annotated[str, tyro.conf.arg(metavar="X,Y,THETA")] = "0,0,0"
    """With --table: where the upper left corner of its drawing lies in the first picture of these [m], and the angle of
    its first row [rad]."""

    base: Annotated[str, tyro.conf.arg(metavar="X,Y,Z,THETA")] = "0,0,0,0"
    """With --poses: where the frame of these poses, that of the robot's base, is in the frame of the workspace [m],
    and the angle of its x axis [rad]."""

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

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.print_board is not None:
            given = [name for name in ("pictures", "table", "poses") if getattr(self, name) is not None]
            if given:
                raise InputError(
                    f"--print-board draws a board, and takes no {given[0]}: calibrate by its pictures later"
                )
            return
        if self.pictures is None:
            raise InputError("calibrate needs a folder with pictures of the board, or --print-board for one")
        if (self.table is None) == (self.poses is None):
            raise InputError("calibrate needs one of --table and --poses: the board lies on the table, or is held")
        other = "place" if self.table is None else "base"
        if getattr(self, other) != getattr(type(self), other):
            needed = "--table" if other == "place" else "--poses"
            raise InputError(f"--{other}: only goes with {needed}, got {getattr(self, other)!r}")

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.perception.calibration_file import save_camera
        from cableway.perception.charuco import Board

        across, down = self._numbers("board", self.board, "x", 2)
        board = Board(
            across=int(across), down=int(down), square=self.square, marker=self.marker, dictionary=self.dictionary
        )
        if self.print_board is not None:
            from cableway.figures.board import board_figure
            from cableway.figures.style import save_figure

            save_figure(board_figure(board), self.print_board)
            Terminal(self).result({"file": str(self.print_board)}, pairs([("file", str(self.print_board))]))
            return 0
        found, given = self._held(board) if self.table is None else self._lying(board, self.table)
        report = {name: value for name, value in vars(found).items() if name not in ("camera", "held")}
        path = self.target("calibrate", CAMERA)
        path.parent.mkdir(parents=True, exist_ok=True)
        save_camera(path, found.camera, **report)
        rows = [
            ("pictures that counted", f"{found.pictures} of {given}"),
            ("residual of the lens", f"{found.lens_residual:.2f} pixels"),
        ]
        if "apart" in report:
            rows.append(("residual with the gripper", f"{report['residual']:.2f} pixels"))
            rows.append(("camera and gripper apart", f"{1000 * report['apart']:.2f} mm"))
        else:
            rows.append(("residual on the table", f"{report['table_residual']:.2f} pixels"))
        Terminal(self).result({**report, "file": str(path)}, pairs([*rows, ("file", str(path))]))
        return 0

    def _lying(self, board: Board, table: Path) -> tuple[Calibration, int]:
        """What the pictures say with those of the board on the table, and how many there are."""
        from cableway.perception.capture import IMAGES, frames, picture, sharpest
        from cableway.perception.table_pose import calibrate

        assert self.pictures is not None
        x, y, angle = self._numbers("place", self.place, ",", 3)
        images = sharpest(str(self.pictures), MOST)
        if table.suffix.lower() in IMAGES:
            lying = [picture(table)]
        else:  # the first one is at the place, be it the sharpest or not
            lying = [next(iter(frames(str(table)))).image, *sharpest(str(table), MOST_ON_TABLE)[1:]]
        return calibrate(images, lying, board, (x, y, angle)), len(images) + len(lying)

    def _held(self, board: Board) -> tuple[HandEye, int]:
        """What the pictures say with the poses of the gripper, and how many there are."""
        import numpy as np

        from cableway.perception.calibration_file import load_poses
        from cableway.perception.capture import picture
        from cableway.perception.hand_eye import hand_eye

        assert self.pictures is not None
        assert self.poses is not None
        x, y, z, angle = self._numbers("base", self.base, ",", 4)
        names, poses = load_poses(self.poses)
        base, (c, s) = np.eye(4), (np.cos(angle), np.sin(angle))
        base[:2, :2], base[:3, 3] = [[c, -s], [s, c]], [x, y, z]
        return hand_eye([picture(self.pictures / name) for name in names], base @ poses, board), len(names)

    def _numbers(self, name: str, text: str, by: str, count: int) -> list[float]:
        try:
            numbers = [float(part) for part in text.split(by)]
        except ValueError:
            numbers = []
        if len(numbers) != count:
            raise InputError(f"--{name} must be {count} numbers with {by!r} between them, got {text!r}")
        return numbers
