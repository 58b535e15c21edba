"""A view by WebRTC, to a player that is not ours."""

from __future__ import annotations

import asyncio

import httpx
import numpy as np
import pytest

import omnimirror as om
from omnimirror.interop.gateway import webrtc
from omnimirror.interop.gateway.gateway import Gateway
from omnimirror.interop.gateway.routes import create_app
from omnimirror.media.video.frames import image_of_frame
from tests.serving import in_a_loop, served

from .test_gateway import VIEWS, camera, film, off, picture_of, until

__all__ = ["camera", "film"]

rtc = pytest.importorskip("aiortc", reason="WebRTC is an extra of its own")


@pytest.fixture
def gateway(film, camera):
    return Gateway(str(film), False, camera, VIEWS, workers=2)


async def watched(address: str, frames: int) -> tuple[np.ndarray, httpx.Response]:
    """What a player sees of a view after some frames, and how it was let go."""
    player = rtc.RTCPeerConnection(rtc.RTCConfiguration(iceServers=[]))
    player.addTransceiver("video", direction="recvonly")
    came: asyncio.Queue = asyncio.Queue()
    player.on("track", came.put_nowait)
    await player.setLocalDescription(await player.createOffer())
    async with httpx.AsyncClient(timeout=300) as client:
        answer = await client.post(f"{address}front/whep", content=player.localDescription.sdp)
        assert (answer.status_code, answer.headers["content-type"]) == (201, "application/sdp")
        await player.setRemoteDescription(rtc.RTCSessionDescription(answer.text, "answer"))
        track = await came.get()
        for _ in range(frames):
            frame = await track.recv()
        end = await client.delete(address.rstrip("/") + answer.headers["location"])
        await player.close()
    return image_of_frame(frame), end


def test_a_player_sees_the_view_and_is_let_go(gateway, camera, film):
    with served(create_app(gateway, None)) as address:
        seen, end = in_a_loop(watched(address, 20))
        assert end.status_code == 200
        until(lambda: gateway.views["front"].watchers == 0)
    straight = om.Dewarper(camera, VIEWS["front"](camera))(picture_of(film))
    assert off(seen, straight) < 6  # coded for a slow line, at first


def test_offers_that_are_none_and_too_many_are_refused(gateway, monkeypatch):
    with served(create_app(gateway, None)) as address:
        answer = httpx.post(f"{address}front/whep", content="hello")
        assert (answer.status_code, "the offer cannot be answered" in answer.text) == (400, True)
        assert gateway.views["front"].watchers == 0
        monkeypatch.setattr(webrtc, "MOST_PEERS", 0)
        assert "0 watch by WebRTC already" in httpx.post(f"{address}front/whep", content="v=0").text
        assert httpx.post(f"{address}nose/whep", content="v=0").status_code == 404
