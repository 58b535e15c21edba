"""``omnimirror simulate``: rendered images, videos and ground truth of a sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from rich.text import Text

from ....base.colour import Light
from ....base.errors import OutsideField
from ....base.files import display_name, write_json
from ....io import write_image
from ....io.batch import WRITABLE_VIDEO_SUFFIXES
from ....io.images import format_of
from ....optics.sensor_files import AnyCamera, bundled_sensors, load_camera, load_sensor
from ....simulation.detector import Detector, Readout
from ....simulation.image_tiles import LIGHT
from ....simulation.radiometry import Radiometry
from ....simulation.rendering import render_light
from ....simulation.scenes.scene import DistantScene, Pose, PosedScene, Scene
from .._declarations import DocumentedCommand, Options, flag, option, takes
from .._option_types import SENSOR, WHOLE
from .._output import PICTURES, format_option, json_option, notice, output_console, output_option, plain_table, say, say_written
from .._scene_options import DETECTOR, FilmOptions, SceneOptions, TakingOptions, pose, rows_bar
from .._sensor_options import HousingOptions

if TYPE_CHECKING:
    from ....simulation.dataset_manifest import CalibrationRecipe, VideoRecipe

OF_PICTURES = ("bits", "bayer", "wavelengths_nm")


class Simulate(click.Group):
    """Command group that treats the first argument as a sensor unless it names a command."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["picture", *args]
        return super().parse_args(ctx, args)


@click.group(cls=Simulate)
def command() -> None:
    """Render the images that a sensor would capture.

    'omnimirror simulate SENSOR ...' is short for 'omnimirror simulate picture SENSOR ...'.
    """


@command.command("picture", cls=DocumentedCommand, page="simulate", examples=("omnimirror simulate paper-spherical --scene street --full-well-e 10000 -o circle.png", "omnimirror simulate mine.toml --path walk.csv -o walk.mp4"))
@click.argument("sensor", type=SENSOR)
@takes(SceneOptions, "scene")
@click.option("--pose", "stands", type=pose, metavar="X,Y,Z,..", help="Mirror pose in the scene: position, mm; pan, tilt, roll, deg.  [default: 0,0,0]")
@takes(FilmOptions, "film")
@click.option("--distant", is_flag=True, help="Treat the scene as infinitely distant, without parallax.")
@takes(TakingOptions, "taking")
@takes(HousingOptions, "housing")
@output_option("--panorama", formats=PICTURES, help="Write a panorama of the light as well.")
@output_option("-o", "--output", formats=PICTURES, required=True, help="Output: PNG, JPEG, ...; HDR: light; EXR: light and ground truth; MP4 with --path.")
@format_option(PICTURES)
def picture(sensor: str, scene: SceneOptions, stands: Pose | None, film: FilmOptions, distant: bool, taking: TakingOptions, housing: HousingOptions, panorama: Path | None, output: Path) -> None:
    """Render the image, or the video, that SENSOR would capture of a scene.

    SENSOR is a sensor, or a calibrated camera, which is rendered without blur.

    An EXR file contains linear light (R, G, B) and, for the chief ray of each pixel centre:
    visibility of the scene (A) and obscuration by camera, rod, rim or lid (H); the point at which
    it leaves the mirror, or the outer surface of its tube or dome (OX, OY, OZ, mm), its direction
    there (DX, DY, DZ) and the distance to the observed point (Z, mm), in the world frame of the
    sensor.
    """
    seen, camera = scene.source().load(), housing.on(load_camera(sensor))
    if film.path is not None:
        named = {"pose": stands, "panorama": panorama, **taking.picked(*OF_PICTURES), "distant": distant or None}
        if asked := [name for name, value in named.items() if value is not None]:
            raise click.UsageError(f"{flag(asked[0])} belongs to pictures, not to a video along a --path")
        _film(camera, seen, output, film, taking)
        return
    if film.given:
        raise click.UsageError(f"{flag(next(iter(film.given)))} belongs to videos; give a --path")
    if output.suffix.lower() in WRITABLE_VIDEO_SUFFIXES:
        raise click.UsageError(f"{output} is a video, which needs a --path of poses")
    posed = PosedScene(seen, stands or Pose())
    _photograph(camera, DistantScene(posed) if distant else posed, output, taking, panorama)


