"""The part of ``omnimirror dewarp`` that straightens videos, cameras and streams."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import fields, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ..dewarp import Dewarper
from ..dewarp.screens import View
from ..errors import InvalidParameter
from ..media import process as processing
from ..media.keyframes import Keyframes
from ..media.live import TICKS, LiveSource, is_live
from ..media.outputs import PipeSink, StreamSink
from ..media.spherical import can_be_spherical
from ..media.video import Item, VideoReader
from ..media.writer import Sink, VideoWriter
from .camera_options import MountedCamera, camera_of
from .dewarp import panorama_of
from .view_options import view_of

UNKNOWN_RATE = Fraction(25)


def straighten_video(source: str, output: str, given: dict[str, Any], interpolation: Any) -> None:
    """From a video file, camera or stream to a video file, a stream (an address) or a pipe (``-``)."""
    if is_live(source):
        _straighten_live(source, output, given, interpolation)
        return
    if output != "-" and "://" not in output and Path(output).resolve() == Path(source).resolve():
        raise click.UsageError(f"{output} is the video to straighten; write to another name")
    with VideoReader(source, given.get("start_s", 0.0), given.get("duration_s"), with_sound=output != "-") as reader:
        turn = Turning(camera_of(given, reader.size), given, interpolation)
        sink = _sink(output, turn.view, reader.frame_rate, given, reader)
        _run(reader.items(), sink, turn, output, reader.expected_frames)


def _straighten_live(source: str, output: str, given: dict[str, Any], interpolation: Any) -> None:
    if "start_s" in given:
        raise click.UsageError(f"--start-s belongs to video files; {source} has no beginning")
    live = LiveSource(source, report=lambda sentence: click.echo(f"omnimirror: {sentence}", err=True))
    try:
        first = live.first()
        turn = Turning(camera_of(given, (first.width, first.height)), given, interpolation)
        sink = _sink(output, turn.view, live.frame_rate or UNKNOWN_RATE, given, None)
        frames = _until(live.frames(), given.get("duration_s"))
        _run(frames, sink, turn, output, None, ahead=0)
    finally:
        live.close()
    click.echo(
        f"{source}: {live.received} frames received, {live.dropped} dropped, {live.reconnects} reconnects", err=True
    )


class Turning:
    """The view over time: it stands still, or moves with keyframes."""

    def __init__(self, camera: MountedCamera, given: dict[str, Any], interpolation: Any) -> None:
        self.camera, self.interpolation = camera, interpolation
        self.viewpoint = given.get("viewpoint", "exact")
        self.view: View = view_of(camera, given)
        self.still = self._dewarper(self.view)
        self.keyframes = Keyframes.load(given["keyframes"]) if "keyframes" in given else None
        if self.keyframes is not None:
            known = {f.name for f in fields(self.view)}
            if unknown := [name for name in self.keyframes.tracks if name not in known]:
                raise InvalidParameter(f"{given['keyframes']}: {unknown[0]} does not apply to the {self.view}")

    def _dewarper(self, view: View) -> Dewarper:
        return Dewarper(self.camera, view, self.interpolation, self.viewpoint)

    def __call__(self, picture: Any, time_s: float) -> Any:
        """The straightened frame of a time."""
        if self.keyframes is None:
            return self.still(picture)
        return self._dewarper(replace(self.view, **self.keyframes.at(time_s)))(picture)  # type: ignore[type-var]


def _sink(output: str, view: View, rate: Fraction, given: dict[str, Any], source: VideoReader | None) -> Sink:
    encoding: dict[str, Any] = {name: given[name] for name in ("codec", "crf") if name in given}
    if unused := [name for name in encoding if output == "-"]:
        raise click.UsageError(f"--{unused[0]} does not apply to a pipe, which is not compressed")
    if output == "-":
        return PipeSink("y4m", rate)
    if "://" in output:
        return StreamSink(output, view.size, rate, **encoding)
    if can_be_spherical(output) and "keyframes" not in given:
        encoding["panorama"] = panorama_of(view)
    if source is None:
        return VideoWriter(output, view.size, rate, time_base=TICKS, **encoding)
    return VideoWriter.like(source, output, view.size, rotation_deg=0, pixel_aspect=Fraction(1), **encoding)


def _run(items: Iterable[Item], sink: Sink, turn: Turning, output: str, total: int | None, ahead: int = 4) -> None:
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
            items, sink, turn, total=total, ahead=ahead,
            progress=lambda p: bar.update(task, completed=p.done, rate=p.rate),
        )  # fmt: skip
    name = "standard output" if output == "-" else output
    width, height = turn.view.size
    click.echo(
        f"{name}: {turn.view}, {width} x {height} px, {outcome.frames} frames, {outcome.rate:.0f} a second", err=True
    )
    if outcome.stopped:
        click.echo(f"omnimirror: stopped; {name} holds what was done", err=True)
        sys.exit(130)


def _until(frames: Iterable[Any], duration_s: float | None) -> Iterable[Any]:
    """Frames of a live source for so long, by their own times."""
    start = None
    for frame in frames:
        start = frame.time if start is None else start
        if duration_s is not None and frame.time is not None and frame.time - (start or 0.0) >= duration_s:
            return
        yield frame
