"""``omnimirror board``: a calibration board to print."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from .....base.files import is_standard_output
from .....calibration.targets.printing import PAPERS_MM, SUFFIXES, write_board
from ...help_pages import DocumentedCommand
from ...options.board import BoardOptions
from ...options.common import NUMBER
from ...options.declared import Options, option, takes
from ...outputs import format_option, output_option, say, say_written


@dataclass(frozen=True)
class SheetOptions(Options):
    """The sheet, as :func:`omnimirror.write_board` takes it."""

    margin_mm: float | None = option(type=NUMBER, metavar="MM", help="White around the board.  [default: one square]")
    paper: str | None = option(type=click.Choice(list(PAPERS_MM)), help="Paper.  [default: as large as it needs]")
    dpi: float = option(type=NUMBER, default=300.0, help="PNG: dots per inch.")


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=("omnimirror board --board 11x7 --square-mm 30 -o board.pdf",),
)
@output_option(
    "-o", "--output", required=True, formats=tuple(suffix[1:] for suffix in SUFFIXES),
    help="A .pdf, .svg or .png file.",
)  # fmt: skip
@format_option(tuple(suffix[1:] for suffix in SUFFIXES))
@takes(BoardOptions, "board")
@takes(SheetOptions, "sheet")
def command(output: Path, board: BoardOptions, sheet: SheetOptions) -> None:
    """Write a calibration board to print at true scale.

    Print it at 100 %, without fitting it to the page, and measure the line of 100 mm at its foot. Glue it to something
    flat and stiff.
    """
    made = board.made()
    written = write_board(made, output, margin_mm=sheet.margin_mm, paper=sheet.paper, dpi=sheet.dpi)
    say_written(written)
    if not is_standard_output(output):
        size = f"--board {made.columns}x{made.rows} --square-mm {made.square_mm:g}"
        say(f"Calibrate with {size} --target {made.kind}, and the square as you measured it")
