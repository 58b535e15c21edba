"""What commands that write for other programs share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click
from rich.console import Console

from ....interop.formats import HandedOver, ProgramFormat
from ...outputs import plain_table, write_standard_output_as

F = TypeVar("F", bound=Callable[..., Any])


def formats_option(known: Mapping[str, ProgramFormat[Any]]) -> Callable[[F], F]:
    """The option ``--format``: names of formats, with commas between them; of the first is what ``-`` writes."""

    def names(_: click.Context, __: click.Parameter, text: str | None) -> list[str] | None:
        if text is None:
            return None
        found = [name.strip() for name in text.split(",")]
        if unknown := [name for name in found if name not in known]:
            raise click.BadParameter(f"{unknown[0]!r} is not a format; valid are {', '.join(known)}")
        write_standard_output_as(known[found[0]].suffix.removeprefix("."))
        return found

    return click.option(
        "--format", "--formats", "formats", is_eager=True, callback=names, metavar="NAME,..",
        help=f"Of {', '.join(known)}.  [default: by the file's suffix]",
    )  # fmt: skip


def check_one_file(output: Path, formats: Sequence[str] | None, known: Mapping[str, ProgramFormat[Any]]) -> None:
    """Refuse to write what are several files to standard output."""
    if output.stem == "-" and formats and (len(formats) > 1 or len(known[formats[0]].endings) > 1):
        raise click.UsageError(f"{', '.join(formats)} are several files, and standard output takes one; name a folder")


def say_handed_over(done: Iterable[HandedOver], console: Console) -> None:
    """A table of the files, what they hold and what is lost."""
    table = plain_table("file", "what", "deviation", words=("file", "what", "deviation"))
    for format_ in done:
        table.add_row("\n".join(map(str, format_.paths)), format_.what, str(format_.deviation))
    console.print(table)
