"""``omnimirror judge``: any sensor beside requirements, and the margins."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import click

from ....design.criteria.requirement_file import load_requirements
from ....design.solve.verdict import judge
from ....files import write_text
from ....specs import load_sensor
from ...options.declared import takes
from ...options.housing import HousingOptions
from ...outputs import output_console, output_option, say_written
from .tables import MISSED, print_verdict


@click.command()
@click.argument("requirements", type=click.Path(path_type=Path))
@click.argument("sensor")
@output_option("--json", "json_file", help="Write the table.")
@takes(HousingOptions, "housing")
def command(requirements: Path, sensor: str, json_file: Path | None, housing: HousingOptions) -> None:
    """Judge SENSOR by REQUIREMENTS, a TOML file as omnimirror design reads it.

    Prints what was asked, what is reached and the margins. What the sensor does is judged, as it is focused, and not
    how its mirror came about. The exit code is 3 where a requirement is missed.

    Example: omnimirror judge panorama.toml paper-equidistant
    """
    asked = load_requirements(requirements)
    verdict = judge(replace(asked, housing=housing.of(asked.housing)), housing.on(load_sensor(sensor)))
    if json_file:
        write_text(json_file, json.dumps(verdict.to_dict(), indent=1, ensure_ascii=False) + "\n")
    console = output_console()
    print_verdict(console, verdict)
    say_written(json_file, console=console)
    sys.exit(0 if verdict.is_met else MISSED)
