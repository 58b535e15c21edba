"""What a server shows, and whose turn it is where something takes long."""

from __future__ import annotations

from dataclasses import dataclass, field

from ...interop.http_server.limits import JobQueue
from .calibrate.looking import Lookers
from .look.cameras import Cameras, Known
from .look.sources import Sources
from .look.streams import Streams


@dataclass
class Studio:
    """What a server shows: sources, cameras, streams; to whom, and simulations, pictures and reports one at a time.

    Parameters
    ----------
    sources
        Pictures, videos and streams that the page may ask for.
    given
        The camera that the page begins with, if the server was started with one.
    hosts
        Names by which the server may be asked, besides those of this machine.
    token
        What other machines must know.
    """

    sources: Sources = field(default_factory=Sources)
    given: Known | None = None
    hosts: tuple[str, ...] = ()
    token: str | None = None

    def __post_init__(self) -> None:
        self.cameras = Cameras(self.given)
        self.streams = Streams()
        self.lookers = Lookers()
        self.simulated, self.unpacked, self.reported = JobQueue(), JobQueue(), JobQueue()
        self.built, self.toleranced, self.slid = JobQueue(), JobQueue(), JobQueue()
