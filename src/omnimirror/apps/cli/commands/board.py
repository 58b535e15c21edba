"""``omnimirror board``: calibration targets for printing, and the options that specify a target."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import click

from ....base.arguments import format_value
from ....base.files import is_standard_output
from ....calibration.targets.boards import KINDS, Board
from ....calibration.targets.printing import PAPERS_MM, SUFFIXES, write_board
from .._declarations import NUMBER, DocumentedCommand, Options, add_options, option, setting
from .._output import output_option, print_line, print_written

# -- Options of a calibration target ---------------------------------------------------------------

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


# -- Command ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SheetOptions(Options):
    """Sheet, with the parameters of :func:`omnimirror.write_board`."""

    paper: str | None = option(
        type=click.Choice(list(PAPERS_MM)),
        help="Paper size.  [default: as large as the board requires]",
    )
    margin_mm: float | None = setting("sheet")
    dpi: float = setting("sheet", 300.0)


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=("omnimirror board --board 11x7 --square-mm 30 -o board.pdf",),
)
@output_option(
    "-o",
    "--output",
    required=True,
    formats=tuple(suffix[1:] for suffix in SUFFIXES),
    help="Output file: .pdf, .svg or .png.",
)
@add_options(BoardOptions, "board")
@add_options(SheetOptions, "sheet")
def command(output: Path, board: BoardOptions, sheet: SheetOptions) -> None:
    """Write a calibration target for printing at true scale.

    Print it at 100 %, without fitting it to the page, and measure the 100 mm line at its foot.
    Mount it on a flat and stiff support.
    """
    target = board.target_board()
    written = write_board(
        target, output, margin_mm=sheet.margin_mm, paper=sheet.paper, dpi=sheet.dpi
    )
    print_written(written)
    if not is_standard_output(output):
        size = f"--board {target.columns}x{target.rows} --square-mm {target.square_mm:g}"
        print_line(
            f"Calibrate with {size} --target {target.kind}, with the measured size of a square"
        )
