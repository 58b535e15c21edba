"""The studio: look through a sensor in the browser, and the page that does without a server.

Needs the extra ``omnimirror[studio]``; :func:`viewer_of` does not, and :func:`video_viewer_of` only ``[video]``.
"""

from .look.viewer import video_viewer_of, viewer_of

__all__ = ["video_viewer_of", "viewer_of"]
