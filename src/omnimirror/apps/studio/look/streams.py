"""Videos, cameras and streams for any number of pages, decoded and encoded once.

A page requests a frame after it has drawn the previous one and receives the newest; intermediate
frames are dropped. A slow page therefore accumulates no delay and does not slow down other pages.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Literal

from ....base.errors import OmnimirrorError
from ..uploads import encoded
from .messages import StreamState
from .sources import Shown

State = Literal["waiting", "playing", "lost", "ended"]
OPENING_S = 60.0
LINGER_S = 2.0  # a reloaded page finds its stream still running


class Stream:
    """Source that is read in a thread while pages watch it."""

    def __init__(self, shown: Shown, loop: asyncio.AbstractEventLoop) -> None:
        self.shown = shown
        self.viewers = 0
        self.count = 0
        """Number of frames so far; also the index of the newest frame."""
        self.state = StreamState(state="waiting", sentence=f"waiting for {shown.name}")
        self._newest: bytes | None = None
        self._loop = loop
        self._news = asyncio.Event()
        from ....io.live.playing import Playing

        # A source that has played before is reopened after a failure; one that never opened is
        # reported as an error, and a reload tries again.
        self._playing = Playing(shown.place, shown.kind == "live", self._report, OPENING_S)
        self._thread = threading.Thread(target=self._run, name=f"studio {shown.name}", daemon=True)
        self._thread.start()

    async def after(self, count: int, state: StreamState | None) -> tuple[int, bytes | None, StreamState]:
        """Wait for a frame newer than ``count`` or a change of state; return both."""
        while self.count == count and self.state == state:
            await self._news.wait()
        return self.count, (self._newest if self.count != count else None), self.state

    def stop(self) -> None:
        """Close the source."""
        self._playing.stop()

    # -- reader thread -------------------------------------------------------------------------

    def _run(self) -> None:
        from ....io.video.frames import image_of_frame

        try:
            for frame in self._playing.frames():
                self._tell(encoded(image_of_frame(frame), ".jpg"), "playing", f"{self.shown.name} is playing")
            self._tell(None, "ended", f"{self.shown.name} has ended")
        except OmnimirrorError as e:
            self._tell(None, "ended", str(e))

    def _report(self, sentence: str) -> None:
        self._tell(None, "playing" if " is back " in sentence else "lost", sentence)

    def _tell(self, jpeg: bytes | None, state: State, sentence: str) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._publish, jpeg, StreamState(state=state, sentence=sentence))

    def _publish(self, jpeg: bytes | None, state: StreamState) -> None:
        if jpeg is not None:
            self._newest, self.count = jpeg, self.count + 1
        self.state = state
        self._news.set()  # wakes all current waiters, not later ones
        self._news = asyncio.Event()


class Streams:
    """Streams that are currently watched."""

    def __init__(self) -> None:
        self._running: dict[str, Stream] = {}

    @asynccontextmanager
    async def watch(self, shown: Shown) -> AsyncIterator[Stream]:
        """Return a stream shared by all pages that watch the source."""
        stream = self._running.get(shown.id)
        if stream is None or stream.state.state == "ended":
            stream = self._running[shown.id] = Stream(shown, asyncio.get_running_loop())
        stream.viewers += 1
        try:
            yield stream
        finally:
            stream.viewers -= 1
            asyncio.get_running_loop().call_later(LINGER_S, self._leave, stream)

    def close(self) -> None:
        """Stop all streams."""
        for stream in self._running.values():
            stream.stop()
        self._running.clear()

    def _leave(self, stream: Stream) -> None:
        if stream.viewers == 0:
            stream.stop()
            if self._running.get(stream.shown.id) is stream:
                del self._running[stream.shown.id]
