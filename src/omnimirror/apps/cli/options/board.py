"""Options that specify a calibration target."""

from __future__ import annotations

import re
from dataclasses import dataclass

import click

from ....base.arguments import shown
from ....calibration.targets.boards import KINDS, Board
from .common import NUMBER
from .declared import Options, option

SIZE = "Columns and rows: inner corners of a chessboard, squares of a ChArUco board, tags of an April grid."
SQUARE = "Side of a square, or of a tag."


def board_size(text: str) -> tuple[int, int]:
    """Parse the columns and rows of a board.

    >>> board_size("11x7")
    (11, 7)
    """
    match = re.fullmatch(r"([0-9]{1,4})x([0-9]{1,4})", text.strip().lower())
    if not match:
        raise click.BadParameter(f"{shown(text)} is not the size of a board, such as 11x7")
    return int(match[1]), int(match[2])


@dataclass(frozen=True)
class SoughtBoardOptions(Options):
    """Calibration board, with the parameters of :class:`omnimirror.Board`; optional."""

    board: tuple[int, int] | None = option(type=board_size, metavar="CxR", show_default=False, help=SIZE)
    square_mm: float | None = option(type=NUMBER, show_default=False, metavar="MM", help=SQUARE)
    target: str = option(type=click.Choice(KINDS), default="chessboard", help="Type of board.")
    marker_mm: float | None = option(
        type=NUMBER, metavar="MM", help="ChArUco: side of a marker.  [default: 3/4 of the square]"
    )
    spacing: float | None = option(
        type=NUMBER, metavar="RATIO", help="April grid: gap between tags as a fraction of their side.  [default: 0.3]"
    )
    family: str | None = option(
        metavar="NAME", help="Marker family by OpenCV name.  [default: 5X5_1000; April grid: APRILTAG_36H11]"
    )
    legacy: bool = option("--legacy-board", is_flag=True, default=False, help="ChArUco: layout of OpenCV before 4.6.")

    def made(self) -> Board | None:
        """Return the board; None without options for one."""
        if self.board is None or self.square_mm is None:
            if self.changed:
                raise click.UsageError("a board takes --board and --square-mm")
            return None
        columns, rows = self.board
        more = self.picked("marker_mm", "spacing", "family")
        return Board(self.target, columns, rows, self.square_mm, legacy=self.legacy, **more)  # type: ignore[arg-type]


@dataclass(frozen=True)
class BoardOptions(SoughtBoardOptions):
    """Calibration board, with the parameters of :class:`omnimirror.Board`."""

    board: tuple[int, int] = option(type=board_size, metavar="CxR", required=True, show_default=False, help=SIZE)
    square_mm: float = option(type=NUMBER, required=True, show_default=False, metavar="MM", help=SQUARE)

    def made(self) -> Board:
        """Return the board."""
        made = super().made()
        assert made is not None
        return made
