"""``omnimirror uncertainty``: uncertainty of directions and of points on the floor."""

from __future__ import annotations

from pathlib import Path

import click

from ....base.files import write_json
from ....calibration.uncertainty import uncertainty_map
from ....optics.camera_files import load_camera
from .._declarations import NUMBER, DocumentedCommand
from .._output import (
    FIGURES,
    json_option,
    output_console,
    output_option,
    print_line,
    print_written,
)


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=("omnimirror uncertainty mine.toml --height-mm 1200 -o floor.png",),
)
@click.argument("camera")
@click.option(
    "--height-mm",
    type=NUMBER,
    help="Height of the mirror above the floor, negative below a ceiling: report errors of points there, in mm.  "
    "[default: errors of directions, in deg]",
)
@click.option(
    "--field-deg",
    type=NUMBER,
    metavar="DEG",
    help="Maximum field angle, measured from the image centre.  [default: the calibrated field]",
)
@output_option("-o", "--output", formats=FIGURES, help="Map over the image (PNG, SVG, PDF).")
@json_option("Write median, 95th percentile and largest error.")
def command(
    camera: str,
    height_mm: float | None,
    field_deg: float | None,
    output: Path | None,
    json_file: Path | None,
) -> None:
    """Estimate the uncertainty of directions measured with the calibrated CAMERA, or of points on
    the floor.

    The result is one standard deviation, from the table [uncertainty] that a calibration writes to
    the camera file. It is restricted to the calibrated field: beyond the outermost corner the model
    is an extrapolation.
    """
    loaded_camera = load_camera(camera)
    result = uncertainty_map(loaded_camera, height_mm=height_mm, field_deg=field_deg)
    console = output_console()
    quantity = "directions" if height_mm is None else f"points of {_surface_text(height_mm)}"
    if not (summary := result.summary()):
        print_line((Path(camera).stem, "bold"), f": no {quantity} in the image", console=console)
    else:
        median, high, largest = summary.values()
        text = f": standard deviation of {quantity}: median {median:.3g} {result.unit}, "
        print_line(
            (Path(camera).stem, "bold"),
            text + f"95 % below {high:.3g}, largest {largest:.3g}",
            console=console,
        )
    if field_deg is None and result.is_restricted:
        print_line(
            ("Note: ", "yellow"),
            f"restricted to the calibrated field of 0 to {result.field_deg:.4g} deg; use "
            "--field-deg to include angles beyond it, where the model is an extrapolation",
            console=console,
        )
    if json_file:
        write_json(
            json_file,
            summary | {"field_deg": result.field_deg, "is_restricted": result.is_restricted},
        )
    if output:
        from ....analysis.figures import save_figure
        from ....analysis.figures.image_plane import error_map

        save_figure(
            error_map(
                result.columns, result.rows, result.sigma, result.unit, f"Error of {quantity}"
            ),
            output,
        )
    print_written(json_file, output, console=console)


def _surface_text(height_mm: float) -> str:
    return (
        f"a floor {height_mm:g} mm below" if height_mm > 0 else f"a ceiling {-height_mm:g} mm above"
    )
