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
from ....cameras.frames import CameraLooks, Mount
from ....cameras.models.camera_model import CameraModel, Optics
from ....io import write_image
from ....io.batch import READABLE_IMAGE_SUFFIXES, expand_inputs
from ....optics.sensor import Sensor
from ....optics.sensor_files import load_camera, save_camera
from .._camera_options import OrientationOptions
from .._declarations import DocumentedCommand, Options, option, takes
from .._option_types import NUMBER, distance, whole_size
from .._output import json_option, output_console, output_option, say, say_written


@dataclass(frozen=True)
class LineOptions(Options):
    """Camera, or known data of an uncalibrated camera, and object distance of the edges."""

    camera: str | None = option(
        metavar="FILE|NAME", help="Camera to refine.  [default: uncalibrated camera]"
    )
    optics: Optics = option(
        type=click.Choice(["mirror", "fisheye"]),
        default="mirror",
        help="Type of optics of an uncalibrated camera.",
    )
    camera_looks: CameraLooks = option(
        type=click.Choice(["up", "down", "forward"]),
        default="up",
        help="Orientation of the optical axis of an uncalibrated camera.",
    )
    rim: tuple[float, float, float] | None = option(
        nargs=3,
        type=NUMBER,
        metavar="U V R",
        help="Circle of the field in the image, px.  [default: the detected outline of a mirror; the largest "
        "circle for a fisheye]",
    )
    inner_radius_px: float | None = option(
        type=NUMBER,
        help="Radius of the central obscuration by the camera itself, px.  [default: as detected with the rim]",
    )
    distance_mm: float = option(
        type=distance,
        metavar="MM",
        default=np.inf,
        help="Object distance of the edges, for mirrors without a single viewpoint.",
    )

    lines: tuple[str, ...] = option(
        default=(),
        multiple=True,
        metavar="FILE",
        show_default=False,
        help="Points marked on straight edges, CSV: line,u_px,v_px, and picture for several images (repeatable).",
    )
    image_size: tuple[int, int] | None = option(
        type=whole_size, metavar="WxH", help="Image size, if only --lines are given."
    )

    def model(self) -> Sensor | CameraModel | None:
        """Return the camera to refine."""
        return None if self.camera is None else load_camera(self.camera)

    def refined(
        self,
        pictures: Sequence[NDArray[Any]],
        lines: Sequence[Sequence[Array]],
        model: Sensor | CameraModel | None,
    ) -> PlumbLineCalibration:
        """Return the refinement of the camera from the edges of images."""
        return calibrate_plumb_lines(
            pictures,
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
@takes(LineOptions, "asked")
@takes(OrientationOptions, "orientation")
@output_option("-o", "--output", help="Output camera file, levelled and with its uncertainty.")
@json_option("Write parameters, residuals and lean.")
@output_option("--figure", help="Draw the edges of the first image: green if straight, red if not.")
def command(
    images: tuple[str, ...],
    asked: LineOptions,
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
    if not (images or asked.lines):
        raise click.UsageError("there are no IMAGES, and no --lines that were marked in them")
    if figure and not images:
        raise click.UsageError("--figure is drawn on the first of IMAGES, and there is none")
    files, marked = expand_inputs(images, READABLE_IMAGE_SUFFIXES), read_line_points(asked.lines)
    pictures = orientation.read(files)
    check_image_sizes(pictures, [file.name for file in files])
    if len(files) == 1 and list(marked) == [DEFAULT_IMAGE_NAME]:
        marked = {files[0].name: marked[DEFAULT_IMAGE_NAME]}
    names = list(dict.fromkeys([*(file.name for file in files), *marked]))
    lines = [marked.get(name, ()) for name in names]
    console = output_console()
    model = asked.model()
    optics = asked.optics if model is None else getattr(model, "optics", "mirror")
    if pictures and asked.rim is None and optics == "mirror":
        (u, v, radius), inner = _found_rim(pictures)
        say(
            f"the rim lies about {u:.1f}, {v:.1f} px, with a radius of {radius:.1f} px",
            console=console,
        )
        if asked.inner_radius_px is not None:
            inner = asked.inner_radius_px
        asked = replace(asked, rim=(u, v, radius), inner_radius_px=inner)
    with console.status("Following edges"):
        found = asked.refined(pictures, lines, model)
    told = found.to_dict()
    used, edges = (sum(p[key] for p in told["images"]) for key in ("used", "edges"))
    say(f"{used} of {edges} edges are straight within {found.rms_px:.2f} px rms", console=console)
    for p in told["parameters"]:
        say(
            (f"  {p['name']}", "bold"),
            f" {p['value']:.6g} +- {p['sigma']:.2g} {p['unit']}",
            console=console,
        )
    for words in found.free:
        say(("not determined: ", "bold"), words, console=console)
    for name, level in zip(names, found.levels, strict=True):
        say((name, "bold"), f": {_lean(level)}", console=console)
    if output:
        save_camera(found.camera, output)  # type: ignore[arg-type]  # of the kinds that files hold
    if json_file:
        write_json(json_file, told)
    if figure:
        write_image(figure, draw_edges(np.asarray(pictures[0]), found.chains[0], found.used[0]))
    say_written(output, json_file, figure, console=console)


def _found_rim(pictures: Sequence[NDArray[Any]]) -> tuple[tuple[float, float, float], float]:
    """Return the circle (centre, radius) and the inner radius of the field, px, of an accepted
    outline.
    """
    found = detect_mirror_outline(pictures)
    if not found.is_accepted:
        raise InvalidParameter(
            f"no rim was found for sure: the confidence {found.confidence:.2f} is below {MIN_CONFIDENCE:g}; "
            "give more pictures of the same sensor or one with all of its rim, or say where it is with --rim U V R"
        )
    inner, radius = found.annulus_px
    return (*found.centre_px, radius), inner


def _lean(level: Level | None) -> str:
    if level is None:
        return "nothing stands upright in it"
    lean = f"pitch {level.pitch_deg:.2f}, roll {level.roll_deg:.2f} deg, +- {level.sigma_deg:.2g}"
    return f"{lean}, by {level.upright} upright edges"
