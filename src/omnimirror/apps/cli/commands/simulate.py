"""``omnimirror simulate``: rendered images, videos and ground truth of a sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
from ....optics.camera_files import AnyCamera, load_camera
from ....optics.sensor_files import SENSOR_ENTRIES, bundled_sensors, load_sensor
from ....simulation.detector import Detector, Readout
from ....simulation.image_tiles import LIGHT
from ....simulation.radiometry import Radiometry
from ....simulation.rendering import render_light
from ....simulation.scenes.scene import DistantScene, Pose, PosedScene, Scene
from .._declarations import (
    INTEGER,
    SENSOR,
    DocumentedCommand,
    Options,
    add_options,
    file_entries,
    flag,
    is_set,
    option,
    setting,
)
from .._output import (
    IMAGE_FORMATS,
    count_bar,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_line,
    print_notice,
    print_written,
)
from .._scene_options import (
    DETECTOR,
    RenderingOptions,
    SceneOptions,
    TrajectoryOptions,
    pose,
)

if TYPE_CHECKING:
    from ....simulation.dataset_manifest import CalibrationRecipe, VideoRecipe
    from ....simulation.simulated_video import ImageSequence

IMAGE_ONLY = ("bits", "bayer", "wavelengths_nm")


class Simulate(click.Group):
    """Command group that treats the first argument as a sensor unless it names a command."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["image", *args]
        return super().parse_args(ctx, args)


@click.group(cls=Simulate)
def command() -> None:
    """Render the images that a sensor would capture.

    'omnimirror simulate SENSOR ...' is short for 'omnimirror simulate image SENSOR ...'.
    """


@dataclass(frozen=True)
class DistantOptions(Options):
    """Scene."""

    distant: bool = setting("scene", False)
    """Treat the scene as infinitely distant, without parallax."""


@command.command(
    "image",
    cls=DocumentedCommand,
    page="simulate",
    examples=(
        "omnimirror simulate paper-spherical --scene street --set detector.full_well_e=10000 -o circle.png",
        "omnimirror simulate mine.toml --path walk.csv -o walk.mp4",
    ),
)
@click.argument("sensor", type=SENSOR)
@add_options(SceneOptions, "scene")
@click.option(
    "--pose",
    "mirror_pose",
    type=pose,
    metavar="X,Y,Z,...",
    help="Mirror pose in the scene: position, mm; pan, tilt, roll, deg.  [default: 0,0,0]",
)
@add_options(TrajectoryOptions, "trajectory")
@add_options(DistantOptions, "distance")
@add_options(RenderingOptions, "rendering")
@file_entries("sensor file", SENSOR_ENTRIES)
@output_option(
    "--panorama",
    formats=IMAGE_FORMATS,
    help="Also write an equirectangular panorama of linear light.",
)
@output_option(
    "-o",
    "--output",
    formats=IMAGE_FORMATS,
    required=True,
    help="Image; EXR with ground truth; MP4 with --path.",
)
def image(
    sensor: str,
    scene: SceneOptions,
    mirror_pose: Pose | None,
    trajectory: TrajectoryOptions,
    distance: DistantOptions,
    rendering: RenderingOptions,
    changes: dict[str, Any],
    panorama: Path | None,
    output: Path,
) -> None:
    """Render the image, or the video, that SENSOR would capture of a scene.

    SENSOR is a sensor, or a calibrated camera, which is rendered without blur.

    An EXR file contains linear light (R, G, B) and, for the chief ray of each pixel centre:
    visibility of the scene (A) and obscuration by camera, rod, rim or lid (H); the point at which
    it leaves the mirror, or the outer surface of its tube or dome (OX, OY, OZ, mm), its direction
    there (DX, DY, DZ) and the distance to the observed point (Z, mm), in the world frame of the
    sensor.
    """
    loaded_scene, camera = scene.source().load(), load_camera(sensor, changes)
    if trajectory.path is not None:
        still_image_options = {
            "mirror_pose": mirror_pose,
            "panorama": panorama,
            **rendering.subset(*IMAGE_ONLY),
            "distant": distance.distant or None,
        }
        if given := [name for name, value in still_image_options.items() if value is not None]:
            raise click.UsageError(f"{flag(given[0])} requires an image, without --path")
        _render_video(camera, loaded_scene, output, trajectory, rendering)
        return
    if trajectory.given:
        raise click.UsageError(f"{flag(next(iter(trajectory.given)))} requires --path")
    if output.suffix.lower() in WRITABLE_VIDEO_SUFFIXES:
        raise click.UsageError(f"the video output {output} requires --path")
    posed = PosedScene(loaded_scene, mirror_pose or Pose())
    _render_image(
        camera, DistantScene(posed) if distance.distant else posed, output, rendering, panorama
    )


