"""Self-contained page with an image or video and its camera; works from disk without server or
installation."""

from __future__ import annotations

import base64
import os
from pathlib import Path
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from ....base.errors import InvalidParameter, MediaError
from ....base.escaping import script_json
from ....base.files import read_bytes
from ....io.pictures.images import LARGEST, orientation_of
from ....io.pictures.orientation import UPRIGHT
from ....optics.sensor_files import AnyCamera
from ..messages import Message
from ..pages import page_text
from ..uploads import eight_bits, encoded
from .messages import Embedded
from .tables import camera_model, camera_tables, title_of

PLACE = "<!--embedded-->"
KINDS = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
"""Image formats that are embedded unchanged."""
VIDEO_KINDS = {".mp4": "video/mp4", ".m4v": "video/mp4", ".mov": "video/mp4", ".webm": "video/webm"}
CODECS = ("h264", "hevc", "vp8", "vp9", "av1")
"""Video codecs supported by browsers."""
LARGEST_INSIDE = 64 << 20
"""Maximum size of an embedded video, bytes; a larger video remains a separate file."""


def viewer_of(
    camera: AnyCamera, name: str, options: tuple[str, ...], path: Path | None, image: NDArray[np.generic]
) -> str:
    """Return a page with one image and its camera.

    Parameters
    ----------
    camera
        Camera of the image.
    name
        Displayed name of the camera.
    options
        Command-line options of the camera, displayed on the page.
    path
        File of the image, if any. A PNG or JPEG without an orientation tag is embedded unchanged,
        any other image as 8-bit PNG.
    image : (h, w) or (h, w, 3) or (h, w, 4) array
        Decoded image.

    Raises
    ------
    InvalidParameter
        The image size differs from that of the camera.
    """
    _check_size(camera, (image.shape[1], image.shape[0]), "picture")
    kind = KINDS.get(path.suffix.lower()) if path is not None else None
    if path is not None and kind is not None and image.dtype == np.uint8 and orientation_of(path) == UPRIGHT:
        media = inside(read_bytes(path, LARGEST), kind)
    else:
        media = inside(encoded(eight_bits(image), ".png"), "image/png")
    return _page_with(camera, name, options, media, path.name if path else "picture.png", is_video=False)


def video_viewer_of(
    camera: AnyCamera,
    name: str,
    options: tuple[str, ...],
    path: Path,
    page: Path,
    *,
    stored_orientation: bool = False,
) -> str:
    """Return a page that plays a video in a loop.

    Videos up to 64 MB are embedded. A larger video remains a separate file: a page on a web server
    loads it directly, a page on disk requests the file from the user, because browsers block
    automatic access.

    Parameters
    ----------
    camera, name, options
        See :func:`viewer_of`.
    path
        Video file.
    page
        Path of the page to be written.
    stored_orientation
        Require frames in their stored orientation; browsers support this only for videos without a
        rotation.

    Raises
    ------
    MediaError
        Video format not supported by browsers.
    InvalidParameter
        The frame size differs from that of the camera.
    """
    from ....io.video.reader import VideoReader

    kind = VIDEO_KINDS.get(path.suffix.lower())
    if kind is None:
        raise MediaError(f"{path} is not a video that browsers play; valid are {', '.join(VIDEO_KINDS)}")
    video = VideoReader(path, with_sound=False, stored_orientation=stored_orientation)
    if video.codec not in CODECS:
        raise MediaError(f"{path} holds {video.codec}, which browsers do not play; valid are {', '.join(CODECS)}")
    if video.rotation_deg:
        raise MediaError(
            f"{path} must have a rotation by a multiple of 90 deg, and none with --stored-orientation, since browsers "
            f"apply it; got {video.rotation_deg} deg"
        )
    _check_size(camera, video.size, "video")
    is_small = path.stat().st_size <= LARGEST_INSIDE
    media = inside(read_bytes(path, LARGEST_INSIDE), kind) if is_small else _beside(path, page)
    return _page_with(camera, name, options, media, path.name, is_video=True)


def _check_size(camera: AnyCamera, size: tuple[int, int], what: str) -> None:
    if size != camera.image_size:
        width, height = camera.image_size
        raise InvalidParameter(f"the {what} has {size[0]} x {size[1]} px, and the camera's have {width} x {height}")


def _beside(path: Path, page: Path) -> str:
    """Return the address of a file relative to a page."""
    try:
        relative = os.path.relpath(path.resolve(), page.resolve().parent)
    except ValueError:  # different drive
        raise InvalidParameter(f"{path} and {page} are on different drives; put them beside each other") from None
    return quote(Path(relative).as_posix())


def _page_with(camera: AnyCamera, name: str, options: tuple[str, ...], media: str, file: str, is_video: bool) -> str:
    shown = Embedded(
        camera=camera_model(name, name, title_of(camera), options, camera),
        tables=base64_of(camera_tables(camera).values.astype("<f4").tobytes()),
        media=media,
        is_video=is_video,
        name=file,
    )
    return page_holding(embedded=shown)


def page_holding(**messages: Message) -> str:
    """Return the page with embedded messages, identified by their names (with hyphens)."""
    held = "".join(
        f'<script type="application/json" id="{name.replace("_", "-")}">'
        f"{script_json(message.model_dump_json())}</script>"
        for name, message in messages.items()
    )
    return page_text().replace(PLACE, held)


def inside(data: bytes, kind: str) -> str:
    """Return a data URL."""
    return f"data:{kind};base64,{base64_of(data)}"


def base64_of(data: bytes) -> str:
    """Encode bytes as base64 text."""
    return base64.b64encode(data).decode()
