"""The part of ``omnimirror dewarp`` that straightens videos, cameras and streams."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import fields, replace
from fractions import Fraction
from functools import partial
from typing import Any

import av
import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ....dewarp import Dewarper
from ....dewarp.sampling.remap import Border
from ....dewarp.screens import View
from ....dewarp.yuv.chroma import Siting
from ....dewarp.yuv.frames import dewarp_frame
from ....errors import InvalidParameter
from ....files import is_same_file
from ....media import process as processing
from ....media.keyframes import Keyframes
from ....media.live.outputs import PipeSink, Preview, StreamSink, Tee, VirtualCamera
from ....media.live.sources import TICKS, LiveSource, is_live
from ....media.video.formats import Kind, losses
from ....media.video.reader import Item, VideoReader
from ....media.video.sequences import is_sequence, standard_input
from ....media.video.spherical import can_be_spherical
from ....media.video.writer import Sink, VideoWriter
from ...options.camera import MountedCamera, camera_of, drawn_by
from ...options.sampling import BorderColour
from ...options.view import view_of
from .dewarp import panorama_of

UNKNOWN_RATE = Fraction(25)


def straighten_video(source: str, outputs: tuple[str, ...], given: dict[str, Any], interpolation: Any) -> None:
    """From a video file, camera or stream to any number of video files, streams (addresses), virtual cameras
    (``/dev/video9``), a pipe (``-``), and a window if ``preview`` is given."""
    _check_outputs(source, outputs, given)
    if is_live(source):
        _straighten_live(source, outputs, given, interpolation)
        return
    if source == "-":
        with standard_input() as path:
            _straighten_file(str(path), outputs, given, interpolation)
    else:
        _straighten_file(source, outputs, given, interpolation)


def _straighten_file(source: str, outputs: tuple[str, ...], given: dict[str, Any], interpolation: Any) -> None:
    if "frame_rate" in given and not is_sequence(source):
        raise click.UsageError("--frame-rate belongs to numbered pictures; videos tell theirs")
    start_s, duration_s = given.get("start_s", 0.0), given.get("duration_s")
    with_sound = any(_is_file(output) for output in outputs)
    with VideoReader(source, start_s, duration_s, with_sound, given.get("frame_rate", 25.0)) as reader:
        for note in reader.notes:
            click.echo(f"omnimirror: {note}", err=True)
        turn = Turning(camera_of(given, reader.size), given, interpolation, reader.siting, reader.pixel_format)
        sink = _sinks(outputs, turn, reader.frame_rate, given, reader)
        is_watched = not any(output == "-" or _is_file(output) for output in outputs)
        items = processing.in_real_time(reader.items()) if is_watched else reader.items()
        _run(items, sink, turn, outputs, reader.expected_frames)


def _straighten_live(source: str, outputs: tuple[str, ...], given: dict[str, Any], interpolation: Any) -> None:
    if "start_s" in given:
        raise click.UsageError(f"--start-s belongs to video files; {source} has no beginning")
    live = LiveSource(source, report=lambda sentence: click.echo(f"omnimirror: {sentence}", err=True))
    try:
        first = live.first()
        camera = camera_of(given, (first.width, first.height))
        turn = Turning(camera, given, interpolation, live.siting, first.format.name)
        sink = _sinks(outputs, turn, live.frame_rate or UNKNOWN_RATE, given, None)
        frames = _until(live.frames(), given.get("duration_s"))
        _run(frames, sink, turn, outputs, None, ahead=0)
    finally:
        live.close()
    click.echo(
        f"{source}: {live.received} frames received, {live.dropped} dropped, {live.reconnects} reconnects", err=True
    )


def _is_file(output: str) -> bool:
    return output != "-" and "://" not in output and not _is_virtual_camera(output)


def _is_virtual_camera(output: str) -> bool:
    return output.startswith("/dev/video")


def _check_outputs(source: str, outputs: tuple[str, ...], given: dict[str, Any]) -> None:
    """Refuse outputs that are in each other's way, and options that belong to none of them."""
    if twice := [output for output in outputs if outputs.count(output) > 1]:
        raise click.UsageError(f"{twice[0]} is to be written twice; give each output once")
    for output in outputs:
        if _is_file(output) and is_same_file(output, source):
            raise click.UsageError(f"{output} is the video to straighten; write to another name")
    if not any(_is_file(output) or "://" in output for output in outputs):
        for name in ("codec", "crf"):
            if name in given:
                raise click.UsageError(f"--{name} does not apply to a pipe, camera or window: nothing is compressed")
    if "format" in given and "-" not in outputs:
        raise click.UsageError("--format says what '-o -' writes; other outputs are named by themselves")
    is_coded = any(_is_file(output) or "://" in output for output in outputs)
    if "pixel_format" in given and given.get("format") != "rawvideo" and not is_coded:
        raise click.UsageError("--pixel-format belongs to files, streams and --format rawvideo")


