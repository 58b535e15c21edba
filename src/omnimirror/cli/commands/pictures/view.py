"""``omnimirror view``: the studio, opened on a picture, video, camera or stream."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ....errors import MediaError
from ....media import read_image
from ...options.camera import camera_of, camera_options, camera_words, check_camera_options
from .dewarp import is_video
from .studio import run_studio, server_options

if TYPE_CHECKING:
    from ....studio.app import Studio
    from ....studio.look.cameras import Known


@click.command()
@click.argument("source")
@camera_options
@server_options
def command(source: str, host: str, port: int, open_browser: bool, folders: tuple[Path, ...], **options: Any) -> None:
    """Look around in SOURCE, in the browser.

    SOURCE is a picture, a video file, or a camera or stream (/dev/video0, rtsp://..). Say which camera it
    was with one of --sensor, --ocam and --ball, or choose it in the page.
    """
    given = {name: value for name, value in options.items() if value is not None}
    if given:
        check_camera_options(given)

    def make() -> Studio:
        from ....studio.app import Studio
        from ....studio.look.sources import Sources

        return Studio(Sources(source, folders, _is_live(source)), _known(source, given) if given else None)

    run_studio(make, host, port, open_browser)


def _is_live(source: str) -> bool:
    """Whether it is a camera or stream; what is neither that nor a file is refused before a page opens."""
    live = is_video(source) and not Path(source).is_file()
    if live and Path(source).suffix and "://" not in source and not source.startswith("/dev/"):
        raise MediaError(f"there is no video {source}")
    if not live and not is_video(source):
        read_image(source)
    return live


def _known(source: str, given: dict[str, Any]) -> Known:
    """The camera that the options describe; the page adds to its command line how it stands."""
    from ....studio.look.cameras import Known
    from ....studio.look.tables import title_of

    size = (1024, 1024)
    if "ball" in given and not is_video(source):
        height, width = read_image(source).shape[:2]
        size = (width, height)
    name, words = camera_words(given)
    camera = camera_of(given, size)
    return Known("given", name, title_of(camera), words, camera)
