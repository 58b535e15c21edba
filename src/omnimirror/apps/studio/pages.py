"""Static files of the page, compressed and cached by the browser."""

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
"""Scripts of the tabs and the 3-D view, loaded on demand."""


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
    >>> len(PageFile("a" * 9999, "text/html").squeezed) < 200
    True
    """

    def __init__(self, text: str, kind: str) -> None:
        self.data, self.kind = text.encode(), kind
        # weak: valid for both encodings
        self.tag = f'W/"{hashlib.sha256(self.data).hexdigest()[:20]}"'

    @cached_property
    def squeezed(self) -> bytes:
        """Compressed text, computed once."""
        return gzip.compress(self.data, 9, mtime=0)

    def answer(self, request: Request) -> Response:
        """Return the file, or 304 if the copy of the browser is current."""
        from starlette.responses import Response  # not required by pages without a server

        headers = {"etag": self.tag, "cache-control": "no-cache", "vary": "accept-encoding"}
        kept = request.headers.get("if-none-match", "")
        if self.tag in [tag.strip() for tag in kept.split(",")]:
            return Response(status_code=304, headers=headers)
        if not _takes_gzip(request.headers.get("accept-encoding", "")):
            return Response(self.data, media_type=self.kind, headers=headers)
        return Response(self.squeezed, media_type=self.kind, headers={**headers, "content-encoding": "gzip"})


def _takes_gzip(accepted: str) -> bool:
    """Check if a browser accepts gzip.

    >>> [_takes_gzip(a) for a in ("gzip, deflate, br", "br", "gzip;q=0", "identity;q=1, gzip;q=0.5")]
    [True, False, False, True]
    """
    for way in accepted.split(","):
        name, _, quality = way.partition(";")
        if name.strip() == "gzip":
            return quality.replace(" ", "") not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
    return False
