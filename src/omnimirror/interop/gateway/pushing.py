"""A transport stream on standard input, pushed to a server as it is: by RTSP, RTMP or SRT.

Run as ``python -m omnimirror.interop.gateway.pushing ADDRESS``, a process of its own: FFmpeg holds Python's lock while
it waits for a server to answer. What goes wrong it says in its last line on standard error.
"""

from __future__ import annotations

import sys
from typing import BinaryIO

import av

from ...errors import MediaError
from ...media.live.outputs import stream_format
from ...media.live.sources import LOW_DELAY
from ...media.video.encoder import sentences

OF_SCHEME = {"rtsp": {"rtsp_transport": "tcp"}}


def push(source: BinaryIO, url: str) -> None:
    """Copy the packets of a stream to an address, until it ends.

    Raises
    ------
    MediaError
        The scheme is not known, nobody answers, or the server has gone.
    """
    scheme = url.partition("://")[0].lower()
    packed_as = stream_format(url)
    with av.open(source, "r", format="mpegts", options=LOW_DELAY) as incoming, sentences(url):
        stream = incoming.streams.video[0]
        with av.open(url, "w", format=packed_as, options=OF_SCHEME.get(scheme, {})) as outgoing:
            copied = outgoing.add_stream_from_template(stream)
            for packet in incoming.demux(stream):
                if packet.dts is not None:
                    packet.stream = copied
                    outgoing.mux(packet)


def main() -> None:
    """Push what comes on standard input."""
    try:
        push(sys.stdin.buffer, sys.argv[1])
    except (MediaError, av.FFmpegError) as e:
        sys.exit(str(e))


if __name__ == "__main__":
    main()
