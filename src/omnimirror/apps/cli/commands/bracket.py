"""``omnimirror bracket``: planning of a focus bracket, and merging of its images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from ....analysis.focus import best_focus
from ....base.files import display_name, write_json
from ....base.typing import Array
from ....dewarp.restoration.focus_bracketing import Bracket, focused_at, merge_bracket, plan_bracket
from ....io import write_image
from ....io.images import format_of
from ....optics.sensor_files import load_sensor
from ....simulation.detector import Detector
from ....simulation.rendering import expose
from ....simulation.scenes.scene import Pose, PosedScene
from .._camera_options import OrientationOptions
from .._declarations import DocumentedCommand, Options, option, takes
from .._option_types import NUMBER, SENSOR, WHOLE, distance, values
from .._output import PICTURES, format_option, head, json_option, output_console, output_option, plain_table, say, say_written
from .._scene_options import SceneOptions, pose, rows_bar


@dataclass(frozen=True)
class ObjectDistance(Options):
    """Object."""

    object_distance_mm: float = option(type=distance, metavar="MM", default=np.inf, help="Object distance from the mirror.")


@dataclass(frozen=True)
class PlanOptions(ObjectDistance):
    """Limits."""

    limit_px: float = option(type=NUMBER, default=1.0, help="Maximum blur, px.")


@dataclass(frozen=True)
class MergeOptions(ObjectDistance):
    """Capture."""

    focus_mm: Array = option(type=values, required=True, show_default=False, metavar="A,B,..", help="Focus distances of the images.")


@dataclass(frozen=True)
class TakeOptions(Options):
    """Rendering."""

    focus_mm: Array | None = option(type=values, metavar="A,B,..", help="Focus distances.  [default: planned for a blur of 1 px]")
    stands: Pose | None = option("--pose", type=pose, metavar="X,Y,Z,..", help="Mirror pose in the scene: position, mm; pan, tilt, roll, deg.  [default: 0,0,0]")
    samples: int = option("--samples", "--spp", type=WHOLE, default=32, help="Rays per pixel.")


@click.group()
def command() -> None:
    """Plan a focus bracket and merge its images by image radius into one sharp image."""


@command.command(cls=DocumentedCommand, page="restoration", examples=("omnimirror bracket plan paper-spherical --limit-px 2",))
@click.argument("sensors", type=SENSOR, nargs=-1, required=True)
@takes(PlanOptions, "asked")
@json_option()
def plan(sensors: tuple[str, ...], asked: PlanOptions, json_file: Path | None) -> None:
    """Compute the fewest focus distances that keep the blur of SENSORS below a limit, and the
    astigmatic zones.
    """
    focus = head("focus_mm")
    numbers = ("pictures", "worst px\none focus", "worst px\nmerged", "astigmatic\ndeg", "least px\nthere")
    table = plain_table("sensor", *numbers, focus, words=("sensor", focus))
    console = output_console()
    records: list[dict[str, Any]] = []
    for name in sensors:
        sensor = load_sensor(name)
        found = plan_bracket(sensor, **asked.given)
        alone = best_focus(sensor, "worst_blur_px", object_distance_mm=asked.object_distance_mm).value
        records.append({"sensor": sensor.name, "focus_mm": found.focus_mm, "worst_px_one_focus": alone, "worst_px_merged": found.blur_px.max(), "astigmatic_deg": found.omega_deg[found.astigmatic]})
        focuses = ", ".join(f"{focus:.1f}" for focus in found.focus_mm)
        table.add_row(sensor.name, f"{len(found.focus_mm)}", f"{alone:.2f}", f"{found.blur_px.max():.2f}", *_astigmatic(found), focuses)
    console.print(table)
    if json_file:
        write_json(json_file, records)
        say_written(json_file, console=console)


def _astigmatic(found: Bracket) -> tuple[str, str]:
    """Format the range of field angles without a sharp focus, and its minimum blur."""
    if not found.astigmatic.any():
        return "-", "-"
    low, high = found.omega_deg[found.astigmatic][[0, -1]]
    return f"{low:.0f} to {high:.0f}", f"{found.least_px.max():.2f}"


@command.command(cls=DocumentedCommand, page="restoration", examples=("omnimirror bracket merge paper-spherical a.png b.png --focus-mm 212,228 -o merged.png",))
@click.argument("sensor", type=SENSOR)
@click.argument("pictures", nargs=-1, required=True, type=click.Path(path_type=Path))
@takes(MergeOptions, "taken")
@takes(OrientationOptions, "orientation")
@output_option("-o", "--output", formats=PICTURES, required=True, help="Output image.")
@format_option(PICTURES)
def merge(sensor: str, pictures: tuple[Path, ...], taken: MergeOptions, orientation: OrientationOptions, output: Path) -> None:
    """Merge PICTURES of SENSOR, focused at different distances, at the scale of its own focus."""
    format_of(output)
    merged = merge_bracket(load_sensor(sensor), orientation.read(pictures), **taken.given)
    write_image(output, merged)
    say(f"{display_name(output)}: {len(pictures)} pictures merged")


@command.command(cls=DocumentedCommand, page="restoration", examples=("omnimirror bracket take paper-spherical --scene street --focus-mm 212,228 -o bracket",))
@click.argument("sensor", type=SENSOR)
@takes(SceneOptions, "scene")
@takes(TakeOptions, "taking")
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), required=True, help="Output folder.")
def take(sensor: str, scene: SceneOptions, taking: TakeOptions, output: Path) -> None:
    """Render the images of a scene that SENSOR would capture at each focus distance."""
    seen, camera = PosedScene(scene.source().load(), taking.stands or Pose()), load_sensor(sensor)
    for focus in plan_bracket(camera).focus_mm if taking.focus_mm is None else taking.focus_mm:
        path = output / f"{focus:.1f}mm.png"
        with rows_bar("Exposing") as progress:
            light = expose(focused_at(camera, float(focus)), seen, samples=taking.samples, blur=True, on_progress=progress)
        write_image(path, Detector().read(light))
        say(f"{path}: focused at {focus:.1f} mm")
