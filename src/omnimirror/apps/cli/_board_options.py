"""Options that specify a calibration target."""

from __future__ import annotations

import re
from dataclasses import dataclass

import click

from ...base.arguments import format_value
from ...calibration.targets.boards import KINDS, Board
from ._declarations import NUMBER, Options, option, setting

SIZE = "Inner corners (chessboard), squares (ChArUco) or tags (April grid)."
SQUARE = "Side of a square, or of a tag."


def board_size(text: str) -> tuple[int, int]:
    """Parse the columns and rows of a board.

    >>> board_size("11x7")
    (11, 7)
    """
    match = re.fullmatch(r"([0-9]{1,4})x([0-9]{1,4})", text.strip().lower())
    if not match:
        raise click.BadParameter(
            f"must be the size of a board, such as 11x7; got {format_value(text)}"
        )
    return int(match[1]), int(match[2])


@dataclass(frozen=True)
class OptionalBoardOptions(Options):
    """Calibration board, with the parameters of :class:`omnimirror.Board`; optional."""

    board: tuple[int, int] | None = option(
        type=board_size, metavar="CxR", show_default=False, help=SIZE
    )
    square_mm: float | None = option(type=NUMBER, show_default=False, metavar="MM", help=SQUARE)
    target: str = option(
        type=click.Choice(KINDS),
        default="chessboard",
        metavar="TYPE",
        help=f"Type of board: {', '.join(KINDS)}.",
    )
    marker_mm: float | None = setting("board")
    spacing: float | None = setting("board")
    family: str | None = setting("board", type=str)
    legacy: bool = setting("board", False)

    def target_board(self) -> Board | None:
        """Return the board; None without options for one."""
        if self.board is None or self.square_mm is None:
            if self.changed:
                raise click.UsageError("--board and --square-mm must be given together")
            return None
        columns, rows = self.board
        more = self.subset("marker_mm", "spacing", "family")
        return Board(self.target, columns, rows, self.square_mm, legacy=self.legacy, **more)  # type: ignore[arg-type]  # types of the keywords depend on their names


@dataclass(frozen=True)
class BoardOptions(OptionalBoardOptions):
    """Calibration board, with the parameters of :class:`omnimirror.Board`."""

    board: tuple[int, int] = option(
        type=board_size, metavar="CxR", required=True, show_default=False, help=SIZE
    )
    square_mm: float = option(
        type=NUMBER, required=True, show_default=False, metavar="MM", help=SQUARE
    )

    def target_board(self) -> Board:
        """Return the board."""
        target = super().target_board()
        assert target is not None
        return target
