"""One source for many views: read while anyone watches any of them, drawn for those who do."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

import av

from ...cameras import Camera
from ...dewarp.contracts import Interpolation
from ...errors import InvalidParameter, OmnimirrorError
from ...media.live.playing import Playing
from ...media.live.sources import TICKS, named
from ...media.video.frames import planar
from ...native import usable_cores
from ..named_views import NamedView
from .live_view import LiveView
from .publishing import publish

LINGER_S = 10.0
"""For so long the source is read on when nobody watches any more: a player that comes back begins at once."""
CHECK_EVERY_S = 1.0
RETRY_S = 10.0
"""After which a source that gave up is asked again: it may be another camera that has come to that place."""


class Gateway:
    """What is offered: a source, and its views.

    Parameters
    ----------
    source
        A camera, an address, or a file, which is played again and again.
    is_live
        Whether it is a camera or an address.
    camera
        Which took it.
    views
        By name.
    interpolation
        As for :class:`omnimirror.Dewarper`.
    tell
        Told in a sentence when the source is lost and when it is back.
    workers
        Threads that draw; one for each core of the processor by default.
    """

    def __init__(
        self,
        source: str,
        is_live: bool,
        camera: Camera,
        views: Mapping[str, NamedView],
        interpolation: Interpolation = "auto",
        tell: Callable[[str], None] = lambda sentence: None,
        workers: int | None = None,
    ) -> None:
        self.source, self._is_live, self._tell = source, is_live, tell
        self.views = {name: LiveView(view, camera, interpolation, self.wake) for name, view in views.items()}
        self.state = f"nobody watches {named(source)}"
        self.received = 0
        """Frames that came from the source."""
        self._pool = ThreadPoolExecutor(workers or usable_cores(), "drawing")
        self._camera = camera
        self._playing: Playing | None = None
        self._begun, self._is_checking = float("-inf"), False
        self._idle_since: float | None = None
        self._start = time.monotonic()

    async def publish(self, template: str) -> None:
        """Push every view to an address in which ``{view}`` stands for its name, until it is cancelled."""
        async with asyncio.TaskGroup() as pushed:
            for name, view in self.views.items():
                pushed.create_task(publish(view.transport, template.replace("{view}", name), self._tell))

    def wake(self) -> None:
        """Begin to read the source, if it is not read already; in the event loop."""
        self._idle_since = None
        if self._playing is None and not self._is_checking:
            self._is_checking = True
            self._begin()
            asyncio.get_running_loop().call_later(CHECK_EVERY_S, self._check)

    def close(self) -> None:
        """Let the source go, and draw no more."""
        if self._playing is not None:
            self._playing.stop()
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _begin(self) -> None:
        self.state = f"waiting for {named(self.source)}"
        self._playing, self._begun = Playing(self.source, self._is_live, self._report), time.monotonic()
        threading.Thread(target=self._read, args=(self._playing,), name="gateway", daemon=True).start()

    def _check(self) -> None:
        """Stop reading when nobody has watched for a while; begin again where the source gave up and somebody does."""
        now = time.monotonic()
        if any(view.is_wanted for view in self.views.values()):
            self._idle_since = None
            if self._playing is None and now - self._begun > RETRY_S:
                self._begin()
        elif self._idle_since is None:
            self._idle_since = now
        elif now - self._idle_since > LINGER_S:
            self._end()
            return
        asyncio.get_running_loop().call_later(CHECK_EVERY_S, self._check)

    def _end(self) -> None:
        self._is_checking = False
        if self._playing is not None:
            self._playing.stop()
            self._playing = None
        self.state = f"nobody watches {named(self.source)}"
        for view in self.views.values():
            view.rest()

    # -- in the reading thread -----------------------------------------------------------------------

    def _read(self, playing: Playing) -> None:
        try:
            for frame in playing.frames():
                if self._playing is not playing:
                    return
                self._offer(frame, playing)
        except OmnimirrorError as e:
            self._report(str(e))
        finally:
            if self._playing is playing:
                self._playing = None

    def _offer(self, frame: av.VideoFrame, playing: Playing) -> None:
        if (frame.width, frame.height) != self._camera.image_size:
            width, height = self._camera.image_size
            raise InvalidParameter(
                f"{named(self.source)} has {frame.width} x {frame.height} px, and the camera's have {width} x {height}"
            )
        self.received += 1
        self.state = f"{named(self.source)} is playing"
        frame = planar(frame)  # once for all views
        frame.time_base, frame.pts = TICKS, round((time.monotonic() - self._start) / TICKS)
        for view in self.views.values():
            if playing.frame_rate:
                view.tell_rate(playing.frame_rate)
            view.offer(frame, playing.siting, self._pool)

    def _report(self, sentence: str) -> None:
        self.state = sentence
        self._tell(sentence)
