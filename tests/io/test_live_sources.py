"""Interrupted streams on loopback, and slow consumers."""

import math
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from itertools import pairwise

import pytest

from omnimirror.base.errors import MediaError
from omnimirror.io.live_outputs import StreamSink
from omnimirror.io.live_sources import TICKS, LiveSource, resolve_source
from omnimirror.io.video_processing import process
from omnimirror.io.video_writer import VideoWriter
from tests.everyday import few
from tests.io.synthetic import SIZE, images_of, make_video

HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: video/mp2t\r\n\r\n"
PATIENCE = {
    "timeout_s": 30.0,
    "patience_s": 300.0,
    "min_delay_s": 0.05,
}  # sufficient for slow machines


@pytest.fixture(scope="module")
def transport(tmp_path_factory):
    """4 s of MPEG-TS with two key frames per second."""
    return make_video(tmp_path_factory.mktemp("live") / "a.ts", 100, with_audio=False).read_bytes()


@contextmanager
def server(*plans):
    """An HTTP server on loopback; each connection follows the next plan, and all later ones follow
    the last plan.

    A plan is a list of bytes and pauses (s); an empty plan closes the connection immediately.
    """
    listener = socket.create_server(("127.0.0.1", 0))
    stop = threading.Event()
    threads = []

    def serve(connection, plan):
        with connection, suppress(OSError):
            connection.recv(4096)
            for part in plan:
                if stop.is_set():
                    return
                if isinstance(part, bytes):
                    connection.sendall(part)
                else:
                    stop.wait(part)

    def serve_connections():
        with suppress(OSError):
            while True:
                connection, _ = listener.accept()
                threads.append(
                    threading.Thread(
                        target=serve, args=(connection, plans[min(len(threads), len(plans) - 1)])
                    )
                )
                threads[-1].start()

    thread = threading.Thread(target=serve_connections)
    thread.start()
    try:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}/live.ts"
    finally:
        stop.set()
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join()
        for server_thread in threads:
            server_thread.join()


