"""``omnimirror init``: commented sensor file as a template."""

from __future__ import annotations

from pathlib import Path

import click

from ....base.errors import OmnimirrorError
from ....base.escaping import shell_word
from ....base.files import is_stream, write_text
from ....design.sensor_file_template import sensor_template
from .._declarations import DocumentedCommand
from .._output import output_option, print_line

DEFAULT = "sensor.toml"


@click.command(
    cls=DocumentedCommand, page="sensor-file", examples=("omnimirror init -o mine.toml",)
)
@output_option("-o", "--output", help=f"Output sensor file.  [default: {DEFAULT}]")
def command(output: Path | None) -> None:
    """Write a commented sensor file and print the next steps."""
    path = Path(DEFAULT) if output is None else output
    if output is None and path.exists():
        raise OmnimirrorError(
            f"{path} already exists; rename it, or specify the file with --output"
        )
    write_text(path, sensor_template("sensor" if is_stream(path) else path.stem))
    if not is_stream(path):
        print_line(f"Wrote {path}; edit it, then run: omnimirror evaluate {shell_word(str(path))}")
