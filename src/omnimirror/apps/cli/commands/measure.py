"""``omnimirror measure``: angles and distances between image points."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import click

from ....base.files import write_json
from ....calibration.measurement import measure
from ....optics.camera_files import load_camera
from .._declarations import NUMBER, DocumentedCommand, Options, add_options, option
from .._output import json_option, output_console, print_line, print_written


@dataclass(frozen=True)
class MeasurementOptions(Options):
    """Plane of the two points, and uncertainties."""

    height_mm: float | None = option(
        type=NUMBER,
        metavar="MM",
        show_default=False,
        help="Height of the mirror above the floor, negative below a ceiling: report the distance there.",
    )
    wall_mm: float | None = option(
        type=NUMBER,
        metavar="MM",
        show_default=False,
        help="Distance of the mirror from a vertical wall: report the distance there.",
    )
    wall_pan_deg: float = option(
        type=NUMBER,
        metavar="DEG",
        default=0.0,
        help="Pan of the nearest point of the wall, to the right.",
    )
    plane_sigma_mm: float = option(
        type=NUMBER,
        metavar="MM",
        default=0.0,
        help="Standard uncertainty of the height or wall distance.",
    )
    plane_sigma_deg: float = option(
        type=NUMBER,
        metavar="DEG",
        default=0.0,
        help="Standard uncertainty of the orientation of the plane, per axis.",
    )
    pixel_sigma_px: float = option(
        type=NUMBER,
        metavar="PX",
        default=0.0,
        help="Standard uncertainty of the pixels, per coordinate.",
    )


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=("omnimirror measure mine.toml 640 500 700 480 --height-mm 1200",),
)
@click.argument("camera")
@click.argument("pixels", nargs=4, type=NUMBER, metavar="U1 V1 U2 V2")
@add_options(MeasurementOptions, "measurement")
@json_option("Write angle, distance, points and uncertainties.")
def command(
    camera: str,
    pixels: tuple[float, float, float, float],
    measurement: MeasurementOptions,
    json_file: Path | None,
) -> None:
    """Measure the angle between two pixels of the image of CAMERA, and their distance on a floor or
    wall.

    Uncertainties are one standard deviation, from the table [uncertainty] that a calibration writes
    to the camera file. They are omitted for a camera without this table, and outside its calibrated
    field.
    """
    result = measure(load_camera(camera), [pixels[:2], pixels[2:]], **measurement.given)
    console = output_console()
    text = f": angle {_quantity_text(result.angle_deg, result.angle_sigma_deg, 'deg')}"
    if result.distance_mm is not None:
        distance = _quantity_text(result.distance_mm, result.distance_sigma_mm, "mm")
        text += f", distance {distance}"
    print_line((Path(camera).stem, "bold"), text, console=console)
    if result.angle_sigma_deg is None:
        print_line(
            ("Note: ", "yellow"),
            "the uncertainty is unknown without calibration uncertainty in the camera file, and "
            "outside the calibrated field",
            console=console,
        )
    if json_file:
        write_json(json_file, asdict(result))
    print_written(json_file, console=console)


def _quantity_text(value: float, sigma: float | None, unit: str) -> str:
    error = "" if sigma is None else f" +- {sigma:.2g}"
    return f"{value:.6g}{error} {unit}"
