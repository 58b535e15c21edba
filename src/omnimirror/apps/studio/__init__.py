"""Studio: browser application for sensors and their images, and pages that need no server.

Requires the extra ``omnimirror[studio]``, except :func:`show`, :func:`viewer_of` and
:func:`page_alone`, which require no extra, and :func:`video_viewer_of`, which requires ``[video]``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._standalone_page import page_alone as page_alone
    from .pages import LookAround as LookAround
    from .pages import show as show
    from .pages import video_viewer_of as video_viewer_of
    from .pages import viewer_of as viewer_of

_HOMES = {
    "LookAround": "pages",
    "page_alone": "_standalone_page",
    "show": "pages",
    "video_viewer_of": "pages",
    "viewer_of": "pages",
}
__all__ = list(_HOMES)


if not TYPE_CHECKING:  # type checkers see the names above and must reject all others

    def __getattr__(name: str) -> Any:
        if name in _HOMES:
            return getattr(import_module(f".{_HOMES[name]}", __name__), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