class Turning:
    """The view over time: it stands still, or moves with keyframes."""

    def __init__(
        self, camera: MountedCamera, given: dict[str, Any], interpolation: Any, siting: Siting, pixel_format: str
    ) -> None:
        stands, camera = camera, drawn_by(camera, given)
        self.pixel_format = pixel_format
        self.camera, self.interpolation, self.siting = camera, interpolation, siting
        self.viewpoint = given.get("viewpoint", "exact")
        self.colour: BorderColour | None = given.get("border")
        self.border: Border = 0
        self.view: View = view_of(camera, given)
        self.panorama = panorama_of(self.view, stands.mount if "keep_lean" in given else None)
        self.keyframes = Keyframes.load(given["keyframes"]) if "keyframes" in given else None
        self.still = self._dewarper(self.view)
        if self.keyframes is not None:
            known = {f.name for f in fields(self.view)}
            if unknown := [name for name in self.keyframes.tracks if name not in known]:
                raise InvalidParameter(f"{given['keyframes']}: {unknown[0]} does not apply to the {self.view}")

    def _dewarper(self, view: View) -> Dewarper:
        return Dewarper(
            self.camera, view, self.interpolation, self.viewpoint, self.border, keep_map=self.keyframes is None
        )

    def __call__(self, frame: av.VideoFrame, time_s: float, to_siting: Siting) -> av.VideoFrame:
        """The straightened frame of a time, its colour samples where those who read it take them to lie."""
        if self.colour is not None:  # the first frame tells how colours are coded
            self.border, self.colour = self.colour.of_frame(frame), None
            self.still = self._dewarper(self.view)
        if self.keyframes is None:
            return dewarp_frame(self.still, frame, self.siting, to_siting)
        view = replace(self.view, **self.keyframes.at(time_s))  # type: ignore[type-var]
        return dewarp_frame(self._dewarper(view), frame, self.siting, to_siting)


def _sinks(
    outputs: tuple[str, ...], turn: Turning, rate: Fraction, given: dict[str, Any], source: VideoReader | None
) -> Sink:
    """All outputs as one; those that were opened are given up if one cannot be."""
    with ExitStack() as opened:
        sinks: list[Sink] = []
        for output in outputs:
            sinks.append(_sink(output, turn, rate, given, source))
            opened.callback(sinks[-1].abort)
            for note in getattr(sinks[-1], "notes", ()):
                click.echo(f"omnimirror: {note}", err=True)
        if "preview" in given:
            sinks.append(Preview(turn.view.size, f"omnimirror: {turn.view}"))
        opened.pop_all()
    return Tee(*sinks) if len(sinks) > 1 else sinks[0]


def _sink(output: str, turn: Turning, rate: Fraction, given: dict[str, Any], source: VideoReader | None) -> Sink:
    size = turn.view.size
    if output == "-":
        return PipeSink(given.get("format", "y4m"), rate, given.get("pixel_format", "rgb24"))
    if _is_virtual_camera(output):
        return VirtualCamera(output, size, rate)
    of_files = ("codec", "crf") if given.get("format") == "rawvideo" else ("codec", "crf", "pixel_format")
    encoding: dict[str, Any] = {name: given[name] for name in of_files if name in given}
    if source is None or "://" in output:
        _say_losses(output, turn, encoding)
    if "://" in output:
        return StreamSink(output, size, rate, **encoding)
    if can_be_spherical(output) and "keyframes" not in given:
        encoding["panorama"] = turn.panorama
    if source is None:
        return VideoWriter(output, size, rate, time_base=TICKS, **encoding)
    return VideoWriter.like(source, output, size, rotation_deg=0, pixel_aspect=Fraction(1), **encoding)


def _say_losses(output: str, turn: Turning, encoding: dict[str, Any]) -> None:
    """Streams, and files of what is live, are for any player, unless a pixel format was asked for."""
    if "pixel_format" not in encoding and (lost := losses(turn.pixel_format, Kind())):
        click.echo(f"omnimirror: {output}: {lost}; --pixel-format names another choice", err=True)


def _run(
    items: Iterable[Item], sink: Sink, turn: Turning, outputs: tuple[str, ...], total: int | None, ahead: int = 4
) -> None:
    """Straighten every frame under a progress bar, and say what became of it."""
    bar = Progress(
        TextColumn("Straightening"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:.0f} frames/s"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    with bar:
        task = bar.add_task("", total=total, rate=0.0)
        outcome = processing.process(
            items, sink, partial(turn, to_siting=sink.siting), "frame", total=total, ahead=ahead,
            progress=lambda p: bar.update(task, completed=p.done, rate=p.rate),
        )  # fmt: skip
    name = ", ".join("standard output" if output == "-" else output for output in outputs) or "preview"
    width, height = turn.view.size
    click.echo(
        f"{name}: {turn.view}, {width} x {height} px, {outcome.frames} frames, {outcome.rate:.0f} a second", err=True
    )
    if outcome.stopped and outputs:
        click.echo(f"omnimirror: stopped; {name} holds what was done", err=True)
        sys.exit(outcome.exit_code)


def _until(frames: Iterable[Any], duration_s: float | None) -> Iterable[Any]:
    """Frames of a live source for so long, by their own times."""
    start = None
    for frame in frames:
        start = frame.time if start is None else start
        if duration_s is not None and frame.time is not None and frame.time - (start or 0.0) >= duration_s:
            return
        yield frame
