"""Views for players of WebRTC, through aiortc, which codes them anew for each."""

from __future__ import annotations

import secrets
from collections.abc import AsyncGenerator
from typing import Any, NamedTuple

import av

from ...errors import InvalidParameter, OmnimirrorError
from .live_view import LiveView

MOST_PEERS = 8
"""Each has an encoder of its own."""
OVER = ("closed", "failed")


class _Peer(NamedTuple):
    connection: Any
    frames: AsyncGenerator[av.VideoFrame, None]


class Peers:
    """Who is connected just now."""

    def __init__(self) -> None:
        self._peers: dict[str, _Peer] = {}

    @property
    def count(self) -> int:
        """Number of peers."""
        return len(self._peers)

    async def answer(self, view: LiveView, offer: str) -> tuple[str, str]:
        """A name for who offers to watch a view, and the answer (SDP).

        Raises
        ------
        InvalidParameter
            The offer is none, or too many watch so already.
        OmnimirrorError
            aiortc is not installed.
        """
        rtc = _library()
        if len(self._peers) >= MOST_PEERS:
            raise InvalidParameter(f"{MOST_PEERS} watch by WebRTC already; the other addresses are open")
        connection = rtc.RTCPeerConnection(rtc.RTCConfiguration(iceServers=[]))
        frames = view.frames.items()
        name = secrets.token_urlsafe(9)
        self._peers[name] = _Peer(connection, frames)

        @connection.on("connectionstatechange")  # type: ignore[untyped-decorator]
        async def changed() -> None:
            if connection.connectionState in OVER:
                await self.end(name)

        try:
            await connection.setRemoteDescription(rtc.RTCSessionDescription(offer, "offer"))
            connection.addTrack(_track_of(rtc, frames))
            await connection.setLocalDescription(await connection.createAnswer())
        except Exception as e:  # of what is no SDP, aiortc raises whatever its parser comes upon
            await self.end(name)
            raise InvalidParameter(
                "the offer cannot be answered; it must be the SDP of a player that receives video (m=video, a=recvonly)"
            ) from e
        return name, connection.localDescription.sdp

    async def end(self, name: str) -> None:
        """Let somebody go; who has gone already is let go of once only."""
        peer = self._peers.pop(name, None)
        if peer is not None:
            await peer.connection.close()
            await peer.frames.aclose()

    async def close(self) -> None:
        """Let all go."""
        for name in list(self._peers):
            await self.end(name)


def _library() -> Any:
    try:
        import aiortc
    except ModuleNotFoundError as e:
        if e.name is None or e.name.partition(".")[0] != "aiortc":
            raise
        raise OmnimirrorError("WebRTC needs aiortc: pip install 'omnimirror[webrtc]'") from None
    return aiortc


def _track_of(rtc: Any, frames: AsyncGenerator[av.VideoFrame, None]) -> Any:
    """Frames as aiortc takes them."""

    class Track(rtc.MediaStreamTrack):  # type: ignore[misc]
        kind = "video"

        async def recv(self) -> av.VideoFrame:
            return await anext(frames)

    return Track()
