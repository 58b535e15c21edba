"""``omnimirror dewarp``: dewarping of images, folders of images, videos and ROS bags."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import partial
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

import click
import numpy as np

from ....base.errors import InvalidParameter, OmnimirrorError, extra_remedy
from ....base.files import write_text
from ....base.native import MAX_THREADS, backend
from ....cameras.camera import Camera
from ....dewarp import views
from ....dewarp.image_files import DewarpedImages, ImageDewarper
from ....dewarp.interfaces import INTERPOLATIONS, Interpolation
from ....dewarp.request import (
    BorderColour,
    DewarpRequest,
    PipeFormat,
    VideoSettings,
    is_video,
    without_tilt,
)
from ....dewarp.screens import Layout, Pole, Rows, Shape
from ....dewarp.view_geometry import Viewpoint
from ....dewarp.views import PartialSize
from ....interop.ros_bags.bag_files import is_bag
from ....io.images import format_of
from .._camera_options import AutoOptions, CameraOptions, OrientationOptions
from .._declarations import (
    NUMBER,
    DocumentedCommand,
    IntegerRange,
    Options,
    add_options,
    angle,
    angle_range,
    distance,
    factor,
    file_entries,
    flag,
    height,
    height_range,
    image_size,
    offset,
    option,
    refuse_inapplicable,
    setting,
    three_wavelengths,
    viewpoint,
)
from .._output import (
    IMAGE_FORMATS,
    frame_rate_bar,
    output_console,
    print_line,
    print_notice,
    print_remark,
    take_standard_output,
)

if TYPE_CHECKING:
    from ....dewarp.restoration.deblurring import Restoration
    from ....interop.ros_bags.dewarping import BagSelection
    from ....optics.camera_files import AnyCamera


# -- View ------------------------------------------------------------------------------------------

PLACE_OPTIONS = ("distance_mm", "offset_mm")
VIEW_OPTIONS: dict[str, tuple[str, ...]] = {
    "panorama": (
        "pan_deg",
        "span_deg",
        "elevation_deg",
        "omega_deg",
        "rows",
        "wall_mm",
        "zoom",
        *PLACE_OPTIONS,
    ),
    "perspective": ("pan_deg", "tilt_deg", "roll_deg", "hfov_deg", "zoom", *PLACE_OPTIONS),
    "dome": ("pan_deg", "omega_deg", "pole", "zoom", *PLACE_OPTIONS),
    "sphere": ("pan_deg", "span_deg", "elevation_deg", "omega_deg", "zoom", *PLACE_OPTIONS),
    "ground": ("pan_deg", "height_mm", "mm_per_px", "zoom", "offset_mm"),
    "planet": ("pan_deg", "hfov_deg", "pole", "zoom", *PLACE_OPTIONS),
    "cube": ("pan_deg", "layout", *PLACE_OPTIONS),
    "mosaic": ("pan_deg", "tilt_deg", "hfov_deg", "elevation_deg", *PLACE_OPTIONS),
    **dict.fromkeys(views.PRESETS, ("pan_deg", "tilt_deg", "zoom", *PLACE_OPTIONS)),
}


@dataclass(frozen=True)
class ViewOptions(Options):
    """View."""

    view: str | None = option(
        type=click.Choice([*views.VIEWS, *views.PRESETS]),
        metavar="NAME",
        help=f"View: {', '.join(views.VIEWS)}; of the paper: "
        f"{', '.join(views.PRESETS)}.  [default: panorama]",
    )
    pan_deg: float | None = option(
        type=angle, metavar="DEG", help="Azimuth of the centre, right of forward.  [default: 0]"
    )
    tilt_deg: float | None = option(
        type=angle,
        metavar="DEG",
        help="Elevation of the centre of a perspective view.  [default: 0]",
    )
    hfov_deg: float | None = option(
        type=angle,
        metavar="DEG",
        help="Horizontal field, perspective or planet.  [default: 90; planet: all]",
    )
    elevation_deg: tuple[float, float] | None = option(
        type=angle_range,
        metavar="MIN:MAX",
        help="Elevations of a panorama.  [default: the field of the camera]",
    )
    distance_mm: float | None = option(
        type=distance, metavar="MM", help="Object distance without parallax.  [default: inf]"
    )
    size: PartialSize | None = option(
        type=image_size,
        metavar="WxH",
        help="Output size, also 1440x or x360.  [default: resolution of the image]",
    )
    roll_deg: float | None = setting("view", type=angle)
    span_deg: float | None = setting("view", type=angle)
    omega_deg: tuple[float, float] | None = setting("view", type=angle_range)
    rows: Rows | None = setting("view")
    wall_mm: tuple[float, float] | None = setting("view", type=height_range)
    offset_mm: tuple[float, float, float] | None = setting("view", type=offset)
    viewpoint: Viewpoint | None = setting("view", type=viewpoint)
    height_mm: float | None = setting("view", type=height)
    mm_per_px: float | None = setting("view", type=distance)
    pole: Pole | None = setting("view")
    layout: Layout | None = setting("view")
    zoom: float | None = setting("view", type=factor)
    allow_upsampling: bool | None = setting("view")

    @property
    def name(self) -> str:
        """Name of the view or preset."""
        return self.view or "panorama"

    @property
    def is_near(self) -> bool:
        """True if the object distance is finite."""
        return self.distance_mm is not None and bool(np.isfinite(self.distance_mm))

    def check(self) -> None:
        """Raise UsageError for options that do not apply to the selected view or contradict each
        other.
        """
        chosen = f"--view {self.name}"
        owners = {f"--view {view}": names for view, names in VIEW_OPTIONS.items()} | {
            chosen: options_of(self.name)
        }
        refuse_inapplicable(self.given, owners, chosen)
        if self.elevation_deg and self.omega_deg:
            raise click.UsageError(
                "--elevation-deg and --set view.omega_deg must not be given together"
            )
        if self.wall_mm:
            self._check_wall()
        if chosen == "--view ground" and self.height_mm is None:
            raise click.UsageError(
                "--view ground requires --set view.height_mm=MM, the height of the mirror above "
                "the ground"
            )
        if self.allow_upsampling and self.zoom is None:
            raise click.UsageError("--set view.allow_upsampling requires --set view.zoom")
        if self.viewpoint is not None and chosen != "--view ground" and not self.is_near:
            raise click.UsageError(
                "--set view.viewpoint requires --distance-mm; it has no effect on a distant screen"
            )

    def _check_wall(self) -> None:
        if other := self.subset("elevation_deg", "omega_deg", "rows"):
            raise click.UsageError(
                f"--set view.wall_mm and {flag(next(iter(other)))} must not be given together"
            )
        if not self.is_near:
            raise click.UsageError(
                "--set view.wall_mm requires --distance-mm, the distance of the wall"
            )

    def of(self, camera: Camera) -> Shape:
        """Return the view of a camera; a limited zoom is reported on stderr."""
        view: Shape
        options = self.subset(
            "size", *(option for option in options_of(self.name) if option != "zoom")
        )
        if self.name in views.PRESETS:
            view = views.preset(self.name, **options)
        else:
            view = _create_view(self.name, camera, options)
        return (
            view
            if self.zoom is None
            else _zoom(camera, view, self.zoom, bool(self.allow_upsampling))
        )


def options_of(view: str) -> tuple[str, ...]:
    """Return the options of a view; for a view of another package, those among its keyword
    arguments.
    """
    if view in VIEW_OPTIONS:
        return VIEW_OPTIONS[view]
    option_names = {f.name for f in fields(ViewOptions)} - {"view", "zoom"}
    return (
        *(name for name in signature(views.VIEWS[view]).parameters if name in option_names),
        "zoom",
    )


def _create_view(name: str, camera: Camera, options: dict[str, Any]) -> Any:
    """Return the named view, with command-line options converted to its arguments."""
    if name in ("panorama", "sphere"):
        _elevations_of_omega(camera, options)
    if "wall_mm" in options:
        low, high = options.pop("wall_mm")
        if not low < high:
            raise click.UsageError(
                f"view.wall_mm must be LOW:HIGH with LOW below HIGH; got {low:g}:{high:g}"
            )
        elevations = np.degrees(np.arctan2([low, high], options["distance_mm"]))
        options |= {"rows": "height", "elevation_deg": tuple(map(float, elevations))}
    return views.VIEWS[name](camera, **options)


def _elevations_of_omega(camera: Camera, options: dict[str, Any]) -> None:
    """Convert angles from the camera axis to elevations (deg); the axis must be vertical, apart
    from tilt.
    """
    if "omega_deg" not in options:
        return
    up = without_tilt(cast("AnyCamera", camera)).axis[2]
    if abs(up) < 0.5:
        raise click.UsageError(
            "--set view.omega_deg requires a camera that looks up or down for a panorama; use "
            "--elevation-deg"
        )
    low, high = sorted(up * (90 - omega) for omega in options.pop("omega_deg"))
    options["elevation_deg"] = (low, high)


def _zoom(camera: Camera, view: Shape, zoom: float, allow_upsampling: bool) -> Shape:
    maximum = views.max_zoom(camera, view)
    if zoom > maximum:
        magnification = zoom / views.resolution(camera, view)
        limited = (
            ""
            if allow_upsampling
            else f"; limited to {maximum:.3g}; use --set view.allow_upsampling=true to remove the limit"
        )
        click.echo(
            f"omnimirror: zoom {zoom:g} exceeds the resolution of the sensor "
            f"({magnification:.1f} output pixels per source pixel){limited}",
            err=True,
        )
        zoom = zoom if allow_upsampling else maximum
    return view.zoomed(zoom)


# -- Resampling ------------------------------------------------------------------------------------


def border(text: str) -> BorderColour:
    """Parse a grey level, ``R,G,B``, or ``#rrggbb``.

    >>> border("16").values, border("255,128,0").values, border("#ff8000").values
    ((16.0,), (255.0, 128.0, 0.0), (255.0, 128.0, 0.0))
    """
    try:
        return BorderColour.of(text)
    except InvalidParameter as e:
        raise click.BadParameter(str(e)) from None


@dataclass(frozen=True)
class SamplingOptions(Options):
    """Resampling."""

    interpolation: Interpolation = option(
        type=click.Choice(list(INTERPOLATIONS)),
        default="auto",
        metavar="NAME",
        help=f"Interpolation: {', '.join(INTERPOLATIONS)}.",
    )
    border: BorderColour | None = option(
        type=border,
        metavar="COLOUR",
        help="Colour outside the field: a grey level, R,G,B or #rrggbb.",
    )
    threads: int | None = setting("resampling", type=IntegerRange(1, MAX_THREADS))


# -- ROS bags --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BagOptions(Options):
    """ROS bags."""

    views: Path | None = option(
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="ROS bags: TOML file of several views.",
    )
    topic: str | None = setting("bag")
    keep_topics: str | tuple[str, ...] | None = setting("bag")
    mirror_frame: str | None = setting("bag")

    def selection(
        self, view: ViewOptions, request: DewarpRequest, changes: dict[str, Any]
    ) -> BagSelection:
        """Return the topics and views of a bag; ``changes`` are those of the file of views."""
        from ....interop.named_views import load_views
        from ....interop.ros_bags.dewarping import BagSelection

        if self.views is not None and view.given:
            raise click.UsageError(f"{flag(next(iter(view.given)))} must not be given with --views")
        name = view.name.replace("-", "_")
        views = {name: request.view} if self.views is None else load_views(self.views, changes)
        keep = self.keep_topics or ()
        topics = tuple(keep.split(",")) if isinstance(keep, str) else keep
        return BagSelection(views, self.topic, topics, self.mirror_frame)

    def refuse(self, source: str) -> None:
        """Raise UsageError if options for ROS bags are given for another source."""
        if changed := self.changed:
            raise click.UsageError(f"{flag(changed[0])} requires a ROS bag; got {source}")


def dewarp_recording(
    sources: tuple[str, ...],
    outputs: tuple[str, ...],
    request: DewarpRequest,
    selection: BagSelection,
) -> None:
    """Dewarp a ROS bag with a progress bar and print the written topics."""
    from ....interop.ros_bags.dewarping import run_bag_dewarping

    if len(sources) > 1 or len(outputs) != 1:
        raise click.UsageError("a ROS bag must be dewarped alone, into one output")
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
        raise click.UsageError(f"{output}: an HTML viewer requires one image or one video file")
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


def is_viewer(output: str) -> bool:
    """Return whether an output is an HTML viewer.

    >>> is_viewer("room.HTML"), is_viewer("room.png"), is_viewer("http://server/view.html")
    (True, False, False)
    """
    is_file = "://" not in output and not Path(output).is_dir()
    return is_file and Path(output).suffix.lower() in (".html", ".htm")


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

    restore: bool | None = option(
        is_flag=True, help="Images: remove the blur of the sensor (deconvolution)."
    )
    skip_existing: bool | None = option(is_flag=True, help="Skip existing output files.")
    transparent: bool | None = setting("image")
    wavelengths_nm: tuple[float, float, float] | None = setting("image", type=three_wavelengths)
    noise: float | None = setting("restoration")
    object_distance_mm: float | None = setting("restoration", type=distance)
    blur_px: float | tuple[float, float] | str | None = setting("restoration")

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
            self.blur_px,
        )


@dataclass(frozen=True)
class VideoOptions(Options):
    """Videos."""

    start_s: float | None = option(
        type=NUMBER, metavar="S", help="Videos: start time.  [default: 0]"
    )
    duration_s: float | None = option(
        type=NUMBER, metavar="S", help="Videos: duration.  [default: to the end]"
    )
    keyframes: Path | None = option(
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Videos: pan, tilt, roll, field and distance over time, CSV or TOML.",
    )
    preview: bool | None = option(
        is_flag=True, help="Videos: show the view in a window; Escape ends it."
    )
    frame_rate: float | None = setting("video")
    codec: str | None = setting("video")
    crf: int | None = setting("video")
    pixel_format: str | None = setting("video")

    def settings(self, kind: str | None) -> VideoSettings:
        """Return input range and output settings of a video; ``kind`` is the pipe format."""
        if kind is not None and kind not in PIPE_FORMATS:
            raise click.UsageError(_wrong_format("a video", PIPE_FORMATS, kind))
        return VideoSettings(**self.given, pipe_format=kind)  # type: ignore[arg-type]  # types of the keywords depend on their names


@click.command(
    cls=DocumentedCommand,
    page="dewarp",
    examples=(
        "omnimirror dewarp image.jpg --auto -o panorama.png",
        "omnimirror dewarp ride.mp4 --sensor mine.toml --view perspective --pan-deg 40 -o right.mp4",
    ),
)
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option(
    "-o",
    "--output",
    "outputs",
    multiple=True,
    help="Image, folder, video, stream, ROS bag, HTML viewer, or - (repeatable).",
)
@file_entries("--views file", None, given_by="views")
@add_options(CameraOptions, "camera")
@add_options(AutoOptions, "auto", group="Camera")
@add_options(ViewOptions, "view")
@add_options(SamplingOptions, "sampling", group="View")
@add_options(OrientationOptions, "orientation")
@add_options(ImageFileOptions, "images", group="Files")
@add_options(VideoOptions, "video", group="Files")
@add_options(BagOptions, "bag", group="Files")
def command(
    sources: tuple[str, ...],
    outputs: tuple[str, ...],
    changes: dict[str, Any],
    camera: CameraOptions,
    auto: AutoOptions,
    view: ViewOptions,
    sampling: SamplingOptions,
    orientation: OrientationOptions,
    images: ImageFileOptions,
    video: VideoOptions,
    bag: BagOptions,
) -> None:
    """Dewarp (undistort) each SOURCE with the camera of --sensor, --ball or --auto: an image, a
    folder, a pattern of files, a video, a stream, or a ROS bag.
    """
    # More than 60 lines: the options of the command and its dispatch by kind of input.
    outputs, kind = _split_format(outputs)
    auto.check(camera)
    for options in (view, images):
        options.check()
    if sampling.threads is not None:
        click.get_current_context().call_on_close(partial(backend.set_threads, backend.threads))
        backend.set_threads(sampling.threads)
    if not outputs and not video.preview:
        raise click.UsageError("--output must be given, or --preview for a video")
    if viewers := [Path(output) for output in outputs if is_viewer(output)]:
        if auto.auto or images.restore:
            other = "--auto" if auto.auto else "--restore"
            raise click.UsageError(f"{other} does not apply to the HTML viewer {viewers[0]}")
        for viewer in viewers:
            write_viewer(sources, viewer, camera, orientation)
        outputs = tuple(output for output in outputs if not is_viewer(output))
        if not outputs:
            return
    if images.skip_existing and outputs and all(Path(output).is_file() for output in outputs):
        print_remark(f"{', '.join(outputs)}: exists, skipped")
        return
    request = replace(
        dewarp_request(camera, view, sampling), stored_orientation=orientation.stored_orientation
    )
    if is_bag(sources[0]):
        if orientation.stored_orientation:
            raise click.UsageError(
                "--set input.stored_orientation requires images or videos; recordings contain no "
                "orientation"
            )
        _check_recording_options(sources[0], auto, images, video)
        selection = bag.selection(view, request, changes)
        dewarp_recording(sources, outputs, request, selection)
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
        raise click.UsageError("--set image.transparent requires images; use --border for videos")
    if images.wavelengths_nm is not None:
        raise click.UsageError(
            f"--set image.wavelengths_nm requires images; got the video {source}; extract its "
            "frames to a folder and dewarp them"
        )
    if images.restore:
        raise click.UsageError(
            f"--restore requires images; got the video {source}; extract its frames to a folder and restore them"
        )


def _check_recording_options(
    source: str, auto: AutoOptions, images: ImageFileOptions, video: VideoOptions
) -> None:
    auto.refuse_video(source)
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
        raise click.UsageError("--border and --set image.transparent must not be given together")
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


def _split_format(outputs: tuple[str, ...]) -> tuple[tuple[str, ...], str | None]:
    """Return outputs with ``-`` instead of ``KIND:-``, and the format of standard output."""
    kinds = [match[1] for output in outputs if (match := re.fullmatch(r"(\w+):-", output))]
    if len(kinds) > 1:
        raise click.UsageError(f"standard output must have one format; got {', '.join(kinds)}")
    plain = tuple(re.sub(r"^\w+:-$", "-", output) for output in outputs)
    return plain, kinds[0] if kinds else None


def _wrong_format(noun: str, formats: Iterable[str], kind: str) -> str:
    """Return the error message for an unknown format of standard output."""
    valid = ", ".join(["-", *(f"{name}:-" for name in formats)])
    return f"standard output of {noun} must be {valid}; got {kind}:-"


def _named(output: str, kind: str | None) -> Path:
    """Return the file name of one image; ``-`` gets the suffix of its format."""
    if kind not in (None, *IMAGE_FORMATS):
        raise click.UsageError(_wrong_format("an image", IMAGE_FORMATS, kind))
    if output != "-":
        format_of(output)  # raises before the image is read
        return Path(output)
    return take_standard_output("--output", kind or IMAGE_FORMATS[0])


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
