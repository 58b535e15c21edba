"""The studio: look through a sensor in the browser, and the page that does without a server.

Needs the extra ``omnimirror[studio]``; :func:`viewer_of` does not.
"""

from .viewer import viewer_of

__all__ = ["viewer_of"]
