"""``omnimirror judge``: any sensor beside requirements, and the margins."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import click

from .....base.arguments import float_of
from .....base.files import write_json
from .....design.criteria.requirement_file import load_requirements
from .....design.solve.temperatures import TemperatureRange, temperature_range
from .....design.solve.verdict import judge
from .....optics.sensor_files import load_sensor
from ...help_pages import DocumentedCommand
from ...options.common import SENSOR
from ...options.declared import takes
from ...options.housing import HousingOptions
from ...outputs import json_option, output_console, say_written
from .tables import MISSED, print_verdict


def temperatures(text: str) -> tuple[float, float]:
    """Two temperatures, degrees Celsius.

    >>> temperatures("-40:85")
    (-40.0, 85.0)
    """
    try:
        low, high = (float_of(word) for word in text.split(":"))
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
@click.option("--temperatures", type=temperatures, metavar="A:B", help="Say over which of these, in C, it is met.")
@takes(HousingOptions, "housing")
def command(
    requirements: Path,
    sensor: str,
    json_file: Path | None,
    temperatures: tuple[float, float] | None,
    housing: HousingOptions,
) -> None:
    """Judge SENSOR by REQUIREMENTS, a TOML file as omnimirror design reads it.

    Prints what was asked, what is reached and the margins. What the sensor does is judged, as it is focused, and not
    how its mirror came about. The exit code is 3 where a requirement is missed.
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
    """A range of temperatures, and what ends it."""
    if math.isnan(found.low_c):
        return f"at no temperature: {', '.join(found.above)} is missed at the reference already"
    sides = ((found.below, "below"), (found.above, "above"))
    ends = [f"{', '.join(what)} is missed {where}" for what, where in sides if what]
    return f"met from {found.low_c:g} to {found.high_c:g} C" + (f"; {'; '.join(ends)}" if ends else "")
