"""``omnimirror init``: commented sensor file as a template."""

from __future__ import annotations

from pathlib import Path

import click

from ....base.errors import OmnimirrorError
from ....base.escaping import shell_word
from ....base.files import is_stream, write_text
from ....design.sensor_file_template import sensor_template
from .._declarations import DocumentedCommand
from .._output import Output, print_line


@click.command(cls=DocumentedCommand, page="sensor-file", examples=("omnimirror init mine.toml",))
@click.argument("path", type=Output(), default="sensor.toml")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def command(path: Path, force: bool) -> None:
    """Write a commented sensor file to PATH (sensor.toml by default) and print the next steps."""
    if path.exists() and not (force or is_stream(path)):
        raise OmnimirrorError(
            f"{path} already exists; specify another name, or use --force to overwrite it"
        )
    write_text(path, sensor_template("sensor" if is_stream(path) else path.stem))
    if not is_stream(path):
        print_line(f"Wrote {path}; edit it, then run: omnimirror evaluate {shell_word(str(path))}")
