"""View by WebRTC in an independent player."""

from __future__ import annotations

import asyncio

import httpx
import numpy as np
import pytest

import omnimirror as om
from omnimirror.interop.gateway import webrtc
from omnimirror.interop.gateway.live_views import Gateway
from omnimirror.interop.gateway.routes import create_app
from omnimirror.io.video_frames import image_of_frame
from tests.serving import in_a_loop, served

from .test_gateway import VIEWS, camera, film, image_of, mean_difference, wait_for

__all__ = ["camera", "film"]

rtc = pytest.importorskip("aiortc", reason="WebRTC is an extra of its own")


@pytest.fixture
def gateway(film, camera):
    return Gateway(str(film), False, camera, VIEWS, workers=2)


async def watched(address: str, frames: int) -> tuple[np.ndarray, httpx.Response]:
    """Return the last of several frames received by a player, and the response to its disconnection."""
    player = rtc.RTCPeerConnection(rtc.RTCConfiguration(iceServers=[]))
    player.addTransceiver("video", direction="recvonly")
    tracks: asyncio.Queue = asyncio.Queue()
    player.on("track", tracks.put_nowait)
    await player.setLocalDescription(await player.createOffer())
    async with httpx.AsyncClient(timeout=300) as client:
        answer = await client.post(f"{address}front/whep", content=player.localDescription.sdp)
        assert (answer.status_code, answer.headers["content-type"]) == (201, "application/sdp")
        await player.setRemoteDescription(rtc.RTCSessionDescription(answer.text, "answer"))
        track = await tracks.get()
        for _ in range(frames):
            frame = await track.recv()
        end = await client.delete(address.rstrip("/") + answer.headers["location"])
        await player.close()
    return image_of_frame(frame), end


def test_player_receives_the_view_and_disconnects(gateway, camera, film):
    with served(create_app(gateway, None)) as address:
        received, end = in_a_loop(watched(address, 20))
        assert end.status_code == 200
        wait_for(lambda: gateway.views["front"].clients == 0)
    straight = om.Dewarper(camera, VIEWS["front"](camera))(image_of(film))
    assert mean_difference(received, straight) < 6  # low initial bit rate


def test_invalid_offers_and_too_many_peers_are_rejected(gateway, monkeypatch):
    with served(create_app(gateway, None)) as address:
        answer = httpx.post(f"{address}front/whep", content="hello")
        assert (answer.status_code, "the offer must be the SDP" in answer.text) == (400, True)
        assert gateway.views["front"].clients == 0
        monkeypatch.setattr(webrtc, "MAX_PEERS", 0)
        assert (
            "the number of WebRTC clients must be at most 0"
            in httpx.post(f"{address}front/whep", content="v=0").text
        )
        assert httpx.post(f"{address}nose/whep", content="v=0").status_code == 404