def _render_image(
    camera: AnyCamera,
    scene: Scene,
    output: Path,
    rendering: RenderingOptions,
    panorama: Path | None = None,
) -> None:
    """Render the image, convert it to the output format, and write it with the panorama of its
    light.
    """
    kind = format_of(output)
    is_light = "float32" in kind.depths and "uint8" not in kind.depths
    if is_light and (given := [name for name in rendering.subset(*DETECTOR) if name != "exposure"]):
        raise click.UsageError(
            f"{flag(given[0])} requires an integer image format; {output.suffix} files contain linear light"
        )
    detector, radiometry = rendering.detector(), rendering.radiometry()
    if detector.bits > 8 and not is_light and "uint16" not in kind.depths:
        raise click.UsageError(
            f"detector.bits must be at most 8 for {output.suffix}; got {detector.bits}; use .png or .tif"
        )
    if output.suffix.lower() == ".exr":
        from ....io.exr import check_exr_can_be_written

        check_exr_can_be_written(output)
    readout = None if is_light or panorama is not None else Readout(detector, rendering.seed)
    with count_bar("Rendering") as progress:
        light = render_light(
            camera,
            scene,
            LIGHT if readout is None else readout.conversion,
            samples=rendering.samples,
            blur=rendering.is_blurred(camera),
            radiometry=radiometry,
            seed=rendering.seed,
            on_progress=progress,
            wavelengths_nm=rendering.wavelengths_nm,
        )
    if readout is not None:
        write_image(output, readout.digital_values(light))
    elif not is_light:
        write_image(output, detector.read(light, rendering.seed))
    else:
        light *= detector.exposure
        _write_light(output, camera, scene, light, radiometry)
    width, height = camera.image_size
    print_line(f"{display_name(output)}: {width} x {height} px, {rendering.samples} rays per pixel")
    if panorama is not None:
        _write_panorama(
            camera, Detector(exposure=1.0 if is_light else detector.exposure).read(light), panorama
        )


def _write_light(
    output: Path, camera: AnyCamera, scene: Scene, light: Light, radiometry: Radiometry | None
) -> None:
    if output.suffix.lower() == ".exr":
        from ....simulation.datasets import write_truth

        write_truth(output, camera, scene, light, radiometry)
    else:
        write_image(output, light)


def _write_panorama(camera: AnyCamera, image: Any, output: Path) -> None:
    from ....dewarp import Dewarper, views

    dewarp = Dewarper(camera, views.panorama(camera), "cubic")
    panorama = dewarp(image)
    write_image(output, panorama)
    print_line(
        f"{display_name(output)}: {dewarp.view}, {panorama.shape[1]} x {panorama.shape[0]} px"
    )


def _render_video(
    camera: AnyCamera,
    scene: Scene,
    output: Path,
    trajectory: TrajectoryOptions,
    rendering: RenderingOptions,
) -> None:
    from ....simulation.simulated_video import write_video

    sequence = _sequence(camera, scene, trajectory, rendering)
    done = 0
    with count_bar("Rendering frames") as progress:

        def on_progress(count: int, total: int) -> None:
            nonlocal done
            done = count
            progress(done, total)

        try:
            write_video(sequence, output, on_progress=on_progress)
        except KeyboardInterrupt:
            _report_interruption(output, done, "frames")
            raise
    width, height = camera.image_size
    print_line(f"{output}: {width} x {height} px, {done} frames")


