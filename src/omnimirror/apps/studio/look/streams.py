"""Videos, cameras and streams for any number of pages: read and coded once, and to each the newest frame.

A page asks for a frame when it has drawn the last one and gets the newest that there is; frames that
came meanwhile it never sees. So a slow page lags behind nobody, and nobody waits for it.
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
LINGER_S = 2.0  # a page that is loaded anew finds its stream running


class Stream:
    """One source, read in a thread for as long as anyone watches."""

    def __init__(self, shown: Shown, loop: asyncio.AbstractEventLoop) -> None:
        self.shown = shown
        self.viewers = 0
        self.count = 0
        """Frames so far; the newest is number ``count``."""
        self.state = StreamState(state="waiting", sentence=f"waiting for {shown.name}")
        self._newest: bytes | None = None
        self._loop = loop
        self._news = asyncio.Event()
        from ....io.live.playing import Playing

        # what has played comes back some day; what never answered is none, and a reload asks again
        self._playing = Playing(shown.place, shown.kind == "live", self._report, OPENING_S)
        self._thread = threading.Thread(target=self._run, name=f"studio {shown.name}", daemon=True)
        self._thread.start()

    async def after(self, count: int, state: StreamState | None) -> tuple[int, bytes | None, StreamState]:
        """The newest frame, once it is not number ``count``, or the state of the stream once it is another."""
        while self.count == count and self.state == state:
            await self._news.wait()
        return self.count, (self._newest if self.count != count else None), self.state

    def stop(self) -> None:
        """Let the source go."""
        self._playing.stop()

    # -- in the reading thread -------------------------------------------------------------------

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
        self._news.set()  # wakes all that wait, and none that come later
        self._news = asyncio.Event()


class Streams:
    """The streams that are watched just now."""

    def __init__(self) -> None:
        self._running: dict[str, Stream] = {}

    @asynccontextmanager
    async def watch(self, shown: Shown) -> AsyncIterator[Stream]:
        """A stream shared with all who watch the same source."""
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
        """Stop all of them."""
        for stream in self._running.values():
            stream.stop()
        self._running.clear()

    def _leave(self, stream: Stream) -> None:
        if stream.viewers == 0:
            stream.stop()
            if self._running.get(stream.shown.id) is stream:
                del self._running[stream.shown.id]
