"""``omnimirror probe``: HDR light probes from images of a mirror ball."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from ....base.arguments import format_value, parse_float
from ....base.files import display_name
from ....dewarp.radiance_maps import PROBE_SUFFIXES, check_probe_file, light_probe, merge_exposures
from ....dewarp.request import Size
from ....io import write_image
from .._camera_options import AutoOptions, CameraOptions, OrientationOptions
from .._declarations import (
    DocumentedCommand,
    IntegerRange,
    Options,
    add_options,
    angle,
    option,
)
from .._output import output_console, output_option, print_line, print_remark

if TYPE_CHECKING:
    from ....optics.camera_files import AnyCamera


def numbers_or_fractions(text: str) -> tuple[float, ...]:
    """Parse comma-separated positive numbers, also as fractions.

    >>> numbers_or_fractions("1/8,0.5")
    (0.125, 0.5)
    """
    pairs = [part.partition("/") for part in text.split(",")]
    try:
        values = tuple(parse_float(over) / parse_float(under or "1") for over, _, under in pairs)
    except (ValueError, ZeroDivisionError):
        values = (np.nan,)
    if not (np.isfinite(values).all() and min(values) > 0):
        raise click.BadParameter(
            f"must be positive numbers such as 1/60 or 0.5; got {format_value(text)}"
        )
    return values


def reflectances(text: str) -> float | tuple[float, ...]:
    """Parse a reflectance, or one for each of red, green and blue.

    >>> reflectances("0.6"), reflectances("0.55,0.56,0.57")
    (0.6, (0.55, 0.56, 0.57))
    """
    values = numbers_or_fractions(text)
    if len(values) not in (1, 3):
        raise click.BadParameter(f"must be R or R,G,B; got {format_value(text)}")
    return values[0] if len(values) == 1 else values


@dataclass(frozen=True)
class ProbeOptions(Options):
    """Light probe."""

    exposures_s: tuple[float, ...] | None = option(
        type=numbers_or_fractions,
        metavar="T,...",
        help="Exposure time of each IMAGE, such as 1/8,1/60; required for several.",
    )
    reflectance: float | tuple[float, float, float] | None = option(
        type=reflectances,
        metavar="R|R,G,B",
        help="Reflectance of the mirror, by which the radiance is divided.  [default: 1]",
    )
    width_px: int | None = option(
        type=IntegerRange(8),
        metavar="PX",
        help="Width of the map, even.  [default: resolution of the image]",
    )
    pan_deg: float | None = option(
        type=angle, metavar="DEG", help="Azimuth of the centre, right of forward.  [default: 0]"
    )


@click.command(
    cls=DocumentedCommand,
    page="dewarp",
    examples=(
        "omnimirror probe ball.jpg --ball 640,480,410,340 --camera-looks forward -o probe.hdr",
        "omnimirror probe dark.jpg bright.jpg --exposures-s 1/500,1/30 --auto --mirror ball -o probe.exr",
    ),
)
@click.argument("images", nargs=-1, required=True, metavar="IMAGE...")
@output_option(
    "-o",
    "--output",
    required=True,
    formats=tuple(suffix[1:] for suffix in PROBE_SUFFIXES),
    help="Equirectangular radiance map (.hdr, .exr).",
)
@add_options(CameraOptions, "camera")
@add_options(AutoOptions, "auto", group="Camera")
@add_options(OrientationOptions, "orientation")
@add_options(ProbeOptions, "probe")
def command(
    images: tuple[str, ...],
    output: Path,
    camera: CameraOptions,
    auto: AutoOptions,
    orientation: OrientationOptions,
    probe: ProbeOptions,
) -> None:
    """Convert an IMAGE of a mirror ball, or of another mirror, to an HDR light probe for Blender,
    Unreal Engine or Mitsuba.

    Several IMAGES with different exposures are merged into one radiance map. The map covers the
    full sphere in linear light; directions that the mirror does not reflect to the camera are
    filled from the edge of the visible part.
    """
    auto.check(camera)
    check_probe_file(output)
    if len(images) > 1 and probe.exposures_s is None:
        raise click.UsageError(f"{len(images)} images require --exposures-s, the time of each")
    pixels = orientation.read([Path(image) for image in images])
    camera_of: Callable[[Size], AnyCamera] = camera.camera
    if auto.auto:
        camera_of, report = auto.camera(images, camera, orientation)
        print_remark(f"omnimirror: {report}")
    drawn = camera.drawing(camera_of((pixels[0].shape[1], pixels[0].shape[0])))
    with output_console().status("Dewarping"):
        light = (
            pixels[0] if probe.exposures_s is None else merge_exposures(pixels, probe.exposures_s)
        )
        result = light_probe(light, drawn, **probe.subset("width_px", "pan_deg", "reflectance"))
        write_image(output, result.radiance)
    height, width = result.visible.shape
    print_line(
        f"{display_name(output)}: light probe, {width} x {height} px, "
        f"{100 * result.visible_fraction:.3g} % of the sphere visible, "
        f"radiance up to {result.radiance.max():.3g}"
    )