def _photograph(camera: AnyCamera, scene: Scene, output: Path, taking: TakingOptions, panorama: Path | None = None) -> None:
    """Render the image, convert it to the output format, and write it with the panorama of its
    light.
    """
    kind = format_of(output)
    is_light = "float32" in kind.depths and "uint8" not in kind.depths
    if is_light and (asked := [name for name in taking.picked(*DETECTOR) if name != "exposure"]):
        raise click.UsageError(f"{flag(asked[0])} belongs to pictures of whole numbers, and {output.suffix} holds light")
    detector, radiometry = taking.detector(), taking.radiometry()
    if detector.bits > 8 and not is_light and "uint16" not in kind.depths:
        raise click.UsageError(f"{output.suffix} holds 8 bits; write .png or .tif for {detector.bits}")
    if output.suffix.lower() == ".exr":
        from ....io.exr import check_exr_can_be_written

        check_exr_can_be_written(output)
    readout = None if is_light or panorama is not None else Readout(detector, taking.seed)
    with rows_bar("Exposing") as progress:
        taken = render_light(camera, scene, LIGHT if readout is None else readout.conversion, samples=taking.samples, blur=taking.is_blurred(camera), radiometry=radiometry, seed=taking.seed, on_progress=progress, wavelengths_nm=taking.wavelengths_nm)
    if readout is not None:
        write_image(output, readout.digital_values(taken))
    elif not is_light:
        write_image(output, detector.read(taken, taking.seed))
    else:
        taken *= detector.exposure
        _write_light(output, camera, scene, taken, radiometry)
    width, height = camera.image_size
    say(f"{display_name(output)}: {width} x {height} px, {taking.samples} rays a pixel")
    if panorama is not None:
        _write_panorama(camera, Detector(exposure=1.0 if is_light else detector.exposure).read(taken), panorama)


def _write_light(output: Path, camera: AnyCamera, scene: Scene, light: Light, radiometry: Radiometry | None) -> None:
    if output.suffix.lower() == ".exr":
        from ....simulation.datasets import write_truth

        write_truth(output, camera, scene, light, radiometry)
    else:
        write_image(output, light)


def _write_panorama(camera: AnyCamera, picture: Any, output: Path) -> None:
    from ....dewarp import Dewarper, views

    dewarp = Dewarper(camera, views.panorama(camera), "cubic")
    straight = dewarp(picture)
    write_image(output, straight)
    say(f"{display_name(output)}: {dewarp.view}, {straight.shape[1]} x {straight.shape[0]} px")


def _film(camera: AnyCamera, scene: Scene, output: Path, film: FilmOptions, taking: TakingOptions) -> None:
    from ....simulation.simulated_video import load_path, write_video

    assert film.path is not None
    done = 0
    with rows_bar("Filming") as progress:

        def written(frame: Any, total: int) -> None:
            nonlocal done
            done = frame.number + 1
            progress(done, total)

        try:
            write_video(camera, scene, path=load_path(film.path), output=output, bodies=film.moving(), frame_rate=film.frame_rate, duration_s=film.duration_s, samples=taking.samples, blur=taking.is_blurred(camera), radiometry=taking.radiometry(), detector=taking.detector(), seed=taking.seed, on_frame=written)
        except KeyboardInterrupt:
            _stopped(output, done, "frames")
            raise
    width, height = camera.image_size
    say(f"{output}: {width} x {height} px, {done} frames")


def _stopped(output: Path, done: int, what: str) -> None:
    """Report the partial output after Ctrl-C and raise Abort."""
    held = f"holds the {done} {what} that were done" if done else "was not written"
    notice(f"{output} {held}")