def paced(data, seconds):
    """Return the data as a plan in real time."""
    size = -(-len(data) // 50)
    return [
        part for at in range(0, len(data), size) for part in (data[at : at + size], seconds / 50)
    ]


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_interrupted_stream_is_reconnected(transport):
    """It ends, then closes two connections immediately, then continues."""
    half = transport[: len(transport) // 2]
    messages = []
    with (
        server([HEAD, *paced(half, 1.0)], [], [], [HEAD, *paced(transport, 2.0), 5.0]) as url,
        LiveSource(url, **PATIENCE, on_warning=messages.append) as source,
    ):
        before = 0
        for frame in source.frames():
            assert (frame.width, frame.height) == SIZE
            if not source.reconnects:
                before = source.received
            elif source.received >= before + 20:
                break
        assert source.frame_rate == 25
    assert before >= 20
    assert source.reconnects == 1
    disconnections = [message for message in messages if "is disconnected" in message]
    delays = [message.rsplit("reconnecting in ")[1] for message in disconnections[:3]]
    assert delays == ["0.05 s", "0.1 s", "0.2 s"]  # doubled without data
    assert f"{url} is reconnected after" in messages[-1]


def test_silent_stream_is_disconnected(transport):
    messages = []
    with (
        server([HEAD, transport, 30.0], [HEAD, *paced(transport, 1.0), 5.0]) as url,
        LiveSource(
            url, timeout_s=1.5, patience_s=300, min_delay_s=0.05, on_warning=messages.append
        ) as source,
    ):
        for _ in source.frames():
            if source.reconnects:
                break
    assert f"{url} is disconnected: no data for 1.5 s; reconnecting in 0.05 s" in messages[0]


def test_slow_consumer_receives_newest_frame(transport):
    with server([HEAD, *paced(transport, 2.0), 5.0]) as url, LiveSource(url, **PATIENCE) as source:
        frames = source.frames()
        times = []
        for _ in range(5):
            times.append(next(frames).time)
            initial_count = source.received
            while source.received < initial_count + 6:
                time.sleep(0.01)
        assert source.dropped >= source.received - 5 - 2  # a queue would keep them
        assert source.dropped > 10
    assert all(b > a for a, b in pairwise(times))


def test_frames_are_ordered_and_counted(transport):
    """The number of frames missed by a consumer depends on the load, but all missed frames are
    counted."""
    with (
        server([HEAD, *paced(transport, 2.5)]) as url,
        LiveSource(url, **PATIENCE, reconnect=False) as source,
    ):
        first = source.first()
        times = [frame.time for frame in source.frames()]
        assert (first.width, first.height) == SIZE
    assert source.received == 100
    assert len(times) == 100 - source.dropped > 1
    assert times == sorted(times)


def test_live_stream_is_recorded(transport, tmp_path):
    with (
        server([HEAD, *paced(transport, 2.0)]) as url,
        LiveSource(url, **PATIENCE, reconnect=False) as source,
    ):
        source.first()
        sink = VideoWriter(tmp_path / "a.mp4", SIZE, source.frame_rate, time_base=TICKS)
        outcome = process(source.frames(), sink, lambda image, time_s: image, queue_size=0)
    frames = images_of(tmp_path / "a.mp4")
    assert len(frames) == outcome.frames == 100 - source.dropped
    assert 0.3 < frames[-1].time - frames[0].time < 4


def test_unreachable_stream_raises():
    url = f"http://127.0.0.1:{free_port()}/live.ts"
    with LiveSource(url, timeout_s=1, patience_s=0.6, min_delay_s=0.05) as source:
        with pytest.raises(
            MediaError, match=r"no frame from http.* for .* s: Connection refused"
        ) as e:
            next(source.frames())
        with pytest.raises(MediaError, match="no frame from"):
            source.first()
    assert "\n" not in str(e.value)


def test_close_ends_frames(transport):
    with server([HEAD, transport, 30.0]) as url:
        source = LiveSource(url, timeout_s=600.0)
        source.first()
        threading.Timer(0.5, source.close).start()
        assert sum(1 for _ in source.frames()) >= 1
        source.close()
        assert (
            source._thread.is_alive()
        )  # the stream is silent, which FFmpeg detects after ten minutes
    source._thread.join()  # or when it is closed


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("/dev/video99", r"the camera must be one of the connected ones .*; got /dev/video99"),
        ("99", r"the camera must be one of the connected ones .*; got /dev/video99"),
        (
            "room.mp4",
            "the source must be a camera such as /dev/video0, or an address of rtsp, rtsps, http, https",
        ),
        (
            "gopher://x",
            "the source must be a camera such as /dev/video0, or an address of rtsp, rtsps, http, https",
        ),
        (
            "http://",
            "the address must contain a host, as in http://HOST or http://HOST:PORT/PATH; got 'http://'",
        ),
        (
            "rtsp://",
            "the address must contain a host, as in rtsp://HOST or rtsp://HOST:PORT/PATH; got 'rtsp://'",
        ),
        ("rtsp:///live", "the address must contain a host, as in rtsp://HOST"),
        (
            "rtsp://me:secret@/live",
            "the address must contain a host, as in rtsp://HOST or rtsp://HOST:PORT/PATH; got 'rtsp:///live'",
        ),
        ("http://[::1", r"'http://\[::1' must be a valid address: Invalid IPv6 URL"),
        (
            "rtsp://door:99999/1",
            "'rtsp://door:99999/1' must be a valid address: Port out of range 0-65535",
        ),
        (
            "rtsp://me:secret@door:x/1",
            "'rtsp://door:x/1' must be a valid address: Port could not be cast to integer value as 'x'",
        ),
        (
            "udp://239.0.0.1",
            r"the address must contain a port, as in udp://HOST:PORT; got 'udp://239\.0\.0\.1'",
        ),
        ("srt://door", "the address must contain a port, as in srt://HOST:PORT; got 'srt://door'"),
        ("file:///no/such.ts", r"file:///no/such\.ts must be the address of an existing file"),
        ("file:///etc", "file:///etc must be the address of an existing file"),
    ],
)
def test_invalid_source_raises(url, message):
    with pytest.raises(MediaError, match=message):
        LiveSource(url)


