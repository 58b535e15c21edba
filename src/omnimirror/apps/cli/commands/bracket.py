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
from .._declarations import (
    INTEGER,
    NUMBER,
    SENSOR,
    DocumentedCommand,
    Options,
    add_options,
    distance,
    option,
    values,
)
from .._output import (
    IMAGE_FORMATS,
    column_head,
    count_bar,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_line,
    print_written,
)
from .._scene_options import SceneOptions, pose


@dataclass(frozen=True)
class ObjectDistance(Options):
    """Object."""

    object_distance_mm: float = option(
        type=distance, metavar="MM", default=np.inf, help="Object distance from the mirror."
    )


@dataclass(frozen=True)
class PlanOptions(ObjectDistance):
    """Limits."""

    limit_px: float = option("--max-blur-px", type=NUMBER, default=1.0, help="Maximum blur, px.")


@dataclass(frozen=True)
class MergeOptions(ObjectDistance):
    """Capture."""

    focus_mm: Array = option(
        type=values,
        required=True,
        show_default=False,
        metavar="A,B,...",
        help="Focus distances of the images.",
    )


@dataclass(frozen=True)
class BracketRenderingOptions(Options):
    """Rendering."""

    focus_mm: Array | None = option(
        type=values,
        metavar="A,B,...",
        help="Focus distances.  [default: planned for a blur of 1 px]",
    )
    mirror_pose: Pose | None = option(
        "--pose",
        type=pose,
        metavar="X,Y,Z,...",
        help="Mirror pose in the scene: position, mm; pan, tilt, roll, deg.  [default: 0,0,0]",
    )
    samples: int = option("--samples", "--spp", type=INTEGER, default=32, help="Rays per pixel.")


@click.group()
def command() -> None:
    """Plan a focus bracket and merge its images by image radius into one sharp image."""


@command.command(
    cls=DocumentedCommand,
    page="restoration",
    examples=("omnimirror bracket plan paper-spherical --max-blur-px 2",),
)
@click.argument("sensors", type=SENSOR, nargs=-1, required=True)
@add_options(PlanOptions, "limits")
@json_option()
def plan(sensors: tuple[str, ...], limits: PlanOptions, json_file: Path | None) -> None:
    """Compute the minimum number of focus distances that keep the blur of SENSORS below a limit, and
    the astigmatic zones.
    """
    focus = column_head("focus_mm")
    numbers = (
        "images",
        "worst px\none focus",
        "worst px\nmerged",
        "astigmatic\ndeg",
        "min. px\nthere",
    )
    table = plain_table("sensor", *numbers, focus, text_columns=("sensor", focus))
    console = output_console()
    records: list[dict[str, Any]] = []
    for name in sensors:
        sensor = load_sensor(name)
        bracket = plan_bracket(sensor, **limits.given)
        alone = best_focus(
            sensor, "worst_blur_px", object_distance_mm=limits.object_distance_mm
        ).value
        records.append(
            {
                "sensor": sensor.name,
                "focus_mm": bracket.focus_mm,
                "worst_px_one_focus": alone,
                "worst_px_merged": bracket.blur_px.max(),
                "astigmatic_deg": bracket.omega_deg[bracket.astigmatic],
            }
        )
        focuses = ", ".join(f"{focus:.1f}" for focus in bracket.focus_mm)
        table.add_row(
            sensor.name,
            f"{len(bracket.focus_mm)}",
            f"{alone:.2f}",
            f"{bracket.blur_px.max():.2f}",
            *_astigmatic(bracket),
            focuses,
        )
    console.print(table)
    if json_file:
        write_json(json_file, records)
        print_written(json_file, console=console)


def _astigmatic(bracket: Bracket) -> tuple[str, str]:
    """Format the range of field angles without a sharp focus, and its minimum blur."""
    if not bracket.astigmatic.any():
        return "-", "-"
    low, high = bracket.omega_deg[bracket.astigmatic][[0, -1]]
    return f"{low:.0f} to {high:.0f}", f"{bracket.least_px.max():.2f}"


@command.command(
    cls=DocumentedCommand,
    page="restoration",
    examples=(
        "omnimirror bracket merge paper-spherical a.png b.png --focus-mm 212,228 -o merged.png",
    ),
)
@click.argument("sensor", type=SENSOR)
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path))
@add_options(MergeOptions, "capture")
@add_options(OrientationOptions, "orientation")
@output_option("-o", "--output", formats=IMAGE_FORMATS, required=True, help="Output image.")
def merge(
    sensor: str,
    images: tuple[Path, ...],
    capture: MergeOptions,
    orientation: OrientationOptions,
    output: Path,
) -> None:
    """Merge IMAGES of SENSOR, focused at different distances, at the scale of its own focus."""
    format_of(output)
    merged = merge_bracket(load_sensor(sensor), orientation.read(images), **capture.given)
    write_image(output, merged)
    print_line(f"{display_name(output)}: {len(images)} images merged")


@command.command(
    cls=DocumentedCommand,
    page="restoration",
    examples=(
        "omnimirror bracket render paper-spherical --scene street --focus-mm 212,228 -o bracket",
    ),
)
@click.argument("sensor", type=SENSOR)
@add_options(SceneOptions, "scene")
@add_options(BracketRenderingOptions, "rendering")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Output folder.",
)
def render(
    sensor: str, scene: SceneOptions, rendering: BracketRenderingOptions, output: Path
) -> None:
    """Render the images of a scene that SENSOR would capture at each focus distance."""
    posed, camera = (
        PosedScene(scene.source().load(), rendering.mirror_pose or Pose()),
        load_sensor(sensor),
    )
    for focus in (
        plan_bracket(camera).focus_mm if rendering.focus_mm is None else rendering.focus_mm
    ):
        path = output / f"{focus:.1f}mm.png"
        with count_bar("Exposing") as progress:
            light = expose(
                focused_at(camera, float(focus)),
                posed,
                samples=rendering.samples,
                blur=True,
                on_progress=progress,
            )
        write_image(path, Detector().read(light))
        print_line(f"{path}: focused at {focus:.1f} mm")