def _sequence(
    camera: AnyCamera, scene: Scene, trajectory: TrajectoryOptions, rendering: RenderingOptions
) -> ImageSequence:
    """Return the image sequence of the options."""
    from ....simulation.simulated_video import ImageSequence, load_path

    assert trajectory.path is not None
    return ImageSequence(
        camera=camera,
        scene=scene,
        path=load_path(trajectory.path),
        bodies=trajectory.moving(),
        frame_rate=trajectory.frame_rate,
        duration_s=trajectory.duration_s,
        samples=rendering.samples,
        blur=rendering.is_blurred(camera),
        radiometry=rendering.radiometry(),
        detector=rendering.detector(),
        seed=rendering.seed,
    )


def _report_interruption(output: Path, done: int, what: str) -> None:
    """Report the partial output after Ctrl-C and raise Abort."""
    state = f"contains {done} {what}" if done else "was not written"
    print_notice(f"{output} {state}")


@command.command(
    "dataset",
    cls=DocumentedCommand,
    page="simulate",
    examples=(
        "omnimirror simulate dataset paper-spherical --views 20 --set detector.full_well_e=10000 -o boards",
    ),
)
@click.argument("sensor", type=SENSOR, required=False)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Output folder.",
)
@click.option(
    "--reproduce",
    type=click.Path(path_type=Path),
    metavar="dataset.json",
    help="Reproduce a dataset with its stored sensor and options.",
)
@click.option("--views", type=INTEGER, help="Number of images of the hall.  [default: 12]")
@add_options(TrajectoryOptions, "trajectory")
@click.option(
    "--truth",
    is_flag=True,
    help="Write an EXR file with light, depth and directions for each image or frame.",
)
@add_options(SceneOptions, "scene")
@add_options(RenderingOptions, "rendering")
@file_entries("sensor file", SENSOR_ENTRIES)
def dataset(
    sensor: str | None,
    output: Path,
    reproduce: Path | None,
    views: int | None,
    trajectory: TrajectoryOptions,
    truth: bool,
    scene: SceneOptions,
    rendering: RenderingOptions,
    changes: dict[str, Any],
) -> None:
    """Write a calibration dataset, or with --path a video dataset, of SENSOR.

    A calibration dataset contains images of the checkerboards of the hall from many poses.
    dataset.json contains for each image its pose and the true pixels of the corners of all visible
    boards (7 rows of 11; null for a corner that is obscured or outside the field), and the
    positions of the corners in the hall (mm).

    A video dataset contains video.mp4 and poses.csv, the pose of the sensor at each frame, in the
    given scene.

    Repeating the same command continues an interrupted dataset. dataset.json also contains all
    settings that --reproduce requires to reproduce the files.
    """
    from ....simulation.dataset_manifest import VideoRecipe

    if reproduce is not None:
        recipe = _existing_recipe(reproduce)
    elif sensor is None:
        raise click.UsageError("SENSOR or --reproduce dataset.json must be given")
    else:
        recipe = _new_recipe(
            lambda: load_camera(sensor, changes), views, trajectory, truth, scene, rendering
        )
    if isinstance(recipe, VideoRecipe):
        _write_video_dataset(output, recipe)
    else:
        _write_calibration_dataset(output, recipe)


