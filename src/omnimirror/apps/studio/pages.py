"""Pages of the studio: static files, self-contained pages with an image or video, and frames in notebooks."""

from __future__ import annotations

import base64
import gzip
import hashlib
import os
from dataclasses import dataclass, field
from functools import cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import format_value, number
from ...base.caching import cached_property
from ...base.errors import InvalidParameter, MediaError
from ...base.escaping import script_json
from ...base.files import read_bytes, write_text
from ...dewarp.restoration.noise import check_restorable
from ...io import read_image
from ...io.image_metadata import UPRIGHT
from ...io.images import MAX_FILE_BYTES, orientation_of
from ...optics.camera_files import AnyCamera
from ...optics.sensor import Sensor
from ._camera_tables import camera_model, camera_tables, title_of
from ._uploads import eight_bits, encoded
from .look_messages import EmbeddedImage
from .messages import Message

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response


# -- Static files ----------------------------------------------------------------------------------

PAGE = Path(__file__).parent / "page" / "index.html"
SCRIPTS = ("design.js", "space.js", "calibrate.js", "webgpu.js")
"""Scripts of the tabs, the 3-D view and the WebGPU renderer, loaded on demand."""


@cache
def page_text() -> str:
    """Return the page of the studio as one file."""
    return PAGE.read_text(encoding="utf-8")


@cache
def script_text(name: str) -> str:
    """Return one of :data:`SCRIPTS`."""
    return PAGE.with_name(name).read_text(encoding="utf-8")


class PageFile:
    """Static text that browsers cache and revalidate before each use.

    Examples
    --------
    >>> len(PageFile("a" * 9999, "text/html").compressed) < 200
    True
    """

    def __init__(self, text: str, kind: str) -> None:
        self.data, self.kind = text.encode(), kind
        # weak: valid for both encodings
        self.tag = f'W/"{hashlib.sha256(self.data).hexdigest()[:20]}"'

    @cached_property
    def compressed(self) -> bytes:
        """Compressed text, computed once."""
        return gzip.compress(self.data, 9, mtime=0)

    def answer(self, request: Request) -> Response:
        """Return the file, or 304 if the copy of the browser is current."""
        from starlette.responses import Response  # not required by pages without a server

        headers = {"etag": self.tag, "cache-control": "no-cache", "vary": "accept-encoding"}
        etags = request.headers.get("if-none-match", "")
        if self.tag in [tag.strip() for tag in etags.split(",")]:
            return Response(status_code=304, headers=headers)
        if not _accepts_gzip(request.headers.get("accept-encoding", "")):
            return Response(self.data, media_type=self.kind, headers=headers)
        return Response(
            self.compressed, media_type=self.kind, headers={**headers, "content-encoding": "gzip"}
        )


def _accepts_gzip(accepted: str) -> bool:
    """Check if a browser accepts gzip.

    >>> [_accepts_gzip(a) for a in ("gzip, deflate, br", "br", "gzip;q=0", "identity;q=1, gzip;q=0.5")]
    [True, False, False, True]
    """
    for way in accepted.split(","):
        name, _, quality = way.partition(";")
        if name.strip() == "gzip":
            return quality.replace(" ", "") not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
    return False


# -- Self-contained page with an image or video ----------------------------------------------------

PLACE = "<!--embedded-->"
KINDS = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
"""Image formats that are embedded unchanged."""
VIDEO_KINDS = {".mp4": "video/mp4", ".m4v": "video/mp4", ".mov": "video/mp4", ".webm": "video/webm"}
CODECS = ("h264", "hevc", "vp8", "vp9", "av1")
"""Video codecs supported by browsers."""
MAX_EMBEDDED_BYTES = 64 << 20
"""Maximum size of an embedded video, bytes; a larger video remains a separate file."""


