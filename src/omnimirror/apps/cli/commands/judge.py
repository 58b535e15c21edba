"""``omnimirror judge``: check of a sensor against requirements, with margins."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import click

from ....base.arguments import parse_float
from ....base.files import write_json
from ....design.requirement_check import TemperatureRange, judge, temperature_range
from ....design.requirement_files import load_requirements
from ....optics.sensor_files import load_sensor
from .._declarations import DocumentedCommand, takes
from .._option_types import SENSOR
from .._output import json_option, output_console, say_written
from .._sensor_options import HousingOptions
from ._design_report import MISSED, print_verdict


def temperatures(text: str) -> tuple[float, float]:
    """Parse two temperatures, degrees Celsius.

    >>> temperatures("-40:85")
    (-40.0, 85.0)
    """
    try:
        low, high = (parse_float(word) for word in text.split(":"))
    except ValueError:
        raise click.BadParameter(f"{text!r} is not two temperatures, such as -40:85") from None
    return low, high


@click.command(
    cls=DocumentedCommand,
    page="design",
    examples=("omnimirror judge panorama.toml paper-equidistant",),
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
@takes(HousingOptions, "housing")
def command(
    requirements: Path,
    sensor: str,
    json_file: Path | None,
    temperatures: tuple[float, float] | None,
    housing: HousingOptions,
) -> None:
    """Check SENSOR against REQUIREMENTS, a TOML file as for omnimirror design, and report the
    margins.

    Prints the requirements, the values reached and the margins. The sensor is evaluated at its own
    focus; the type of mirror is not checked. The exit code is 3 if a requirement is missed.
    """
    asked = load_requirements(requirements)
    asked, seen = replace(asked, housing=housing.of(asked.housing)), housing.on(load_sensor(sensor))
    verdict = judge(asked, seen)
    numbers = verdict.to_dict()
    console = output_console()
    print_verdict(console, verdict)
    if temperatures is not None:
        coldest, warmest = temperatures
        found = temperature_range(asked, seen, coldest_c=coldest, warmest_c=warmest)
        numbers["temperatures"] = found.to_dict()
        console.print(_range_words(found))
    if json_file:
        write_json(json_file, numbers)
    say_written(json_file, console=console)
    sys.exit(0 if verdict.is_met else MISSED)


def _range_words(found: TemperatureRange) -> str:
    """Format a range of temperatures and its limiting requirements."""
    if math.isnan(found.low_c):
        return f"at no temperature: {', '.join(found.above)} is missed at the reference already"
    sides = ((found.below, "below"), (found.above, "above"))
    ends = [f"{', '.join(what)} is missed {where}" for what, where in sides if what]
    return f"met from {found.low_c:g} to {found.high_c:g} C" + (
        f"; {'; '.join(ends)}" if ends else ""
    )
