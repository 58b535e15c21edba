"""Dewarping of videos, cameras and streams: one source with any number of outputs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import av

from ..base.arguments import validate_arguments
from ..base.errors import InvalidParameter
from ..base.files import is_same_file
from ..base.logs import OnProgress
from ..base.results import Columns, Result, record_of, table_of
from ..cameras.camera import Camera
from ..io import video_processing
from ..io.image_sequences import is_sequence, may_share_a_name, numbered, numbers_of, standard_input
from ..io.images import can_be_panorama
from ..io.keyframes import Keyframes
from ..io.live_outputs import PipeSink, Preview, StreamSink, Tee, VirtualCamera
from ..io.live_sources import TICKS, LiveSource, is_live
from ..io.mp4 import can_be_spherical
from ..io.video_frames import (
    FULL_RANGE,
    ColourCoding,
    PixelFormat,
    conversion_losses,
    empty_frame,
    is_full_range,
    planes,
    workable,
)
from ..io.video_metadata import DISPLAY_LOST, MasteringDisplay
from ..io.video_reader import Item, VideoReader
from ..io.video_writer import ImageSequenceWriter, Sink, VideoWriter, check_pattern, is_image_output
from . import views
from ._dewarper import Dewarper
from .interfaces import Border, Interpolation
from .request import BorderArgument, BorderColour, DewarpRequest, Size, VideoSettings
from .sampling import check_size
from .screens import View
from .view_geometry import Viewpoint
from .yuv import Siting

# -- Video frames ----------------------------------------------------------------------------------


def dewarp_frame(
    dewarp: Dewarper, frame: av.VideoFrame, siting: Siting = "left", to_siting: Siting | None = None
) -> av.VideoFrame:
    """Dewarp a video frame to a new frame with the same timestamp and colour coding.

    Parameters
    ----------
    dewarp
        Dewarper for the camera and the view.
    frame
        Frame of any pixel format; formats other than planar YUV and NV12 are first converted to
        planes without loss of depth.
    siting, to_siting
        Position of chroma samples in the frame and in the result; see :meth:`Dewarper.planes`.
        Readers and sinks of :mod:`omnimirror.io` report theirs.

    Returns
    -------
    Frame of pixel format nv12 for nv12 input, otherwise planar YUV of the same depth and chroma
    resolution, with transparency if present: transparent outside the field unless the border is a
    colour.

    Raises
    ------
    InvalidParameter
        If the frame does not have the size of the camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.io.video_frames import empty_frame, planes
    >>> frame, parts = empty_frame((1024, 1024))
    >>> for part in parts:
    ...     part[:] = 100
    >>> dewarp = om.Dewarper(om.load_sensor("paper-spherical"), om.screens.Plane((640, 480)))
    >>> planes(dewarp_frame(dewarp, frame))[0][240, 320]
    np.uint8(100)
    """
    frame = workable(frame)
    kind = PixelFormat.of(frame.format.name)
    dewarped, target = empty_frame(
        dewarp.view.size, "nv12" if frame.format.name == "nv12" else kind.name, like=frame
    )
    is_full = is_full_range(frame)
    if is_full:
        dewarped.color_range = FULL_RANGE
    dewarp.planes(planes(frame), target, siting, to_siting, is_full, kind.bits)
    return dewarped


# -- Videos, cameras and streams -------------------------------------------------------------------

UNKNOWN_RATE = Fraction(25)


@dataclass(frozen=True)
class DewarpedVideo(Result):
    """Result of dewarping a video."""

    view: View
    outcome: video_processing.ProcessingResult
    """Number of frames written, frame rate, and whether the run was cancelled."""
    summary: str = ""
    """Received and dropped frames of a live source."""

    def _table(self) -> Columns:
        return table_of([{**record_of(self.outcome), "summary": self.summary}])


@dataclass(frozen=True)
class VideoCallbacks:
    """Callbacks for messages and progress."""

    on_warning: Callable[[str], None] = lambda message: None
    """Called with a sentence about losses and doubts."""
    on_progress: OnProgress = lambda done, total: None
    """Called a few times per second with the number of frames and the expected number."""


NO_CALLBACKS = VideoCallbacks()


@validate_arguments
def dewarp_video(
    source: str | Path,
    outputs: str | Path | Sequence[str | Path],
    *,
    camera: Camera | Callable[[Size], Camera],
    view: View | Callable[[Camera], View] = views.panorama,
    interpolation: Interpolation = "auto",
    viewpoint: Viewpoint = "exact",
    border: BorderArgument | None = None,
    keep_tilt: bool = False,
    stored_orientation: bool = False,
    settings: VideoSettings | None = None,
    on_progress: OnProgress | None = None,
    on_warning: Callable[[str], None] | None = None,
) -> DewarpedVideo:
    """Dewarp a video, as ``omnimirror dewarp`` does, preserving depth, colours, sound and timing.

    Parameters
    ----------
    source
        Video file, numbered images (``f%04d.png``), camera, stream, or ``-`` for standard input.
    outputs
        Files, addresses (``udp://..``), virtual cameras (``/dev/video9``) and ``-`` for a pipe.
    camera
        Camera, or a function that returns it for an image size (width, height) in px.
    view
        Screen of :mod:`omnimirror.screens`, or a function of the camera, such as those of
        :mod:`omnimirror.views`.
    interpolation, viewpoint
        As in :class:`omnimirror.Dewarper`.
    border
        Colour outside the field: a grey level or (red, green, blue), 0 to 255, or ``"#rrggbb"``.
    keep_tilt
        Draw the view relative to the tilted camera, without levelling.
    stored_orientation
        Use frames as stored, ignoring the rotation in the display matrix of the video.
    settings
        Selection of the video and output settings.
    on_progress
        Callback of the number of frames and the expected number, None if unknown; called a few
        times per second.
    on_warning
        Callback for messages about losses and contradictions.

    Returns
    -------
    DewarpedVideo
        View and number of frames written.

    Raises
    ------
    InvalidParameter
        If outputs or options are incompatible.
    MediaError
        If the source cannot be read or an output cannot be written.

    Examples
    --------
    >>> import numpy as np, omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for i in range(3):
    ...         om.write_image(f"{folder}/{i}.png", np.full((1024, 1024, 3), 80 * i, np.uint8))
    ...     film = om.dewarp_video(
    ...         f"{folder}/%d.png", f"{folder}/film.mp4", camera=om.load_sensor("paper-spherical"),
    ...         view=om.screens.Cylinder((320, 120), -60.0, 30.0),
    ...     )
    >>> film.outcome.frames, film.view.size
    (3, (320, 120))
    """
    colour = None if border is None else BorderColour.of(border)
    request = DewarpRequest(
        camera, view, interpolation, viewpoint, colour, keep_tilt, stored_orientation
    )
    names = [outputs] if isinstance(outputs, str | Path) else list(outputs)
    if not names:
        raise InvalidParameter("outputs must contain at least one output; got none")
    callbacks = VideoCallbacks(
        on_warning or NO_CALLBACKS.on_warning, on_progress or NO_CALLBACKS.on_progress
    )
    return dewarp_source(
        str(source), [str(name) for name in names], request, settings or VideoSettings(), callbacks
    )


def dewarp_source(
    source: str,
    outputs: Sequence[str],
    request: DewarpRequest,
    settings: VideoSettings,
    callbacks: VideoCallbacks | None = None,
) -> DewarpedVideo:
    """Dewarp a video as specified by a request."""
    _check_outputs(source, outputs, settings)
    callbacks = callbacks or NO_CALLBACKS
    if is_live(source):
        return _dewarp_live_source(source, outputs, request, settings, callbacks)
    with standard_input() if source == "-" else nullcontext(source) as path:
        return _dewarp_file(str(path), outputs, request, settings, callbacks)


def _dewarp_file(
    source: str,
    outputs: Sequence[str],
    request: DewarpRequest,
    settings: VideoSettings,
    callbacks: VideoCallbacks,
) -> DewarpedVideo:
    if settings.frame_rate is not None and not is_sequence(source):
        raise InvalidParameter(
            f"frame_rate must be omitted unless the source is an image sequence; got {settings.frame_rate:g}"
        )
    with_audio = any(_is_video_file(output) for output in outputs)
    rate = 25.0 if settings.frame_rate is None else settings.frame_rate
    with VideoReader(
        source,
        settings.start_s or 0.0,
        settings.duration_s,
        with_audio,
        rate,
        request.stored_orientation,
    ) as reader:
        for note in reader.notes:
            callbacks.on_warning(note)
        view_over_time = ViewOverTime(
            request, reader.size, settings, reader.siting, reader.pixel_format
        )
        sink = _sinks(
            outputs,
            view_over_time,
            FrameProperties(reader.frame_rate, reader.colour, reader.display),
            reader,
            callbacks,
        )
        is_watched = not any(output == "-" or _is_file(output) for output in outputs)
        items = video_processing.in_real_time(reader.items()) if is_watched else reader.items()
        if isinstance(sink, ImageSequenceWriter):
            items = sink.missing_frames(items)
        outcome = _run(items, sink, view_over_time, reader.expected_frames, callbacks)
        _report_stale_images(outputs, outcome.frames, settings, callbacks)
        return DewarpedVideo(view_over_time.view, outcome)


def _dewarp_live_source(
    source: str,
    outputs: Sequence[str],
    request: DewarpRequest,
    settings: VideoSettings,
    callbacks: VideoCallbacks,
) -> DewarpedVideo:
    if settings.start_s is not None:
        raise InvalidParameter(
            f"start_s must be omitted for the live source {source}; got {settings.start_s:g}"
        )
    live = LiveSource(
        source, on_warning=callbacks.on_warning, stored_orientation=request.stored_orientation
    )
    try:
        first = live.first()
        for note in live.notes:
            callbacks.on_warning(note)
        view_over_time = ViewOverTime(
            request, (first.width, first.height), settings, live.siting, first.format.name
        )
        properties = FrameProperties(
            live.frame_rate or UNKNOWN_RATE,
            ColourCoding.of_video(first),
            MasteringDisplay.of(first.side_data),
        )
        sink = _sinks(outputs, view_over_time, properties, None, callbacks)
        outcome = _run(
            _until(live.frames(), settings.duration_s),
            sink,
            view_over_time,
            None,
            callbacks,
            ahead=0,
        )
    finally:
        live.close()
    _report_stale_images(outputs, outcome.frames, settings, callbacks)
    summary = (
        f"{live.received} frames received, {live.dropped} dropped, {live.reconnects} reconnects"
    )
    return DewarpedVideo(view_over_time.view, outcome, summary)


def _report_stale_images(
    outputs: Sequence[str], count: int, settings: VideoSettings, callbacks: VideoCallbacks
) -> None:
    """Report numbered images left by an earlier, longer run: readers of the pattern would continue
    with them.
    """
    for output in outputs:
        if settings.skip_existing or not (_is_file(output) and is_image_output(output)):
            continue
        pattern = Path(output)
        if others := [number for number in numbers_of(pattern) if number > count]:
            first, last = (numbered(pattern, number).name for number in (min(others), max(others)))
            callbacks.on_warning(
                f"{output}: {first} to {last} are images of a previous run and do not belong to this video"
            )


def _is_file(output: str) -> bool:
    return output != "-" and "://" not in output and not _is_virtual_camera(output)


def _is_video_file(output: str) -> bool:
    """Return True for a file with frames and sound, not numbered images."""
    return _is_file(output) and not is_image_output(output)


def _is_virtual_camera(output: str) -> bool:
    return output.startswith("/dev/video")


def _check_outputs(source: str, outputs: Sequence[str], settings: VideoSettings) -> None:
    """Raise an error for conflicting outputs and for options that apply to none of them."""
    if duplicates := [output for output in outputs if outputs.count(output) > 1]:
        raise InvalidParameter(f"the outputs must differ; got {duplicates[0]} twice")
    for output in outputs:
        if _is_file(output) and is_same_file(output, source):
            raise InvalidParameter(f"the output must differ from the source video; got {output}")
    sequences = [output for output in outputs if _is_file(output) and is_image_output(output)]
    for pattern in map(check_pattern, sequences):
        if is_sequence(source) and may_share_a_name(source, pattern):
            raise InvalidParameter(
                f"the output must not overwrite the source images {source}; got {pattern}"
            )
    if sequences and settings.skip_existing and (len(outputs) > 1 or settings.preview):
        raise InvalidParameter(
            f"skip_existing must be used with a single image sequence as output; omit all outputs except {sequences[0]}"
        )
    is_coded = any(_is_video_file(output) or "://" in output for output in outputs)
    if not is_coded and (
        inapplicable := [name for name in ("codec", "crf") if getattr(settings, name) is not None]
    ):
        raise InvalidParameter(
            f"{inapplicable[0]} must be omitted unless an output is a video file or "
            f"stream; got {getattr(settings, inapplicable[0])}"
        )
    if settings.pipe_format is not None and "-" not in outputs:
        raise InvalidParameter(
            f"pipe_format must be omitted unless an output is '-'; got {settings.pipe_format}"
        )
    if settings.pixel_format is not None and settings.pipe_format != "rawvideo" and not is_coded:
        raise InvalidParameter(
            "pixel_format must be omitted unless an output is a video file, a stream or a "
            f"pipe of raw video; got {settings.pixel_format}"
        )


class ViewOverTime:
    """View over time: static, or with keyframes."""

    border: Border

    def __init__(
        self,
        request: DewarpRequest,
        size: Size,
        settings: VideoSettings,
        siting: Siting,
        pixel_format: str,
    ) -> None:
        mounted = request.camera_of(size)
        check_size(size, mounted.image_size, "video")
        self.request, self.settings, self.siting, self.pixel_format = (
            request,
            settings,
            siting,
            pixel_format,
        )
        self.camera = request.view_camera(mounted)
        self.colour, self.border = request.border, 0
        self.view: View = request.view_of(self.camera)
        self.panorama = request.panorama_of(mounted, self.view)
        self.keyframes = None if settings.keyframes is None else Keyframes.load(settings.keyframes)
        self.still = self._dewarper(self.view)
        if self.keyframes is not None:
            names = {f.name for f in fields(self.view)}  # type: ignore[arg-type]  # subclasses are dataclasses
            if unknown := [name for name in self.keyframes.tracks if name not in names]:
                raise InvalidParameter(
                    f"{settings.keyframes}: the columns must be parameters of the {self.view}; got {unknown[0]}"
                )

    def _dewarper(self, view: View) -> Dewarper:
        return self.request.dewarper(
            self.camera, view, self.border, keep_map=self.keyframes is None
        )

    def __call__(self, frame: av.VideoFrame, time_s: float, to_siting: Siting) -> av.VideoFrame:
        """Return the dewarped frame at a time, with the chroma siting assumed by readers of the
        output.
        """
        if self.colour is not None:  # the first frame determines the colour coding
            self.border, self.colour = self.colour.for_frame(frame), None
            self.still = self._dewarper(self.view)
        if self.keyframes is None:
            return dewarp_frame(self.still, frame, self.siting, to_siting)
        view = replace(self.view, **self.keyframes.at(time_s))  # type: ignore[type-var]  # all implementations are dataclasses
        return dewarp_frame(self._dewarper(view), frame, self.siting, to_siting)


class FrameProperties(NamedTuple):
    """Properties common to all frames of a source."""

    rate: Fraction
    colour: ColourCoding
    display: MasteringDisplay


def _sinks(
    outputs: Sequence[str],
    view_over_time: ViewOverTime,
    properties: FrameProperties,
    source: VideoReader | None,
    callbacks: VideoCallbacks,
) -> Sink:
    """Open all outputs as one sink; opened outputs are discarded if one fails."""
    with ExitStack() as opened:
        sinks: list[Sink] = []
        for output in outputs:
            sinks.append(_sink(output, view_over_time, properties, source, callbacks))
            opened.callback(sinks[-1].abort)
            for note in getattr(sinks[-1], "notes", ()):
                callbacks.on_warning(note)
        if view_over_time.settings.preview:
            sinks.append(Preview(view_over_time.view.size, f"omnimirror: {view_over_time.view}"))
        opened.pop_all()
    return Tee(*sinks) if len(sinks) > 1 else sinks[0]


def _sink(
    output: str,
    view_over_time: ViewOverTime,
    properties: FrameProperties,
    source: VideoReader | None,
    callbacks: VideoCallbacks,
) -> Sink:
    size, settings, rate = view_over_time.view.size, view_over_time.settings, properties.rate
    if (
        properties.display != MasteringDisplay()
        and not _is_video_file(output)
        and "://" not in output
    ):
        callbacks.on_warning(
            f"{output}: {DISPLAY_LOST}; files encoded with libx264 or libx265 preserve it"
        )
    if output == "-":
        return PipeSink(settings.pipe_format or "y4m", rate, settings.pixel_format or "rgb24")
    if _is_virtual_camera(output):
        return VirtualCamera(output, size, rate)
    if is_image_output(output) and "://" not in output:
        panorama = (
            view_over_time.panorama
            if can_be_panorama(output) and settings.keyframes is None
            else None
        )
        return ImageSequenceWriter(
            output,
            size,
            view_over_time.pixel_format,
            properties.colour,
            panorama,
            skip_existing=settings.skip_existing,
        )
    encoding: dict[str, Any] = settings.encoding()
    # Streams and recordings of live sources must play anywhere, unless a pixel format is specified.
    is_for_any = source is None or "://" in output
    if (
        is_for_any
        and "pixel_format" not in encoding
        and (losses := conversion_losses(view_over_time.pixel_format, PixelFormat()))
    ):
        callbacks.on_warning(f"{output}: {losses}; use --set video.pixel_format for another format")
    if is_for_any:  # use the range assumed by players
        encoding |= {
            "colour": replace(properties.colour, range=min(properties.colour.range, 1)),
            "display": properties.display,
        }
    if "://" in output:
        return StreamSink(output, size, rate, **encoding)
    if can_be_spherical(output) and settings.keyframes is None:
        encoding["panorama"] = view_over_time.panorama
    if source is None:
        return VideoWriter(output, size, rate, time_base=TICKS, **encoding)
    return VideoWriter.from_source(
        source, output, size, rotation_deg=0, pixel_aspect=Fraction(1), **encoding
    )


def _run(
    items: Iterable[Item],
    sink: Sink,
    view_over_time: ViewOverTime,
    total: int | None,
    callbacks: VideoCallbacks,
    ahead: int = 4,
) -> video_processing.ProcessingResult:
    """Dewarp all frames."""
    return video_processing.process(
        items,
        sink,
        partial(view_over_time, to_siting=sink.siting),
        "frame",
        total=total,
        queue_size=ahead,
        on_progress=callbacks.on_progress,
    )


def _until(frames: Iterable[Any], duration_s: float | None) -> Iterable[Any]:
    """Yield frames of a live source for a duration by their timestamps."""
    start = None
    for frame in frames:
        start = frame.time if start is None else start
        if (
            duration_s is not None
            and frame.time is not None
            and frame.time - (start or 0.0) >= duration_s
        ):
            return
        yield frame
