"""``omnimirror bracket``: where to focus several pictures, and one sharp picture of them."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from ....analysis import best_focus
from ....files import name_of
from ....media import read_image, write_image
from ....media.pictures.images import format_of
from ....simulate import Detector, Pose, PosedScene, expose
from ....simulate.restoration.bracketing import Bracket, focused_at, merge_bracket, plan_bracket
from ....specs import load_sensor
from ...options.common import NUMBER, WHOLE, distance, values
from ...options.declared import takes
from ...options.scene import SceneOptions, pose, rows_bar
from ...outputs import PICTURES, format_option, output_console, output_option, say

OBJECT_DISTANCE = click.option(
    "--object-distance-mm", type=distance, metavar="MM", default="inf", show_default=True,
    help="From the mirror to the object.",
)  # fmt: skip


@click.group()
def command() -> None:
    """Focus bracketing: a few pictures at planned distances, merged by radius into one that is sharp."""


@command.command()
@click.argument("sensors", nargs=-1, required=True)
@click.option("--limit-px", type=NUMBER, default=1.0, show_default=True, help="Largest blur, in pixels.")
@OBJECT_DISTANCE
def plan(sensors: tuple[str, ...], limit_px: float, object_distance_mm: float) -> None:
    """The fewest focus distances that keep the blur of SENSORS under a limit, and where astigmatism forbids it.

    Example: omnimirror bracket plan paper-spherical --limit-px 2
    """
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("sensor")
    for heading in ("pictures", "worst px\none focus", "worst px\nmerged", "astigmatic\ndeg", "least px\nthere"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("focus mm")
    for name in sensors:
        sensor = load_sensor(name)
        found = plan_bracket(sensor, limit_px, object_distance_mm=object_distance_mm)
        alone = best_focus(sensor, "worst_blur_px", object_distance_mm=object_distance_mm).value
        focuses = ", ".join(f"{focus:.1f}" for focus in found.focus_mm)
        table.add_row(
            sensor.name, f"{len(found.focus_mm)}", f"{alone:.2f}", f"{found.blur_px.max():.2f}", *_astigmatic(found),
            focuses,
        )  # fmt: skip
    output_console().print(table)


def _astigmatic(found: Bracket) -> tuple[str, str]:
    """Between which angles no focus is sharp, and the least blur there."""
    if not found.astigmatic.any():
        return "-", "-"
    low, high = found.omega_deg[found.astigmatic][[0, -1]]
    return f"{low:.0f} to {high:.0f}", f"{found.least_px.max():.2f}"


@command.command()
@click.argument("sensor")
@click.argument("pictures", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--focus-mm", type=values, required=True, metavar="A,B,..", help="Where the pictures are focused.")
@OBJECT_DISTANCE
@output_option("-o", "--output", formats=PICTURES, required=True, help="The picture to write.")
@format_option(PICTURES)
def merge(
    sensor: str, pictures: tuple[Path, ...], focus_mm: NDArray[np.float64], object_distance_mm: float, output: Path
) -> None:
    """Merge PICTURES of SENSOR, focused at different distances, to the scale of its own focus.

    Example: omnimirror bracket merge paper-spherical a.png b.png --focus-mm 212,228 -o merged.png
    """
    format_of(output)
    merged = merge_bracket(
        load_sensor(sensor), [read_image(p) for p in pictures], focus_mm=focus_mm, object_distance_mm=object_distance_mm
    )
    write_image(output, merged)
    say(f"{name_of(output)}: {len(pictures)} pictures merged")


@command.command()
@click.argument("sensor")
@click.option("--focus-mm", type=values, metavar="A,B,..", help="Where to focus.  [default: as planned for 1 px]")
@takes(SceneOptions, "scene")
@click.option("--pose", "stands", type=pose, metavar="X,Y,Z,..",
              help="Where the mirror stands in the scene, mm, and pan, tilt, roll, deg.  [default: 0,0,0]")  # fmt: skip
@click.option("--samples", "--spp", type=WHOLE, default=32, show_default=True, help="Rays per pixel.")
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), required=True, help="A folder.")
def take(
    sensor: str,
    focus_mm: NDArray[np.float64] | None,
    scene: SceneOptions,
    stands: Pose | None,
    samples: int,
    output: Path,
) -> None:
    """Simulate the pictures that SENSOR takes of a scene at each focus.

    Example: omnimirror bracket take paper-spherical --scene street --focus-mm 212,228 -o bracket
    """
    seen, camera = PosedScene(scene.source().load(), stands or Pose()), load_sensor(sensor)
    for focus in plan_bracket(camera).focus_mm if focus_mm is None else focus_mm:
        path = output / f"{focus:.1f}mm.png"
        with rows_bar("Exposing") as progress:
            light = expose(focused_at(camera, float(focus)), seen, samples=samples, blur=True, progress=progress)
        write_image(path, Detector().read(light))
        click.echo(f"{path}: focused at {focus:.1f} mm")
