"""What commands that write for other programs share."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

import click
from rich.console import Console

from ....handoff.formats import HandedOver
from ...outputs import plain_table


def format_names(known: Collection[str]) -> Callable[[str], list[str]]:
    """A click type: names of formats, with commas between them.

    >>> format_names(["exr", "npz"])("npz, exr")
    ['npz', 'exr']
    """

    def names(text: str) -> list[str]:
        found = [name.strip() for name in text.split(",")]
        if unknown := [name for name in found if name not in known]:
            raise click.BadParameter(f"{unknown[0]!r} is not a format; valid are {', '.join(known)}")
        return found

    return names


def say_handed_over(done: Iterable[HandedOver], console: Console) -> None:
    """A table of the files, what they hold and what is lost."""
    table = plain_table("file", "what", "deviation", words=("file", "what", "deviation"))
    for format_ in done:
        table.add_row("\n".join(map(str, format_.paths)), format_.what, str(format_.deviation))
    console.print(table)
