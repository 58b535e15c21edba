"""``omnimirror lines``: a camera refined and levelled by the straight edges of ordinary pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from .....base.errors import InvalidParameter
from .....base.files import write_json
from .....calibration.lines import Level, LineCalibration, calibrate_lines, drawn_edges, read_lines
from .....calibration.lines.marked import ONLY
from .....calibration.rim import SURE, check_alike, find_rim
from .....cameras.frames import CameraLooks, Mount
from .....cameras.models.base import CameraModel, Optics
from .....io import write_image
from .....io.batch import READABLE, expand_inputs
from .....optics.sensor import Sensor
from .....optics.sensor_files import load_camera, save_camera
from ...help_pages import DocumentedCommand
from ...options.common import NUMBER, distance, whole_size
from ...options.declared import Options, option, takes
from ...options.orientation import OrientationOptions
from ...outputs import json_option, output_console, output_option, say, say_written

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LineOptions(Options):
    """The camera to be refined, or what is known of one that nobody has calibrated, and where edges stand."""

    camera: str | None = option(metavar="FILE|NAME", help="To be refined.  [default: nothing is known of it]")
    optics: Optics = option(
        type=click.Choice(["mirror", "fisheye"]), default="mirror", help="Of a camera of which nothing is known."
    )
    camera_looks: CameraLooks = option(
        type=click.Choice(["up", "down", "forward"]), default="up",
        help="Where the optical axis of an unknown camera points.",
    )  # fmt: skip
    rim: tuple[float, float, float] | None = option(
        nargs=3, type=NUMBER, metavar="U V R",
        help="Circle of the field in the picture, px.  [default: a mirror's rim, as found; of a fisheye the largest]",
    )  # fmt: skip
    inner_radius_px: float | None = option(
        type=NUMBER, help="Inside of which the camera sees itself.  [default: as found with the rim]"
    )
    distance_mm: float = option(
        type=distance, metavar="MM", default=np.inf, help="Of the edges, for mirrors of many viewpoints."
    )

    lines: tuple[str, ...] = option(
        default=(), multiple=True, metavar="FILE", show_default=False,
        help="Points marked on straight edges, CSV: line,u_px,v_px, and picture if there are several; may be repeated.",
    )  # fmt: skip
    image_size: tuple[int, int] | None = option(
        type=whole_size, metavar="WxH", help="Of the pictures, where there are --lines alone."
    )

    def model(self) -> Sensor | CameraModel | None:
        """The camera to be refined."""
        return None if self.camera is None else load_camera(self.camera)

    def refined(
        self, pictures: Sequence[NDArray[Any]], lines: Sequence[Sequence[Array]], model: Sensor | CameraModel | None
    ) -> LineCalibration:
        """What the edges of some pictures say of the camera."""
        return calibrate_lines(
            pictures, lines=lines, image_size=self.image_size, model=model, optics=self.optics,
            mount=Mount(self.camera_looks),
            centre_px=None if self.rim is None else self.rim[:2],
            radius_px=None if self.rim is None else self.rim[2],
            inner_radius_px=self.inner_radius_px or 0.0, distance_mm=self.distance_mm,
        )  # fmt: skip


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
@output_option("-o", "--output", help="Write the camera, level and with its uncertainty.")
@json_option("Write parameters, residuals and lean.")
@output_option("--figure", help="Draw the edges of the first picture: green where straight, red where not.")
def command(
    images: tuple[str, ...],
    asked: LineOptions,
    orientation: OrientationOptions,
    output: Path | None,
    json_file: Path | None,
    figure: Path | None,
) -> None:
    """Refine a camera until straight edges in IMAGES are straight, and level it by what stands upright.

    IMAGES are files, folders or patterns of them: rooms and streets, where there is no target. Edges that programs do
    not follow are marked by hand: --lines.
    """
    if not (images or asked.lines):
        raise click.UsageError("there are no IMAGES, and no --lines that were marked in them")
    if figure and not images:
        raise click.UsageError("--figure is drawn on the first of IMAGES, and there is none")
    files, marked = expand_inputs(images, READABLE), read_lines(asked.lines)
    pictures = orientation.read(files)
    check_alike(pictures, [file.name for file in files])
    if len(files) == 1 and list(marked) == [ONLY]:
        marked = {files[0].name: marked[ONLY]}
    names = list(dict.fromkeys([*(file.name for file in files), *marked]))
    lines = [marked.get(name, ()) for name in names]
    console = output_console()
    model = asked.model()
    optics = asked.optics if model is None else getattr(model, "optics", "mirror")
    if pictures and asked.rim is None and optics == "mirror":
        (u, v, radius), inner = _found_rim(pictures)
        say(f"the rim lies about {u:.1f}, {v:.1f} px, with a radius of {radius:.1f} px", console=console)
        if asked.inner_radius_px is not None:
            inner = asked.inner_radius_px
        asked = replace(asked, rim=(u, v, radius), inner_radius_px=inner)
    with console.status("Following edges"):
        found = asked.refined(pictures, lines, model)
    told = found.to_dict()
    used, edges = (sum(p[key] for p in told["pictures"]) for key in ("used", "edges"))
    say(f"{used} of {edges} edges are straight within {found.rms_px:.2f} px rms", console=console)
    for p in told["parameters"]:
        say((f"  {p['name']}", "bold"), f" {p['value']:.6g} +- {p['sigma']:.2g} {p['unit']}", console=console)
    for words in found.free:
        say(("not determined: ", "bold"), words, console=console)
    for name, level in zip(names, found.levels, strict=True):
        say((name, "bold"), f": {_lean(level)}", console=console)
    if output:
        save_camera(found.camera, output)  # type: ignore[arg-type]  # of the kinds that files hold
    if json_file:
        write_json(json_file, told)
    if figure:
        write_image(figure, drawn_edges(np.asarray(pictures[0]), found.chains[0], found.used[0]))
    say_written(output, json_file, figure, console=console)


def _found_rim(pictures: Sequence[NDArray[Any]]) -> tuple[tuple[float, float, float], float]:
    """Circle (middle, radius) and inner radius of the field, px, of a rim that is sure."""
    found = find_rim(pictures)
    if not found.is_sure:
        raise InvalidParameter(
            f"no rim was found for sure: the confidence {found.confidence:.2f} is below {SURE:g}; give more pictures "
            "of the same sensor or one with all of its rim, or say where it is with --rim U V R"
        )
    inner, radius = found.annulus_px
    return (*found.centre_px, radius), inner


def _lean(level: Level | None) -> str:
    if level is None:
        return "nothing stands upright in it"
    lean = f"pitch {level.pitch_deg:.2f}, roll {level.roll_deg:.2f} deg, +- {level.sigma_deg:.2g}"
    return f"{lean}, by {level.upright} upright edges"
