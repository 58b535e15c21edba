"""HTML viewer output of ``omnimirror dewarp``."""

from __future__ import annotations

from pathlib import Path

import click

from .....base.errors import OmnimirrorError
from .....base.files import write_text
from .....dewarp.pipelines import is_video
from ...options.camera import CameraOptions
from ...options.orientation import OrientationOptions
from ...outputs import say


def write_viewer(
    sources: tuple[str, ...], output: Path, options: CameraOptions, orientation: OrientationOptions
) -> None:
    """Write an HTML viewer of one image or video."""
    from ....studio import video_viewer_of, viewer_of

    is_film = is_video(sources[0]) and Path(sources[0]).is_file()
    if len(sources) > 1 or (is_video(sources[0]) and not is_film) or not is_one_picture(sources[0]):
        raise click.UsageError("--viewer holds one picture, or one video file")
    if output.suffix.lower() not in (".html", ".htm"):
        raise click.UsageError(f"--viewer writes an HTML file, such as {output.stem or 'view'}.html, and no {output}")
    name, words = options.words()
    is_stored = orientation.stored_orientation
    if is_film:
        camera = options.drawing(options.camera(_size_of_video(sources[0], is_stored)))
        text = video_viewer_of(camera, name, words, Path(sources[0]), output, stored_orientation=is_stored)
    else:
        (picture,) = orientation.read([Path(sources[0])])
        camera = options.drawing(options.camera((picture.shape[1], picture.shape[0])))
        text = viewer_of(camera, name, words, Path(sources[0]), picture)
    write_text(output, text)
    say(f"{output}: open it in a browser to look around in {sources[0]}")


def is_one_picture(source: str) -> bool:
    """Return whether a source is a single file, not a folder or pattern."""
    return not Path(source).is_dir() and (Path(source).exists() or not set("*?[") & set(source))


def needs_pyav(source: str) -> OmnimirrorError:
    """Return the exception for a missing video reader."""
    return OmnimirrorError(f"{source} is a video, which needs PyAV: pip install 'omnimirror[video]'")


def _size_of_video(source: str, is_stored: bool) -> tuple[int, int]:
    try:
        from .....io.video.reader import VideoReader
    except ModuleNotFoundError as e:
        if e.name != "av":
            raise
        raise needs_pyav(source) from None
    return VideoReader(source, with_sound=False, stored_orientation=is_stored).size
