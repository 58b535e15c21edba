"""``omnimirror export``: what a workshop and other programs need of a sensor."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from datetime import date
from pathlib import Path

import click

from ....arguments import float_of
from ....files import write_json
from ....manufacturing import DEFAULT_FORMATS, FORMATS, Body, Exported, Tool, Workshop, load_workshop
from ....manufacturing.body import TAP_DRILLS_MM
from ....manufacturing.drawings.sheet import SHEETS
from ....manufacturing.exporter import export
from ....manufacturing.tolerancing.drawing_conflicts import tolerance_conflicts
from ....manufacturing.tolerancing.tolerance_file import allocated_tolerances
from ....sensor import Sensor
from ....specs import load_sensor
from ...help_pages import DocumentedCommand
from ...options.common import NUMBER, SENSOR, WHOLE
from ...options.declared import Options, option, takes
from ...options.housing import HousingOptions
from ...outputs import json_option, output_console, output_option, plain_table, say, say_written

DRAWN = (".pdf", ".svg", ".png", ".dxf")


def formats(text: str) -> list[str]:
    """Names of formats, with commas between them.

    >>> formats("step, pdf")
    ['step', 'pdf']
    """
    names = [name.strip() for name in text.split(",")]
    if unknown := [name for name in names if name not in FORMATS]:
        raise click.BadParameter(f"{unknown[0]!r} is not a format; valid are {', '.join(FORMATS)}")
    return names


def scale(text: str) -> float:
    """A drawing scale, paper to nature.

    >>> scale("1:2"), scale("5:1")
    (0.5, 5.0)
    """
    try:
        paper, nature = (float_of(part) for part in text.split(":"))
        number = paper / nature
    except (ValueError, ZeroDivisionError):
        number = 0.0
    if not number > 0:
        raise click.BadParameter(f"{text!r} is not a scale, such as 1:2 or 5:1")
    return number


@dataclass(frozen=True)
class BodyOptions(Options):
    """The solids behind the mirrors; what is not said is as the rim of the sensor's housing shows it."""

    thickness_mm: float | None = option(type=NUMBER, help="Solid: from the rim to the back.  [default: 5]")
    bore_diameter_mm: float | None = option(type=NUMBER, help="Solid: bore on the axis, from the back.")
    thread: str | None = option(type=click.Choice(list(TAP_DRILLS_MM)), help="Instead: a bore to tap this thread in.")
    bore_depth_mm: float | None = option(type=NUMBER, help="Of the bore; 'inf' goes through.  [default: 10]")
    flange_width_mm: float | None = option(type=NUMBER, help="Solid: a flange at the back, beyond the rim.")
    flange_thickness_mm: float | None = option(type=NUMBER, help="Of the flange.  [default: 2]")
    counterbore_diameter_mm: float | None = option(
        type=NUMBER, help="Solid: a wider bore from the back, for a camera that looks through it."
    )
    counterbore_depth_mm: float | None = option(type=NUMBER, help="Of the wider bore.  [default: 5]")
    secondary_thickness_mm: float | None = option(
        type=NUMBER, help="Solid of a second mirror: the same of it.  [default: 5]"
    )

    def body(self, sensor: Sensor) -> Body | None:
        """The solid behind the mirror; None if nothing is said of it."""
        said = {name: value for name, value in self.given.items() if name != "secondary_thickness_mm"}
        return replace(Body.of(sensor.housing.rim, sensor.mirror), **said) if said else None

    def secondary_body(self) -> Body | None:
        """The solid behind the second mirror; None if nothing is said of it."""
        return None if self.secondary_thickness_mm is None else Body(self.secondary_thickness_mm)


@dataclass(frozen=True)
class FileOptions(Options):
    """How fine files are, as :func:`omnimirror.export` takes it."""

    chord_tolerance_um: float = option(type=NUMBER, default=10.0, help="STL, 3MF: of the triangles.")
    step_mm: float | None = option(type=NUMBER, help="Table: step along x.  [default: a hundredth of the rim radius]")
    step_deg: float | None = option(type=NUMBER, help="Table: instead, step of the field angle.")
    digits: int = option(type=WHOLE, default=6, help="Table, path of a tool: decimals of a millimetre.")
    grid_points: int = option(type=WHOLE, default=257, help="Grid sag: points along each side.")
    sheet: str = option(type=click.Choice(list(SHEETS)), default="A3", help="Drawing: paper.")
    scale: float | None = option(
        type=scale, metavar="1:N", help="Drawing: of the sensor.  [default: the largest that fits]"
    )


