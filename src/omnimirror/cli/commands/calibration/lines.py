"""``omnimirror lines``: a camera refined and levelled by the straight edges of ordinary pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from ....calibrate.lines import Level, calibrate_lines, drawn_edges
from ....calibrate.rim import SURE, find_rim
from ....errors import InvalidParameter
from ....files import write_text
from ....frames import Mount
from ....media import read_image, write_image
from ....specs import load_camera, save_camera
from ...options.common import NUMBER, distance
from ...outputs import output_console, output_option, say, say_written


@click.command()
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--camera", metavar="FILE|NAME", help="To be refined.  [default: nothing is known of it]")
@click.option(
    "--optics", type=click.Choice(["mirror", "fisheye"]), default="mirror", show_default=True,
    help="Of a camera of which nothing is known.",
)  # fmt: skip
@click.option(
    "--camera-looks", type=click.Choice(["up", "down", "forward"]), default="up", show_default=True,
    help="Where the optical axis of an unknown camera points.",
)  # fmt: skip
@click.option(
    "--rim", nargs=3, type=NUMBER, metavar="U V R",
    help="Circle of the field in the picture, px.  [default: a mirror's rim, as found; of a fisheye the largest]",
)  # fmt: skip
@click.option(
    "--inner-radius-px", type=NUMBER, help="Inside of which the camera sees itself.  [default: as found with the rim]"
)
@click.option("--distance-mm", type=distance, default="inf", help="Of the edges, for mirrors of many viewpoints.")
@output_option("-o", "--output", help="Write the camera, level and with its uncertainty.")
@output_option("--json", "json_file", help="Write parameters, residuals and lean.")
@output_option("--figure", help="Draw the edges of the first picture: green where straight, red where not.")
def command(
    images: tuple[Path, ...],
    camera: str | None,
    optics: str,
    camera_looks: str,
    rim: tuple[float, float, float] | None,
    inner_radius_px: float | None,
    distance_mm: float,
    output: Path | None,
    json_file: Path | None,
    figure: Path | None,
) -> None:
    """Refine a camera until straight edges in IMAGES are straight, and level it by what stands upright.

    For rooms and streets, where there is no target. Example: omnimirror lines room.jpg --camera mine.toml -o built.toml
    """
    pictures = [read_image(path) for path in images]
    console = output_console()
    model = None if camera is None else load_camera(camera)
    if rim is None and (optics if model is None else getattr(model, "optics", "mirror")) == "mirror":
        *circle, inner = _found_rim(pictures)
        rim = (circle[0], circle[1], circle[2])
        say(f"the rim lies about {rim[0]:.1f}, {rim[1]:.1f} px, with a radius of {rim[2]:.1f} px", console=console)
        inner_radius_px = inner if inner_radius_px is None else inner_radius_px
    with console.status("Following edges"):
        found = calibrate_lines(
            pictures,
            model=model,
            optics=optics,  # type: ignore[arg-type]  # one of the two
            mount=Mount(camera_looks),  # type: ignore[arg-type]  # one of the three
            centre_px=None if rim is None else (rim[0], rim[1]),
            radius_px=None if rim is None else rim[2],
            inner_radius_px=inner_radius_px or 0.0,
            distance_mm=distance_mm,
        )
    told = found.to_dict()
    used, edges = (sum(p[key] for p in told["pictures"]) for key in ("used", "edges"))
    say(f"{used} of {edges} edges are straight within {found.rms_px:.2f} px rms", console=console)
    for p in told["parameters"]:
        say((f"  {p['name']}", "bold"), f" {p['value']:.6g} +- {p['sigma']:.2g} {p['unit']}", console=console)
    for words in found.free:
        say(("not determined: ", "bold"), words, console=console)
    for path, level in zip(images, found.levels, strict=True):
        say((path.name, "bold"), f": {_lean(level)}", console=console)
    if output:
        save_camera(found.camera, output)  # type: ignore[arg-type]  # of the kinds that files hold
    if json_file:
        write_text(json_file, json.dumps(told, indent=1) + "\n")
    if figure:
        write_image(figure, drawn_edges(np.asarray(pictures[0]), found.chains[0], found.used[0]))
    say_written(output, json_file, figure, console=console)


def _found_rim(pictures: Sequence[NDArray[Any]]) -> tuple[float, float, float, float]:
    """Middle, radius and inner radius (px) of the field, of a rim that is sure."""
    found = find_rim(pictures)
    if not found.is_sure:
        raise InvalidParameter(
            f"no rim was found for sure: the confidence {found.confidence:.2f} is below {SURE:g}; give more pictures "
            "of the same sensor or one with all of its rim, or say where it is with --rim U V R"
        )
    inner, radius = found.annulus_px
    return *found.centre_px, radius, inner


def _lean(level: Level | None) -> str:
    if level is None:
        return "nothing stands upright in it"
    lean = f"pitch {level.pitch_deg:.2f}, roll {level.roll_deg:.2f} deg, +- {level.sigma_deg:.2g}"
    return f"{lean}, by {level.upright} upright edges"
