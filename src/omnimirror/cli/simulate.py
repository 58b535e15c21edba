"""``omnimirror simulate``: pictures, videos and ground truth that a sensor would take."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import click
import numpy as np

from ..errors import OmnimirrorError
from ..media import write_image
from ..media.images import format_of
from ..sensor import Sensor
from ..simulate import Distant, Placed, Pose, Scene, expose
from ..specs import load_sensor
from .options import flag
from .scene_options import (
    DETECTOR,
    SHELLS,
    behind_support,
    detector_of,
    hardware_of,
    picture_options,
    pose,
    rows_bar,
    scene_of,
    scene_options,
)

VIDEOS = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".ts")


class Simulate(click.Group):
    """What follows is a sensor, unless it is the name of a command."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["picture", *args]
        return super().parse_args(ctx, args)


@click.group(cls=Simulate)
def command() -> None:
    """Show what a sensor would see.

    'omnimirror simulate SENSOR ..' is short for 'omnimirror simulate picture SENSOR ..'.
    """


@command.command("picture")
@click.argument("sensor")
@scene_options
@click.option("--pose", "placed", type=pose, metavar="X,Y,Z,..",
              help="Where the mirror stands in the scene, mm, and pan, tilt, roll, deg.  [default: 0,0,0]")  # fmt: skip
@click.option("--path", type=click.Path(path_type=Path), help="Videos: poses over time, a CSV or TOML file.")
@click.option("--fps", type=float, help="Videos: frames a second.  [default: 25]")
@click.option("--duration-s", type=float, help="Videos: how long.  [default: to the last pose]")
@click.option("--distant", is_flag=True, help="Take the scene for infinitely far away: no parallax.")
@picture_options
@click.option("--panorama", type=click.Path(path_type=Path), help="Write its panorama, too.")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True,
              help="PNG, JPEG, ..; HDR for light; EXR for light and ground truth; MP4 for --path.")  # fmt: skip
def picture(sensor: str, scene: str, output: Path, **options: Any) -> None:
    """Take the picture, or the video, that SENSOR would take of a scene.

    An EXR file holds linear light (R, G, B) and for the centre of each pixel: whether it sees anything (A), the
    distance from the mirror to what it sees (Z, mm), the direction (DX, DY, DZ) and the point on the mirror it sees
    from (OX, OY, OZ, mm), in the sensor's world frame.
    """
    given = {name: value for name, value in options.items() if value is not None}
    seen, camera = scene_of(scene, given), load_sensor(sensor)
    if "path" in given:
        _film(camera, seen, output, given)
        return
    for name in ("fps", "duration_s"):
        if name in given:
            raise click.UsageError(f"{flag(name)} belongs to videos; give a --path")
    if output.suffix.lower() in VIDEOS:
        raise click.UsageError(f"{output} is a video, which needs a --path of poses")
    _photograph(camera, seen, output, given)


def _photograph(camera: Sensor, scene: Scene, output: Path, given: dict[str, Any]) -> None:
    kind = format_of(output)
    is_light = "float32" in kind.depths and "uint8" not in kind.depths
    if is_light and (asked := [name for name in DETECTOR if name in given and name != "exposure"]):
        raise click.UsageError(
            f"{flag(asked[0])} belongs to pictures of whole numbers, and {output.suffix} holds light"
        )
    detector = detector_of(given)
    if detector.bits > 8 and not is_light and "uint16" not in kind.depths:
        raise OmnimirrorError(f"{output.suffix} holds 8 bits; write .png or .tif for {detector.bits}")
    placed = behind_support(camera, Placed(scene, given.get("placed", Pose())), given)
    seen: Scene = Distant(placed) if given["distant"] else placed
    with rows_bar("Exposing") as progress:
        hardware, seed = hardware_of(camera, given), given["seed"]
        light = expose(camera, seen, given["samples"], given["blur"], hardware=hardware, seed=seed, progress=progress)
    if output.suffix.lower() == ".exr":
        _write_truth(camera, seen, detector.exposure * light, output)
    elif is_light:
        write_image(output, np.ascontiguousarray((detector.exposure * light)[..., ::-1]))
    else:
        write_image(output, _for_file(detector.read(light, given["seed"])))
    width, height = camera.image_size
    click.echo(f"{output}: {width} x {height} px, {given['samples']} rays a pixel")
    if "panorama" in given:
        _write_panorama(camera, _for_file(detector_of({}).read(detector.exposure * light)), given["panorama"])


def _for_file(picture: Any) -> Any:
    """In the order of files: blue, green, red."""
    return picture if picture.ndim == 2 else np.ascontiguousarray(picture[..., ::-1])


def _write_truth(camera: Sensor, scene: Scene, light: Any, output: Path) -> None:
    from ..files import replacing
    from ..media.exr import write_channels
    from ..simulate.truth import ground_truth

    truth = ground_truth(camera, scene)
    with replacing(output) as temporary:
        write_channels(temporary, truth.channels(light))


