"""``omnimirror convert``: conversion of camera models between file formats."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.table import Table

from ....base.files import write_json
from ....calibration.conversion import Conversion, convert
from ....calibration.formats import FORMATS
from ....cameras.camera import CameraLooks, Mount
from ....cameras.models.camera_model import Optics
from .._declarations import (
    NUMBER,
    DocumentedCommand,
    Options,
    add_options,
    angle,
    distance,
    full_image_size,
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


def distance_list(text: str) -> tuple[float, ...]:
    """Parse comma-separated distances in mm, ``inf`` allowed.

    >>> distance_list("500,inf")
    (500.0, inf)
    """
    return tuple(distance(part.strip()) for part in text.split(","))


@dataclass(frozen=True)
class SourceDataOptions(Options):
    """Source, with the parameters of :func:`omnimirror.convert`."""

    camera: str | None = option(
        metavar="N|NAME", help="Camera of a rig: index from 0, or name.  [default: 0]"
    )
    optics: Optics | None = setting("camera")
    rim_radius_px: float | None = setting("camera")
    image_size: tuple[int, int] | None = setting("camera", type=full_image_size)


@dataclass(frozen=True)
class MountOptions(Options):
    """Mounting, which other file formats do not contain."""

    camera_looks: CameraLooks | None = setting("camera")
    forward_azimuth_deg: float | None = setting("camera", type=angle)
    image_flipped: bool | None = setting("camera")


@dataclass(frozen=True)
class ApproximationOptions(Options):
    """Approximation error."""

    tolerance_px: float | None = option(
        type=NUMBER,
        metavar="PX",
        help="Fit another model with at most this error if the format does not support the source model.",
    )
    distance_mm: tuple[float, ...] | None = setting("fit", type=distance_list)
    field_deg: float | None = setting("fit")
    inner_deg: float | None = setting("fit")


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=(
        "omnimirror convert calib_results.txt -o camera.yaml --to opencv-omnidir --tolerance-px 0.5",
    ),
)
@click.argument("source", type=click.Path(path_type=Path))
@output_option(
    "-o",
    "--output",
    required=True,
    help="Output file, whose name selects the format unless --to does.",
)
@click.option(
    "--from",
    "from_",
    type=click.Choice(list(FORMATS)),
    help="Format of SOURCE.  [default: detected]",
)
@click.option(
    "--to",
    metavar="FORMAT",
    help="Format of the output, or one of its models, such as kalibr-ds.",
)
@click.option("--flip", is_flag=True, help="Write the camera of the image mirrored left to right.")
@add_options(SourceDataOptions, "source_data")
@add_options(MountOptions, "mount")
@add_options(ApproximationOptions, "approximation")
@json_option("Write the approximation error, in pixels and for each distance.")
def command(
    source: Path,
    output: Path,
    from_: str | None,
    to: str | None,
    flip: bool,
    source_data: SourceDataOptions,
    mount: MountOptions,
    approximation: ApproximationOptions,
    json_file: Path | None,
) -> None:
    """Convert the camera model in SOURCE to another file format and report the error."""
    options: dict[str, Any] = {**source_data.given, **approximation.given}
    if mount.given:
        options["mount"] = Mount(**mount.given)
    conversion = convert(source, output, to=to, from_=from_, flip=flip, **options)
    console = output_console()
    print_line(
        f"{conversion.source} to {conversion.target}: {error_text(conversion)}", console=console
    )
    if len(conversion.costs) > 1:
        console.print(_table(conversion))
    for note in conversion.notes:
        print_line(("Note: ", "yellow"), note, console=console)
    if json_file:
        errors = {
            "exact": conversion.exact,
            "rms_px": conversion.rms_px,
            "largest_px": conversion.largest_px,
        }
        costs = [one._asdict() for one in conversion.costs]
        write_json(
            json_file,
            {"from": conversion.source, "to": conversion.target}
            | errors
            | {"costs": costs, "notes": conversion.notes},
        )
    print_written(output, json_file, console=console)


def error_text(conversion: Conversion) -> str:
    """Format the approximation error of a conversion in one line."""
    if conversion.exact:
        return "exact"
    approximation = "panorama" if conversion.target.endswith("equirectangular") else "fitted model"
    worst = max(conversion.costs, key=lambda c: c.largest_px)
    (u, v), distance = (
        worst.at_px,
        "" if len(conversion.costs) == 1 else f", object distance {_distance(worst.distance_mm)}",
    )
    return (
        f"{approximation}, error {conversion.rms_px:.3g} px rms, at most {conversion.largest_px:.3g} px at "
        f"({u:.0f}, {v:.0f}), {worst.at_deg:.3g} deg from the axis{distance}"
    )


def _distance(distance_mm: float) -> str:
    return "infinity" if np.isinf(distance_mm) else f"{distance_mm:g} mm"


def _table(conversion: Conversion) -> Table:
    table = plain_table("distance\nmm", "error, rms\npx", "maximum\npx", "at field angle\ndeg")
    for c in conversion.costs:
        table.add_row(
            f"{c.distance_mm:g}", f"{c.rms_px:.3g}", f"{c.largest_px:.3g}", f"{c.at_deg:.3g}"
        )
    return table
