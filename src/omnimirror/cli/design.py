"""``omnimirror design``: from requirements to a sensor file, and the margins."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from ..design.assessment import ROUNDING
from ..design.conflicts import Conflict, Relaxation
from ..design.designing import Design, design_sensor
from ..design.families import FAMILIES
from ..design.mappings import MAPPINGS
from ..design.requirements import Requirements, load_requirements, requirements_of
from ..files import write_text
from ..specs import Places, save_sensor
from .design_search import number_or_range
from .options import distance, output_console

MISSED = 3
"""Exit code where a sensor was designed that misses a requirement."""

SECTIONS: dict[str, tuple[str, ...]] = {
    "field": ("omega_max_deg", "omega_min_deg", "camera_radius_mm", "object_distance_mm"),
    "mirror": (
        "mapping", "family", "fit", "apex", "rim_radius_mm", "conic", "plane_distance_mm", "cylinder_radius_mm",
        "mapping_csv",
    ),
    "lens": ("kind", "focal_length_mm", "theta_max_deg", "f_number", "focus_mm"),
    "imager": ("width_px", "height_px", "pixel_pitch_um"),
}  # fmt: skip
"""The options that stand for entries of the requirement file, by their table."""


@click.command()
@click.argument("requirements", required=False, type=click.Path(path_type=Path))
@click.option("--mapping", type=click.Choice([*MAPPINGS]), help="How the image is to be laid out.")
@click.option("--mirror", "family", metavar="FAMILY", help=f"Instead: {', '.join(FAMILIES)} or polynomial:N.")
@click.option("--fit", metavar="FORM:N", help="Make it a polynomial:N or an asphere:N that keeps the mapping best.")
@click.option("--omega-max-deg", type=float, help="Field angle at the rim.")
@click.option("--omega-min-deg", type=float, help="Where the field begins that matters.")
@click.option("--apex", type=click.Choice(["smooth", "pointed"]), help="pointed: the image centre shows omega-min-deg.")
@click.option("--camera-radius-mm", type=float, help="Of what stands at the lens and hides the view.")
@click.option(
    "--object-distance-mm", type=distance, metavar="MM", help="From the mirror to the object; inf by default."
)
@click.option("--rim-radius-mm", type=number_or_range, metavar="MM|LOW:HIGH", help="Of the mirror.")
@click.option("--conic", type=number_or_range, metavar="K|LOW:HIGH", help="Conic constant, where the family leaves it.")
@click.option("--plane-distance-mm", type=float, help="Of a ground-plane mapping: mirror vertex to the plane.")
@click.option("--cylinder-radius-mm", type=float, help="Of a cylinder mapping.")
@click.option("--mapping-csv", type=click.Path(), help="Of a tabulated mapping: columns omega_deg, height.")
@click.option("--lens", "kind", type=click.Choice(["perspective", "orthographic"]), help="perspective by default.")
@click.option("--focal-length-mm", type=number_or_range, metavar="MM|LOW:HIGH", help="Of the lens.")
@click.option("--theta-max-deg", type=number_or_range, metavar="DEG|LOW:HIGH", help="Viewing angle at the rim.")
@click.option("--f-number", type=number_or_range, metavar="F|LOW:HIGH", help="Of the lens; 4 by default.")
@click.option("--focus-mm", type=float, help="Object distance in focus; the best by default.")
@click.option("--width-px", type=int, help="Of the imager; 1024 by default.")
@click.option("--height-px", type=int, help="Of the imager; 1024 by default.")
@click.option("--pixel-pitch-um", type=float, help="Of the imager; 5.2 by default.")
@click.option("--name", help="Of the sensor.")
@click.option("-o", "--out", type=click.Path(path_type=Path), help="Write the sensor file.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write the table, and what conflicts.")
@click.option("--figures", type=click.Path(path_type=Path), help="Draw the paper's figures into this folder.")
def command(
    requirements: Path | None,
    name: str | None,
    out: Path | None,
    json_file: Path | None,
    figures: Path | None,
    **entries: Any,
) -> None:
    """Design a sensor that meets REQUIREMENTS, a TOML file; or what the options say, which go before the file.

    Prints what was asked, what is reached and the margins, and where not all can be met what would have to give.
    The exit code is then 3. Example: omnimirror design --mapping equidistant --omega-max-deg 135 --theta-max-deg 12
    --rim-radius-mm 43.9 -o sensor.toml
    """
    console = output_console()
    wanted = _wanted(requirements, name, entries)
    with console.status("Designing") as status:
        design = design_sensor(wanted, lambda words: status.update(f"Designing: {words}"))
    if out:
        save_sensor(design.sensor, out)
    if json_file:
        write_text(json_file, json.dumps(design.to_dict(), indent=1, ensure_ascii=False) + "\n")
    print_design(console, design)
    if figures:
        _draw(console, design, figures)
    for path in (out, json_file, figures):
        if path:
            console.print(f"Wrote [bold]{path}[/]", highlight=False, soft_wrap=True)
    if not design.is_met:
        sys.exit(MISSED)


def _wanted(file: Path | None, name: str | None, entries: dict[str, Any]) -> Requirements:
    """The requirements of a file with the options in place of its entries, or of the options alone."""
    given = {k: list(v) if isinstance(v, tuple) else v for k, v in entries.items() if v is not None}
    changes: dict[str, Any] = {
        section: found
        for section, names in SECTIONS.items()
        if (found := {k: v for k, v in given.items() if k in names})
    }
    title = {"name": name} if name else {}
    if file is not None:
        return load_requirements(file, changes | title)
    if not changes:
        raise click.UsageError("give a requirement file, or a field and a mirror by options")
    if "imager" in changes:
        changes["imager"] = {"width_px": 1024, "height_px": 1024, "pixel_pitch_um": 5.2} | changes["imager"]
    return requirements_of(title | changes, Places("", "the options"))


def print_design(console: Console, design: Design) -> None:
    """The table, the notes, and what conflicts."""
    sensor = design.sensor
    console.print(
        f"[bold]{sensor.name}[/]: {sensor.mirror.KIND}, lens {_number(sensor.mirror_distance_mm)} mm from its vertex",
        highlight=False, soft_wrap=True,
    )  # fmt: skip
    for note in design.notes:
        console.print(f"  {note}", highlight=False, soft_wrap=True)
    console.print()
    table = Table(box=None, pad_edge=False, header_style="bold", collapse_padding=True)
    for heading in ("requirement", "asked", "reached", "margin", "at Ω", ""):
        table.add_column(heading, justify="left" if heading in ("requirement", "") else "right", no_wrap=True)
    for row in design.rows:
        at = "" if row.omega_deg is None else f"{row.omega_deg:.4g} deg"
        met = "met" if row.is_met else "[bold red]missed[/]"
        margin = 0.0 if abs(row.margin) <= ROUNDING * row.scale else row.margin
        asked = _asked(row.at_least, row.at_most, row.unit)
        table.add_row(row.label, asked, _number(row.reached), _number(margin), at, met)
    console.print(table)
    if design.conflict is not None:
        _print_conflict(console, design.conflict)


def _asked(low: float | None, high: float | None, unit: str) -> str:
    if low is not None and high is not None:
        text = _number(low) if low == high else f"{_number(low)} to {_number(high)}"
    else:
        text = f"at least {_number(low)}" if low is not None else f"at most {_number(high)}"
    return f"{text} {unit}".rstrip()


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.5g}"


def _print_conflict(console: Console, conflict: Conflict) -> None:
    console.print(f"\nNot everything can be met: {'; '.join(conflict.missed)}.", highlight=False, soft_wrap=True)
    helpful = [r for r in conflict.alone if r.needed is not None and r.needed != r.asked]
    if helpful:
        console.print("All is met if one of these alone gives:", highlight=False)
        for r in helpful:
            console.print(f"  {_change(r)}", highlight=False, soft_wrap=True)
    else:
        console.print("No single requirement that gives, within half of what is asked, would do.", highlight=False)
    if conflict.joint_share is not None:
        console.print(f"Or if all give at once by {conflict.joint_share:.2%}:", highlight=False)
        for r in conflict.joint:
            console.print(f"  {_change(r)}", highlight=False, soft_wrap=True)


def _change(r: Relaxation) -> str:
    unit = f" {r.unit}" if r.unit else ""
    share = f" ({r.share:.2%})" if r.share is not None else ""
    return f"{r.name}: {_number(r.needed)}{unit} instead of {_number(r.asked)}{unit}{share}"


def _draw(console: Console, design: Design, folder: Path) -> None:
    from ..figures import save_all

    with console.status("Drawing figures"):
        save_all([design.sensor], folder)
