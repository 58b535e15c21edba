"""Entry point of the streaming gateway."""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable, Mapping
from pathlib import Path

from ...base.arguments import validate_arguments
from ...base.errors import InvalidParameter, MediaError
from ...cameras.camera import Camera
from ...dewarp.interfaces import Interpolation
from ...dewarp.request import is_video
from ...io.live_outputs import stream_format
from ...io.live_sources import source_size
from ..http_server.auth import is_loopback
from ..http_server.server import listen, run_server, server_addresses
from ..named_views import NamedView
from .live_views import Gateway
from .routes import create_app


@validate_arguments
def serve_views(
    source: str,
    views: Mapping[str, NamedView],
    *,
    camera: Camera,
    interpolation: Interpolation = "auto",
    host: str = "127.0.0.1",
    port: int = 0,
    token: str | None = None,
    publish_to: str | None = None,
    threads: int | None = None,
    stored_orientation: bool = False,
    on_start: Callable[[str], None] = print,
    on_status: Callable[[str], None] | None = None,
) -> None:
    """Serve views of a camera or stream as network cameras until Ctrl-C.

    Each view is available at ``/NAME.mjpg`` (MJPEG), ``/NAME.ts`` (MPEG-TS), ``/NAME.m3u8`` (HLS)
    and ``/NAME.jpg`` (one image). ``/api/views`` lists the views; a POST request with JSON to
    ``/api/views/NAME`` steers a steerable view.

    Parameters
    ----------
    source
        Camera or stream (``/dev/video0``, ``rtsp://...``), or a video file, which is repeated.
    views
        Views by name, such as the result of :func:`omnimirror.load_views`.
    camera
        Camera model of the source images.
    interpolation
        As for :class:`omnimirror.Dewarper`.
    host, port
        Address of the server; port 0 selects a free port.
    token
        Access token, sent by clients as the password of any user or as ``?token=``. If the server
        is reachable from other machines, the default is a random token.
    publish_to
        URL of a media server to which every view is pushed; ``{view}`` is replaced by its name.
    threads
        Number of dewarping threads; default: one per core.
    stored_orientation
        Ignore the rotation in the display matrix of a video, for cameras that were calibrated with
        stored pixels. By default, it is applied and reported.
    on_start
        Called with a sentence with the addresses of the server.
    on_status
        Called with a sentence when the source is lost or restored, or its frames are rotated;
        default: ``on_start``.

    Raises
    ------
    InvalidParameter
        If there are no views, a view has odd sides, or the token or the URL is invalid.
    MediaError
        If the source is not a camera, stream or video file.
    OmnimirrorError
        If the server cannot listen on the address.
    KeyboardInterrupt
        After Ctrl-C.

    Examples
    --------
    >>> import omnimirror as om
    >>> views = {"front": om.NamedView("front")}
    >>> om.serve_views("missing.mp4", views, camera=om.load_sensor("paper-spherical"))
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.MediaError: source must be a camera, stream or video file; got missing.mp4
    """
    is_file = Path(source).is_file()
    check_source(source)
    if not views:
        raise InvalidParameter("views must contain at least one view; got none")
    if token is not None and not re.fullmatch("[!-~]+", token):
        raise InvalidParameter(
            "token must consist of ASCII letters, digits and punctuation characters without spaces"
        )
    if publish_to is not None:
        stream_format(publish_to)
        if "{view}" not in publish_to:
            raise InvalidParameter(
                f"publish_to must contain {{view}}, the name of the view; got {publish_to}"
            )
    gateway = Gateway(
        source,
        not is_file,
        camera,
        views,
        interpolation,
        on_status or on_start,
        threads,
        stored_orientation=stored_orientation,
    )
    if token is None and not is_loopback(host):
        token = secrets.token_urlsafe(16)
    listener = listen(host, port)
    bound_port = listener.getsockname()[1]
    query = f"?token={token}" if token else ""
    urls = [f"http://{name}:{bound_port}/{query}" for name in server_addresses(host)]
    count = "1 view" if len(views) == 1 else f"{len(views)} views"
    on_start(f"omnimirror serves {count} at {' or '.join(urls)} (Ctrl-C to stop)")
    run_server(create_app(gateway, token, publish_to), listener)


def check_source(source: str) -> None:
    """Raise MediaError unless a source is a camera, a stream or a readable video file."""
    is_live = "://" in source or source.startswith("/dev/") or source.isdigit()
    if source == "-" or not is_video(source) or not (is_live or Path(source).is_file()):
        raise MediaError(f"source must be a camera, stream or video file; got {source}")
    if not is_live:
        source_size(source, is_live=False)
