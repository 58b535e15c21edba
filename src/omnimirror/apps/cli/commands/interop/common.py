"""Options and output shared by the export commands."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click
from rich.console import Console

from .....interop.export_formats import ExportedFiles, ExportFormat
from ...outputs import plain_table, write_standard_output_as

F = TypeVar("F", bound=Callable[..., Any])


def formats_option(known: Mapping[str, ExportFormat[Any]]) -> Callable[[F], F]:
    """Return the option ``--format``; the first format also determines the format of ``-``."""

    def names(_: click.Context, __: click.Parameter, text: str | None) -> list[str] | None:
        if text is None:
            return None
        requested = [name.strip() for name in text.split(",")]
        if unknown := [name for name in requested if name not in known]:
            raise click.BadParameter(f"must be one of {', '.join(known)}; got {unknown[0]!r}")
        write_standard_output_as(known[requested[0]].suffix.removeprefix("."))
        return requested

    return click.option(
        "--format", "--formats", "formats", is_eager=True, callback=names, metavar="NAME,...",
        help=f"Formats: {', '.join(known)}.  [default: by the suffix of the file]",
    )  # fmt: skip


def check_one_file(output: Path, formats: Sequence[str] | None, known: Mapping[str, ExportFormat[Any]]) -> None:
    """Raise UsageError if several files would be written to standard output."""
    if output.stem == "-" and formats and (len(formats) > 1 or len(known[formats[0]].endings) > 1):
        names = ", ".join(formats)
        raise click.UsageError(f"standard output takes one file and {names} consists of several; give a folder")


def print_exported_files(exported: Iterable[ExportedFiles], console: Console) -> None:
    """Print a table of files, contents and deviations."""
    columns = ("file", "contents", "deviation")
    table = plain_table(*columns, words=columns)
    for files in exported:
        table.add_row("\n".join(map(str, files.paths)), files.description, str(files.deviation))
    console.print(table)