def _write_panorama(camera: Sensor, picture: Any, output: Path) -> None:
    from ..dewarp import Dewarper, views

    dewarp = Dewarper(camera, views.panorama(camera), "cubic")
    straight = dewarp(picture)
    write_image(output, straight)
    click.echo(f"{output}: {dewarp.view}, {straight.shape[1]} x {straight.shape[0]} px")


def _film(camera: Sensor, scene: Scene, output: Path, given: dict[str, Any]) -> None:
    for name in ("placed", "panorama", "bits", "bayer"):
        if name in given:
            shown = "pose" if name == "placed" else name
            raise click.UsageError(f"{flag(shown)} belongs to pictures, not to a video along a --path")
    if given["distant"] or given.get("support") in SHELLS:
        raise click.UsageError("--distant, tubes and domes belong to pictures, not to a video along a --path")
    try:
        from ..media.frames import frame_of_image
        from ..media.writer import VideoWriter
    except ModuleNotFoundError as e:
        if e.name != "av":
            raise
        raise OmnimirrorError(f"{output} is a video, which needs PyAV: install omnimirror[video]") from None
    from ..simulate.video import frame_at, frame_times, load_path

    path, rate, detector = load_path(given["path"]), given.get("fps", 25.0), detector_of(given)
    times = frame_times(path, rate, given.get("duration_s"))
    hardware, seed = hardware_of(camera, given), given["seed"]
    exact_rate = Fraction(rate).limit_denominator(1001)
    with rows_bar("Filming") as progress, VideoWriter(output, camera.image_size, exact_rate) as video:
        for number, time in enumerate(times):
            light = frame_at(camera, scene, path, time, given["samples"], given["blur"], hardware, seed + number)
            frame = frame_of_image(_for_file(detector.read(light, seed + number)))
            frame.pts, frame.time_base = number, 1 / exact_rate
            video.write(frame)
            progress(number + 1, len(times))
    width, height = camera.image_size
    click.echo(f"{output}: {width} x {height} px, {len(times)} frames")


@command.command("dataset")
@click.argument("sensor")
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), required=True, help="A folder.")
@click.option("--views", type=int, default=12, show_default=True, help="How many pictures.")
@picture_options
def dataset(sensor: str, output: Path, views: int, **options: Any) -> None:
    """Write a calibration set: pictures of the hall's checkerboards that SENSOR would take from many poses.

    dataset.json holds for each picture its pose and the true pixels of the corners of all boards in view (7 rows
    of 11; null where a corner is hidden or out of the field), and the corners' places in the hall (mm).
    """
    from ..simulate.dataset import write_calibration_set

    given = {name: value for name, value in options.items() if value is not None}
    if given.get("support") in SHELLS:
        raise click.UsageError("tubes and domes bend the rays of a set whose corners are true without; leave it out")
    camera = load_sensor(sensor)
    hardware, detector = hardware_of(camera, given), detector_of(given)
    with rows_bar("Taking pictures") as progress:
        written = write_calibration_set(
            camera, output, views, given["samples"], given["blur"], hardware, detector, given["seed"]
        )
        for number, _ in enumerate(written, start=1):
            progress(min(number, views), views)
    click.echo(f"{output}: {views} pictures, sensor.toml and dataset.json")


@command.command("roundtrip")
@click.argument("sensors", nargs=-1, required=True, metavar="SENSOR...")
@click.option("--samples", "--spp", type=int, default=16, show_default=True, help="Rays per pixel.")
def roundtrip(sensors: tuple[str, ...], samples: int) -> None:
    """Simulate the room's wall at 800 mm, straighten it, and compare with what a pinhole sees: a table.

    Decibels (sRGB) of the sharp picture straightened exactly, with pixels of half the size, blurred by the aperture,
    and straightened from the best single viewpoint; then the largest shifts found, and the one that Eq. 23 predicts.
    """
    from rich.table import Table

    from ..simulate.round_trip import round_trip
    from .options import output_console

    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("exact", "half pixels", "blurred", "single"):
        if heading == "exact":
            table.add_column("sensor", no_wrap=True)
        table.add_column(f"{heading}\ndB", justify="right")
    for heading in ("exact", "single", "Eq. 23"):
        table.add_column(f"shift, {heading}\npx", justify="right")
    console = output_console()
    for name in sensors:
        with console.status(f"Simulating {name}"):
            found = round_trip(load_sensor(name), samples)
        decibels = (found.exact_db, found.finer_db, found.blurred_db, found.single_db)
        shifts = (np.abs(s).max() for s in (found.exact_px, found.single_px, found.predicted_px))
        table.add_row(name, *(f"{d:.1f}" for d in decibels), *(f"{s:.2f}" for s in shifts))
    console.print(table)
