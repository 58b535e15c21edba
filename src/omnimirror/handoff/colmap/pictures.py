"""The pictures of a project: files, or frames of a video."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from ...errors import InvalidParameter
from ...media import read_image
from ...media.batch import expand_inputs
from ...straighten import is_video


class Walk(NamedTuple):
    """What a sensor took."""

    total: int | None
    """How many there are, also of those that are left out; None where a video does not say it."""
    pictures: Iterator[tuple[str, NDArray[Any]]]
    """Those that count, in the order in which they were taken: each by the name that it shall have."""


def pictures_of(sources: Iterable[str | Path] | str | Path, every: int = 1) -> Walk:
    """One of so many pictures of files, or of a folder; or one frame of so many of a video.

    Raises
    ------
    InvalidParameter
        Two pictures would have one name, or a video is not alone.
    MediaError
        There are none.
    """
    given = [sources] if isinstance(sources, str | Path) else list(sources)
    if not any(is_video(str(source)) for source in given):
        files = expand_inputs(given)
        names = _names(files)[::every]
        return Walk(len(files), ((name, read_image(file)) for name, file in zip(names, files[::every], strict=True)))
    if len(given) > 1:
        raise InvalidParameter(f"pictures has {len(given)} entries, a video among them; it is valid as one video alone")
    from ...media.video.reader import VideoReader

    with VideoReader(given[0], with_sound=False) as reader:
        total = reader.expected_frames
    return Walk(total, _frames(given[0], every))


def _frames(video: str | Path, every: int) -> Iterator[tuple[str, NDArray[Any]]]:
    from ...media.video.frames import image_of_frame
    from ...media.video.reader import VideoReader

    with VideoReader(video, with_sound=False) as reader:
        for number, frame in enumerate(reader.frames()):
            if number % every == 0:
                yield f"frame-{number:06d}.png", image_of_frame(frame)


def _names(files: Sequence[Path]) -> list[str]:
    names = [f"{file.stem}.png" for file in files]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InvalidParameter(f"two pictures would both be named {twice}; rename one")
    return names
