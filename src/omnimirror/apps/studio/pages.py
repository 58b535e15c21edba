"""The page's own files, sent once: compressed, and again only when they have changed."""

from __future__ import annotations

import gzip
import hashlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from ...base.numerics.lazy import cached_property

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response

PAGE = Path(__file__).parent / "page" / "index.html"
SCRIPTS = ("bench.js", "space.js", "calibrate.js")
"""Of the tabs and the 3-D view, which the page fetches when they are wanted."""


@cache
def page_text() -> str:
    """The studio's page, one file with everything in it."""
    return PAGE.read_text(encoding="utf-8")


@cache
def script_text(name: str) -> str:
    """One of :data:`SCRIPTS`."""
    return PAGE.with_name(name).read_text(encoding="utf-8")


class PageFile:
    """A text that browsers keep and ask about before each use.

    Examples
    --------
    >>> len(PageFile("a" * 9999, "text/html").squeezed) < 200
    True
    """

    def __init__(self, text: str, kind: str) -> None:
        self.data, self.kind = text.encode(), kind
        # weak: the same for both ways of sending
        self.tag = f'W/"{hashlib.sha256(self.data).hexdigest()[:20]}"'

    @cached_property
    def squeezed(self) -> bytes:
        """Compressed, once."""
        return gzip.compress(self.data, 9, mtime=0)

    def answer(self, request: Request) -> Response:
        """The file, or that the browser's is still right."""
        from starlette.responses import Response  # the page from disk does without a server

        headers = {"etag": self.tag, "cache-control": "no-cache", "vary": "accept-encoding"}
        kept = request.headers.get("if-none-match", "")
        if self.tag in [tag.strip() for tag in kept.split(",")]:
            return Response(status_code=304, headers=headers)
        if not _takes_gzip(request.headers.get("accept-encoding", "")):
            return Response(self.data, media_type=self.kind, headers=headers)
        return Response(self.squeezed, media_type=self.kind, headers={**headers, "content-encoding": "gzip"})


def _takes_gzip(accepted: str) -> bool:
    """Whether a browser unpacks it.

    >>> [_takes_gzip(a) for a in ("gzip, deflate, br", "br", "gzip;q=0", "identity;q=1, gzip;q=0.5")]
    [True, False, False, True]
    """
    for way in accepted.split(","):
        name, _, quality = way.partition(";")
        if name.strip() == "gzip":
            return quality.replace(" ", "") not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
    return False
