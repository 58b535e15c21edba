"""``omnimirror export``: CAD files, lens files, tables and drawings of a sensor."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import click

from ....base.arguments import parse_float
from ....base.files import write_json
from ....manufacturing import (
    DEFAULT_FORMATS,
    FORMATS,
    Body,
    ExportedFile,
    Tool,
    Workshop,
    load_workshop,
)
from ....manufacturing.body import TAP_DRILLS_MM
from ....manufacturing.drawings.sheet import SHEETS
from ....manufacturing.exporter import DRAWING_SUFFIXES, export
from ....manufacturing.tolerancing.drawing_conflicts import tolerance_conflicts
from ....manufacturing.tolerancing.tolerance_file import load_allocated_tolerances
from ....optics.sensor import Sensor
from ....optics.sensor_files import load_sensor
from .._declarations import (
    SENSOR,
    DocumentedCommand,
    Options,
    add_options,
    file_entries,
    option,
    setting,
)
from .._output import (
    json_option,
    output_console,
    output_option,
    plain_table,
    print_line,
    print_written,
)


def formats(text: str) -> list[str]:
    """Parse comma-separated format names.

    >>> formats("step, pdf")
    ['step', 'pdf']
    """
    names = [name.strip() for name in text.split(",")]
    if unknown := [name for name in names if name not in FORMATS]:
        raise click.BadParameter(f"formats must be from {', '.join(FORMATS)}; got {unknown[0]!r}")
    return names


def scale(text: str) -> float:
    """Parse a drawing scale, paper to actual size.

    >>> scale("1:2"), scale("5:1")
    (0.5, 5.0)
    """
    try:
        paper, nature = (parse_float(part) for part in text.split(":"))
        number = paper / nature
    except (ValueError, ZeroDivisionError):
        number = 0.0
    if not number > 0:
        raise click.BadParameter(f"scale must have a format such as 1:2 or 5:1; got {text!r}")
    return number


@dataclass(frozen=True)
class BodyOptions(Options):
    """Bodies of the mirrors; defaults follow from the rims in the housing of the sensor."""

    thread: str | None = option(
        type=click.Choice(list(TAP_DRILLS_MM)),
        metavar="M2...M12",
        help="Tapped hole for this thread on the axis, from the back.",
    )
    bore_depth_mm: float | None = setting("body")
    flange_width_mm: float | None = setting("body")
    thickness_mm: float | None = setting("body")
    bore_diameter_mm: float | None = setting("body")
    flange_thickness_mm: float | None = setting("body")
    counterbore_diameter_mm: float | None = setting("body")
    counterbore_depth_mm: float | None = setting("body")
    secondary_thickness_mm: float | None = setting("body")

    def body(self, sensor: Sensor) -> Body | None:
        """Return the body of the mirror; None without options."""
        changes = {
            name: value for name, value in self.given.items() if name != "secondary_thickness_mm"
        }
        return replace(Body.of(sensor.housing.rim, sensor.mirror), **changes) if changes else None

    def secondary_body(self) -> Body | None:
        """Return the body of the secondary mirror; None without options."""
        return None if self.secondary_thickness_mm is None else Body(self.secondary_thickness_mm)


@dataclass(frozen=True)
class FileOptions(Options):
    """Resolution of files, as for :func:`omnimirror.export`."""

    chord_tolerance_um: float = setting("file", 10.0)
    step_mm: float | None = setting("file")
    step_deg: float | None = setting("file")
    digits: int = setting("file", 6)
    grid_points: int = setting("file", 257)
    sheet: str = setting("file", "A3", type=click.Choice(list(SHEETS)))
    scale: float | None = setting("file", type=scale)

    def arguments(self) -> dict[str, Any]:
        """Return the keyword arguments of :func:`omnimirror.export`."""
        return self.given


@dataclass(frozen=True)
class ToolOptions(Options):
    """Lathe tool and cutting parameters."""

    radius_mm: float = setting("tool", 0.5)
    feed_um: float = setting("tool", 2.0)
    tolerance_nm: float = setting("tool", 5.0)
    spindle_rpm: float = setting("tool", 1000.0)
    clearance_mm: float = setting("tool", 1.0)
    x_is_diameter: bool = setting("tool", False)

    def tool(self) -> Tool | None:
        """Return the tool; None if all options have their default."""
        return None if self == ToolOptions() else Tool(**self.given)


@click.command(
    cls=DocumentedCommand,
    page="manufacture",
    examples=(
        "omnimirror export paper-spherical -o export --thread M6 --set body.bore_depth_mm=12",
        "omnimirror export mine.toml -o mirror.step",
    ),
)
@click.argument("sensor", type=SENSOR)
@output_option(
    "-o",
    "--output",
    required=True,
    formats=("csv",),
    help="Folder, or file whose suffix selects the format; - prints the sag table.",
)
@click.option(
    "--formats",
    type=formats,
    metavar="NAME,...",
    help=f"Formats for a folder: {', '.join(FORMATS)}.  [default: {','.join(DEFAULT_FORMATS)}]",
)
@click.option(
    "--workshop",
    metavar="FILE",
    help="Drawing: TOML file with title block, material, coating, texture, tolerances.",
)
@click.option(
    "--tolerances", metavar="FILE", help="Drawing: TOML or JSON file of 'omnimirror tolerance'."
)
@add_options(BodyOptions, "body")
@add_options(FileOptions, "files")
@add_options(ToolOptions, "lathe")
@file_entries("sensor file", ("housing",))
@click.option(
    "--allow-changes",
    is_flag=True,
    help="Write the files even if the sensor is changed.",
)
@click.option(
    "--requirements",
    metavar="FILE",
    help="Requirement file whose affected entries are listed for a changed sensor.",
)
@json_option("Write the table of files and deviations.")
def command(
    sensor: str,
    output: Path,
    formats: list[str] | None,
    workshop: str | None,
    tolerances: str | None,
    body: BodyOptions,
    files: FileOptions,
    lathe: ToolOptions,
    changes: dict[str, Any],
    allow_changes: bool,
    requirements: str | None,
    json_file: Path | None,
) -> None:
    """Export CAD files, lens files, tables and a drawing of SENSOR.

    Prints a table with the deviation of the surface in each file from the mirror.
    """
    camera = load_sensor(sensor)
    can_draw = formats is None or any(f".{name}" in DRAWING_SUFFIXES for name in formats)
    data = _workshop(camera, workshop, tolerances) if can_draw or workshop or tolerances else None
    console = output_console()
    with console.status("Writing"):
        written = export(
            camera,
            output,
            formats=formats,
            body=body.body(camera),
            secondary_body=body.secondary_body(),
            housing=load_sensor(sensor, changes).housing,
            tool=lathe.tool(),
            workshop=data,
            allow_changes=allow_changes,
            requirements=requirements,
            **files.arguments(),
        )
    numbers = ("deviation\num", "ray deviation\ndeg")
    table = plain_table("file", "content", *numbers, text_columns=("file", "content"))
    for file in written:
        table.add_row(str(file.path), file.description, deviation_text(file), ray_text(file))
    console.print(table)
    if json_file:
        write_json(json_file, [asdict(file) | {"path": str(file.path)} for file in written])
        print_written(json_file, console=console)
    if data is not None and any(file.path.suffix.lower() in DRAWING_SUFFIXES for file in written):
        parts = ("mirror",) if camera.secondary is None else ("mirror", "secondary")
        if missing := data.missing(parts):
            console.print(f"Missing entries of the drawing: {', '.join(missing)} (--workshop FILE)")
        for conflict in tolerance_conflicts(camera, data, body.body(camera), body.secondary_body()):
            print_line(("inconsistent tolerances", "yellow"), f": {conflict}", console=console)
    for file in written:
        if not file.follows:
            print_line(
                (f"{file.path.name} is not accurate", "yellow"),
                f": its rays deviate by up to {ray_text(file)} deg from those of the "
                "mirror; no asphere is more accurate; use the grid sag (--formats gridsag)",
                console=console,
            )


def _workshop(sensor: Sensor, workshop: str | None, tolerances: str | None) -> Workshop:
    """Return the data of the drawing, with today as the default date."""
    data = Workshop() if workshop is None else load_workshop(workshop)
    sizes = {} if tolerances is None else load_allocated_tolerances(tolerances, sensor)
    return replace(data.dated(), tolerances=sizes)


def deviation_text(file: ExportedFile) -> str:
    """Format the deviation of a file."""
    if file.deviation_um is None:
        return ""
    return f"{file.deviation_um:.2g}" if file.deviation_um else "exact"


def ray_text(file: ExportedFile) -> str:
    """Format the ray deviation of a lens file."""
    if file.ray_deg is None:
        return ""
    return f"{file.ray_deg:.2g}" if file.ray_deg else "exact"
