"""``omnimirror dewarp``: dewarping of images, folders of images, videos and ROS bags."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import click

from ....base.errors import OmnimirrorError
from ....base.files import write_text
from ....base.native import backend
from ....dewarp.image_files import DewarpedImages, ImageDewarper
from ....dewarp.request import DewarpRequest, PipeFormat, Recording, is_video
from ....interop.ros_bags.bag_files import is_bag
from ....io.images import format_of
from .._camera_options import AutoOptions, CameraOptions, OrientationOptions
from .._declarations import DocumentedCommand, Options, flag, option, takes
from .._option_types import NUMBER, WHOLE, distance, three_wavelengths
from .._output import PICTURES, frame_bar, notice, output_console, remark, say, take_standard_output
from .._view_options import SamplingOptions, ViewOptions

if TYPE_CHECKING:
    from ....dewarp.restoration.blur_kernels import BlurDiameters
    from ....dewarp.restoration.deblurring import Restoration


# -- Dewarping of ROS bags by ``omnimirror dewarp`` ------------------------------------------------


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
            name = "keep_topic" if changed[0] == "keep_topics" else changed[0]
            raise click.UsageError(f"{flag(name)} requires a ROS bag; got {source}")


def dewarp_recording(
    sources: tuple[str, ...],
    outputs: tuple[str, ...],
    how: DewarpRequest,
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
        {view.preset or view.view or "panorama": how.view}
        if bag.views is None
        else load_views(bag.views)
    )
    selection = BagSelection(views, bag.topic, bag.keep_topics or (), bag.mirror_frame)
    with frame_bar() as progress:
        result = run_bag_dewarping(Path(sources[0]), Path(outputs[0]), how, selection, progress)
    for note in result.notes:
        notice(note)
    copied = f", {result.copied} copied messages" if result.copied else ""
    say(f"{outputs[0]}: {result.images} images of {result.topic}{copied}")
    for topic in result.output_topics:
        say(f"  {topic}")
    if result.exit_code:
        notice(f"stopped; {outputs[0]} contains the messages dewarped so far")
        sys.exit(result.exit_code)


# -- HTML viewer output of ``omnimirror dewarp`` ---------------------------------------------------


def write_viewer(
    sources: tuple[str, ...], output: Path, options: CameraOptions, orientation: OrientationOptions
) -> None:
    """Write an HTML viewer of one image or video."""
    from ...studio import image_viewer, video_viewer

    is_film = is_video(sources[0]) and Path(sources[0]).is_file()
    if len(sources) > 1 or (is_video(sources[0]) and not is_film) or not is_one_picture(sources[0]):
        raise click.UsageError("--viewer holds one picture, or one video file")
    if output.suffix.lower() not in (".html", ".htm"):
        raise click.UsageError(
            f"--viewer writes an HTML file, such as {output.stem or 'view'}.html, and no {output}"
        )
    name, words = options.words()
    is_stored = orientation.stored_orientation
    if is_film:
        camera = options.drawing(options.camera(_size_of_video(sources[0], is_stored)))
        text = video_viewer(
            camera, name, words, Path(sources[0]), output, stored_orientation=is_stored
        )
    else:
        (picture,) = orientation.read([Path(sources[0])])
        camera = options.drawing(options.camera((picture.shape[1], picture.shape[0])))
        text = image_viewer(camera, name, words, Path(sources[0]), picture)
    write_text(output, text)
    say(f"{output}: open it in a browser to look around in {sources[0]}")


def is_one_picture(source: str) -> bool:
    """Return whether a source is a single file, not a folder or pattern."""
    return not Path(source).is_dir() and (Path(source).exists() or not set("*?[") & set(source))


def needs_pyav(source: str) -> OmnimirrorError:
    """Return the exception for a missing video reader."""
    return OmnimirrorError(
        f"{source} is a video, which needs PyAV: pip install 'omnimirror[video]'"
    )


def _size_of_video(source: str, is_stored: bool) -> tuple[int, int]:
    try:
        from ....io.video_reader import VideoReader
    except ModuleNotFoundError as e:
        if e.name != "av":
            raise
        raise needs_pyav(source) from None
    return VideoReader(source, with_sound=False, stored_orientation=is_stored).size


# -- ``omnimirror dewarp``: dewarping of images, folders of images, and videos ---------------------

PIPE_FORMATS = get_args(PipeFormat)


@dataclass(frozen=True)
class PictureOptions(Options):
    """Images."""

    skip_existing: bool | None = option(
        is_flag=True,
        help="Skip existing output files, which continues an interrupted folder or image sequence.",
    )
    transparent: bool | None = option(
        "--transparent/--black",
        help="Images: make pixels outside the field transparent.  [default: on if the format supports it: PNG, "
        "TIFF, WebP]",
    )
    restore: bool | None = option(
        is_flag=True,
        help="Images: restore (deconvolve) first, with the known blur of --sensor or with --blur-px.",
    )
    noise: float | None = option(
        type=NUMBER,
        metavar="SHARE",
        help="Noise for --restore, as a fraction of full scale.  [default: estimated]",
    )
    object_distance_mm: float | None = option(
        type=distance,
        metavar="MM",
        help="Object distance for --restore, from the mirror.  [default: inf]",
    )
    blur_px: str | None = option(
        metavar="PX|T,S|FILE",
        help="Blur for --restore with any camera: diameter, tangential and sagittal diameters, or a CSV file of "
        "radius_px or omega_deg, t_px and s_px.  [default: the blur of the sensor]",
    )

    wavelengths_nm: tuple[float, float, float] | None = option(
        type=three_wavelengths,
        metavar="R,G,B",
        help="Images of a --sensor: dewarp each colour channel with its own refraction by lens and cover.",
    )

    def check(self) -> None:
        """Raise UsageError for restoration options without --restore."""
        if not self.restore and (asked := self.picked("noise", "object_distance_mm", "blur_px")):
            raise click.UsageError(f"{flag(next(iter(asked)))} belongs to --restore")

    def restoration(self) -> Restoration | None:
        """Return the restoration settings; None without --restore."""
        if not self.restore:
            return None
        from ....dewarp.restoration.deblurring import Restoration

        return Restoration(
            self.noise,
            self.object_distance_mm,
            None if self.blur_px is None else _told(self.blur_px),
        )


@dataclass(frozen=True)
class VideoOptions(Options):
    """Videos."""

    start_s: float | None = option(
        "--start", "--start-s", type=NUMBER, help="Videos: start time in seconds.  [default: 0]"
    )
    duration_s: float | None = option(
        "--duration",
        "--duration-s",
        type=NUMBER,
        help="Videos: duration in seconds.  [default: the rest]",
    )
    frame_rate: float | None = option(
        type=NUMBER, help="Image sequences: frames per second.  [default: 25]"
    )
    codec: str | None = option(
        help="Videos: encoder by FFmpeg name.  [default: by the file suffix]"
    )
    crf: int | None = option(
        type=WHOLE,
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
        help="Videos: encoded pixel format by FFmpeg name.  [default: that of the source if the codec supports it; "
        "raw: rgb24]"
    )

    def recording(self, kind: str | None) -> Recording:
        """Return input range and output settings of a video; ``kind`` is the pipe format."""
        if kind is not None and kind not in PIPE_FORMATS:
            valid = ", ".join(PIPE_FORMATS)
            raise click.UsageError(
                f"--format {kind} belongs to pictures; of a video valid are {valid}"
            )
        return Recording(**self.given, pipe_format=kind)  # type: ignore[arg-type]


@click.command(
    cls=DocumentedCommand,
    page="dewarp",
    examples=(
        "omnimirror dewarp picture.jpg --auto -o panorama.png",
        "omnimirror dewarp picture.jpg --sensor mine.toml --view perspective --pan-deg 40 --hfov-deg 70 -o view.png",
        "omnimirror dewarp ride.mp4 --sensor mine.toml --view panorama -o straight.mp4",
    ),
)
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option(
    "-o",
    "--output",
    "outputs",
    multiple=True,
    help="Output: an image, or a folder for several; for videos also an address (udp://..., rtsp://...), a virtual "
    "camera (/dev/video9), an image sequence (f%04d.png) or - for a pipe (repeatable).",
)
@takes(AutoOptions, "auto")
@takes(CameraOptions, "camera")
@takes(ViewOptions, "view")
@takes(SamplingOptions, "sampling")
@takes(OrientationOptions, "orientation")
@takes(PictureOptions, "pictures")
@takes(VideoOptions, "video")
@takes(BagOptions, "bag")
@click.option(
    "--format",
    "kind",
    type=click.Choice([*PIPE_FORMATS, *PICTURES]),
    metavar="NAME",
    help=f"Format for '-o -': {', '.join(PIPE_FORMATS)}, or for an image {', '.join(PICTURES)}.  [default: y4m, png]",
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
    pictures: PictureOptions,
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
    for options in (view, pictures):
        options.check()
    if sampling.threads is not None:
        click.get_current_context().call_on_close(partial(backend.set_threads, backend.threads))
        backend.set_threads(sampling.threads)
    if viewer is not None:
        if auto.auto:
            raise click.UsageError("--viewer takes a camera that is known; leave out --auto")
        if pictures.restore:
            raise click.UsageError("--viewer holds the picture as it is; leave out --restore")
        write_viewer(sources, viewer, camera, orientation)
        if not outputs:
            return
    if not outputs and not video.preview:
        raise click.UsageError(
            "say what to write with -o or --viewer, or of a video ask for a --preview"
        )
    if pictures.skip_existing and outputs and all(Path(output).is_file() for output in outputs):
        remark(f"{', '.join(outputs)}: there already")
        return
    how = replace(
        straightening(camera, view, sampling), stored_orientation=orientation.stored_orientation
    )
    if is_bag(sources[0]):
        if orientation.stored_orientation:
            raise click.UsageError(
                "--stored-orientation belongs to images and videos; recordings hold no orientation"
            )
        _refuse_of_recordings(sources[0], auto, pictures, video, kind)
        dewarp_recording(sources, outputs, how, view, bag)
        return
    bag.refuse(sources[0])
    if is_video(sources[0]):
        auto.refuse_video(sources[0])
    if len(sources) == 1 and is_video(sources[0]):
        _refuse_of_pictures(sources[0], pictures)
        recording = replace(video.recording(kind), skip_existing=bool(pictures.skip_existing))
        _video(sources[0], outputs, how, recording)
    else:
        _refuse_of_videos(sources[0], outputs, sampling, pictures, video)
        restoration, output = pictures.restoration(), _output(sources, outputs[0], kind)
        told = ""
        if auto.auto:  # after all options are checked
            found, told = auto.camera(sources, camera, orientation)
            how = replace(how, camera=found)
        straightener = ImageDewarper(
            how,
            transparent=pictures.transparent,
            restoration=restoration,
            wavelengths_nm=pictures.wavelengths_nm,
        )
        _pictures(
            sources, output, straightener, bool(pictures.skip_existing), sampling.threads, told
        )


def straightening(
    camera: CameraOptions, view: ViewOptions, sampling: SamplingOptions
) -> DewarpRequest:
    """Return the dewarping settings of the options."""
    return DewarpRequest(
        camera.camera,
        view.of,
        sampling.interpolation,
        view.viewpoint or "exact",
        sampling.border,
        bool(camera.keep_lean),
    )


def _refuse_of_pictures(source: str, pictures: PictureOptions) -> None:
    if pictures.transparent is not None:
        raise click.UsageError(
            "--transparent and --black belong to pictures; videos have a --border"
        )
    if pictures.wavelengths_nm is not None:
        raise click.UsageError(
            f"--wavelengths-nm belongs to pictures, and {source} is a video, whose colours are coded together; "
            "a folder of its frames can be straightened so"
        )
    if pictures.restore:
        raise click.UsageError(
            f"--restore belongs to pictures, since it takes seconds for each, and {source} is a video; "
            "a folder of its frames can be restored"
        )


def _refuse_of_recordings(
    source: str, auto: AutoOptions, pictures: PictureOptions, video: VideoOptions, kind: str | None
) -> None:
    auto.refuse_video(source)
    if kind is not None:
        raise click.UsageError(
            f"--format says what '-' writes, and recordings such as {source} become files"
        )
    for options, of in ((pictures, "pictures"), (video, "videos")):
        if options.changed:
            raise click.UsageError(
                f"{flag(options.changed[0])} belongs to {of}, and {source} is a recording"
            )


def _refuse_of_videos(
    source: str,
    outputs: tuple[str, ...],
    sampling: SamplingOptions,
    pictures: PictureOptions,
    video: VideoOptions,
) -> None:
    if pictures.transparent is not None and sampling.border is not None:
        raise click.UsageError(
            "--border is the colour outside the field; leave out --transparent and --black"
        )
    if asked := list(video.given):
        raise click.UsageError(f"{flag(asked[0])} belongs to videos, and {source} is none")
    if len(outputs) > 1:
        raise click.UsageError(f"{outputs[1]} is one output too many: several belong to videos")


def _output(sources: tuple[str, ...], output: str, kind: str | None) -> tuple[Path, bool]:
    """Return the output path of images, and whether it is a single file rather than a folder."""
    if (
        len(sources) == 1
        and is_one_picture(sources[0])
        and not (Path(output).is_dir() or output.endswith("/"))
    ):
        return _named(output, kind), True
    return Path(output), False


def _pictures(
    sources: tuple[str, ...],
    output: tuple[Path, bool],
    straightener: ImageDewarper,
    is_going_on: bool,
    threads: int | None,
    told: str,
) -> None:
    """Dewarp one image to a file, or several to a folder; ``told`` is the report of the detected
    camera.
    """
    target, is_file = output
    if is_file:
        done = straightener(Path(sources[0]), target)
        _say_found(told)
        say(done)
        return
    with output_console().status("Straightening") as status:
        found = straightener.many(
            sources,
            target,
            skip_existing=is_going_on,
            threads=threads,
            progress=lambda done, of: status.update(f"Straightening: {done} of {of}"),
        )
    _say_found(told)
    _say_done(target, found, is_going_on)
    sys.exit(found.results.exit_code)


def _say_found(told: str) -> None:
    """Report the detected camera."""
    if told:
        remark(f"omnimirror: {told}")


def _say_done(folder: Path, found: DewarpedImages, is_going_on: bool) -> None:
    results = found.results
    for name, sentence in results.failed.items():
        notice(f"{name}: {sentence}")
    count = len(results.done) + len(results.failed) + len(results.not_begun)
    was_there = f", {found.was_there} were there" if is_going_on else ""
    say(f"{folder}: {len(results.done)} of {count} pictures straightened{was_there}")
    for words, how_many in found.oriented.items():
        say(f"{folder}: {how_many} of them {words}")
    for why, how_many in found.left_out.items():
        say(f"{folder}: {how_many} of them {why}")
    if results.not_begun:
        click.echo(f"omnimirror: stopped; {folder} holds what was done", err=True)


def _named(output: str, kind: str | None) -> Path:
    """Return the file name of one image; ``-`` gets the suffix of its format."""
    if kind in PIPE_FORMATS:
        raise click.UsageError(
            f"--format {kind} belongs to videos; of a picture valid are {', '.join(PICTURES)}"
        )
    if output != "-":
        if kind is not None:
            raise click.UsageError(
                "--format says what '-' writes; files are written as their suffix says"
            )
        format_of(output)  # raises before the image is read
        return Path(output)
    return take_standard_output("--output", kind or PICTURES[0])


def _told(blur_px: str) -> BlurDiameters | str:
    """Parse one or two numbers, or a file name."""
    try:
        numbers = [float(part) for part in blur_px.split(",")]
    except ValueError:
        return blur_px
    if len(numbers) > 2:
        raise click.UsageError(
            f"--blur-px {blur_px} has {len(numbers)} numbers; give one, T,S or a file"
        )
    return numbers


def _video(source: str, outputs: tuple[str, ...], how: DewarpRequest, recording: Recording) -> None:
    """Dewarp every frame of a video with a progress bar, and print the result."""
    try:
        from ....dewarp.video_files import Listener, dewarp_source
    except ModuleNotFoundError as e:
        if e.name != "av":
            raise
        raise needs_pyav(source) from None
    with frame_bar() as progress:
        listener = Listener(notice, progress)
        done = dewarp_source(source, outputs, how, recording, listener)
    name = (
        ", ".join("standard output" if output == "-" else output for output in outputs) or "preview"
    )
    (width, height), outcome = done.view.size, done.outcome
    told = f"{width} x {height} px, {outcome.frames} frames, {outcome.rate:.0f} a second"
    remark(f"{name}: {done.view}, {told}")
    if done.summary:
        remark(f"{source}: {done.summary}")
    if outcome.stopped and (outputs or outcome.is_signal):  # not a closed preview
        notice(f"stopped; {name} holds what was done" if outputs else "stopped")
        sys.exit(outcome.exit_code)
