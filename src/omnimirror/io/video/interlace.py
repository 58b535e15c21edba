"""Deinterlacing: fields captured at different times cannot be dewarped as one image."""

from __future__ import annotations

from fractions import Fraction

import av
from av.filter import Graph


class Fields:
    """Deinterlacer of interlaced frames with FFmpeg's bwdif; other frames pass unchanged.

    Each image has the time of its first field; missing rows are estimated from the frames before
    and after, which delays the output by one frame.
    """

    def __init__(self) -> None:
        self._graph: Graph | None = None
        self._kind: tuple[int, int, str] | None = None

    def __call__(self, frame: av.VideoFrame) -> list[av.VideoFrame]:
        """Return the images that are complete after this frame."""
        if self._graph is None and not frame.interlaced_frame:
            return [frame]
        ready: list[av.VideoFrame] = []
        kind = (frame.width, frame.height, frame.format.name)
        if self._graph is None or kind != self._kind:
            ready, self._graph, self._kind = self.rest(), _graph(frame), kind
        self._graph.push(frame)
        return ready + _pulled(self._graph)

    def rest(self) -> list[av.VideoFrame]:
        """Return the delayed image."""
        graph, self._graph = self._graph, None
        if graph is None:
            return []
        graph.push(None)
        return _pulled(graph)


def _graph(frame: av.VideoFrame) -> Graph:
    graph = Graph()
    source = graph.add_buffer(
        width=frame.width,
        height=frame.height,
        format=frame.format,
        time_base=frame.time_base or Fraction(1, av.time_base),
    )
    bwdif = graph.add("bwdif", "mode=send_frame:deint=interlaced")
    sink = graph.add("buffersink")
    source.link_to(bwdif)
    bwdif.link_to(sink)
    graph.configure()
    return graph


def _pulled(graph: Graph) -> list[av.VideoFrame]:
    ready: list[av.VideoFrame] = []
    while True:
        try:
            frame = graph.pull()
        except (av.error.BlockingIOError, av.error.EOFError):
            return ready
        assert isinstance(frame, av.VideoFrame)
        ready.append(frame)
