"""Option for the orientation of images and videos, and reports of applied orientations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ....io.pictures.images import orientation_of, read_picture
from ....io.pictures.orientation import UPRIGHT, applied
from ..outputs import remark
from .declared import Options, option


@dataclass(frozen=True)
class OrientationOptions(Options):
    """Orientation of images and videos."""

    stored_orientation: bool = option(
        default=False, is_flag=True,
        help="Take pixels as stored, without the rotation in EXIF data (images) or in the display matrix (videos).",
    )  # fmt: skip

    def read(self, files: Sequence[Path]) -> list[NDArray[Any]]:
        """Return the images in files, and report the orientations that were applied."""
        found = [read_picture(file, stored_orientation=self.stored_orientation) for file in files]
        self._report([carried.orientation for _, carried in found])
        return [image for image, _ in found]

    def report(self, files: Sequence[Path]) -> None:
        """Report the orientations that are applied to the images in files."""
        self._report([orientation_of(file) for file in files])

    def report_video(self, video: str) -> None:
        """Report remarks on a video, such as the orientation applied to its frames."""
        from ....io.video.reader import VideoReader

        with VideoReader(video, with_sound=False, stored_orientation=self.stored_orientation) as reader:
            for note in reader.notes:
                remark(f"omnimirror: {note}")

    def _report(self, orientations: Sequence[int]) -> None:
        for orientation, count in Counter(orientations).items():
            if orientation != UPRIGHT:
                words = applied(orientation, self.stored_orientation)
                remark(f"omnimirror: {count} of {len(orientations)} images {words}")
