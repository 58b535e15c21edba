"""The studio: look through a sensor in the browser, and the page that does without a server.

Needs the extra ``omnimirror[studio]``; :func:`show` and :func:`viewer_of` do not, :func:`video_viewer_of` needs
``[video]`` only.
"""

from .look.viewer import video_viewer_of, viewer_of
from .notebook import LookAround, show

__all__ = ["LookAround", "show", "video_viewer_of", "viewer_of"]
