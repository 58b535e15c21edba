"""``omnimirror studio``: the workbench in the browser."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from ....errors import OmnimirrorError
from ...options.common import WholeRange

if TYPE_CHECKING:
    from ....studio.app import Studio

Command = TypeVar("Command", bound=Callable[..., Any])

_OPTIONS = (
    click.option(
        "--host", default="127.0.0.1", show_default=True, help="Where to listen; beyond this machine, with a token."
    ),
    click.option("--port", type=WholeRange(0, 65535), default=0, help="Where to listen.  [default: any that is free]"),
    click.option("--open/--no-open", "open_browser", default=True, help="Whether to open the page in the browser."),
    click.option(
        "--folder",
        "folders",
        multiple=True,
        type=click.Path(exists=True, file_okay=False, path_type=Path),
        help="Offer the pictures and videos of a folder too.",
    ),
)


def server_options(command: Command) -> Command:
    """Give a click command all options that describe the server."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def run_studio(make: Callable[[], Studio], host: str, port: int, open_browser: bool) -> None:
    """Serve until Ctrl-C, or say what is missing."""
    try:
        from ....studio.serve import serve
    except ModuleNotFoundError as e:
        if e.name not in ("fastapi", "starlette", "uvicorn"):
            raise
        raise OmnimirrorError("the studio needs FastAPI and uvicorn: pip install 'omnimirror[studio]'") from None
    serve(make(), host, port, open_browser, click.echo)


@click.command()
@server_options
def command(host: str, port: int, open_browser: bool, folders: tuple[Path, ...]) -> None:
    """Open the studio in the browser: look through a sensor at pictures, videos and cameras.

    It listens on this machine alone unless --host says otherwise.
    """

    def make() -> Studio:
        from ....studio.app import Studio
        from ....studio.look.sources import Sources

        return Studio(Sources(folders=folders))

    run_studio(make, host, port, open_browser)
