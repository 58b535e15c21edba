"""``omnimirror studio``: look through a sensor, and design one, in the browser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ....errors import OmnimirrorError
from ...help_pages import DocumentedCommand
from ...options.common import WholeRange
from ...options.declared import Options, option, takes

if TYPE_CHECKING:
    from ....studio.studio import Studio


@dataclass(frozen=True)
class ListenOptions(Options):
    """Where a server listens."""

    host: str = option(default="127.0.0.1", help="Where to listen; beyond this machine, with a token.")
    port: int = option(
        type=WholeRange(0, 65535), default=0, show_default=False, help="Where to listen.  [default: any that is free]"
    )


@dataclass(frozen=True)
class ServerOptions(ListenOptions):
    """How the page is served."""

    open_browser: bool = option(
        "--open/--no-open", default=True, show_default=False, help="Whether to open the page in the browser."
    )
    folders: tuple[Path, ...] = option(
        "--folder", multiple=True, type=click.Path(exists=True, file_okay=False, path_type=Path),
        help="Offer the pictures and videos of a folder too.",
    )  # fmt: skip


def run_studio(make: Callable[[], Studio], server: ServerOptions) -> None:
    """Serve until Ctrl-C, or say what is missing."""
    try:
        from ....studio.server import serve
    except ModuleNotFoundError as e:
        if e.name not in ("fastapi", "starlette", "uvicorn"):
            raise
        raise OmnimirrorError("the studio needs FastAPI and uvicorn: pip install 'omnimirror[studio]'") from None
    serve(make(), server.host, server.port, server.open_browser, click.echo)


@click.command(
    cls=DocumentedCommand,
    page="studio",
    examples=("omnimirror studio --folder pictures",),
)
@takes(ServerOptions, "server")
def command(server: ServerOptions) -> None:
    """Open the studio in the browser: look through a sensor at pictures, videos and cameras, or design one.

    It listens on this machine alone unless --host says otherwise.
    """

    def make() -> Studio:
        from ....studio.look.sources import Sources
        from ....studio.studio import Studio

        return Studio(Sources(folders=server.folders))

    run_studio(make, server)