@dataclass(frozen=True)
class ToolOptions(Options):
    """The tool of a lathe and how it is led."""

    tool_radius_mm: float = option(type=NUMBER, default=0.5, help="Path of a tool: its nose radius.")
    feed_um: float = option(type=NUMBER, default=2.0, help="Path: feed along the surface in a turn.")
    path_tolerance_nm: float = option(type=NUMBER, default=5.0, help="Path: how far it may leave the mirror.")
    spindle_rpm: float = option(type=NUMBER, default=1000.0, help="Path: turns a minute.")
    clearance_mm: float = option(type=NUMBER, default=1.0, help="Path: between tool and work before and after.")
    x_is_diameter: bool = option(is_flag=True, default=False, help="Path: the machine counts X as a diameter.")

    def tool(self) -> Tool:
        """The tool that is said."""
        return Tool(
            self.tool_radius_mm, self.feed_um, self.path_tolerance_nm, self.spindle_rpm, self.clearance_mm,
            self.x_is_diameter,
        )  # fmt: skip


@click.command(
    cls=DocumentedCommand,
    page="manufacture",
    examples=(
        "omnimirror export paper-spherical -o workshop --thread M6 --bore-depth-mm 12",
        "omnimirror export mine.toml -o mirror.step",
    ),
)
@click.argument("sensor", type=SENSOR)
@output_option("-o", "--output", required=True, formats=("csv",),
               help="A folder, or one file whose suffix says what to write; - prints the sag table.")  # fmt: skip
@click.option("--formats", type=formats, metavar="NAME,..",
              help=f"For a folder: of {', '.join(FORMATS)}.  [default: {','.join(DEFAULT_FORMATS)}]")  # fmt: skip
@click.option("--workshop", metavar="FILE",
              help="Drawing: title block, material, coating, texture, tolerances; a TOML file.")  # fmt: skip
@click.option("--tolerances", metavar="FILE",
              help="Drawing: those of 'omnimirror tolerance', from its TOML or JSON file.")  # fmt: skip
@takes(BodyOptions, "solid")
@takes(FileOptions, "files")
@takes(ToolOptions, "lathe")
@takes(HousingOptions, "housing")
@click.option("--allow-changes", is_flag=True,
              help="Write the files even if an option changes the evaluated sensor.")  # fmt: skip
@json_option("Write the table: each file, what it holds and how far it lies from the mirror.")
def command(
    sensor: str,
    output: Path,
    formats: list[str] | None,
    workshop: str | None,
    tolerances: str | None,
    solid: BodyOptions,
    files: FileOptions,
    lathe: ToolOptions,
    housing: HousingOptions,
    allow_changes: bool,
    json_file: Path | None,
) -> None:
    """Write CAD files, lens files, tables and a drawing of SENSOR, a sensor file or a bundled sensor.

    Every line of the table says how far the file's surface lies from the mirror.
    """
    camera = load_sensor(sensor)
    told = _workshop(camera, workshop, tolerances)
    console = output_console()
    with console.status("Writing"):
        written = export(
            camera, output, formats=formats, body=solid.body(camera), secondary_body=solid.secondary_body(),
            housing=housing.of(camera.housing), tool=lathe.tool(), workshop=told,
            allow_changes=allow_changes, **files.given,
        )  # fmt: skip
    numbers = ("deviation from the mirror\num", "of its rays\ndeg")
    table = plain_table("file", "what", *numbers, words=("file", "what"))
    for file in written:
        table.add_row(str(file.path), file.what, deviation_words(file), ray_words(file))
    console.print(table)
    if json_file:
        write_json(json_file, [asdict(file) | {"path": str(file.path)} for file in written])
        say_written(json_file, console=console)
    parts = ("mirror",) if camera.secondary is None else ("mirror", "secondary")
    if any(file.path.suffix.lower() in DRAWN for file in written) and (missing := told.missing(parts)):
        console.print(f"A shop will ask for what the drawing does not say: {', '.join(missing)} (--workshop FILE)")
    if any(file.path.suffix.lower() in DRAWN for file in written):
        for conflict in tolerance_conflicts(camera, told, solid.body(camera), solid.secondary_body()):
            say(("tolerances contradict each other", "yellow"), f": {conflict}", console=console)
    for file in written:
        if not file.follows:
            say(
                (f"{file.path.name} does not follow the mirror", "yellow"),
                f": its rays are up to {ray_words(file)} deg off; no asphere does better, the grid sag "
                "(--formats gridsag) does",
                console=console,
            )


def _workshop(sensor: Sensor, workshop: str | None, tolerances: str | None) -> Workshop:
    """What the drawing is told; its date is today's unless it is said."""
    told = Workshop() if workshop is None else load_workshop(workshop)
    title = told.title if told.title.date else replace(told.title, date=date.today().isoformat())
    return replace(told, title=title, tolerances={} if tolerances is None else allocated_tolerances(tolerances, sensor))


def deviation_words(file: Exported) -> str:
    """The deviation of a file as it is printed."""
    if file.deviation_um is None:
        return ""
    return f"{file.deviation_um:.2g}" if file.deviation_um else "exact"


def ray_words(file: Exported) -> str:
    """By how much a lens file's rays leave those of the mirror, as it is printed."""
    if file.ray_deg is None:
        return ""
    return f"{file.ray_deg:.2g}" if file.ray_deg else "exact"