@command.command("dataset", cls=DocumentedCommand, page="simulate", examples=("omnimirror simulate dataset paper-spherical --views 20 --full-well-e 10000 -o boards",))
@click.argument("sensor", type=SENSOR, required=False)
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), required=True, help="Output folder.")
@click.option("--again", type=click.Path(path_type=Path), metavar="dataset.json", help="Reproduce a dataset: its sensor and options, no others.")
@click.option("--views", type=WHOLE, help="Number of images of the hall.  [default: 12]")
@takes(FilmOptions, "film")
@click.option("--truth", is_flag=True, help="Write an EXR file with light, depth and directions for each image or frame.")
@takes(SceneOptions, "scene")
@takes(TakingOptions, "taking")
@takes(HousingOptions, "housing")
def dataset(sensor: str | None, output: Path, again: Path | None, views: int | None, film: FilmOptions, truth: bool, scene: SceneOptions, taking: TakingOptions, housing: HousingOptions) -> None:
    """Write a calibration dataset, or with --path a video dataset, of SENSOR.

    A calibration dataset contains images of the checkerboards of the hall from many poses.
    dataset.json contains for each image its pose and the true pixels of the corners of all visible
    boards (7 rows of 11; null for a corner that is obscured or outside the field), and the
    positions of the corners in the hall (mm).

    A video dataset contains video.mp4 and poses.csv, the pose of the sensor at each frame, in the
    given scene.

    Repeating the same command continues an interrupted dataset. dataset.json also contains all
    settings that --again requires to reproduce the files.
    """
    from ....simulation.dataset_manifest import VideoRecipe

    if again is not None:
        recipe = _made_before(again)
    elif sensor is None:
        raise click.UsageError("a set is taken with a SENSOR, or made --again from a dataset.json")
    else:
        recipe = _asked_for(lambda: housing.on(load_camera(sensor)), views, film, truth, scene, taking)
    if isinstance(recipe, VideoRecipe):
        _write_video_set(output, recipe)
    else:
        _write_calibration_set(output, recipe)


def _made_before(again: Path) -> CalibrationRecipe | VideoRecipe:
    """Return the recipe of an existing dataset."""
    from importlib.metadata import version

    from ....simulation.dataset_manifest import load_recipe

    context = click.get_current_context()
    for name in context.params:
        source = context.get_parameter_source(name)
        if name not in ("again", "output") and source == click.core.ParameterSource.COMMANDLINE:
            what = "a SENSOR" if name == "sensor" else flag(name)
            raise click.UsageError(f"{what} is not valid beside --again, which takes all from {again}")
    kept, this = load_recipe(again), version("omnimirror")
    if kept.created_with != this:
        notice(f"{again} is of omnimirror {kept.created_with}, and {this} may make other files")
    return kept.recipe


def _asked_for(sensor: Callable[[], AnyCamera], views: int | None, film: FilmOptions, truth: bool, scene: SceneOptions, taking: TakingOptions) -> CalibrationRecipe | VideoRecipe:
    """Return the recipe of the dataset for the options."""
    from ....simulation.dataset_manifest import CalibrationRecipe, VideoRecipe

    if taking.wavelengths_nm is not None:
        raise click.UsageError("--wavelengths-nm belongs to pictures, not to a set")
    common: dict[str, Any] = {"samples": taking.samples, "blur": taking.wants_blur, "seed": taking.seed, "radiometry": taking.radiometry(), "detector": taking.detector(), "truth": truth}
    if film.path is None:
        source = click.get_current_context().get_parameter_source("scene")
        is_named = source == click.core.ParameterSource.COMMANDLINE
        if asked := [name for name in (*scene.given, *film.given) if name != "scene" or is_named]:
            raise click.UsageError(f"{flag(asked[0])} belongs to a video set; give a --path, or take the hall as it is")
        return CalibrationRecipe(sensor=sensor(), views=12 if views is None else views, **common)
    from ....simulation.simulated_video import load_path

    if asked := [*["views"] * (views is not None), *taking.picked("bits", "bayer")]:
        raise click.UsageError(f"{flag(asked[0])} belongs to a calibration set, not to a video along a --path")
    return VideoRecipe(sensor=sensor(), scene=scene.source(), path=load_path(film.path), bodies=film.moving(), frame_rate=film.frame_rate, duration_s=film.duration_s, **common)


def _write_calibration_set(output: Path, recipe: CalibrationRecipe) -> None:
    from ....simulation.datasets import render_views

    views, done = recipe.views, 0
    with rows_bar("Taking pictures") as progress:
        try:
            for number, _ in enumerate(render_views(recipe, output), start=1):
                done = min(number, views)
                progress(done, views)
        except KeyboardInterrupt:
            _stopped(output, done, "pictures")
            raise
    say(f"{output}: {views} pictures, sensor.toml and dataset.json")


def _write_video_set(output: Path, recipe: VideoRecipe) -> None:
    from ....simulation.datasets import render_frames

    done = 0
    with rows_bar("Filming") as progress:

        def report(number: int, total: int) -> None:
            nonlocal done
            done = number
            progress(number, total)

        try:
            frames = render_frames(recipe, output, report)
        except KeyboardInterrupt:
            _stopped(output, done, "frames")
            raise
    say(f"{output}: {frames} frames, sensor.toml, video.mp4, poses.csv and dataset.json")


