"""Outline search process.

Run as ``python -m omnimirror.apps.studio._outline_process``, it reads a line of JSON, a line with
the length of the image, and the image; it writes one progress message per line.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import BinaryIO

from pydantic import BaseModel

from ...base.errors import OmnimirrorError
from ._uploads import image_in
from .look_messages import DetectedOutline, OutlineSearchStatus


class OutlineRequest(BaseModel):
    """Name of the uploaded image, and whether its orientation is ignored."""

    name: str
    stored_orientation: bool = False


def search(
    request: OutlineRequest, data: bytes, on_status: Callable[[OutlineSearchStatus], None]
) -> None:
    """Detect the mirror outline in an uploaded image at its full size, and report the progress."""
    from ...calibration.rim import detect_mirror_outline  # the server imports this module

    def on_progress(done: int, total: int | None) -> None:
        message = "Comparing circles at several resolutions"
        fraction = done / total if total else 0.0
        on_status(OutlineSearchStatus(state="running", message=message, fraction=fraction))

    try:
        on_status(OutlineSearchStatus(state="running", message="Reading the image"))
        image = image_in(data, request.name, stored_orientation=request.stored_orientation)
        outline = detect_mirror_outline(image, on_progress=on_progress)
    except OmnimirrorError as e:
        on_status(OutlineSearchStatus(state="failed", message=str(e)))
    except MemoryError:
        message = f"{request.name} requires more memory than the server has"
        on_status(OutlineSearchStatus(state="failed", message=message))
    else:
        result = DetectedOutline(
            centre_px=outline.centre_px,
            radius_px=outline.radius_px,
            confidence=outline.confidence,
            is_reliable=outline.is_accepted,
            image_size=outline.image_size,
        )
        message = f"confidence {outline.confidence:.2f}"
        on_status(OutlineSearchStatus(state="done", message=message, fraction=1.0, outline=result))


def main(requests: BinaryIO) -> None:
    """Run the search of standard input."""
    request = OutlineRequest.model_validate_json(requests.readline())
    data = requests.read(int(requests.readline()))
    search(request, data, lambda status: print(status.model_dump_json(), flush=True))


if __name__ == "__main__":
    main(sys.stdin.buffer)
