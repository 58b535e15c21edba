"""``omnimirror schema``: JSON Schemas of TOML files for editors."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ....base.files import write_text
from ....interop.file_schemas import KINDS, schema
from .._declarations import DocumentedCommand
from .._output import output_option


@click.command(
    cls=DocumentedCommand,
    page="sensor-file",
    examples=("omnimirror schema sensor -o sensor.schema.json",),
)
@click.argument("kind", type=click.Choice(list(KINDS)))
@output_option("-o", "--output", help="Output file.  [default: standard output]")
def command(kind: str, output: Path | None) -> None:
    """Write the JSON Schema of a kind of TOML file, for editors and validators."""
    text = json.dumps(schema(kind), indent=2, allow_nan=False)
    write_text(Path("-") if output is None else output, f"{text}\n")
