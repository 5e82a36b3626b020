"""A calibration board to print."""

from __future__ import annotations

from cableway.figures.style import INK, NOTE, Figure, add_axes, new_figure
from cableway.perception.charuco import Board

INCH = 0.0254
EDGE = 0.012
"""Paper about the squares [m]: printers leave some white, and the board needs some."""


def board_figure(board: Board) -> Figure:
    """The board in its true size, with what it is below it.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """
    edge, width, height = (size / INCH for size in (EDGE, board.across * board.square, board.down * board.square))
    figure = new_figure(width + 2 * edge, height + 2 * edge)
    axes = add_axes(figure, edge, edge, width, height)
    axes.set_axis_off()
    axes.imshow(board.drawing(), cmap="gray", vmin=0, vmax=255, interpolation="nearest", aspect="auto")
    told = (
        f"--board {board.across}x{board.down} --square {board.square:g} --marker {board.marker:g}: print it at 100%, "
        "glue it to something flat, and measure a square"
    )
    figure.text(0.5, 0.4 * edge / (height + 2 * edge), told, ha="center", va="center", fontsize=NOTE, color=INK)
    return figure
