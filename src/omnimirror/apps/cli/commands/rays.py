"""``omnimirror rays``: ray tables for renderers, and the option and output shared with ``omnimirror maps``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click
from rich.console import Console

from ....interop.export_formats import ExportedFiles, ExportFormat
from ....interop.ray_tables import RAY_FORMATS, write_rays
from ....optics.camera_files import load_camera
from .._declarations import INTEGER, SENSOR, DocumentedCommand
from .._output import output_console, output_option, plain_table, write_standard_output_as

# -- Shared with ``omnimirror maps`` ---------------------------------------------------------------

F = TypeVar("F", bound=Callable[..., Any])


def formats_option(registry: Mapping[str, ExportFormat[Any]]) -> Callable[[F], F]:
    """Return the option ``--format``; the first format also determines the format of ``-``."""

    def names(_: click.Context, __: click.Parameter, text: str | None) -> list[str] | None:
        if text is None:
            return None
        requested = [name.strip() for name in text.split(",")]
        if unknown := [name for name in requested if name not in registry]:
            raise click.BadParameter(f"must be one of {', '.join(registry)}; got {unknown[0]!r}")
        write_standard_output_as(registry[requested[0]].suffix.removeprefix("."))
        return requested

    return click.option(
        "--format",
        "--formats",
        "formats",
        is_eager=True,
        callback=names,
        metavar="NAME,...",
        help=f"Formats: {', '.join(registry)}.  [default: by the suffix of the file]",
    )


def check_one_file(
    output: Path, formats: Sequence[str] | None, registry: Mapping[str, ExportFormat[Any]]
) -> None:
    """Raise UsageError if several files would be written to standard output."""
    if (
        output.stem == "-"
        and formats
        and (len(formats) > 1 or len(registry[formats[0]].endings) > 1)
    ):
        names = ", ".join(formats)
        raise click.UsageError(
            f"standard output requires a single file; {names} consists of several; specify a folder"
        )


def print_exported_files(exported: Iterable[ExportedFiles], console: Console) -> None:
    """Print a table of files, contents and deviations."""
    columns = ("file", "contents", "deviation")
    table = plain_table(*columns, text_columns=columns)
    for files in exported:
        table.add_row("\n".join(map(str, files.paths)), files.description, str(files.deviation))
    console.print(table)


# -- Command ---------------------------------------------------------------------------------------


@click.command(
    cls=DocumentedCommand,
    page="interoperability",
    examples=("omnimirror rays paper-spherical -o rays.exr",),
)
@click.argument("camera", type=SENSOR, metavar="SENSOR|CAMERA")
@output_option(
    "-o",
    "--output",
    required=True,
    formats=("exr", "npz"),
    help="Output file, whose suffix selects the format, or folder.",
)
@formats_option(RAY_FORMATS)
@click.option(
    "--step", type=INTEGER, default=1, show_default=True, help="Spacing of the sampled pixels, px."
)
def command(camera: str, output: Path, formats: list[str] | None, step: int) -> None:
    """Write origin, direction and weight of the ray of each pixel for other programs.

    SENSOR|CAMERA is a sensor file, a camera file or a bundled sensor. Lengths are in mm unless the
    format requires another unit; x is forward, y left and z up, with the origin at the mirror
    vertex.
    """
    check_one_file(output, formats, RAY_FORMATS)
    console = output_console()
    with console.status("Tracing"):
        exported = write_rays(load_camera(camera), output, formats=formats, step=step)
    print_exported_files(exported, console)
