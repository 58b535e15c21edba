"""Run the gateway until Ctrl-C."""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable, Mapping
from pathlib import Path

from ...arguments import checked
from ...cameras import Camera
from ...dewarp.contracts import Interpolation
from ...errors import InvalidParameter, MediaError
from ...media.live.outputs import stream_format
from ...media.live.playing import size_of
from ...straighten import is_video
from ..http_server.access import is_loopback
from ..http_server.server import listen, names_of, run
from ..named_views import NamedView
from .gateway import Gateway
from .routes import create_app


@checked
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
    tell: Callable[[str], None] = print,
    report: Callable[[str], None] | None = None,
) -> None:
    """Offer views of a camera or stream as ordinary cameras on the network, until Ctrl-C.

    Each is at ``/NAME.mjpg`` (MJPEG), ``/NAME.ts`` (MPEG-TS), ``/NAME.m3u8`` (HLS) and ``/NAME.jpg`` (one picture).
    ``/api/views`` lists them; a POST of JSON to ``/api/views/NAME`` steers one that is steered.

    Parameters
    ----------
    source
        A camera or stream (``/dev/video0``, ``rtsp://..``), or a video file, which is played again and again.
    views
        By name, such as :func:`omnimirror.load_views` reads.
    camera
        Which takes the pictures.
    interpolation
        As for :class:`omnimirror.Dewarper`.
    host, port
        Where to listen; port 0 takes any that is free.
    token
        What who watches must know, as a password with any name or as ``?token=``. Beyond this machine one is made where
        none is given.
    publish_to
        The address of a server to which every view is pushed too, with ``{view}`` for its name.
    threads
        That draw; one for each core of the processor by default.
    tell
        Told the addresses, in a sentence.
    report
        Told in a sentence when the source is lost and when it is back; as ``tell`` by default.

    Raises
    ------
    InvalidParameter
        There are no views, or one of odd sides; or the token or the address to publish to is none.
    MediaError
        The source is no camera, stream or video file.
    OmnimirrorError
        The address cannot be listened on.
    KeyboardInterrupt
        Ctrl-C ended it.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.serve_views("nowhere.mp4", {"front": om.NamedView("front")}, camera=om.load_sensor("paper-spherical"))
    Traceback (most recent call last):
    ...
    omnimirror.errors.MediaError: nowhere.mp4 is no camera, stream or video file
    """
    is_file = Path(source).is_file()
    check_source(source)
    if not views:
        raise InvalidParameter("views is empty; it is valid with one at least")
    if token == "":
        raise InvalidParameter("the token is empty; leave it out, or give a word")
    if token is not None and not re.fullmatch("[!-~]+", token):
        raise InvalidParameter("token must consist of ASCII letters, digits and signs, without spaces")
    if publish_to is not None:
        stream_format(publish_to)
        if "{view}" not in publish_to:
            raise InvalidParameter(f"{publish_to} is one address for all views to be published; put {{view}} into it")
    gateway = Gateway(source, not is_file, camera, views, interpolation, report or tell, threads)
    if token is None and not is_loopback(host):
        token = secrets.token_urlsafe(16)
    listening = listen(host, port)
    bound = listening.getsockname()[1]
    query = f"?token={token}" if token else ""
    addresses = [f"http://{name}:{bound}/{query}" for name in names_of(host)]
    count = "1 view" if len(views) == 1 else f"{len(views)} views"
    tell(f"omnimirror serves {count} at {' or '.join(addresses)} (Ctrl-C ends it)")
    run(create_app(gateway, token, publish_to), listening)


def check_source(source: str) -> None:
    """Refuse what cannot be a camera, stream or video file, and a file that cannot be read as one."""
    is_place = "://" in source or source.startswith("/dev/") or source.isdigit()
    if source == "-" or not is_video(source) or not (is_place or Path(source).is_file()):
        raise MediaError(f"{source} is no camera, stream or video file")
    if not is_place:
        size_of(source, is_live=False)
