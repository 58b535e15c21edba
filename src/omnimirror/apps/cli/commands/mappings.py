"""``omnimirror mappings``: comparison of all mappings for which a mirror can be generated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click
from rich.text import Text

from ....base.errors import OmnimirrorError
from ....base.files import write_json
from ....design.mirror_construction import MountedMirror, mappings
from ....optics.tracing.meridian import Meridian
from .._declarations import NUMBER, DocumentedCommand, Options, add_options, option
from .._output import (
    FIGURES,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_written,
)

MAX_DRAWN = 6


@dataclass(frozen=True)
class RimOptions(Options):
    """Rim ray."""

    omega_max_deg: float = option(type=NUMBER, default=75.0, help="Field angle at the rim.")
    theta_max_deg: float = option(
        type=NUMBER,
        default=12.0,
        help="Viewing angle of the lens at the rim; 0 for an orthographic lens.",
    )


@click.command(
    cls=DocumentedCommand,
    page="design",
    examples=("omnimirror mappings --omega-max-deg 135 -o mappings.png",),
)
@add_options(RimOptions, "rim")
@output_option(
    "-o",
    "--output",
    formats=FIGURES,
    help="Figure of the mirror sections and image heights: svg, png, pdf.",
)
@json_option()
def command(rim: RimOptions, output: Path | None, json_file: Path | None) -> None:
    """List the mappings of omnimirror design with the mirror of each for a given field and lens.

    Lengths are in units of the rim radius M.
    """
    console = output_console()
    table = plain_table(
        "mapping", "m/M", "sag/M", "vertex radius/M", "", text_columns=("mapping", ""), tight=True
    )
    mounted: dict[str, MountedMirror] = {}
    records: list[dict[str, float | str]] = []
    for name, result in mappings(**rim.given).items():
        if isinstance(result, OmnimirrorError):
            table.add_row(name, "", "", "", Text(str(result), style="dim"))
            records.append({"mapping": name, "error": str(result)})
            continue
        mounted[name] = result
        mirror = result.mirror
        numbers = (result.distance_mm, mirror.sag(1.0), 1 / mirror.curvature(0.0))
        shape = {
            "distance": numbers[0],
            "sag": float(numbers[1]),
            "vertex_radius": float(numbers[2]),
        }
        records.append({"mapping": name, "mirror": mirror.KIND} | shape)
        table.add_row(
            name,
            *(f"{v:.8g}" for v in numbers),
            "" if name == mirror.KIND else mirror.KIND,
        )
    console.print(table)
    if json_file:
        write_json(json_file, records)
        print_written(json_file, console=console)
    if output:
        _draw(
            {
                name: Meridian(p.mirror, p.distance_mm)
                for name, p in list(mounted.items())[:MAX_DRAWN]
            },
            output,
        )
        print_written(output, console=console)


def _draw(mirrors: dict[str, Meridian], path: Path) -> None:
    from ....analysis.figures import save_figure
    from ....analysis.figures.curves import meridian_curves

    save_figure(meridian_curves(mirrors), path)