def image_viewer(
    camera: AnyCamera,
    name: str,
    options: tuple[str, ...],
    path: Path | None,
    image: NDArray[np.generic],
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
        If the image size differs from that of the camera.
    """
    _check_size(camera, (image.shape[1], image.shape[0]), "image")
    kind = KINDS.get(path.suffix.lower()) if path is not None else None
    if (
        path is not None
        and kind is not None
        and image.dtype == np.uint8
        and orientation_of(path) == UPRIGHT
    ):
        media = inside(read_bytes(path, MAX_FILE_BYTES), kind)
    else:
        media = inside(encoded(eight_bits(image), ".png"), "image/png")
    return _page_with(
        camera, name, options, media, path.name if path else "image.png", is_video=False
    )


def video_viewer(
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
        See :func:`image_viewer`.
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
        If browsers do not support the format of the video.
    InvalidParameter
        If the frame size differs from that of the camera.
    """
    from ...io.video_reader import VideoReader

    kind = VIDEO_KINDS.get(path.suffix.lower())
    if kind is None:
        raise MediaError(
            f"{path} must be a video format that browsers support ({', '.join(VIDEO_KINDS)})"
        )
    video = VideoReader(path, with_audio=False, stored_orientation=stored_orientation)
    if video.codec not in CODECS:
        raise MediaError(
            f"the video codec of {path} must be one of {', '.join(CODECS)}; got {video.codec}"
        )
    if video.rotation_deg:
        raise MediaError(
            f"{path} must have a rotation by a multiple of 90 deg, and none with "
            f"--set input.stored_orientation=true, since browsers apply it; got {video.rotation_deg} deg"
        )
    _check_size(camera, video.size, "video")
    is_small = path.stat().st_size <= MAX_EMBEDDED_BYTES
    media = inside(read_bytes(path, MAX_EMBEDDED_BYTES), kind) if is_small else _beside(path, page)
    return _page_with(camera, name, options, media, path.name, is_video=True)


def _check_size(camera: AnyCamera, size: tuple[int, int], what: str) -> None:
    if size != camera.image_size:
        width, height = camera.image_size
        raise InvalidParameter(
            f"the {what} must have {width} x {height} px, the image size of the camera; got {size[0]} x {size[1]} px"
        )


def _beside(path: Path, page: Path) -> str:
    """Return the address of a file relative to a page."""
    try:
        relative = os.path.relpath(path.resolve(), page.resolve().parent)
    except ValueError:  # different drive
        raise InvalidParameter(
            f"{path} and {page} must be on the same drive; move one of them"
        ) from None
    return quote(Path(relative).as_posix())


def _page_with(
    camera: AnyCamera, name: str, options: tuple[str, ...], media: str, file: str, is_video: bool
) -> str:
    content = EmbeddedImage(
        camera=camera_model(name, name, title_of(camera), options, camera),
        tables=base64_of(camera_tables(camera).values.astype("<f4").tobytes()),
        media=media,
        is_video=is_video,
        name=file,
    )
    return page_with_messages(embedded=content)


def page_with_messages(**messages: Message) -> str:
    """Return the page with embedded messages, identified by their names (with hyphens)."""
    held = "".join(
        '<script type="application/json" '
        f'id="{name.replace("_", "-")}">{script_json(message.model_dump_json())}</script>'
        for name, message in messages.items()
    )
    return page_text().replace(PLACE, held)


def inside(data: bytes, kind: str) -> str:
    """Return a data URL."""
    return f"data:{kind};base64,{base64_of(data)}"


def base64_of(data: bytes) -> str:
    """Encode bytes as base64 text."""
    return base64.b64encode(data).decode()


# -- Notebooks -------------------------------------------------------------------------------------

MIN_HEIGHT_PX, MAX_HEIGHT_PX = 120, 4000


@dataclass(frozen=True)
class InteractiveView:
    """Interactive page, displayed as the last expression of a notebook cell.

    Attributes
    ----------
    page
        Self-contained HTML with image and camera.
    height_px
        Height of the frame, pixels.

    Examples
    --------
    >>> InteractiveView("<p>", 300)._repr_html_()
    '<iframe srcdoc="&lt;p&gt;" style="width: 100%; height: 300px; border: 0" allow="fullscreen; gyroscope"></iframe>'
    """

    page: str = field(repr=False)
    height_px: int

    def _repr_html_(self) -> str:
        """Return the page in a frame for notebooks."""
        style = f"width: 100%; height: {self.height_px}px; border: 0"
        return f'<iframe srcdoc="{escape(self.page)}" style="{style}" allow="fullscreen; gyroscope"></iframe>'

    def save(self, path: str | Path) -> None:
        """Write the page as an HTML file.

        Parameters
        ----------
        path
            HTML file.
        """
        write_text(path, self.page)


def show(
    image: str | Path | NDArray[Any],
    camera: AnyCamera,
    *,
    height_px: int = 480,
    stored_orientation: bool = False,
) -> InteractiveView:
    """Display interactive views of an image in a notebook: pan, tilt and zoom, panoramas and other
    projections.

    Parameters
    ----------
    image : (h, w), (h, w, 3) or (h, w, 4) array, or a file
        Image; colours are RGB.
    camera
        Camera of the image: a sensor, a calibrated camera or a mirror ball.
    height_px
        Height of the view, pixels.
    stored_orientation
        Use the pixels of a file as stored and ignore the orientation in its EXIF data.

    Returns
    -------
    InteractiveView
        Page that a notebook displays as the last expression of a cell; ``save`` writes it to a
        file.

    Raises
    ------
    InvalidParameter
        If the camera is unknown, or the image size differs from that of the camera.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> ball = om.MirrorBall(centre_px=(31.5, 31.5), rim_radius_px=30.0, field_deg=300.0, image_size=(64, 64))
    >>> om.show(np.full((64, 64, 3), 90, np.uint8), ball)._repr_html_()[:15]
    '<iframe srcdoc='
    """
    if not isinstance(camera, AnyCamera):
        raise InvalidParameter(
            f"camera must be a sensor or a camera, for example from load_sensor; got {format_value(camera)}"
        )
    height = number("height_px", height_px)
    if not MIN_HEIGHT_PX <= height <= MAX_HEIGHT_PX:
        raise InvalidParameter(
            f"height_px must be between {MIN_HEIGHT_PX} and {MAX_HEIGHT_PX}; got {height:g}"
        )
    path = Path(image) if isinstance(image, str | Path) else None
    pixels = (
        read_image(image, stored_orientation=stored_orientation)
        if isinstance(image, str | Path)
        else image
    )
    check_restorable(pixels)
    name = camera.name if isinstance(camera, Sensor) else camera.KIND
    return InteractiveView(
        image_viewer(camera, name, ("--sensor", f"{name}.toml"), path, pixels), round(height)
    )
