"""Studio: browser application for sensors and their images, and pages that need no server.

Requires the extra ``omnimirror[studio]``, except :func:`show`, :func:`image_viewer` and
:func:`standalone_page`, which require no extra, and :func:`video_viewer`, which requires ``[video]``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._standalone_page import standalone_page as standalone_page
    from .pages import InteractiveView as InteractiveView
    from .pages import image_viewer as image_viewer
    from .pages import show as show
    from .pages import video_viewer as video_viewer

_HOMES = {
    "InteractiveView": "pages",
    "standalone_page": "_standalone_page",
    "show": "pages",
    "video_viewer": "pages",
    "image_viewer": "pages",
}
__all__ = list(_HOMES)


if not TYPE_CHECKING:  # type checkers see the names above and must reject all others

    def __getattr__(name: str) -> Any:
        if name in _HOMES:
            return getattr(import_module(f".{_HOMES[name]}", __name__), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
