"""``omnimirror check``: check of a sensor against requirements, with margins."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import click

from ....base.arguments import format_value, parse_float
from ....base.files import write_json
from ....design.requirement_check import TemperatureRange, check_requirements, temperature_range
from ....design.requirement_files import REQUIREMENT_ENTRIES, load_requirements
from ....optics.sensor_files import load_sensor
from .._declarations import SENSOR, DocumentedCommand, file_entries
from .._output import json_option, output_console, print_written
from ._design_report import EXIT_MISSED, print_verdict


def temperatures(text: str) -> tuple[float, float]:
    """Parse two temperatures, degrees Celsius.

    >>> temperatures("-40:85")
    (-40.0, 85.0)
    """
    try:
        low, high = (parse_float(word) for word in text.split(":"))
    except ValueError:
        raise click.BadParameter(
            f"must be two temperatures, such as -40:85; got {format_value(text)}"
        ) from None
    return low, high


@click.command(
    cls=DocumentedCommand,
    page="design",
    examples=("omnimirror check panorama.toml paper-equidistant",),
)
@click.argument("requirements", type=click.Path(path_type=Path))
@click.argument("sensor", type=SENSOR)
@json_option()
@click.option(
    "--temperatures",
    type=temperatures,
    metavar="A:B",
    help="Temperature range, C: report the part in which the requirements are met.",
)
@file_entries("requirement file", REQUIREMENT_ENTRIES)
def command(
    requirements: Path,
    sensor: str,
    json_file: Path | None,
    temperatures: tuple[float, float] | None,
    changes: dict[str, Any],
) -> None:
    """Check SENSOR against REQUIREMENTS, a TOML file as for omnimirror design, and report the
    margins.

    Prints the requirements, the values reached and the margins. The sensor is evaluated at its own
    focus, with the housing of --set if given; the type of mirror is not checked. The exit code is 3
    if a requirement is missed.
    """
    loaded = load_requirements(requirements, changes)
    camera = load_sensor(sensor, {k: v for k, v in changes.items() if k == "housing"})
    verdict = check_requirements(loaded, camera)
    numbers = verdict.to_dict()
    console = output_console()
    print_verdict(console, verdict)
    if temperatures is not None:
        coldest, warmest = temperatures
        limits = temperature_range(loaded, camera, coldest_c=coldest, warmest_c=warmest)
        numbers["temperatures"] = limits.to_dict()
        console.print(_format_range(limits))
    if json_file:
        write_json(json_file, numbers)
    print_written(json_file, console=console)
    sys.exit(0 if verdict.is_met else EXIT_MISSED)


def _format_range(limits: TemperatureRange) -> str:
    """Format a range of temperatures and its limiting requirements."""
    if math.isnan(limits.low_c):
        return (
            f"met at no temperature: {', '.join(limits.above)} missed at the reference temperature"
        )
    sides = ((limits.below, "below"), (limits.above, "above"))
    ends = [f"{', '.join(labels)} missed {where}" for labels, where in sides if labels]
    return f"met from {limits.low_c:g} to {limits.high_c:g} C" + (
        f"; {'; '.join(ends)}" if ends else ""
    )
