"""``omnimirror lines``: refinement and levelling of a camera from straight edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from ....base.errors import InvalidParameter
from ....base.files import write_json
from ....base.typing import Array
from ....calibration.levelling import Level
from ....calibration.plumb_lines import PlumbLineCalibration, calibrate_plumb_lines, draw_edges
from ....calibration.rim import MIN_CONFIDENCE, check_image_sizes, detect_mirror_outline
from ....calibration.straight_edges import DEFAULT_IMAGE_NAME, read_line_points
from ....cameras.camera import CameraLooks, Mount
from ....cameras.models.camera_model import CameraModel, Optics
from ....io import write_image
from ....io.batch import READABLE_IMAGE_SUFFIXES, expand_inputs
from ....optics.camera_files import load_camera, save_camera
from ....optics.sensor import Sensor
from .._camera_options import OrientationOptions
from .._declarations import (
    NUMBER,
    DocumentedCommand,
    Options,
    add_options,
    distance,
    full_image_size,
    option,
    setting,
)
from .._output import json_option, output_console, output_option, print_line, print_written


@dataclass(frozen=True)
class LineOptions(Options):
    """Camera, marked lines and their object distance."""

    camera: str | None = option(
        metavar="FILE|NAME", help="Camera to refine.  [default: uncalibrated camera]"
    )
    rim: tuple[float, float, float] | None = option(
        nargs=3,
        type=NUMBER,
        metavar="U V R",
        help="Circle of the field in the image, px.  [default: the detected outline of a "
        "mirror; the largest circle for a fisheye]",
    )
    lines: tuple[str, ...] = option(
        default=(),
        multiple=True,
        metavar="FILE",
        show_default=False,
        help="Points marked on straight edges, CSV: line,u_px,v_px, and image for several images (repeatable).",
    )
    image_size: tuple[int, int] | None = option(
        type=full_image_size, metavar="WxH", help="Image size, if only --lines are given."
    )
    optics: Optics = setting("camera", "mirror")
    camera_looks: CameraLooks = setting("camera", "up")
    inner_radius_px: float | None = setting("rim")
    distance_mm: float = setting("lines", np.inf, type=distance)

    def model(self) -> Sensor | CameraModel | None:
        """Return the camera to refine."""
        return None if self.camera is None else load_camera(self.camera)

    def refined(
        self,
        images: Sequence[NDArray[Any]],
        lines: Sequence[Sequence[Array]],
        model: Sensor | CameraModel | None,
    ) -> PlumbLineCalibration:
        """Return the refinement of the camera from the edges of images."""
        return calibrate_plumb_lines(
            images,
            lines=lines,
            image_size=self.image_size,
            model=model,
            optics=self.optics,
            mount=Mount(self.camera_looks),
            centre_px=None if self.rim is None else self.rim[:2],
            radius_px=None if self.rim is None else self.rim[2],
            inner_radius_px=self.inner_radius_px or 0.0,
            distance_mm=self.distance_mm,
        )


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=(
        "omnimirror lines room.jpg --camera mine.toml -o built.toml",
        "omnimirror lines --lines edges.csv --image-size 1024x1024 --camera mine.toml -o built.toml",
    ),
)
@click.argument("images", nargs=-1)
@add_options(LineOptions, "options")
@add_options(OrientationOptions, "orientation")
@output_option("-o", "--output", help="Output camera file, levelled and with its uncertainty.")
@json_option("Write parameters, residuals and tilt.")
@output_option("--figure", help="Draw the edges of the first image: green if straight, red if not.")
def command(
    images: tuple[str, ...],
    options: LineOptions,
    orientation: OrientationOptions,
    output: Path | None,
    json_file: Path | None,
    figure: Path | None,
) -> None:
    """Refine a camera until straight edges in IMAGES are straight, and level it from vertical
    edges.

    IMAGES are files, folders or file patterns of rooms and streets, without a target. Mark edges
    that are not detected automatically by hand: --lines.
    """
    if not (images or options.lines):
        raise click.UsageError("IMAGES or --lines must be given")
    if figure and not images:
        raise click.UsageError("--figure requires IMAGES")
    files, marked = expand_inputs(images, READABLE_IMAGE_SUFFIXES), read_line_points(options.lines)
    pixels = orientation.read(files)
    check_image_sizes(pixels, [file.name for file in files])
    if len(files) == 1 and list(marked) == [DEFAULT_IMAGE_NAME]:
        marked = {files[0].name: marked[DEFAULT_IMAGE_NAME]}
    names = list(dict.fromkeys([*(file.name for file in files), *marked]))
    lines = [marked.get(name, ()) for name in names]
    console = output_console()
    model = options.model()
    optics = options.optics if model is None else getattr(model, "optics", "mirror")
    if pixels and options.rim is None and optics == "mirror":
        (u, v, radius), inner = _detect_rim(pixels)
        print_line(
            f"detected rim: centre {u:.1f}, {v:.1f} px, radius {radius:.1f} px", console=console
        )
        if options.inner_radius_px is not None:
            inner = options.inner_radius_px
        options = replace(options, rim=(u, v, radius), inner_radius_px=inner)
    with console.status("Tracing edges"):
        result = options.refined(pixels, lines, model)
    record = result.to_dict()
    used, edges = (sum(p[key] for p in record["images"]) for key in ("used", "edges"))
    print_line(
        f"{used} of {edges} edges used, residual {result.rms_px:.2f} px rms", console=console
    )
    for p in record["parameters"]:
        print_line(
            (f"  {p['name']}", "bold"),
            f" {p['value']:.6g} +- {p['sigma']:.2g} {p['unit']}",
            console=console,
        )
    for parameter in result.free:
        print_line(("not determined: ", "bold"), parameter, console=console)
    for name, level in zip(names, result.levels, strict=True):
        print_line((name, "bold"), f": {_format_level(level)}", console=console)
    if output:
        save_camera(result.camera, output)  # type: ignore[arg-type]  # of the kinds that files hold
    if json_file:
        write_json(json_file, record)
    if figure:
        write_image(figure, draw_edges(np.asarray(pixels[0]), result.chains[0], result.used[0]))
    print_written(output, json_file, figure, console=console)


def _detect_rim(images: Sequence[NDArray[Any]]) -> tuple[tuple[float, float, float], float]:
    """Return the circle (centre, radius) and the inner radius of the field, px, of an accepted
    outline.
    """
    rim = detect_mirror_outline(images)
    if not rim.is_accepted:
        raise InvalidParameter(
            f"no rim detected: the confidence must be at least {MIN_CONFIDENCE:g}; got "
            f"{rim.confidence:.2f}; use more images of the same sensor, or one with the "
            "whole rim, or specify the rim with --rim U V R"
        )
    inner, radius = rim.annulus_px
    return (*rim.centre_px, radius), inner


def _format_level(level: Level | None) -> str:
    if level is None:
        return "no vertical edges"
    tilt = f"pitch {level.pitch_deg:.2f}, roll {level.roll_deg:.2f} deg, +- {level.sigma_deg:.2g}"
    return f"{tilt}, from {level.upright} vertical edges"
