"""``omnimirror studio``: image viewer and sensor design in the browser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ....base.errors import OmnimirrorError, extra_remedy
from ....base.files import write_text
from .._camera_options import OrientationOptions
from .._declarations import DocumentedCommand, IntegerRange, Options, add_options, option
from .._output import is_quiet, print_line, print_remark, progress_bar

if TYPE_CHECKING:
    from ...studio._server_state import Studio


@dataclass(frozen=True)
class ListenOptions(Options):
    """Server."""

    host: str = option(
        default="127.0.0.1",
        help="Host address; addresses reachable from other machines require a token.",
    )
    port: int = option(
        type=IntegerRange(0, 65535),
        default=0,
        show_default=False,
        help="Port.  [default: any free port]",
    )


@dataclass(frozen=True)
class ServerOptions(ListenOptions):
    """Server and browser."""

    open_browser: bool = option(
        "--open/--no-open", default=True, show_default=False, help="Open the page in the browser."
    )
    folders: tuple[Path, ...] = option(
        "--folder",
        multiple=True,
        type=click.Path(exists=True, file_okay=False, path_type=Path),
        help="Also serve the images and videos of a folder.",
    )


@dataclass(frozen=True)
class PageOptions(Options):
    """Standalone page."""

    page: Path | None = option(
        "--page",
        type=click.Path(dir_okay=False, path_type=Path),
        help="Write a standalone page that views any image through the bundled sensors, without a server.",
    )


def orientation_remark(message: str) -> None:
    """Print a remark on an image or video that a page opened."""
    print_remark(f"omnimirror: {message}")


def run_studio(make: Callable[[], Studio], server: ServerOptions) -> None:
    """Serve until Ctrl-C, or report the missing packages."""
    try:
        from ...studio.app import serve
    except ModuleNotFoundError as e:
        if e.name not in ("fastapi", "starlette", "uvicorn"):
            raise
        raise OmnimirrorError(
            f"the studio requires FastAPI and uvicorn: {extra_remedy('studio')}"
        ) from None
    serve(make(), server.host, server.port, server.open_browser, click.echo)


@click.command(
    cls=DocumentedCommand,
    page="studio",
    examples=("omnimirror studio --folder images", "omnimirror studio --page viewer.html"),
)
@add_options(PageOptions, "standalone")
@add_options(OrientationOptions, "orientation")
@add_options(ServerOptions, "server")
def command(
    server: ServerOptions, orientation: OrientationOptions, standalone: PageOptions
) -> None:
    """Open the studio in the browser: view images, videos and cameras through a sensor, or design
    one.

    The server listens on this machine only, unless --host is given.
    """
    if standalone.page is not None:
        return _write_page(standalone.page)

    def make() -> Studio:
        from ...studio._server_state import Sources, Studio

        return Studio(
            Sources(folders=server.folders),
            stored_orientation=orientation.stored_orientation,
            on_note=orientation_remark,
        )

    run_studio(make, server)


def _write_page(path: Path) -> None:
    """Write the standalone page."""
    from rich.console import Console

    from ...studio import standalone_page

    if path.suffix.lower() not in (".html", ".htm"):
        raise click.UsageError(
            f"--page must be an HTML file, such as {path.stem or 'viewer'}.html; got {path}"
        )
    with progress_bar(Console(stderr=True, quiet=is_quiet())) as bar:
        task = bar.add_task("Simulating rooms", total=None)
        text = standalone_page(
            on_progress=lambda done, all_: bar.update(task, completed=done, total=all_)
        )
    write_text(path, text)
    print_line(
        f"Wrote {path}; open it in a browser, or host it on a web server, and drop images on it"
    )
