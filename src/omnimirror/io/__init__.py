"""Input and output of images and videos.

Images are available here; video is imported from its own modules, since FFmpeg is slow to import:
``video.reader`` reads files and ``video.writer`` writes them, ``live.sources`` reads cameras and
streams, ``live.outputs`` contains pipes, streams and windows, and ``processing`` connects a source
to a sink.
"""

from ._panorama import GPano
from .images import read_image, write_image

__all__ = ["GPano", "read_image", "write_image"]
