"""``omnimirror form``: form error of a manufactured mirror from measured points."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import click
import numpy as np
from rich.console import Console

from ....base.errors import InvalidParameter
from ....base.files import write_json
from ....manufacturing.metrology.forbes import ForbesAsphere, forbes_asphere
from ....manufacturing.metrology.form_errors import FormError, form_error
from ....manufacturing.metrology.readers import MM, Unit, read_points
from ....manufacturing.tolerancing.compensation import CALIBRATIONS, after
from ....manufacturing.tolerancing.mirror_form import FormEffect, as_built, form_effect
from ....optics.mirrors import Mirror
from ....optics.sensor import Sensor
from ....optics.sensor_files import load_sensor, save_sensor
from .._declarations import SENSOR, DocumentedCommand, Options, add_options, option, setting
from .._output import (
    FIGURES,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_written,
)

MAX_TERMS = 12


@dataclass(frozen=True)
class PointOptions(Options):
    """Reading and fitting of the points."""

    unit: str = option(
        type=click.Choice(list(MM)),
        default="mm",
        help="Unit of point lists; other formats contain their unit.",
    )
    are_departures: bool = setting("points", False)
    probe_radius_mm: float = setting("points", 0.0)
    order: int | None = setting("fit")
    asymmetric: bool = setting("as_built", False)

    def of(self, mirror: Mirror, path: Path) -> FormError:
        """Compute the form error."""
        points = read_points(path, cast(Unit, self.unit))
        return form_error(
            mirror,
            points,
            order=self.order,
            are_departures=self.are_departures,
            probe_radius_mm=self.probe_radius_mm,
        )


@click.command(
    cls=DocumentedCommand,
    page="measured",
    examples=("omnimirror form paper-spherical cmm.csv -o as-built.toml --figure form.png",),
)
@click.argument("sensor", type=SENSOR)
@click.argument("points", type=click.Path(path_type=Path))
@add_options(PointOptions, "fit")
@output_option(
    "-o", "--output", formats=("toml",), help="Write the sensor with the as-built mirror."
)
@output_option(
    "--figure",
    formats=FIGURES,
    help="Figure of form, residuals, meridian and terms (PNG, SVG, PDF).",
)
@json_option("Write all results as JSON.")
def command(
    sensor: str,
    points: Path,
    fit: PointOptions,
    output: Path | None,
    figure: Path | None,
    json_file: Path | None,
) -> None:
    """Analyse the form error of the mirror of SENSOR from measured POINTS.

    Separates alignment, form and noise, and evaluates the effect on the image before and after
    calibration. POINTS: list of x, y, z, OpticStudio grid sag, .x3p, Zygo .dat and .datx, ...
    """
    if fit.asymmetric and output is None:
        raise click.UsageError("as_built.asymmetric requires --output")
    nominal = load_sensor(sensor)
    console = output_console()
    with console.status("Fitting"):
        form = fit.of(nominal.mirror, points)
        effect, reason = _effect(nominal, form)
    _print_form(console, form)
    asphere, asphere_reason = _asphere(form)
    _print_asphere(console, asphere, asphere_reason)
    if effect is not None:
        _print_effect(console, effect)
    else:
        console.print(f"\nthe effect on the image cannot be computed: {reason}")
    written = []
    if output is not None:
        save_sensor(as_built(nominal, form, asymmetric=fit.asymmetric), output)
        written.append(output)
    if figure is not None:
        from ....analysis.figures.style import save_figure, styled
        from ....manufacturing.metrology.form_map import plot_form_error

        with styled():
            save_figure(plot_form_error(form), figure)
        written.append(figure)
    if json_file is not None:
        write_json(json_file, _numbers(form, effect, asphere))
        written.append(json_file)
    print_written(*written, console=console)


def _effect(sensor: Sensor, form: FormError) -> tuple[FormEffect | None, str]:
    """Return the effect on the image, or the reason why it is not available."""
    try:
        return form_effect(sensor, form), ""
    except InvalidParameter as e:
        return None, str(e)


def _asphere(form: FormError) -> tuple[ForbesAsphere | None, str]:
    """Return the Forbes asphere of the as-built mirror, or the reason why it is not available."""
    try:
        return forbes_asphere(form.corrected()), ""
    except InvalidParameter as e:
        return None, str(e)


def _print_asphere(console: Console, asphere: ForbesAsphere | None, asphere_reason: str) -> None:
    if asphere is None:
        console.print(f"\nno Forbes asphere: {asphere_reason}", soft_wrap=True)
        return
    terms, names = ", ".join(f"{um:.4f}" for um in asphere.um), "a0"
    names += f" ... a{len(asphere.um) - 1}" if len(asphere.um) > 1 else ""
    console.print(
        f"\nForbes asphere (Qbfs): R = {asphere.radius_mm:.6f} mm, {names} = "
        f"{terms} um, residual {asphere.rms_residual_um:.2g} um rms",
        soft_wrap=True,
    )


def _print_form(console: Console, form: FormError) -> None:
    alignment, (low, high) = form.place, form.radial_range_mm
    outliers = f", {form.outliers} outliers rejected" if form.outliers else ""
    console.print(
        f"{len(form.x_mm)} points{outliers}, {low:.3g} to {high:.4g} mm from the axis; rim radius "
        f"{form.mirror.rim_radius_mm:.4g} mm"
    )
    (x, y, z), (about_x, about_y) = (
        np.round(alignment.vertex_mm, 4) + 0.0,
        np.round(alignment.tilt_deg, 4) + 0.0,
    )
    over = "; axes rotated by 180 deg about x" if alignment.is_inverted else ""
    console.print(
        f"alignment: vertex at {x:.4f}, {y:.4f}, {z:.4f} mm, tilt {about_x:.4f}, {about_y:.4f} deg{over}"
    )
    if alignment.is_profile:
        console.print("profile through the axis: only rotationally symmetric terms are determined")
    if alignment.radius_mm is not None and alignment.radius_sigma_mm is not None:
        nominal = float(form.mirror.radius_t(0.0))
        console.print(
            f"radius of the best-fit sphere: {alignment.radius_mm:.5f} +- {alignment.radius_sigma_mm:.2g} mm, "
            f"{100 * (alignment.radius_mm / nominal - 1):+.3g} % of the nominal {nominal:.6g} mm"
        )
    if alignment.is_centred_by_outline:
        console.print(
            "the points do not determine the rotation about the centre: aligned by their outline"
        )
    elif len(alignment.free):
        console.print(
            "the points do not determine the rotation about the centre: axis of the machine used"
        )
    console.print(
        f"\nform {form.peak_to_valley_um:.3g} um P-V, {form.rms_um:.3g} um rms, rotationally symmetric part "
        f"{form.rotational_rms_um:.3g} um rms\nnoise {form.noise_um:.2g} um, unexplained "
        f"{form.unexplained_um:.2g} um\n"
    )
    table = plain_table("term", "name", "um rms", "+-", text_columns=("name",))
    ranked = sorted((t for t in form.terms if t.noll > 1), key=lambda term: -abs(term.um))
    for term in ranked[:MAX_TERMS]:
        table.add_row(str(term.noll), term.name, f"{term.um:.4f}", f"{term.sigma_um:.4f}")
    console.print(table)
    if len(ranked) > MAX_TERMS:
        console.print(f"... and {len(ranked) - MAX_TERMS} smaller ones; use --json for all")


def _print_effect(console: Console, effect: FormEffect) -> None:
    if effect.lost_rays:
        console.print(f"\n{effect.lost_rays} objects in the field are not imaged")
        return
    table = plain_table("image", "px", text_columns=("image",))
    for depth in CALIBRATIONS:
        label = "motion" if depth == "none" else f"motion after calibration: {depth}"
        table.add_row(label, f"{effect.as_built[after('motion_px', depth)]:.4f}")
    table.add_row("blur, nominal", f"{effect.nominal['blur_px']:.3f}")
    table.add_row("blur, as-built", f"{effect.as_built['blur_px']:.3f}")
    console.print(table)
    if effect.untraced_um > 0.0:
        console.print(f"terms above order 12, {effect.untraced_um:.2g} um rms, are not included")


def _numbers(
    form: FormError, effect: FormEffect | None, asphere: ForbesAsphere | None
) -> dict[str, Any]:
    return {
        "points": len(form.x_mm),
        "outliers": form.outliers,
        "vertex_mm": np.asarray(form.place.vertex_mm).tolist(),
        "tilt_deg": np.asarray(form.place.tilt_deg).tolist(),
        "is_inverted": form.place.is_inverted,
        "radius_mm": form.place.radius_mm,
        "radius_sigma_mm": form.place.radius_sigma_mm,
        "is_profile": form.place.is_profile,
        "peak_to_valley_um": form.peak_to_valley_um,
        "rms_um": form.rms_um,
        "rotational_rms_um": form.rotational_rms_um,
        "noise_um": form.noise_um,
        "unexplained_um": form.unexplained_um,
        "terms": [
            {"noll": t.noll, "name": t.name, "um": t.um, "sigma_um": t.sigma_um} for t in form.terms
        ],
        "forbes_qbfs": None if asphere is None else asdict(asphere),
        "image": None if effect is None else effect.to_dict(),
    }
