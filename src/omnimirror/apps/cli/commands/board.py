"""``omnimirror board``: calibration targets for printing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from ....base.files import is_standard_output
from ....calibration.targets.printing import PAPERS_MM, SUFFIXES, write_board
from .._board_options import BoardOptions
from .._declarations import DocumentedCommand, Options, add_options, option, setting
from .._output import output_option, print_line, print_written


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
