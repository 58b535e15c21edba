"""``omnimirror evaluate``: complete evaluation of one sensor as in the paper."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from ....analysis.camera_evaluation import CameraMapping, evaluate_camera
from ....analysis.evaluation import READ_COLUMNS, Evaluation, evaluate
from ....analysis.focus import FOCUS_MERITS, best_focus, best_viewpoint
from ....analysis.operating_conditions import at_temperature, thermal_motion_px
from ....base.escaping import shell_command
from ....base.quantities import QUANTITIES
from ....base.toml_validation import SourceLocator, merge_tables
from ....base.typing import Array
from ....calibration.sensor_model import SensorModel
from ....optics.camera_files import load_camera
from ....optics.housing import NO_HOUSING
from ....optics.lenses import BlurMode, SurfaceLens
from ....optics.mirrors import Cone, SampledProfile
from ....optics.sensor import Sensor
from ....optics.sensor_files import SENSOR_ENTRIES, lens_of
from ....optics.tracing.obscuration import obscuration_summary
from .._declarations import (
    NUMBER,
    SENSOR,
    DocumentedCommand,
    Options,
    add_options,
    distance,
    file_entries,
    flag,
    focus,
    option,
    pixel,
    setting,
    values,
)
from .._output import (
    json_option,
    output_console,
    output_option,
    print_line,
    print_rows,
    print_written,
)

MAX_NAMED = 5  # outliers listed by name
TERMINAL_COLUMNS = [name for name in READ_COLUMNS if name not in ("x_mm", "floored_area_deg2")]
"""Columns printed on the terminal; files contain all columns."""


@dataclass(frozen=True)
class EvaluationOptions(Options):
    """Evaluation points, with the parameters of :func:`omnimirror.evaluate`."""

    omega_deg: Array | None = option(
        type=values,
        metavar="A:B:STEP",
        help="Field angles, measured from the direction back past the lens.",
    )
    x_mm: Array | None = option(
        type=values,
        metavar="A:B:STEP",
        help="Mirror points by their distance from the axis, instead of field angles.",
    )
    h_px: Array | None = option(
        type=values,
        metavar="A:B:STEP",
        help="Image heights in pixels from the centre, instead of field angles.",
    )
    pixels: tuple[tuple[float, float], ...] = option(
        "--pixel",
        type=pixel,
        metavar="U,V",
        multiple=True,
        help="Pixel, instead of field angles (repeatable).",
    )
    object_distance_mm: float = option(
        type=distance,
        metavar="MM",
        default=np.inf,
        help="Object distance from the reflection point.",
    )
    focus_mm: Any = option(
        type=focus,
        metavar="MM|auto",
        help="Object distance in focus, or 'auto'.  [default: the focus of the sensor]",
    )
    temperature_c: float | None = option(
        type=NUMBER,
        metavar="C",
        help="Temperature of the sensor; requires a table [thermal] in its file.",
    )
    merit: str = setting("focus", "worst_floored_area_deg2", type=click.Choice(list(FOCUS_MERITS)))
    mode: BlurMode = setting("blur", "exact")
    image_radius_px: float | None = setting("blur")
    tolerance_px: float = setting("blur", 1.0)
    wavelength_nm: float = setting("light", 550.0)

    def evaluation(self, sensor: Sensor) -> Evaluation:
        """Return the evaluation for the options."""
        arguments = self.given | {"pixels": self.pixels or None}
        arguments.pop("temperature_c", None)
        return evaluate(sensor, **arguments)


@click.command(
    cls=DocumentedCommand,
    page="evaluation",
    examples=(
        "omnimirror evaluate paper-spherical --omega-deg 0:135:5",
        "omnimirror evaluate mine.toml --focus-mm auto --csv mine.csv -o figures",
    ),
)
@click.argument("sensor", type=SENSOR)
@add_options(EvaluationOptions, "conditions")
@click.option(
    "--lens",
    type=click.Path(path_type=Path),
    metavar="ZMX",
    help="Lens prescription that replaces the lens of the sensor, with the same first principal "
    "point and focus distance.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the figures of the paper.",
)
@output_option(
    "--csv",
    "csv_file",
    help="Write all columns with 17 significant digits; for a measured mirror also their standard deviations.",
)
@json_option("Write summary and all columns.")
@file_entries("sensor file", SENSOR_ENTRIES)
def command(
    sensor: str,
    conditions: EvaluationOptions,
    lens: Path | None,
    output: Path | None,
    csv_file: Path | None,
    json_file: Path | None,
    changes: dict[str, Any],
) -> None:
    """Evaluate SENSOR, a sensor file or the name of a bundled sensor.

    Prints a table; output files contain more columns.

    For a calibrated camera (camera file or OCamCalib file) the table contains radius, resolution,
    viewpoint and, if the uncertainty is known, the error of directions; likewise for a sensor with
    a decentred or tilted mirror, averaged over azimuths. omnimirror uncertainty evaluates the
    uncertainty of a calibrated camera over the whole image.
    """
    lens_entries = {} if lens is None else changes.pop("lens", {})
    camera, console = load_camera(sensor, changes), output_console()
    if not isinstance(camera, Sensor) or not camera.is_axial:
        _refuse_optical_options(camera, conditions, {"lens": lens, "output": output})
        if isinstance(camera, Sensor):
            camera.check(
                "evaluation of a misaligned sensor",
                "single mirror",
                "thin lens",
                "ideal except poses",
            )
        model = SensorModel(camera) if isinstance(camera, Sensor) else camera
        camera_mapping = evaluate_camera(model, conditions.omega_deg)
        _show_mapping(console, sensor, camera_mapping, csv_file, json_file)
        return
    if lens is not None:
        entries = {"file": str(lens), "focus_distance_mm": camera.lens.focus_distance_mm}
        table = merge_tables({"kind": SurfaceLens.KIND} | entries, lens_entries)
        camera = replace(camera, lens=lens_of(table, SourceLocator("", "the lens"), Path()))
    if conditions.temperature_c is not None:
        _print_motion(console, camera, conditions.temperature_c)
        camera = at_temperature(camera, conditions.temperature_c)
    result = conditions.evaluation(camera)
    if csv_file:
        result.to_csv(csv_file, deviations=True)
    if json_file:
        result.to_json(json_file)
    print_summary(console, result, conditions.merit)
    print_table(console, result)
    print_written(csv_file, json_file, console=console)
    if output:
        _draw(console, result, output)


def _print_motion(console: Console, sensor: Sensor, temperature_c: float) -> None:
    """Print the image motion due to the change of temperature."""
    motion = thermal_motion_px(sensor, temperature_c)
    assert sensor.thermal is not None, "checked by thermal_motion_px"
    console.print(
        f"image motion between {sensor.thermal.reference_c:g} C and {temperature_c:g} C: up to {motion:.3g} px"
    )


def _refuse_optical_options(
    camera: Any, conditions: EvaluationOptions, paths: dict[str, Path | None]
) -> None:
    """Raise UsageError for quantities that a calibrated camera or a misaligned mirror does not
    have.
    """
    names = [*conditions.changed, *(name for name, path in paths.items() if path)]
    if given := [flag(name) for name in names if name != "omega_deg"]:
        reason = "requires a mirror and a lens, which a camera file does not contain"
        if isinstance(camera, Sensor):
            reason = "requires an aligned mirror and cover; here one is decentred or tilted"
        raise click.UsageError(f"{given[0]} {reason}; only --omega-deg, --csv and --json apply")


def _show_mapping(
    console: Console,
    source: str,
    result: CameraMapping,
    csv_file: Path | None,
    json_file: Path | None,
) -> None:
    if csv_file:
        result.to_csv(csv_file)
    if json_file:
        result.to_json(json_file)
    s = result.summary()
    heading = (
        f": {s['kind'].replace('-', ' ')} model of a {s['optics']}, field to "
        f"{s['field_deg']:.6g} deg at a radius of {s['rim_radius_px']:.1f} px"
    )
    print_line((Path(source).name, "bold"), heading, console=console)
    if isinstance(result.camera, SensorModel):
        print_line(
            f"{_misalignment_text(result.camera.sensor)}: values for distant objects, "
            "averaged over azimuths; resolution varies by up to "
            f"{result.azimuthal_variation_percent:.2g} % with azimuth",
            console=console,
        )
    if result.camera.uncertainty is not None:
        command = shell_command(["omnimirror", "uncertainty", source])
        print_line(
            f"error: standard deviation of directions; for the whole image: {command}",
            console=console,
        )
    console.print()
    cells = result.texts()
    heads = [(QUANTITIES[column].heading, QUANTITIES[column].unit) for column in cells]
    print_rows(console, heads, cells.values())
    print_written(csv_file, json_file, console=console)


def print_table(console: Console, result: Evaluation) -> None:
    """Print the columns that fit; on narrow terminals fewer columns, never wrapped numbers."""
    columns = [*TERMINAL_COLUMNS, *result.of_lens]
    cells, width = result.texts(columns), 0
    names: list[str] = []
    for name in columns:
        q = QUANTITIES[name]
        width += max(len(q.heading), len(q.unit), *map(len, cells[name])) + 2
        if console.is_terminal and width > console.width:
            break
        names.append(name)
    heads = [(QUANTITIES[name].heading, QUANTITIES[name].unit) for name in names]
    print_rows(console, heads, [cells[name] for name in names])
    hidden = len(columns) - len(names)
    if hidden:
        print_line(
            (f"{hidden} columns omitted; use a wider terminal, or --csv for all", "dim"),
            console=console,
        )


def print_summary(console: Console, result: Evaluation, merit: str) -> None:
    """Print field, focus and blur of the sensor in a few lines."""
    sensor, s = result.sensor, result.summary()
    near, far = result.depth_of_field_mm
    best = best_focus(
        sensor,
        merit,
        object_distance_mm=float(np.max(result.object_distance_mm)),
        mode=result.mode,
        image_radius_px=result.image_radius_px,
        wavelength_nm=result.wavelength_nm,
    )
    second = (
        ""
        if sensor.secondary is None
        else f" with secondary mirror ({sensor.secondary.mirror.KIND})"
    )
    lines = [
        f": {sensor.mirror.KIND}{second}, {sensor.lens.KIND} lens, field "
        f"{s['field_deg'][0]:.4g} to {s['field_deg'][1]:.6g} deg, rim at "
        f"{s['rim_radius_px']:.1f} px",
        f"focus L0 = {result.focus_mm:.2f} mm; depth of field {near:.2f} to {far:.2f} mm "
        f"(blur within {result.tolerance_px:g} px); Airy disc {result.airy_px:.2f} px at "
        f"{result.wavelength_nm:g} nm",
        f"best focus by {merit}: {best.focus_mm:.2f} mm, value {best.value:.4g} {QUANTITIES[merit].unit}",
    ]
    if sensor.housing != NO_HOUSING:
        lines.append(
            f"obscured at every azimuth: {obscuration_summary(sensor.obscurations, sensor.obscured_percent)}"
        )
    if isinstance(sensor.mirror, Cone) and sensor.secondary is None:
        radius, z = sensor.mirror.pinhole_ring(sensor.meridian.m)
        lines.append(
            f"no single viewpoint (cone): virtual pinholes on a ring of radius {radius:.2f} mm at z = {z:.2f} mm"
        )
    if np.isfinite(result.object_distance_mm).all():
        v = best_viewpoint(
            sensor, float(np.min(result.object_distance_mm)), image_radius_px=result.image_radius_px
        )
        lines.append(
            f"best single viewpoint: {v.z_mm:.3f} mm above the vertex, error up to "
            f"{v.worst_px:.2f} px ({v.worst_deg:.3f} deg)"
        )
    if isinstance(sensor.mirror, SampledProfile):
        lines += profile_lines(result, sensor.mirror)
    print_line((sensor.name, "bold"), "\n".join(lines), console=console)
    console.print()


def profile_lines(result: Evaluation, mirror: SampledProfile) -> list[str]:
    """Format the noise, the outliers and the resulting errors of a measured mirror profile."""
    fit, lines = mirror.fit, []
    if outliers := mirror.outliers:
        named = ", ".join(f"{i + 1} (x = {mirror.x_mm[i]:g} mm)" for i in outliers[:MAX_NAMED])
        more = f" and {len(outliers) - MAX_NAMED} more" if len(outliers) > MAX_NAMED else ""
        lines.append(f"rejected outliers of the profile: {named}{more}")
    deviations = result.standard_deviations()
    if deviations:
        source = (
            "estimated from the points"
            if mirror.uncertainty_um is None
            else "as specified, or by their scatter"
        )
        lines.append(
            f"profile smoothed to {fit.uncertainty_mm * 1e3:.3g} um, {source}; standard deviations at most:"
        )
        finite = (
            (QUANTITIES[k], v[np.isfinite(v)]) for k, v in deviations.items() if k in READ_COLUMNS
        )
        maxima = [
            f"{q.heading} {v.max():.2g} {q.unit}".strip()
            for q, v in finite
            if v.size and v.max() > 0
        ]
        lines.append("  " + ", ".join(maxima))
    return lines


def _draw(console: Console, result: Evaluation, folder: Path) -> None:
    from ....analysis.figures import Conditions, save_all

    with console.status("Drawing figures"):
        paths = save_all([result.sensor], folder, conditions=Conditions.of(result))
    print_line(f"Wrote {len(paths)} figures to ", (str(folder), "bold"), console=console)


def _misalignment_text(sensor: Sensor) -> str:
    """Format the decentre and tilt of a sensor."""
    parts = {"mirror": sensor.mirror_pose, "cover": sensor.housing.shell}
    misalignments = [
        f"the {name} is decentred by "
        f"{np.hypot(part.decentre_x_mm, part.decentre_y_mm):.3g} mm and tilted by "
        f"{np.hypot(part.tilt_x_deg, part.tilt_y_deg):.3g} deg"
        for name, part in parts.items()
        if part is not None and not part.is_axial
    ]
    return ", ".join(misalignments)
