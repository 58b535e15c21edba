"""Publishing of transport streams to a media server such as MediaMTX or go2rtc.

Each stream is pushed by a separate process, ``python -m omnimirror.interop.gateway.publishing
URL``, because FFmpeg holds Python's interpreter lock while it waits for a server. The process reads
the stream from standard input and reports an error in its last line on standard error.
"""

from __future__ import annotations

import asyncio
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Callable
from contextlib import aclosing, suppress
from typing import BinaryIO

import av

from ...base.errors import MediaError
from ...io.live_outputs import stream_format
from ...io.live_sources import LOW_DELAY, without_credentials
from ...io.video_encoder import media_errors
from .stream_outputs import TransportOutput

MIN_DELAY_S, MAX_DELAY_S = 0.5, 30.0
"""Delay before a retry, doubled after each failure."""
CHUNKS_UNTIL_CONNECTED = 100
"""Chunks after which a connection counts as successful."""
MODULE = "omnimirror.interop.gateway.publishing"
SCHEME_OPTIONS = {"rtsp": {"rtsp_transport": "tcp"}}


async def publish_stream(
    output: TransportOutput, url: str, on_status: Callable[[str], None]
) -> None:
    """Push a transport stream to a URL until cancelled, and reconnect after failures.

    The publisher is a client of the output like any other, but always connected, because viewers
    at the server are not visible to it.

    Parameters
    ----------
    output
        Output to publish.
    url
        RTSP, RTMP or SRT URL.
    on_status
        Called with a sentence when the connection is lost.
    """
    delay_s, is_lost = MIN_DELAY_S, False
    while True:
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            MODULE,
            url,
            stdin=PIPE,
            stdout=DEVNULL,
            stderr=PIPE,
            start_new_session=True,
        )
        try:
            if await _feed(process, output):
                delay_s, is_lost = MIN_DELAY_S, False
            reason = await _last_error(process)
        finally:
            await _terminate(process)
        if not is_lost:
            on_status(f"cannot publish to {without_credentials(url)}: {reason}; retrying")
        is_lost = True
        await asyncio.sleep(delay_s)
        delay_s = min(2 * delay_s, MAX_DELAY_S)


async def _terminate(process: Process) -> None:
    """Kill a process and close its pipes before the event loop ends."""
    with suppress(ProcessLookupError):
        process.kill()
    if process.stdin is not None:
        process.stdin.close()
    await process.communicate()  # waits until standard error is closed


async def _feed(process: Process, output: TransportOutput) -> bool:
    """Write the stream to a process until it ends; return whether it was connected."""
    assert process.stdin is not None
    count = 0
    with suppress(BrokenPipeError, ConnectionResetError):
        async with aclosing(output.chunks()) as chunks:
            async for chunk in chunks:
                process.stdin.write(chunk)
                await process.stdin.drain()
                count += 1
    return count > CHUNKS_UNTIL_CONNECTED


async def _last_error(process: Process) -> str:
    assert process.stderr is not None
    lines = (await process.stderr.read()).decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "the process ended"


# -- publisher process ---------------------------------------------------------------------------


def push_stream(source: BinaryIO, url: str) -> None:
    """Copy the packets of a transport stream to a URL until the stream ends.

    Raises
    ------
    MediaError
        If the scheme is unknown or the server is not reachable.
    """
    scheme = url.partition("://")[0].lower()
    container = stream_format(url)
    options = SCHEME_OPTIONS.get(scheme, {})
    with av.open(source, "r", format="mpegts", options=LOW_DELAY) as incoming, media_errors(url):
        stream = incoming.streams.video[0]
        with av.open(url, "w", format=container, options=options) as outgoing:
            copy = outgoing.add_stream_from_template(stream)
            for packet in incoming.demux(stream):
                if packet.dts is not None:
                    packet.stream = copy
                    outgoing.mux(packet)


def main() -> None:
    """Push the stream on standard input."""
    try:
        push_stream(sys.stdin.buffer, sys.argv[1])
    except (MediaError, av.FFmpegError) as e:
        sys.exit(str(e))


if __name__ == "__main__":
    main()
