"""State of a studio server: sources, streams, cameras, and queues for long-running requests."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Container, Iterable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ...base.errors import OmnimirrorError
from ...interop.http_server.limits import JobQueue
from ...io.batch import IMAGE_SUFFIXES, VIDEO_SUFFIXES
from ._look_cameras import Cameras, NamedCamera
from ._uploads import encoded
from ._workers import BoardDetectorPool, OutlineSearches, Restorations
from .look_messages import Source, StreamState

# -- Sources ---------------------------------------------------------------------------------------

MAX_LISTED = 2000


@dataclass(frozen=True)
class ListedSource:
    """Source with its location; the page receives only its ``id``."""

    id: str
    name: str
    kind: Literal["image", "video", "live"]
    place: str

    @property
    def message(self) -> Source:
        return Source(id=self.id, name=self.name, kind=self.kind, command=self.command)

    @property
    def command(self) -> str:
        """Location of the source, relative to the working directory if shorter."""
        here = Path.cwd()
        is_near = self.kind != "live" and Path(self.place).is_relative_to(here)
        return str(Path(self.place).relative_to(here)) if is_near else self.place


class Sources:
    """Available sources. A page selects from the list and never sends a path.

    Parameters
    ----------
    given
        Images, videos, cameras and streams; the page opens the first.
    folders
        Folders of additional images and videos.
    live
        Given sources that are cameras or streams.

    Raises
    ------
    MediaError
        If the address of a camera or stream is invalid.
    """

    def __init__(
        self, names: Sequence[str] = (), folders: Iterable[Path] = (), live: Container[str] = ()
    ) -> None:
        unique_names = list(dict.fromkeys(names))
        ids = ["source", *(f"source-{number}" for number in range(2, len(unique_names) + 1))]
        self.given = [
            _listed(id, name, name in live) for id, name in zip(ids, unique_names, strict=False)
        ]
        self._folders = [folder.resolve() for folder in folders]

    def list(self) -> list[ListedSource]:
        """Return all currently available sources."""
        names = list(self.given)
        for number, folder in enumerate(self._folders):
            for path in sorted(folder.iterdir()):
                inside = path.resolve().is_relative_to(
                    folder
                )  # symbolic links can point outside the folder
                if inside and path.is_file() and kind_of_file(path) and len(names) < MAX_LISTED:
                    source = _listed(f"{number}/{path.name}", str(path), False)
                    names.append(source)
        return names

    def find(self, id: str) -> ListedSource:
        """Return a source by id.

        Raises
        ------
        KeyError
            If the id is unknown.
        """
        for source in self.list():
            if source.id == id:
                return source
        raise KeyError(id)


def kind_of_file(path: Path) -> Literal["image", "video"] | None:
    """Return the kind of a file by its suffix.

    >>> kind_of_file(Path("room.PNG")), kind_of_file(Path("ride.mp4")), kind_of_file(Path("notes.txt"))
    ('image', 'video', None)
    """
    suffix = path.suffix.lower()
    return "image" if suffix in IMAGE_SUFFIXES else "video" if suffix in VIDEO_SUFFIXES else None


def _listed(id: str, name: str, is_live: bool) -> ListedSource:
    if is_live:
        from ...io.live_sources import resolve_source, without_credentials

        resolve_source(name)
        return ListedSource(id, without_credentials(name), "live", name)
    path = Path(name)
    return ListedSource(id, path.name, kind_of_file(path) or "image", name)


# -- Streams ---------------------------------------------------------------------------------------
#
# A page requests a frame after it has drawn the previous one and receives the newest; intermediate
# frames are dropped. A slow page therefore accumulates no delay and does not slow down other pages.

State = Literal["waiting", "playing", "lost", "ended"]
OPENING_S = 60.0
LINGER_S = 2.0  # a reloaded page finds its stream still running


class Stream:
    """Source that is read in a thread while pages watch it."""

    def __init__(
        self,
        source: ListedSource,
        loop: asyncio.AbstractEventLoop,
        stored_orientation: bool,
        on_note: Callable[[str], None],
    ) -> None:
        self.source = source
        self._on_note = on_note
        self.viewers = 0
        self.count = 0
        """Number of frames so far; also the index of the newest frame."""
        self.state = StreamState(state="waiting", message=f"waiting for {source.name}")
        self._newest: bytes | None = None
        self._loop = loop
        self._news = asyncio.Event()
        from ...io.live_sources import Playback

        # A source that has played before is reopened after a failure; one that never opened is
        # reported as an error, and a reload tries again.
        self._playing = Playback(
            source.place,
            source.kind == "live",
            self._report,
            OPENING_S,
            stored_orientation=stored_orientation,
        )
        self._thread = threading.Thread(target=self._run, name=f"studio {source.name}", daemon=True)
        self._thread.start()

    async def after(
        self, count: int, state: StreamState | None
    ) -> tuple[int, bytes | None, StreamState]:
        """Wait for a frame newer than ``count`` or a change of state; return both."""
        while self.count == count and self.state == state:
            await self._news.wait()
        return self.count, (self._newest if self.count != count else None), self.state

    def stop(self) -> None:
        """Close the source."""
        self._playing.stop()

    # -- reader thread -------------------------------------------------------------------------

    def _run(self) -> None:
        from ...io.video_frames import image_of_frame

        has_reported = False
        try:
            for frame in self._playing.frames():
                if not has_reported:
                    has_reported = True
                    for note in self._playing.notes:
                        self._on_note(note)
                self._notify(
                    encoded(image_of_frame(frame), ".jpg"),
                    "playing",
                    f"{self.source.name} is playing",
                )
            self._notify(None, "ended", f"{self.source.name} has ended")
        except OmnimirrorError as e:
            self._notify(None, "ended", str(e))

    def _report(self, message: str) -> None:
        self._notify(None, "playing" if " is reconnected " in message else "lost", message)

    def _notify(self, jpeg: bytes | None, state: State, message: str) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(
                self._publish, jpeg, StreamState(state=state, message=message)
            )

    def _publish(self, jpeg: bytes | None, state: StreamState) -> None:
        if jpeg is not None:
            self._newest, self.count = jpeg, self.count + 1
        self.state = state
        self._news.set()  # wakes all current waiters, not later ones
        self._news = asyncio.Event()


class Streams:
    """Streams that are currently watched.

    Parameters
    ----------
    stored_orientation
        Send frames as stored, without the rotation of a display matrix.
    on_note
        Called in the reader thread with a sentence on an opened source.
    """

    def __init__(
        self,
        stored_orientation: bool = False,
        on_note: Callable[[str], None] = lambda message: None,
    ) -> None:
        self._options = stored_orientation, on_note
        self._running: dict[str, Stream] = {}

    @asynccontextmanager
    async def watch(self, source: ListedSource) -> AsyncIterator[Stream]:
        """Return a stream shared by all pages that watch the source."""
        stream = self._running.get(source.id)
        if stream is None or stream.state.state == "ended":
            stream = self._running[source.id] = Stream(
                source, asyncio.get_running_loop(), *self._options
            )
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
            if self._running.get(stream.source.id) is stream:
                del self._running[stream.source.id]


# -- State and job queues --------------------------------------------------------------------------


@dataclass
class Studio:
    """Sources, cameras, streams and access rules of a server; simulations and images run one at
    a time.

    Parameters
    ----------
    sources
        Images, videos and streams that pages can request.
    given
        Initial camera of the page, if any.
    hosts
        Accepted host names in addition to those of this machine.
    token
        Access token required from other machines.
    stored_orientation
        Show images and videos as stored, without the orientation in their files.
    on_note
        Called with a sentence on an opened image or video, such as its orientation.
    """

    sources: Sources = field(default_factory=Sources)
    given: NamedCamera | None = None
    hosts: tuple[str, ...] = ()
    token: str | None = None
    stored_orientation: bool = False
    on_note: Callable[[str], None] = lambda message: None

    def __post_init__(self) -> None:
        self.cameras = Cameras(self.given)
        self.streams = Streams(self.stored_orientation, self.on_note)
        self.board_detectors = BoardDetectorPool()
        self.outline_searches = OutlineSearches()
        self.restorations = Restorations()
        self.simulations, self.conversions = JobQueue(), JobQueue()
        self.built, self.toleranced, self.slider_violations = JobQueue(), JobQueue(), JobQueue()
