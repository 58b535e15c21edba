"""``omnimirror dewarp``: dewarping of images, folders of images, videos and ROS bags."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import click

from ....base.errors import OmnimirrorError, extra_remedy
from ....base.files import write_text
from ....base.native import backend
from ....dewarp.image_files import DewarpedImages, ImageDewarper
from ....dewarp.request import DewarpRequest, PipeFormat, VideoSettings, is_video
from ....interop.ros_bags.bag_files import is_bag
from ....io.images import format_of
from .._camera_options import AutoOptions, CameraOptions, OrientationOptions
from .._declarations import DocumentedCommand, Options, add_options, flag, option
from .._option_types import INTEGER, NUMBER, distance, three_wavelengths
from .._output import (
    IMAGE_FORMATS,
    frame_rate_bar,
    output_console,
    print_line,
    print_notice,
    print_remark,
    take_standard_output,
)
from .._view_options import SamplingOptions, ViewOptions

if TYPE_CHECKING:
    from ....dewarp.restoration.blur_model import BlurDiameters
    from ....dewarp.restoration.deblurring import Restoration


# -- ROS bags --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BagOptions(Options):
    """Options for ROS bags."""

    topic: str | None = option(
        metavar="TOPIC", help="ROS bag: image topic.  [default: the only one]"
    )
    views: Path | None = option(
        type=click.Path(path_type=Path), help="ROS bag: TOML file of several named views."
    )
    keep_topics: tuple[str, ...] | None = option(
        "--keep-topic",
        multiple=True,
        metavar="PATTERN",
        help="ROS bag: topics to copy unchanged, such as '/odom*' or '*' (repeatable).",
    )
    mirror_frame: str | None = option(
        metavar="NAME",
        help="ROS bag: existing TF frame of the mirror, x forward, y left, z up.  [default: a new frame]",
    )

    def refuse(self, source: str) -> None:
        """Raise UsageError if options for ROS bags are given for another source."""
        if changed := self.changed:
            raise click.UsageError(f"{flag(changed[0])} requires a ROS bag; got {source}")


def dewarp_recording(
    sources: tuple[str, ...],
    outputs: tuple[str, ...],
    request: DewarpRequest,
    view: ViewOptions,
    bag: BagOptions,
) -> None:
    """Dewarp a ROS bag with a progress bar and print the written topics."""
    from ....interop.named_views import load_views
    from ....interop.ros_bags.dewarping import BagSelection, run_bag_dewarping

    if len(sources) > 1 or len(outputs) != 1:
        raise click.UsageError("a ROS bag must be dewarped alone, into one output")
    if bag.views is not None and view.given:
        raise click.UsageError(f"{flag(next(iter(view.given)))} must not be given with --views")
    views = (
        {view.preset or view.view or "panorama": request.view}
        if bag.views is None
        else load_views(bag.views)
    )
    selection = BagSelection(views, bag.topic, bag.keep_topics or (), bag.mirror_frame)
    with frame_rate_bar() as progress:
        result = run_bag_dewarping(Path(sources[0]), Path(outputs[0]), request, selection, progress)
    for note in result.notes:
        print_notice(note)
    copied = f", {result.copied} copied messages" if result.copied else ""
    print_line(f"{outputs[0]}: {result.images} images of {result.topic}{copied}")
    for topic in result.output_topics:
        print_line(f"  {topic}")
    if result.exit_code:
        print_notice(f"stopped; {outputs[0]} contains the messages dewarped so far")
        sys.exit(result.exit_code)


# -- HTML viewer -----------------------------------------------------------------------------------


def write_viewer(
    sources: tuple[str, ...], output: Path, options: CameraOptions, orientation: OrientationOptions
) -> None:
    """Write an HTML viewer of one image or video."""
    from ...studio import image_viewer, video_viewer

    is_video_file = is_video(sources[0]) and Path(sources[0]).is_file()
    if (
        len(sources) > 1
        or (is_video(sources[0]) and not is_video_file)
        or not is_single_file(sources[0])
    ):
        raise click.UsageError("--viewer requires one image or one video file")
    if output.suffix.lower() not in (".html", ".htm"):
        raise click.UsageError(
            f"--viewer must be an HTML file, such as {output.stem or 'view'}.html; got {output}"
        )
    name, arguments = options.command_words()
    is_stored = orientation.stored_orientation
    if is_video_file:
        camera = options.drawing(options.camera(_size_of_video(sources[0], is_stored)))
        text = video_viewer(
            camera, name, arguments, Path(sources[0]), output, stored_orientation=is_stored
        )
    else:
        (image,) = orientation.read([Path(sources[0])])
        camera = options.drawing(options.camera((image.shape[1], image.shape[0])))
        text = image_viewer(camera, name, arguments, Path(sources[0]), image)
    write_text(output, text)
    print_line(f"Wrote {output}; open it in a browser to view {sources[0]}")


def is_single_file(source: str) -> bool:
    """Return whether a source is a single file, not a folder or pattern."""
    return not Path(source).is_dir() and (Path(source).exists() or not set("*?[") & set(source))


def missing_pyav(source: str) -> OmnimirrorError:
    """Return the exception for a missing video reader."""
    return OmnimirrorError(f"reading the video {source} requires PyAV: {extra_remedy('video')}")


def _size_of_video(source: str, is_stored: bool) -> tuple[int, int]:
    try:
        from ....io.video_reader import VideoReader
    except ModuleNotFoundError as e:
        if e.name != "av":
            raise
        raise missing_pyav(source) from None
    return VideoReader(source, with_audio=False, stored_orientation=is_stored).size


# -- Command ---------------------------------------------------------------------------------------

PIPE_FORMATS = get_args(PipeFormat)


@dataclass(frozen=True)
class ImageFileOptions(Options):
    """Images."""

    skip_existing: bool | None = option(
        is_flag=True,
        help="Skip existing output files, which continues an interrupted folder or image sequence.",
    )
    transparent: bool | None = option(
        "--transparent/--black",
        help="Images: make pixels outside the field transparent.  [default: on if the format "
        "supports it: PNG, TIFF, WebP]",
    )
    restore: bool | None = option(
        is_flag=True,
        help="Images: restore (deconvolve) first, with the known blur of --sensor or with --blur-px.",
    )
    noise: float | None = option(
        type=NUMBER,
        metavar="FRACTION",
        help="Noise for --restore, as a fraction of full scale.  [default: estimated]",
    )
    object_distance_mm: float | None = option(
        type=distance,
        metavar="MM",
        help="Object distance for --restore, from the mirror.  [default: inf]",
    )
    blur_px: str | None = option(
        metavar="PX|T,S|FILE",
        help="Blur for --restore with any camera: diameter, tangential and sagittal diameters, "
        "or a CSV file of radius_px or omega_deg, t_px and s_px.  [default: the blur of "
        "the sensor]",
    )

    wavelengths_nm: tuple[float, float, float] | None = option(
        type=three_wavelengths,
        metavar="R,G,B",
        help="Images of a --sensor: dewarp each colour channel with its own refraction by lens and cover.",
    )

    def check(self) -> None:
        """Raise UsageError for restoration options without --restore."""
        if not self.restore and (given := self.subset("noise", "object_distance_mm", "blur_px")):
            raise click.UsageError(f"{flag(next(iter(given)))} requires --restore")

    def restoration(self) -> Restoration | None:
        """Return the restoration settings; None without --restore."""
        if not self.restore:
            return None
        from ....dewarp.restoration.deblurring import Restoration

        return Restoration(
            self.noise,
            self.object_distance_mm,
            None if self.blur_px is None else _blur_diameters(self.blur_px),
        )


@dataclass(frozen=True)
class VideoOptions(Options):
    """Videos."""

    start_s: float | None = option(type=NUMBER, help="Videos: start time in seconds.  [default: 0]")
    duration_s: float | None = option(
        type=NUMBER, help="Videos: duration in seconds.  [default: the rest]"
    )
    frame_rate: float | None = option(
        type=NUMBER, help="Image sequences: frames per second.  [default: 25]"
    )
    codec: str | None = option(
        help="Videos: encoder by FFmpeg name.  [default: by the file suffix]"
    )
    crf: int | None = option(
        type=INTEGER,
        help="Videos: constant rate factor, smaller is better.  [default: of the encoder]",
    )
    keyframes: Path | None = option(
        type=click.Path(path_type=Path),
        help="Videos: keyframes of pan, tilt, roll, field and distance, a CSV or TOML file.",
    )
    preview: bool | None = option(
        is_flag=True, help="Videos: show the view in a window; Escape ends it."
    )
    pixel_format: str | None = option(
        help="Videos: encoded pixel format by FFmpeg name.  [default: that of the source if the "
        "codec supports it; raw: rgb24]"
    )

    def settings(self, kind: str | None) -> VideoSettings:
        """Return input range and output settings of a video; ``kind`` is the pipe format."""
        if kind is not None and kind not in PIPE_FORMATS:
            valid = ", ".join(PIPE_FORMATS)
            raise click.UsageError(f"--format must be one of {valid} for a video; got {kind}")
        return VideoSettings(**self.given, pipe_format=kind)  # type: ignore[arg-type]


@click.command(
    cls=DocumentedCommand,
    page="dewarp",
    examples=(
        "omnimirror dewarp image.jpg --auto -o panorama.png",
        "omnimirror dewarp image.jpg --sensor mine.toml --view perspective --pan-deg 40 --hfov-deg 70 -o view.png",
        "omnimirror dewarp ride.mp4 --sensor mine.toml --view panorama -o panorama.mp4",
    ),
)
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option(
    "-o",
    "--output",
    "outputs",
    multiple=True,
    help="Output: an image, or a folder for several; for videos also an address (udp://..., "
    "rtsp://...), a virtual camera (/dev/video9), an image sequence (f%04d.png) or - for a "
    "pipe (repeatable).",
)
@add_options(AutoOptions, "auto")
@add_options(CameraOptions, "camera")
@add_options(ViewOptions, "view")
@add_options(SamplingOptions, "sampling")
@add_options(OrientationOptions, "orientation")
@add_options(ImageFileOptions, "images")
@add_options(VideoOptions, "video")
@add_options(BagOptions, "bag")
@click.option(
    "--format",
    "kind",
    type=click.Choice([*PIPE_FORMATS, *IMAGE_FORMATS]),
    metavar="NAME",
    help=f"Format for '-o -': {', '.join(PIPE_FORMATS)}; for an image {', '.join(IMAGE_FORMATS)}.  [default: y4m, png]",
)
@click.option(
    "--viewer",
    type=click.Path(dir_okay=False, path_type=Path),
    help="One image or video: write a self-contained HTML viewer.",
)
def command(
    sources: tuple[str, ...],
    outputs: tuple[str, ...],
    auto: AutoOptions,
    camera: CameraOptions,
    view: ViewOptions,
    sampling: SamplingOptions,
    orientation: OrientationOptions,
    images: ImageFileOptions,
    video: VideoOptions,
    bag: BagOptions,
    kind: str | None,
    viewer: Path | None,
) -> None:
    """Dewarp (undistort) each SOURCE, captured with a mirror sensor, a mirror ball or a fisheye.

    A SOURCE is an image, a folder or pattern of images, a video file, a camera or stream
    (/dev/video0, rtsp://...), an image sequence as a video (f%04d.png), a video on standard input
    (-), or a robot recording (.mcap, .db3, .bag, or a rosbag2 folder).

    Specify the camera with one of --sensor, --ocam and --ball, or use --auto to detect the outline
    of the mirror. The output is drawn from the viewpoint of the camera: never reversed, with
    forward at the centre of a panorama and at the top of a dome.
    """
    auto.check(camera)
    for options in (view, images):
        options.check()
    if sampling.threads is not None:
        click.get_current_context().call_on_close(partial(backend.set_threads, backend.threads))
        backend.set_threads(sampling.threads)
    if viewer is not None:
        if auto.auto:
            raise click.UsageError(
                "--viewer and --auto must not be given together; specify the camera"
            )
        if images.restore:
            raise click.UsageError("--viewer and --restore must not be given together")
        write_viewer(sources, viewer, camera, orientation)
        if not outputs:
            return
    if not outputs and not video.preview:
        raise click.UsageError("--output or --viewer must be given, or --preview for a video")
    if images.skip_existing and outputs and all(Path(output).is_file() for output in outputs):
        print_remark(f"{', '.join(outputs)}: exists, skipped")
        return
    request = replace(
        dewarp_request(camera, view, sampling), stored_orientation=orientation.stored_orientation
    )
    if is_bag(sources[0]):
        if orientation.stored_orientation:
            raise click.UsageError(
                "--stored-orientation requires images or videos; recordings contain no orientation"
            )
        _check_recording_options(sources[0], auto, images, video, kind)
        dewarp_recording(sources, outputs, request, view, bag)
        return
    bag.refuse(sources[0])
    if is_video(sources[0]):
        auto.refuse_video(sources[0])
    if len(sources) == 1 and is_video(sources[0]):
        _check_video_options(sources[0], images)
        settings = replace(video.settings(kind), skip_existing=bool(images.skip_existing))
        _dewarp_video(sources[0], outputs, request, settings)
    else:
        _check_image_options(sources[0], outputs, sampling, images, video)
        restoration, output = images.restoration(), _output(sources, outputs[0], kind)
        report = ""
        if auto.auto:  # after all options are checked
            detected, report = auto.camera(sources, camera, orientation)
            request = replace(request, camera=detected)
        dewarper = ImageDewarper(
            request,
            transparent=images.transparent,
            restoration=restoration,
            wavelengths_nm=images.wavelengths_nm,
        )
        _dewarp_images(
            sources, output, dewarper, bool(images.skip_existing), sampling.threads, report
        )


def dewarp_request(
    camera: CameraOptions, view: ViewOptions, sampling: SamplingOptions
) -> DewarpRequest:
    """Return the dewarping settings of the options."""
    return DewarpRequest(
        camera.camera,
        view.of,
        sampling.interpolation,
        view.viewpoint or "exact",
        sampling.border,
        bool(camera.keep_tilt),
    )


def _check_video_options(source: str, images: ImageFileOptions) -> None:
    if images.transparent is not None:
        raise click.UsageError("--transparent and --black require images; use --border for videos")
    if images.wavelengths_nm is not None:
        raise click.UsageError(
            f"--wavelengths-nm requires images; got the video {source}; extract its frames to a folder and dewarp them"
        )
    if images.restore:
        raise click.UsageError(
            f"--restore requires images; got the video {source}; extract its frames to a folder and restore them"
        )


def _check_recording_options(
    source: str, auto: AutoOptions, images: ImageFileOptions, video: VideoOptions, kind: str | None
) -> None:
    auto.refuse_video(source)
    if kind is not None:
        raise click.UsageError(
            f"--format requires '-' as the output; the recording {source} is dewarped to a file"
        )
    for options, kind_of_source in ((images, "images"), (video, "videos")):
        if options.changed:
            raise click.UsageError(
                f"{flag(options.changed[0])} requires {kind_of_source}; got the recording {source}"
            )


def _check_image_options(
    source: str,
    outputs: tuple[str, ...],
    sampling: SamplingOptions,
    images: ImageFileOptions,
    video: VideoOptions,
) -> None:
    if images.transparent is not None and sampling.border is not None:
        raise click.UsageError("--border must not be given together with --transparent or --black")
    if given := list(video.given):
        raise click.UsageError(f"{flag(given[0])} requires a video; got {source}")
    if len(outputs) > 1:
        raise click.UsageError(
            f"several outputs require a video; got the image output {outputs[1]} in addition"
        )


def _output(sources: tuple[str, ...], output: str, kind: str | None) -> tuple[Path, bool]:
    """Return the output path of images, and whether it is a single file rather than a folder."""
    if (
        len(sources) == 1
        and is_single_file(sources[0])
        and not (Path(output).is_dir() or output.endswith("/"))
    ):
        return _named(output, kind), True
    return Path(output), False


def _dewarp_images(
    sources: tuple[str, ...],
    output: tuple[Path, bool],
    dewarper: ImageDewarper,
    skip_existing: bool,
    threads: int | None,
    report: str,
) -> None:
    """Dewarp one image to a file, or several to a folder; ``report`` describes the detected
    camera.
    """
    target, is_file = output
    if is_file:
        done = dewarper(Path(sources[0]), target)
        _report_camera(report)
        print_line(done)
        return
    with output_console().status("Dewarping") as status:
        dewarped = dewarper.dewarp_many(
            sources,
            target,
            skip_existing=skip_existing,
            threads=threads,
            on_progress=lambda done, of: status.update(f"Dewarping: {done} of {of}"),
        )
    _report_camera(report)
    _print_results(target, dewarped, skip_existing)
    sys.exit(dewarped.results.exit_code)


def _report_camera(report: str) -> None:
    """Report the detected camera."""
    if report:
        print_remark(f"omnimirror: {report}")


def _print_results(folder: Path, dewarped: DewarpedImages, skip_existing: bool) -> None:
    results = dewarped.results
    for name, reason in results.failed.items():
        print_notice(reason if name in reason else f"{name}: {reason}")
    count = len(results.done) + len(results.failed) + len(results.not_started)
    existing = f", {dewarped.skipped} existed" if skip_existing else ""
    print_line(f"{folder}: {len(results.done)} of {count} images dewarped{existing}")
    for text, number in dewarped.oriented.items():
        print_line(f"{folder}: {number} of them {text}")
    for reason, number in dewarped.dropped_metadata.items():
        print_line(f"{folder}: {number} of them {reason}")
    if results.not_started:
        click.echo(f"omnimirror: stopped; {folder} contains the completed images", err=True)


def _named(output: str, kind: str | None) -> Path:
    """Return the file name of one image; ``-`` gets the suffix of its format."""
    if kind in PIPE_FORMATS:
        raise click.UsageError(
            f"--format must be one of {', '.join(IMAGE_FORMATS)} for an image; got {kind}"
        )
    if output != "-":
        if kind is not None:
            raise click.UsageError(
                "--format requires '-' as the output; the suffix of a file specifies its format"
            )
        format_of(output)  # raises before the image is read
        return Path(output)
    return take_standard_output("--output", kind or IMAGE_FORMATS[0])


def _blur_diameters(blur_px: str) -> BlurDiameters | str:
    """Parse one or two numbers, or a file name."""
    try:
        numbers = [float(part) for part in blur_px.split(",")]
    except ValueError:
        return blur_px
    if len(numbers) > 2:
        raise click.UsageError(f"--blur-px must be a diameter, T,S or a file; got {blur_px}")
    return numbers


def _dewarp_video(
    source: str, outputs: tuple[str, ...], request: DewarpRequest, settings: VideoSettings
) -> None:
    """Dewarp every frame of a video with a progress bar, and print the result."""
    try:
        from ....dewarp.video_files import VideoCallbacks, dewarp_source
    except ModuleNotFoundError as e:
        if e.name != "av":
            raise
        raise missing_pyav(source) from None
    with frame_rate_bar() as progress:
        callbacks = VideoCallbacks(print_notice, progress)
        done = dewarp_source(source, outputs, request, settings, callbacks)
    name = (
        ", ".join("standard output" if output == "-" else output for output in outputs) or "preview"
    )
    (width, height), outcome = done.view.size, done.outcome
    size = f"{width} x {height} px, {outcome.frames} frames, {outcome.rate:.0f} frames/s"
    print_remark(f"{name}: {done.view}, {size}")
    if done.summary:
        print_remark(f"{source}: {done.summary}")
    if outcome.is_stopped and (outputs or outcome.is_signal):  # not a closed preview
        print_notice(f"stopped; {name} contains the completed frames" if outputs else "stopped")
        sys.exit(outcome.exit_code)