@dataclass(frozen=True)
class ShardOptions(Options):
    """Storage."""

    per_shard: int = option(type=WHOLE, default=100, help="Samples per tar file.")


@command.command("learning", cls=DocumentedCommand, page="simulate", examples=("omnimirror simulate learning paper-spherical --path walk.csv --bodies carts.toml --spp 4 -o walk",))
@click.argument("sensor", type=SENSOR)
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), required=True, help="Output folder.")
@takes(FilmOptions, "film")
@takes(ShardOptions, "stored")
@takes(SceneOptions, "scene")
@takes(TakingOptions, "taking")
@takes(HousingOptions, "housing")
def learning(sensor: str, output: Path, film: FilmOptions, stored: ShardOptions, scene: SceneOptions, taking: TakingOptions, housing: HousingOptions) -> None:
    """Write a training dataset: images of SENSOR along a --path, with ground truth for each pixel.

    The dataset consists of WebDataset shards, tar files in which each frame has an image, its pose,
    and arrays: depth, directions and origins of the rays, normals, labels, and optical flow to the
    next frame. README.md describes the format.
    """
    from ....simulation.datasets import write_training_dataset
    from ....simulation.simulated_video import load_path

    if film.path is None:
        raise click.UsageError("a set to learn from is taken along poses; give a --path")
    if taking.wavelengths_nm is not None:
        raise click.UsageError("--wavelengths-nm belongs to pictures, not to a set")
    camera, path, bodies = housing.on(load_camera(sensor)), load_path(film.path), film.moving()
    with rows_bar("Taking frames") as progress:
        try:
            shards = write_training_dataset(
                camera, scene.source().load(), path=path, folder=output, bodies=bodies, frame_rate=film.frame_rate, duration_s=film.duration_s, samples=taking.samples, blur=taking.is_blurred(camera), radiometry=taking.radiometry(), detector=taking.detector(), seed=taking.seed, on_progress=progress, **stored.given
            )
        except KeyboardInterrupt:
            _stopped(output, len([*output.glob("set-*.tar")]), "shards")
            raise
    say(f"{output}: {shards[0].name} to {shards[-1].name}, sensor.toml and README.md")


@dataclass(frozen=True)
class RoundTripOptions(Options):
    """Rendering."""

    samples: int = option("--samples", "--spp", type=WHOLE, default=16, help="Rays per pixel.")


@command.command("roundtrip", cls=DocumentedCommand, page="simulate", examples=("omnimirror simulate roundtrip paper-spherical paper-hyperboloidal",))
@click.argument("sensors", type=SENSOR, nargs=-1, metavar="[SENSOR...]")
@takes(RoundTripOptions, "taking")
@json_option()
def roundtrip(sensors: tuple[str, ...], taking: RoundTripOptions, json_file: Path | None) -> None:
    """Render a wall of the room at 800 mm, dewarp it, and compare it with a pinhole camera.

    The table contains the PSNR (dB, sRGB) of the sharp image dewarped exactly, with pixels of half
    the size, blurred by the aperture, and dewarped from the best single viewpoint; the fraction of
    the error due to blur; and the largest measured shifts with the prediction of Eq. 23. All
    bundled sensors are used unless SENSORS are given.
    """
    from ....simulation.round_trip import measure_round_trip

    heads = [f"{heading}\ndB" for heading in ("exact", "half pixels", "blurred", "single")] + ["of it blur\n%"]
    heads += [f"shift, {heading}\npx" for heading in ("exact", "single", "Eq. 23")]
    table = plain_table("sensor", *heads, words=("sensor",))
    console = output_console()
    records: list[dict[str, Any]] = []
    for name in sensors or bundled_sensors():
        try:
            with console.status(Text(f"Simulating {name}")):
                found = measure_round_trip(load_sensor(name), **taking.given)
        except OutsideField as e:
            if name in sensors:
                raise
            notice(e)
            continue
        records.append({"sensor": name, "blur_share": found.blur_share} | asdict(found))
        decibels = (found.exact_db, found.finer_db, found.blurred_db, found.single_db)
        numbers = [*(f"{d:.1f}" for d in decibels), f"{100 * found.blur_share:.0f}"]
        numbers += [f"{np.abs(s).max():.2f}" for s in (found.exact_px, found.single_px, found.predicted_px)]
        table.add_row(name, *("-" if number == "nan" else number for number in numbers))
    console.print(table)
    if json_file:
        write_json(json_file, records)
        say_written(json_file, console=console)
