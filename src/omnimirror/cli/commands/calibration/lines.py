"""``omnimirror lines``: a camera refined and levelled by the straight edges of ordinary pictures."""

from __future__ import annotations

import json
from pathlib import Path

import click
import numpy as np

from ....calibrate.lines import Level, calibrate_lines, drawn_edges
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
@click.option("--rim", nargs=3, type=NUMBER, metavar="U V R", help="Circle of the field in the picture, px.")
@click.option("--inner-radius-px", type=NUMBER, default=0.0, help="Inside of which the camera sees itself.")
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
    inner_radius_px: float,
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
    with console.status("Following edges"):
        found = calibrate_lines(
            pictures,
            model=None if camera is None else load_camera(camera),
            optics=optics,  # type: ignore[arg-type]  # one of the two
            mount=Mount(camera_looks),  # type: ignore[arg-type]  # one of the three
            centre_px=None if rim is None else (rim[0], rim[1]),
            radius_px=None if rim is None else rim[2],
            inner_radius_px=inner_radius_px,
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


def _lean(level: Level | None) -> str:
    if level is None:
        return "nothing stands upright in it"
    lean = f"pitch {level.pitch_deg:.2f}, roll {level.roll_deg:.2f} deg, +- {level.sigma_deg:.2g}"
    return f"{lean}, by {level.upright} upright edges"