def _existing_recipe(dataset: Path) -> CalibrationRecipe | VideoRecipe:
    """Return the recipe of an existing dataset."""
    from importlib.metadata import version

    from ....simulation.dataset_manifest import load_recipe

    context = click.get_current_context()
    for name in context.params:
        source = context.get_parameter_source(name)
        if name not in ("reproduce", "output") and source == click.core.ParameterSource.COMMANDLINE:
            what = "SENSOR" if name == "sensor" else flag(name)
            raise click.UsageError(
                f"{what} and --reproduce must not be given together; {dataset} contains all settings"
            )
    if is_set():
        raise click.UsageError(
            f"--set and --reproduce must not be given together; {dataset} contains all settings"
        )
    manifest, installed = load_recipe(dataset), version("omnimirror")
    if manifest.created_with != installed:
        print_notice(
            f"{dataset} was written by omnimirror {manifest.created_with}; the files of {installed} may differ"
        )
    return manifest.recipe


def _new_recipe(
    sensor: Callable[[], AnyCamera],
    views: int | None,
    trajectory: TrajectoryOptions,
    truth: bool,
    scene: SceneOptions,
    rendering: RenderingOptions,
) -> CalibrationRecipe | VideoRecipe:
    """Return the recipe of the dataset for the options."""
    from ....simulation.dataset_manifest import CalibrationRecipe, VideoRecipe

    if rendering.wavelengths_nm is not None:
        raise click.UsageError("rendering.wavelengths_nm requires a single image, not a dataset")
    common: dict[str, Any] = {
        "samples": rendering.samples,
        "blur": rendering.blur,
        "seed": rendering.seed,
        "radiometry": rendering.radiometry(),
        "detector": rendering.detector(),
        "truth": truth,
    }
    if trajectory.path is None:
        source = click.get_current_context().get_parameter_source("scene")
        is_named = source == click.core.ParameterSource.COMMANDLINE
        if given := [
            name for name in (*scene.given, *trajectory.given) if name != "scene" or is_named
        ]:
            raise click.UsageError(
                f"{flag(given[0])} requires a video dataset with --path; the calibration dataset has a fixed scene"
            )
        return CalibrationRecipe(sensor=sensor(), views=12 if views is None else views, **common)
    from ....simulation.simulated_video import load_path

    if given := [*["views"] * (views is not None), *rendering.subset("bits", "bayer")]:
        raise click.UsageError(f"{flag(given[0])} requires a calibration dataset, without --path")
    return VideoRecipe(
        sensor=sensor(),
        scene=scene.source(),
        path=load_path(trajectory.path),
        bodies=trajectory.moving(),
        frame_rate=trajectory.frame_rate,
        duration_s=trajectory.duration_s,
        **common,
    )


def _write_calibration_dataset(output: Path, recipe: CalibrationRecipe) -> None:
    from ....simulation.datasets import write_calibration_dataset

    with _dataset_progress(output, "images") as on_progress:
        views = write_calibration_dataset(recipe, output, on_progress=on_progress)
    print_line(f"{output}: {views} images, sensor.toml and dataset.json")


def _write_video_dataset(output: Path, recipe: VideoRecipe) -> None:
    from ....simulation.datasets import write_video_dataset

    with _dataset_progress(output, "frames") as on_progress:
        frames = write_video_dataset(recipe, output, on_progress=on_progress)
    print_line(f"{output}: {frames} frames, sensor.toml, video.mp4, poses.csv and dataset.json")


@contextmanager
def _dataset_progress(output: Path, noun: str) -> Iterator[Callable[[int, int], None]]:
    """Show a progress bar of a dataset and yield its callback; report an interruption."""
    done = 0
    with count_bar(f"Rendering {noun}") as progress:

        def report(number: int, total: int) -> None:
            nonlocal done
            done = number
            progress(number, total)

        try:
            yield report
        except KeyboardInterrupt:
            _report_interruption(output, done, noun)
            raise


@dataclass(frozen=True)
class ShardOptions(Options):
    """Storage and execution."""

    per_shard: int = setting("storage", 100)
    workers: int = setting("execution", 1)


