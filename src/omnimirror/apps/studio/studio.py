"""State of a studio server, with queues for long-running requests."""

from __future__ import annotations

from dataclasses import dataclass, field

from ...interop.http_server.limits import JobQueue
from .calibrate.looking import Lookers
from .look.cameras import Cameras, Known
from .look.sources import Sources
from .look.streams import Streams


@dataclass
class Studio:
    """Sources, cameras, streams and access rules of a server; simulations, images and reports run
    one at a time.

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
