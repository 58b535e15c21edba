"""The studio: look through a sensor in the browser, and the page that does without a server.

Needs the extra ``omnimirror[studio]``; :func:`show`, :func:`viewer_of` and :func:`page_alone` do not,
:func:`video_viewer_of` needs ``[video]`` only.
"""

from .look.alone import page_alone
from .look.viewer import video_viewer_of, viewer_of
from .notebook import LookAround, show

__all__ = ["LookAround", "page_alone", "show", "video_viewer_of", "viewer_of"]
