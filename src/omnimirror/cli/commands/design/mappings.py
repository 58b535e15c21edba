"""``omnimirror mappings``: every mapping that a mirror can be generated for, beside each other."""

from __future__ import annotations

from pathlib import Path

import click
from rich.table import Table
from rich.text import Text

from ....design.construct.rim import MountedMirror
from ....design.construct.survey import mappings
from ....errors import OmnimirrorError
from ....tracing.meridian import Meridian
from ...options.common import NUMBER
from ...outputs import FIGURES, format_option, output_console, output_option, say_written

MOST_DRAWN = 6


@click.command()
@click.option("--omega-max-deg", type=NUMBER, default=75.0, show_default=True, help="Field angle at the rim.")
@click.option("--theta-max-deg", type=NUMBER, default=12.0, show_default=True,
              help="Viewing angle of the lens there; 0 for an orthographic one.")  # fmt: skip
@output_option("--figure", formats=FIGURES, help="Draw their sections and image heights: svg, png, pdf.")
@format_option(FIGURES)
def command(omega_max_deg: float, theta_max_deg: float, figure: Path | None) -> None:
    """List the mappings of omnimirror design, with the mirror that each needs for a field and a lens.

    Lengths are in rim radii M. Example: omnimirror mappings --omega-max-deg 135 --figure mappings.png
    """
    console = output_console()
    table = Table(box=None, pad_edge=False, header_style="bold", collapse_padding=True)
    table.add_column("mapping", no_wrap=True)
    for heading in ("m/M", "sag/M", "vertex radius/M"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column()
    mounted: dict[str, MountedMirror] = {}
    for name, found in mappings(omega_max_deg, theta_max_deg).items():
        if isinstance(found, OmnimirrorError):
            table.add_row(name, "", "", "", Text(str(found), style="dim"))
            continue
        mounted[name] = found
        mirror = found.mirror
        numbers = (found.distance_mm, mirror.sag(1.0), 1 / mirror.curvature(0.0))
        table.add_row(name, *(f"{v:.8g}" for v in numbers), "" if name == mirror.KIND else f"the {mirror.KIND}")
    console.print(table)
    if figure:
        _draw({name: Meridian(p.mirror, p.distance_mm) for name, p in list(mounted.items())[:MOST_DRAWN]}, figure)
        say_written(figure, console=console)


def _draw(mirrors: dict[str, Meridian], path: Path) -> None:
    from ....figures import save_figure
    from ....figures.meridians import meridian_curves

    save_figure(meridian_curves(mirrors), path)
