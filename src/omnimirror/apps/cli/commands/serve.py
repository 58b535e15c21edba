"""``omnimirror serve``: views of a camera as network cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from ....base.errors import OmnimirrorError, extra_remedy
from ....base.native import MAX_THREADS
from ....dewarp.interfaces import Interpolation
from ....interop.named_views import load_views
from .._camera_options import CameraOptions, OrientationOptions
from .._declarations import (
    DocumentedCommand,
    IntegerRange,
    add_options,
    file_entries,
    option,
    setting,
)
from .._output import print_notice
from .studio import ListenOptions


@dataclass(frozen=True)
class GatewayOptions(ListenOptions):
    """Options of the gateway."""

    token: str | None = option(
        envvar="OMNIMIRROR_TOKEN",
        help="Access token: password of any user, or ?token=...; also from OMNIMIRROR_TOKEN.  "
        "[default: random if reachable from other machines]",
    )
    publish: str | None = option(
        metavar="ADDRESS",
        help="Also push every view to a media server, such as 'rtsp://server:8554/{view}'.",
    )
    interpolation: Interpolation = setting("resampling", default="auto")
    threads: int | None = setting("resampling", type=IntegerRange(1, MAX_THREADS))


@click.command(
    cls=DocumentedCommand,
    page="gateway",
    examples=("omnimirror serve rtsp://camera/1 --views views.toml --sensor mine.toml",),
)
@click.argument("source")
@click.option(
    "--views",
    "views_file",
    required=True,
    type=click.Path(path_type=Path),
    help="TOML file of named views.",
)
@add_options(CameraOptions, "camera")
@add_options(OrientationOptions, "orientation")
@add_options(GatewayOptions, "gateway")
@file_entries("--views file", None)
def command(
    source: str,
    views_file: Path,
    camera: CameraOptions,
    orientation: OrientationOptions,
    gateway: GatewayOptions,
    changes: dict[str, Any],
) -> None:
    """Serve views of SOURCE as network cameras: MJPEG, MPEG-TS, HLS and JPEG images over HTTP.

    SOURCE is a camera or stream (/dev/video0, rtsp://...), or a video file, which is repeated. Each
    view of the file is available at /NAME.mjpg, /NAME.ts, /NAME.m3u8 and /NAME.jpg; /api/views
    lists them, and a POST request to /api/views/NAME steers a steerable view.
    """
    camera.check()
    try:
        from ....interop.gateway.serving import check_source, serve_views
        from ....io.live_sources import source_size
    except ModuleNotFoundError as e:
        if e.name not in ("fastapi", "starlette", "uvicorn", "av"):
            raise
        raise OmnimirrorError(
            f"serving views requires FastAPI and PyAV: {extra_remedy('studio')}"
        ) from None
    check_source(source)
    views = load_views(views_file, changes)
    is_stored = orientation.stored_orientation
    is_live = not Path(source).is_file()
    size = (
        (0, 0)
        if camera.ball is None
        else source_size(source, is_live, stored_orientation=is_stored)
    )
    serve_views(
        source,
        views,
        camera=camera.drawing(camera.camera(size)),
        interpolation=gateway.interpolation,
        host=gateway.host,
        port=gateway.port,
        token=gateway.token,
        publish_to=gateway.publish,
        threads=gateway.threads,
        stored_orientation=is_stored,
        on_start=click.echo,
        on_status=print_notice,
    )
