"""``omnimirror reproduce``: figures and statements of the paper."""

from __future__ import annotations

from pathlib import Path

import click

from .._declarations import DocumentedCommand
from .._output import output_console, print_line


@click.command(
    cls=DocumentedCommand, page="errata", examples=("omnimirror reproduce -o paper --figures",)
)
@click.option(
    "-o",
    "--output",
    "folder",
    type=click.Path(path_type=Path),
    default="reproduced",
    show_default=True,
    help="Folder for numbers.csv, numbers.md and the figures.",
)
@click.option(
    "--figures/--no-figures",
    default=True,
    show_default=True,
    help="Draw figures, or write the table only.",
)
@click.option(
    "--only",
    multiple=True,
    metavar="FIG",
    help="Draw this figure only, for example fig4 (repeatable).",
)
@click.option(
    "--style",
    type=click.Choice(["paper", "slides"]),
    default="paper",
    show_default=True,
    help="Style of the figures: column width of a journal, or larger text and lines.",
)
@click.option(
    "--format",
    "formats",
    type=click.Choice(["svg", "png", "pdf"]),
    multiple=True,
    default=("svg", "png"),
    show_default=True,
    help="File format of the figures (repeatable).",
)
def command(
    folder: Path, figures: bool, only: tuple[str, ...], style: str, formats: tuple[str, ...]
) -> None:
    """Redraw the figures of Ohte and Tsuzuki (2012) and check the statements of the paper.

    The exit code is 1 if a verdict differs from the known one.
    """
    from ....base.errors import ReproductionError
    from ....base.logs import forward_steps
    from ...reproduction import _claims, reproduce_paper

    console = output_console()
    with (
        console.status("Computing") as status,
        forward_steps(lambda step: status.update(f"Computing {step}")),
    ):
        result = reproduce_paper(
            folder,
            figures=figures,
            only=only or None,
            formats=formats,
            style=style,
        )
    console.print(_claims.terminal_table(result.rows))
    console.print(_claims.summary(result.rows), highlight=False, soft_wrap=True)
    print_line(f"Wrote {len(result.files)} files to ", (str(folder), "bold"), console=console)
    if result.unexpected:
        rows = "; ".join(r.title for r in result.unexpected)
        raise ReproductionError(f"verdicts differ from the known ones in rows {rows}")
