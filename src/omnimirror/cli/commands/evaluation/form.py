"""``omnimirror form``: what a mirror that was made is, from points that were measured on it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import click
import numpy as np
from rich.console import Console

from ....errors import InvalidParameter
from ....files import write_json
from ....manufacturing.metrology.forbes import ForbesAsphere, forbes_asphere
from ....manufacturing.metrology.form_error import FormError, form_error
from ....manufacturing.metrology.readers import MM, Unit, read_points
from ....manufacturing.tolerancing.compensation import CALIBRATIONS, after
from ....manufacturing.tolerancing.mirror_form import FormEffect, as_made, form_effect
from ....mirrors import Mirror
from ....sensor import Sensor
from ....specs import load_sensor, save_sensor
from ...help_pages import DocumentedCommand
from ...options.common import NUMBER, SENSOR, WHOLE
from ...options.declared import Options, option, takes
from ...outputs import FIGURES, json_option, output_console, output_option, plain_table, say_written

MOST_TERMS = 12


@dataclass(frozen=True)
class PointOptions(Options):
    """How the points are read and fitted."""

    unit: str = option(type=click.Choice(list(MM)), default="mm", help="Of points by the line; other files say theirs.")
    departures: bool = option(
        is_flag=True, default=False, help="The third number is no height but the departure, along the normal."
    )
    probe_radius_mm: float = option(
        type=NUMBER, default=0.0, help="Radius of the probe, of points that are centres of its ball."
    )
    order: int | None = option(
        type=WHOLE, help="Largest order of the terms that are not about the axis.  [default: what the points ask for]"
    )

    def of(self, mirror: Mirror, path: Path) -> FormError:
        """The form error."""
        points = read_points(path, cast(Unit, self.unit))
        return form_error(
            mirror, points, order=self.order, are_departures=self.departures, probe_radius_mm=self.probe_radius_mm
        )


@click.command(
    cls=DocumentedCommand,
    page="measured",
    examples=("omnimirror form paper-spherical cmm.csv --figure form.png -o as-made.toml",),
)
@click.argument("sensor", type=SENSOR)
@click.argument("points", type=click.Path(path_type=Path))
@takes(PointOptions, "asked")
@output_option("-o", "--output", formats=("toml",), help="Write the sensor with the mirror as it was made.")
@click.option("--whole", is_flag=True, help="With -o: also what is not about the axis, for pictures and straightening.")
@output_option("--figure", formats=FIGURES, help="Draw the form, what is left, meridian and terms (PNG, SVG, PDF).")
@json_option("Write all numbers.")
def command(
    sensor: str,
    points: Path,
    asked: PointOptions,
    output: Path | None,
    whole: bool,
    figure: Path | None,
    json_file: Path | None,
) -> None:
    """Say what the mirror of SENSOR became, from POINTS that were measured on it.

    Its place in the machine is taken away, noise is told from form, and what the form does to the picture is said, as
    it is and after calibrations. POINTS: x, y, z by the line, an OpticStudio grid, .x3p, Zygo's .dat and .datx, ..
    """
    if whole and output is None:
        raise click.UsageError("--whole belongs to -o, the sensor that is written")
    meant = load_sensor(sensor)
    console = output_console()
    with console.status("Fitting"):
        form = asked.of(meant.mirror, points)
        effect, why_not = _effect(meant, form)
    _print_form(console, form)
    asphere, why_none = _asphere(form)
    _print_asphere(console, asphere, why_none)
    if effect is not None:
        _print_effect(console, effect)
    else:
        console.print(f"\nwhat it does to the picture is not known: {why_not}")
    written = []
    if output is not None:
        save_sensor(as_made(meant, form, whole=whole), output)
        written.append(output)
    if figure is not None:
        from ....figures.style import save_figure, styled
        from ....manufacturing.metrology.form_map import form_figure

        with styled():
            save_figure(form_figure(form), figure)
        written.append(figure)
    if json_file is not None:
        write_json(json_file, _numbers(form, effect, asphere))
        written.append(json_file)
    say_written(*written, console=console)


def _effect(sensor: Sensor, form: FormError) -> tuple[FormEffect | None, str]:
    """What the form does, or why that is not known of a sensor of this kind."""
    try:
        return form_effect(sensor, form), ""
    except InvalidParameter as e:
        return None, str(e)


def _asphere(form: FormError) -> tuple[ForbesAsphere | None, str]:
    """The mirror as made as an asphere of Forbes, or why it is none."""
    try:
        return forbes_asphere(form.corrected()), ""
    except InvalidParameter as e:
        return None, str(e)


def _print_asphere(console: Console, asphere: ForbesAsphere | None, why_none: str) -> None:
    if asphere is None:
        console.print(f"\nabout its axis it is no asphere of Forbes: {why_none}", soft_wrap=True)
        return
    terms, names = ", ".join(f"{um:.4f}" for um in asphere.um), "a0"
    names += f" ... a{len(asphere.um) - 1}" if len(asphere.um) > 1 else ""
    console.print(
        f"\nabout its axis an asphere of Forbes (Qbfs): R = {asphere.radius_mm:.6f} mm, {names} = "
        f"{terms} um, which leaves {asphere.left_um:.2g} um rms",
        soft_wrap=True,
    )


def _print_form(console: Console, form: FormError) -> None:
    place, (least, most) = form.place, form.reach_mm
    wrong = f", {form.wrong} left out as wrong" if form.wrong else ""
    console.print(
        f"{len(form.x_mm)} points{wrong}, {least:.3g} to {most:.4g} mm from the axis of a mirror of "
        f"{form.mirror.rim_radius_mm:.4g} mm"
    )
    (x, y, z), (about_x, about_y) = np.round(place.vertex_mm, 4) + 0.0, np.round(place.tilt_deg, 4) + 0.0
    over = "; turned over about x" if place.turned_over else ""
    console.print(f"its place: vertex at {x:.4f}, {y:.4f}, {z:.4f} mm, tilt {about_x:.4f}, {about_y:.4f} deg{over}")
    if place.is_profile:
        console.print("profile through the axis: only the form about the axis is determined")
    if place.radius_mm is not None and place.radius_sigma_mm is not None:
        nominal = float(form.mirror.radius_t(0.0))
        console.print(
            f"radius of the sphere: {place.radius_mm:.5f} +- {place.radius_sigma_mm:.2g} mm, "
            f"{100 * (place.radius_mm / nominal - 1):+.3g} % of the nominal {nominal:.6g} mm"
        )
    if place.is_centred_by_outline:
        console.print("points do not determine the rotation about its centre: it was centred by their outline")
    elif len(place.free):
        console.print("points do not determine the rotation about its centre: the axis is that of the machine")
    console.print(
        f"\nform {form.peak_to_valley_um:.3g} um from peak to valley, {form.rms_um:.3g} um rms, of that "
        f"{form.rotational_rms_um:.3g} um about the axis\nnoise of a point {form.noise_um:.2g} um, neither form nor "
        f"noise {form.unexplained_um:.2g} um\n"
    )
    table = plain_table("term", "name", "um rms", "+-", words=("name",))
    ranked = sorted((t for t in form.terms if t.noll > 1), key=lambda term: -abs(term.um))
    for term in ranked[:MOST_TERMS]:
        table.add_row(str(term.noll), term.name, f"{term.um:.4f}", f"{term.sigma_um:.4f}")
    console.print(table)
    if len(ranked) > MOST_TERMS:
        console.print(f".. and {len(ranked) - MOST_TERMS} smaller ones; --json tells all")


def _print_effect(console: Console, effect: FormEffect) -> None:
    if effect.lost_rays:
        console.print(f"\n{effect.lost_rays} of the objects in the field are not seen any more")
        return
    table = plain_table("the picture", "px", words=("the picture",))
    for depth in CALIBRATIONS:
        words = "moves" if depth == "none" else f"moves, after a calibration: {depth}"
        table.add_row(words, f"{effect.made[after('motion_px', depth)]:.4f}")
    table.add_row("is blurred, as meant", f"{effect.meant['blur_px']:.3f}")
    table.add_row("is blurred, as made", f"{effect.made['blur_px']:.3f}")
    console.print(table)
    if effect.beyond_um > 0.0:
        console.print(f"terms above order 6, {effect.beyond_um:.2g} um rms, are not in these")


def _numbers(form: FormError, effect: FormEffect | None, asphere: ForbesAsphere | None) -> dict[str, Any]:
    return {
        "points": len(form.x_mm),
        "wrong": form.wrong,
        "vertex_mm": np.asarray(form.place.vertex_mm).tolist(),
        "tilt_deg": np.asarray(form.place.tilt_deg).tolist(),
        "turned_over": form.place.turned_over,
        "radius_mm": form.place.radius_mm,
        "radius_sigma_mm": form.place.radius_sigma_mm,
        "is_profile": form.place.is_profile,
        "peak_to_valley_um": form.peak_to_valley_um,
        "rms_um": form.rms_um,
        "rotational_rms_um": form.rotational_rms_um,
        "noise_um": form.noise_um,
        "unexplained_um": form.unexplained_um,
        "terms": [{"noll": t.noll, "name": t.name, "um": t.um, "sigma_um": t.sigma_um} for t in form.terms],
        "forbes_qbfs": None if asphere is None else asdict(asphere),
        "picture": None if effect is None else effect.to_dict(),
    }
