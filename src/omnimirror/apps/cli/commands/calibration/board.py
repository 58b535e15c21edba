"""``omnimirror board``: calibration targets for printing."""

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
    """Sheet, with the parameters of :func:`omnimirror.write_board`."""

    margin_mm: float | None = option(
        type=NUMBER, metavar="MM", help="White margin around the board.  [default: one square]"
    )
    paper: str | None = option(
        type=click.Choice(list(PAPERS_MM)), help="Paper size.  [default: as large as the board requires]"
    )
    dpi: float = option(type=NUMBER, default=300.0, help="Resolution of PNG files, dots per inch.")


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=("omnimirror board --board 11x7 --square-mm 30 -o board.pdf",),
)
@output_option(
    "-o", "--output", required=True, formats=tuple(suffix[1:] for suffix in SUFFIXES),
    help="Output file: .pdf, .svg or .png.",
)  # fmt: skip
@format_option(tuple(suffix[1:] for suffix in SUFFIXES))
@takes(BoardOptions, "board")
@takes(SheetOptions, "sheet")
def command(output: Path, board: BoardOptions, sheet: SheetOptions) -> None:
    """Write a calibration target for printing at true scale.

    Print it at 100 %, without fitting it to the page, and measure the 100 mm line at its foot.
    Mount it on a flat and stiff support.
    """
    made = board.made()
    written = write_board(made, output, margin_mm=sheet.margin_mm, paper=sheet.paper, dpi=sheet.dpi)
    say_written(written)
    if not is_standard_output(output):
        size = f"--board {made.columns}x{made.rows} --square-mm {made.square_mm:g}"
        say(f"Calibrate with {size} --target {made.kind}, and the square as you measured it")
