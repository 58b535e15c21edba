"""``omnimirror view``: studio page for images, videos, cameras or streams."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ....base.errors import MediaError
from ....dewarp.request import is_video
from ....io import read_image
from .._camera_options import CameraOptions, OrientationOptions
from .._declarations import DocumentedCommand, add_options
from .studio import ServerOptions, orientation_remark, run_studio

if TYPE_CHECKING:
    from ...studio._look_cameras import NamedCamera
    from ...studio._server_state import Studio


@click.command(
    cls=DocumentedCommand,
    page="studio",
    examples=(
        "omnimirror view /dev/video0 --sensor mine.toml",
        "omnimirror view room.mp4 --sensor mine.toml",
        "omnimirror view rtsp://door/1 rtsp://yard/1 --sensor mine.toml",
    ),
)
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@add_options(CameraOptions, "camera")
@add_options(OrientationOptions, "orientation")
@add_options(ServerOptions, "server")
def command(
    sources: tuple[str, ...],
    camera: CameraOptions,
    orientation: OrientationOptions,
    server: ServerOptions,
) -> None:
    """View each SOURCE in the browser.

    SOURCE is an image, a video file, or a camera or stream (/dev/video0, rtsp://...); the page
    opens with the first and lists the others. Specify the camera with --sensor or
    --ball, or select it on the page.
    """
    if camera.given:
        camera.check()

    def make() -> Studio:
        from ...studio._server_state import Sources, Studio

        live = [source for source in sources if _is_live(source)]
        named_camera = _known(sources[0], camera, orientation) if camera.given else None
        return Studio(
            Sources(sources, server.folders, live),
            named_camera,
            stored_orientation=orientation.stored_orientation,
            on_note=orientation_remark,
        )

    run_studio(make, server)


def _is_live(source: str) -> bool:
    """Return whether a source is a camera or stream; raise an error unless it is one of these or a
    file.
    """
    live = is_video(source) and not Path(source).is_file()
    if live and Path(source).suffix and "://" not in source and not source.startswith("/dev/"):
        raise MediaError(f"cannot read the video {source}: the file does not exist")
    if not live and not is_video(source):
        read_image(source)
    return live


def _known(source: str, options: CameraOptions, orientation: OrientationOptions) -> NamedCamera:
    """Return the camera of the options; the page adds its mounting to the command line."""
    from ...studio._camera_tables import title_of
    from ...studio._look_cameras import NamedCamera

    size = (1024, 1024)
    if options.ball is not None and not is_video(source):
        height, width = read_image(source, stored_orientation=orientation.stored_orientation).shape[
            :2
        ]
        size = (width, height)
    name, arguments = options.command_words()
    camera = options.camera(size)
    return NamedCamera("given", name, title_of(camera), arguments, camera)