@command.command(
    "training",
    cls=DocumentedCommand,
    page="simulate",
    examples=(
        "omnimirror simulate training paper-spherical --path walk.csv --set video.bodies=carts.toml --spp 4 -o walk",
    ),
)
@click.argument("sensor", type=SENSOR)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Output folder.",
)
@add_options(TrajectoryOptions, "trajectory")
@add_options(ShardOptions, "storage")
@add_options(SceneOptions, "scene")
@add_options(RenderingOptions, "rendering")
@file_entries("sensor file", SENSOR_ENTRIES)
def training(
    sensor: str,
    output: Path,
    trajectory: TrajectoryOptions,
    storage: ShardOptions,
    scene: SceneOptions,
    rendering: RenderingOptions,
    changes: dict[str, Any],
) -> None:
    """Write a training dataset: images of SENSOR along a --path, with ground truth for each pixel.

    The dataset consists of WebDataset shards, tar files in which each frame has an image, its pose,
    and arrays: depth, directions and origins of the rays, normals, labels, and optical flow to the
    next frame. README.md describes the format.
    """
    from ....simulation.datasets import write_training_dataset

    if trajectory.path is None:
        raise click.UsageError("a training dataset requires --path")
    if rendering.wavelengths_nm is not None:
        raise click.UsageError("rendering.wavelengths_nm requires a single image, not a dataset")
    camera = load_camera(sensor, changes)
    sequence = _sequence(camera, scene.source().load(), trajectory, rendering)
    with count_bar("Rendering frames") as progress:
        try:
            shards = write_training_dataset(sequence, output, on_progress=progress, **storage.given)
        except KeyboardInterrupt:
            _report_interruption(output, len([*output.glob("set-*.tar")]), "shards")
            raise
    print_line(f"{output}: {shards[0].name} to {shards[-1].name}, sensor.toml and README.md")


@dataclass(frozen=True)
class RoundTripRendering(Options):
    """Rendering."""

    samples: int = option("--samples", "--spp", type=INTEGER, default=16, help="Rays per pixel.")


@command.command(
    "roundtrip",
    cls=DocumentedCommand,
    page="simulate",
    examples=("omnimirror simulate roundtrip paper-spherical paper-hyperboloidal",),
)
@click.argument("sensors", type=SENSOR, nargs=-1, metavar="[SENSOR...]")
@add_options(RoundTripRendering, "rendering")
@json_option()
def roundtrip(
    sensors: tuple[str, ...], rendering: RoundTripRendering, json_file: Path | None
) -> None:
    """Render a wall of the room at 800 mm, dewarp it, and compare it with a pinhole camera.

    The table contains the PSNR (dB, sRGB) of the sharp image dewarped exactly, with pixels of half
    the size, blurred by the aperture, and dewarped from the best single viewpoint; the fraction of
    the error due to blur; and the largest measured shifts with the prediction of Eq. 23. All
    bundled sensors are used unless SENSORS are given.
    """
    from ....simulation.round_trip import measure_round_trip

    heads = [f"{heading}\ndB" for heading in ("exact", "half pixels", "blurred", "single")] + [
        "due to blur\n%"
    ]
    heads += [f"shift, {heading}\npx" for heading in ("exact", "single", "Eq. 23")]
    table = plain_table("sensor", *heads, text_columns=("sensor",))
    console = output_console()
    records: list[dict[str, Any]] = []
    for name in sensors or bundled_sensors():
        try:
            with console.status(Text(f"Simulating {name}")):
                result = measure_round_trip(load_sensor(name), **rendering.given)
        except OutsideField as e:
            if name in sensors:
                raise
            print_notice(e)
            continue
        records.append({"sensor": name, "blur_fraction": result.blur_fraction} | asdict(result))
        decibels = (result.exact_db, result.finer_db, result.blurred_db, result.single_db)
        numbers = [*(f"{d:.1f}" for d in decibels), f"{100 * result.blur_fraction:.0f}"]
        numbers += [
            f"{np.abs(s).max():.2f}"
            for s in (result.exact_px, result.single_px, result.predicted_px)
        ]
        table.add_row(name, *("-" if number == "nan" else number for number in numbers))
    console.print(table)
    if json_file:
        write_json(json_file, records)
        print_written(json_file, console=console)