@pytest.mark.parametrize(
    "url", ["udp://@:1234", "tcp://:1234?listen", "http://[::1]:80/x", "rtsp://me:p@ss@door/1"]
)
def test_valid_sources_are_accepted(url):
    assert resolve_source(url) == (url, None)


@pytest.mark.parametrize("opening_s", [None, 0.3])
def test_unresponsive_stream_raises(opening_s):
    """After the timeout, or a shorter one for the first frame; a stream that has played before is
    awaited for longer."""
    patience_s = 0.3 if opening_s is None else math.inf
    url = f"http://me:secret@127.0.0.1:{free_port()}/live.ts"
    messages: list[str] = []
    with (
        LiveSource(
            url,
            1.0,
            patience_s,
            opening_s=opening_s,
            min_delay_s=0.02,
            max_delay_s=0.02,
            on_warning=messages.append,
        ) as source,
        pytest.raises(MediaError, match="no frame from http://127"),
    ):
        source.first()
    assert messages
    assert not any("secret" in message for message in messages)


def test_permanent_errors_raise_immediately(tmp_path):
    """No retry: the result would be the same."""
    (tmp_path / "passwd").write_text("root:x:0:0\n" * 99)
    messages: list[str] = []
    with server([b"HTTP/1.1 401 Unauthorized\r\nContent-Length: 0\r\n\r\n"]) as locked:
        for url in (f"file://{tmp_path}/passwd", locked):
            with (
                LiveSource(url, patience_s=math.inf, on_warning=messages.append) as source,
                pytest.raises(MediaError, match="cannot read"),
            ):
                source.first()
    assert not messages


# -- outgoing streams
# -------------------------------------------------------------------------------

PUSH = """
import sys, time
from fractions import Fraction
import numpy as np
from omnimirror.io.video_frames import frame_of_image
from omnimirror.io.live_outputs import StreamSink
for attempt in range(3000):
    try:
        sink = StreamSink(sys.argv[1], (64, 48), 25)
        break
    except ValueError:
        time.sleep(0.1)
try:
    for i in range(int(sys.argv[2])):
        frame = frame_of_image(np.full((48, 64, 3), 8 * (i % 30), np.uint8))
        frame.pts, frame.time_base = i, Fraction(1, 25)
        sink.write(frame)
        time.sleep(0.03)
    sink.close()
except ValueError:
    sink.abort()
"""


def push(url, frames):
    """Send from another process: FFmpeg holds the GIL while it opens a stream for writing."""
    return subprocess.Popen(
        [sys.executable, "-c", PUSH, url, str(frames)], stderr=subprocess.DEVNULL
    )


@pytest.mark.parametrize("scheme", few(["udp", "rtsp"], "rtsp"))
def test_stream_sink_output_is_received(scheme):
    port = free_port(socket.SOCK_DGRAM if scheme == "udp" else socket.SOCK_STREAM)
    url = f"{scheme}://127.0.0.1:{port}" + ("/live" if scheme == "rtsp" else "")
    # There is no RTSP server here; the reader acts as one and needs a timeout, without which it
    # waits forever.
    options = {"rtsp_flags": "listen", "listen_timeout": "300"} if scheme == "rtsp" else {}
    timeout_s = 300 if scheme == "rtsp" else 30
    with LiveSource(url, timeout_s, patience_s=300, min_delay_s=0.05, options=options) as source:
        sender = push(url + "?pkt_size=1316" * (scheme == "udp"), 100_000)
        try:
            for frame in source.frames():
                assert (frame.width, frame.height) == SIZE
                if (
                    source.received >= 3
                ):  # several have arrived; the sender would continue for an hour
                    break
        finally:
            sender.terminate()
            sender.wait()


def test_unsupported_stream_address_raises():
    for url in ("room.mp4", "gopher://x"):
        with pytest.raises(
            MediaError,
            match="the scheme of a stream must be one of udp, tcp, http, rtsp, rtmp, srt; got",
        ):
            StreamSink(url, SIZE, 25)
    with pytest.raises(MediaError, match=r"cannot write http://.*: Connection refused"):
        StreamSink(f"http://127.0.0.1:{free_port()}/x", SIZE, 25)
