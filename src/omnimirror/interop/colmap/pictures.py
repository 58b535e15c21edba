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


def pictures_of(
    sources: Iterable[str | Path] | str | Path, every: int = 1, *, stored_orientation: bool = False
) -> Walk:
    """Return every n-th image of files or of a folder, or every n-th frame of a video.

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
        images = (read_image(file, stored_orientation=stored_orientation) for file in files[::every])
        return Walk(len(files), zip(names, images, strict=True))
    if len(given) > 1:
        raise InvalidParameter(f"pictures has {len(given)} entries, a video among them; it is valid as one video alone")
    from ...media.video.reader import VideoReader

    with VideoReader(given[0], with_sound=False) as reader:
        total = reader.expected_frames
    return Walk(total, _frames(given[0], every, stored_orientation))


def _frames(video: str | Path, every: int, stored_orientation: bool) -> Iterator[tuple[str, NDArray[Any]]]:
    from ...media.video.frames import image_of_frame
    from ...media.video.reader import VideoReader

    with VideoReader(video, with_sound=False, stored_orientation=stored_orientation) as reader:
        for number, frame in enumerate(reader.frames()):
            if number % every == 0:
                yield f"frame-{number:06d}.png", image_of_frame(frame)


def _names(files: Sequence[Path]) -> list[str]:
    names = [f"{file.stem}.png" for file in files]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InvalidParameter(f"two pictures would both be named {twice}; rename one")
    return names
