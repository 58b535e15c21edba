"""WebRTC clients through aiortc, which encodes the view for each client."""

from __future__ import annotations

import secrets
from collections.abc import AsyncGenerator
from typing import Any, NamedTuple

import av

from ...base.errors import InvalidParameter, OmnimirrorError, extra_remedy
from .live_views import LiveView

MAX_PEERS = 8
"""Maximum number of WebRTC clients; each has its own encoder."""
TERMINAL_STATES = ("closed", "failed")


class _Peer(NamedTuple):
    connection: Any
    frames: AsyncGenerator[av.VideoFrame, None]


class PeerConnections:
    """Connected WebRTC clients."""

    def __init__(self) -> None:
        self._peers: dict[str, _Peer] = {}

    @property
    def count(self) -> int:
        """Number of connected clients."""
        return len(self._peers)

    async def answer(self, view: LiveView, offer: str) -> tuple[str, str]:
        """Connect a client to a view.

        Parameters
        ----------
        view
            Requested view.
        offer
            SDP offer of the client.

        Returns
        -------
        name, answer
            Identifier of the connection and SDP answer.

        Raises
        ------
        InvalidParameter
            If the offer is invalid or too many clients are connected.
        OmnimirrorError
            If aiortc is not installed.
        """
        aiortc = _import_aiortc()
        if len(self._peers) >= MAX_PEERS:
            raise InvalidParameter(
                f"the number of WebRTC clients must be at most {MAX_PEERS}; use MJPEG, MPEG-TS or HLS"
            )
        connection = aiortc.RTCPeerConnection(aiortc.RTCConfiguration(iceServers=[]))
        frames = view.frames.items()
        name = secrets.token_urlsafe(9)
        self._peers[name] = _Peer(connection, frames)

        @connection.on("connectionstatechange")  # type: ignore[untyped-decorator]  # no stubs
        async def on_state_change() -> None:
            if connection.connectionState in TERMINAL_STATES:
                await self.disconnect(name)

        try:
            await connection.setRemoteDescription(aiortc.RTCSessionDescription(offer, "offer"))
            connection.addTrack(_video_track(aiortc, frames))
            await connection.setLocalDescription(await connection.createAnswer())
        except Exception as e:  # aiortc raises arbitrary errors of its parser for invalid SDP
            await self.disconnect(name)
            raise InvalidParameter(
                "the offer must be the SDP of a player that receives video (m=video, a=recvonly)"
            ) from e
        return name, connection.localDescription.sdp

    async def disconnect(self, name: str) -> None:
        """Close a connection; unknown names are ignored."""
        peer = self._peers.pop(name, None)
        if peer is not None:
            await peer.connection.close()
            await peer.frames.aclose()

    async def close(self) -> None:
        """Close all connections."""
        for name in list(self._peers):
            await self.disconnect(name)


def _import_aiortc() -> Any:
    try:
        import aiortc
    except ModuleNotFoundError as e:
        if e.name is None or e.name.partition(".")[0] != "aiortc":
            raise
        raise OmnimirrorError(f"WebRTC requires aiortc: {extra_remedy('webrtc')}") from None
    return aiortc


def _video_track(aiortc: Any, frames: AsyncGenerator[av.VideoFrame, None]) -> Any:
    """Return frames as a media track of aiortc."""

    class Track(aiortc.MediaStreamTrack):  # type: ignore[misc]  # base class without stubs
        kind = "video"

        async def recv(self) -> av.VideoFrame:
            return await anext(frames)

    return Track()
