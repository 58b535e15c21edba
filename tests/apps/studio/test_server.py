"""Server: responses, refusals, and streams for many pages."""

from __future__ import annotations

import asyncio
import json
import re
import socket
import struct
import subprocess
import sys
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

import av
import cv2
import httpx
import numpy as np
import pytest
from click.testing import CliRunner
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

import omnimirror as om
from omnimirror.apps.cli import app as command_line
from omnimirror.apps.studio import _server_state, app
from omnimirror.apps.studio._server_state import Sources, Streams, Studio
from omnimirror.apps.studio._uploads import browser_image, encoded
from omnimirror.apps.studio.app import create_app
from omnimirror.interop.http_server.auth import is_loopback
from omnimirror.interop.http_server.limits import MAX_MESSAGE_BYTES
from omnimirror.interop.http_server.server import listen
from tests.io.test_orientation import write_with_orientation
from tests.io.test_video import write_rotated
from tests.serving import in_a_loop

from .browser import serving
from .images import write_video

LOCAL = "http://127.0.0.1"
IMAGE = np.random.default_rng(3).integers(0, 255, (30, 44, 3), np.uint8)


@pytest.fixture
def client():
    with TestClient(create_app(), base_url=LOCAL) as client:
        yield client


def error_message(answer) -> str:
    """Return the reason of a refusal: one sentence without internals of the server."""
    detail = answer.json()["detail"]
    assert "Traceback" not in detail
    assert "/src/" not in detail
    return detail


def outline_statuses(client, data: bytes, name: str = "image") -> list[dict]:
    """Return the progress messages of an outline search."""
    response = client.post("/api/outline", content=data, params={"name": name})
    assert response.status_code == 200
    return [json.loads(line) for line in response.text.splitlines()]


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def test_outline_of_uploaded_image_agrees_with_python(client):
    v, u = np.mgrid[:1800, :2400]
    disc = np.where(
        np.hypot(u - 1270.3, v - 810.7) < 690,
        120 + 80 * np.sign(np.sin(9 * np.arctan2(v - 810, u - 1270))),
        12,
    ).astype(np.uint8)
    *progress, last = outline_statuses(client, png(disc), "disc.png")
    outline, reference = last["outline"], om.detect_mirror_outline(disc)
    assert outline["centre_px"] == list(reference.centre_px)  # of the image at its full size
    assert outline["radius_px"] == pytest.approx(690, abs=0.5)
    assert outline["confidence"] == reference.confidence
    assert outline["is_reliable"]
    assert outline["image_size"] == [2400, 1800]
    fractions = [status["fraction"] for status in progress]
    assert {status["state"] for status in progress} == {"running"}
    assert fractions == sorted(fractions)
    assert 0.5 < fractions[-1] < 1


def test_failed_outline_searches_report_reason(client):
    (*_, empty) = outline_statuses(client, png(np.full((100, 200), 90, np.uint8)))
    assert not empty["outline"]["is_reliable"]
    (*_, failed) = outline_statuses(client, b"no image", "notes.png")
    assert (failed["state"], failed["outline"]) == ("failed", None)
    assert "notes.png: it must be an undamaged image file" in failed["message"]
    assert client.post("/api/outline", content=b"").status_code == 400


def test_outline_is_cached(client):
    data = png(np.full((90, 120), 91, np.uint8))
    first, second = (outline_statuses(client, data) for _ in range(2))
    assert len(first) > 1
    assert second == first[-1:]


def test_closed_connection_cancels_outline_search():
    data = np.random.default_rng(1).integers(0, 255, (1500, 1500, 3), np.uint8)
    studio = Studio()
    with serving(studio) as address, httpx.Client(base_url=address, timeout=60) as client:
        with client.stream("POST", "/api/outline", content=png(data)) as response:
            next(response.iter_lines())
            assert studio.outline_searches._workers._pending == 1
        start_s = time.monotonic()
        while studio.outline_searches._workers._pending:
            assert time.monotonic() - start_s < 5
            time.sleep(0.02)
        # the next search starts immediately
        small = client.post("/api/outline", content=png(data[:60, :60]))
        assert '"state":"done"' in small.text.splitlines()[-1]


def test_health_and_page_are_served(client):
    assert client.get("/health").json() == {"status": "ok", "version": om.__version__}
    page = client.get("/")
    assert "<title>omnimirror studio</title>" in page.text
    assert "default-src 'none'" in page.headers["content-security-policy"]


def test_tables_reproduce_pixels_of_camera(client):
    """Compared with the projection of the sensor; interpolation here is that of the shader."""
    sensor = om.load_sensor("paper-spherical")
    model = client.get("/api/camera", params={"id": "paper-spherical"}).json()
    values = np.frombuffer(
        client.get("/api/camera/tables", params={"id": "paper-spherical"}).content, "<f4"
    )
    t = model["tables"]
    radii = values[: t["radii"]].astype(float)
    d = np.random.default_rng(1).normal(size=(500, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    axial, right, down = (d @ np.array(model[name]) for name in ("axis", "right", "down"))
    half = np.sqrt((1 - axial) / 2)
    r = np.interp(half, np.linspace(t["first"], t["last"], t["radii"]), radii)
    pixels = model["centre_px"] + (r / np.hypot(right, down))[:, None] * np.stack(
        [right, down], axis=-1
    )
    exact = sensor.project_directions(d)
    assert exact.valid.mean() > 0.7
    assert np.linalg.norm(pixels - exact.pixels, axis=1)[exact.valid].max() < 0.001


def test_camera_has_requested_mount(client):
    request = {"id": "paper-spherical", "camera_looks": "down", "forward_azimuth_deg": 30}
    model = client.get("/api/camera", params=request).json()
    assert model["pole"] == "zenith"
    assert model["axis"] == [0, 0, 1]
    assert model["mount_in_file"]["camera_looks"] == "up"


def test_camera_has_requested_tilt(client):
    """The tables are unchanged and the axes rotated: the direction right of forward descends by the
    roll."""
    request = {"id": "paper-spherical", "forward_azimuth_deg": 0, "pitch_deg": 20, "roll_deg": 5}
    model = client.get("/api/camera", params=request).json()
    assert (model["mount"]["pitch_deg"], model["mount"]["roll_deg"]) == (20, 5)
    assert model["right"] == pytest.approx(
        [np.cos(np.radians(20)), 0, np.sin(np.radians(20))]
    )  # image right: forward
    assert model["axis"][1] == pytest.approx(np.sin(np.radians(5)))
    assert client.get("/api/camera", params=request | {"pitch_deg": 91}).status_code == 422


# -- access control
# ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("localhost", True),
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("::1", True),
        ("", False),
        ("example.org", False),
        ("localhost.example.org", False),
        ("127.0.0.1.example.org", False),
        ("door", False),
        ("0.0.0.0", False),
        ("::", False),
        ("192.168.1.7", False),
        ("::2", False),
        ("128.0.0.1", False),
    ],
)
def test_only_loopback_addresses_require_no_token(host, expected):
    assert is_loopback(host) is expected


def test_content_security_policy_names_every_directive(client):
    """Parsed as by a browser; a missing directive would default to no restriction."""
    policy = client.get("/").headers["content-security-policy"]
    directives = {name: sources for name, *sources in map(str.split, policy.split(";"))}
    forbidden = ["default-src", "base-uri", "form-action", "frame-ancestors"]
    assert {name: directives[name] for name in forbidden} == {
        name: ["'none'"] for name in forbidden
    }
    assert directives["img-src"] == ["'self'", "blob:", "data:"]
    assert directives["media-src"] == ["'self'", "blob:", "mediastream:"]
    assert directives["connect-src"] == ["'self'", "blob:", "data:"]
    assert directives["script-src"][0] == "'self'"
    hashes = [*directives["script-src"][1:], *directives["style-src"]]
    assert all(source.startswith("'sha256-") for source in hashes)


def test_foreign_hosts_and_origins_are_rejected(client):
    assert "evil.example" in error_message(client.get("/health", headers={"host": "evil.example"}))
    answer = client.post("/api/sensors", content=b"x", headers={"origin": "https://evil.example"})
    assert answer.status_code == 403
    assert "https://evil.example" in error_message(answer)
    with (
        pytest.raises(WebSocketDisconnect),
        client.websocket_connect(
            "/api/stream?id=source", headers={"origin": "https://evil.example"}
        ),
    ):
        pass


def test_remote_access_requires_token():
    assert not is_loopback("0.0.0.0")
    with TestClient(create_app(Studio(token="secret")), base_url="http://192.168.1.7:80") as client:
        assert client.get("/health").status_code == 200
        assert "token" in error_message(client.get("/api/start"))
        assert client.get("/api/start", params={"token": "wrong"}).status_code == 403
        assert client.get("/", params={"token": "secret"}).status_code == 200
        assert client.get("/api/start").status_code == 200  # by the cookie
    with TestClient(create_app(Studio(token="secret")), base_url="http://192.168.1.7:80") as client:
        with (
            pytest.raises(WebSocketDisconnect),
            client.websocket_connect("ws://192.168.1.7/api/stream?id=source"),
        ):
            pass
        with client.websocket_connect(
            "ws://192.168.1.7/api/stream?id=source&token=secret"
        ) as socket:
            assert "unknown stream" in socket.receive_text()


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "127.0.0.1.evil.example"},
        {"host": "localhost@evil.example"},
        {"host": "evil.example:80@127.0.0.1"},
        {"host": "127.0.0.1:80:80"},
        {"host": "127.0.0.1 evil.example"},
        {"origin": "https://127.0.0.1"},
        {"origin": "chrome-extension://127.0.0.1"},
        {"origin": "http://user@127.0.0.1"},
        {"host": ""},
        {"host": "[::1"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:9999"},
        {"origin": "http://127.0.0.1.evil.example"},
    ],
)
def test_similar_hosts_and_origins_are_rejected(headers, client):
    answer = client.post("/api/sensors", content=b"x", headers=headers)
    assert answer.status_code == 403
    assert error_message(answer)


def test_compressed_text_bomb_is_rejected(client):
    """A compressed comment of 100 MB in a PNG of one pixel."""
    png = cv2.imencode(".png", np.zeros((1, 1, 3), np.uint8))[1].tobytes()
    body = b"zTXtComment\0\0" + zlib.compress(bytes(100 << 20), 9)
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    answer = client.post(
        "/api/convert", params={"name": "bomb.png"}, content=png[:33] + chunk + png[33:]
    )
    assert answer.status_code == 200
    assert len(answer.content) < 1000  # the comment is neither decompressed nor copied


# -- hostile files
# ---------------------------------------------------------------------------------------


def png_of(width: int, height: int) -> bytes:
    """Return a PNG with a huge announced size and almost no data."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    rows = zlib.compress(b"\0" * 100_000, 9)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    ("side", "message"),
    [
        (11_000, "11000 x 11000 px in the PNG header exceed the capacity of"),
        (60_000, "the decoded pixels of bomb.png must take at most 512 MB; got 10300 MB"),
    ],
)
def test_decompression_bombs_are_rejected_by_header(side, message, client):
    answer = client.post("/api/convert", params={"name": "bomb.png"}, content=png_of(side, side))
    assert answer.status_code == 400
    assert message in error_message(answer)


@pytest.mark.parametrize(
    "data", [b"", b"no picture", b"PK\3\4" + bytes(100), b"\x89PNG\r\n\x1a\n", b"II*\0" + bytes(8)]
)
def test_invalid_image_is_rejected(data, client):
    answer = client.post("/api/convert", content=data)
    assert answer.status_code == 400
    assert error_message(answer)


def test_truncated_image_is_rejected(client):
    jpeg = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (99, 99, 3), np.uint8))[
        1
    ].tobytes()
    answer = client.post("/api/convert", params={"name": "../../half.jpg"}, content=jpeg[:-400])
    assert answer.status_code == 400
    assert error_message(answer) == "cannot read the image half.jpg: the file is truncated"


def test_oversized_body_is_rejected_early(client):
    size = MAX_MESSAGE_BYTES + 1
    assert client.post("/api/sensors", content=b"#" * size).status_code == 413

    def pieces():
        for _ in range(size // 4096 + 1):
            yield b"#" * 4096

    answer = client.post("/api/sensors", content=pieces())  # chunked: no announced length
    assert answer.status_code == 413
    assert error_message(answer).startswith("the body must be at most 1 MB; got ")


def test_sensor_files_cannot_name_files_of_the_server(client):
    text = '[mirror]\nkind = "sampled"\nprofile_csv = "/etc/passwd"\n[lens]\n[imager]\n'
    answer = client.post("/api/sensors", params={"name": "spy.toml"}, content=text)
    assert answer.status_code == 400
    assert "must not name a file" in error_message(answer)
    assert "root:" not in answer.text


@pytest.mark.parametrize(
    "data", [b"\xff\xfe\0", b"[mirror", b"1 2 3\n4", b"{}", b"[mirror]\nkind = 3"]
)
def test_invalid_calibration_files_are_rejected(data, client):
    answer = client.post("/api/sensors", content=data)
    assert answer.status_code == 400
    assert error_message(answer)


def test_deep_images_are_converted_to_8_bits():
    image = (np.arange(48, dtype=np.uint16) * 1365).reshape(4, 4, 3)
    tiff = cv2.imencode(".tif", image)[1].tobytes()
    shallow = cv2.imdecode(
        np.frombuffer(browser_image(tiff, "deep.tif")[0], np.uint8), cv2.IMREAD_UNCHANGED
    )
    np.testing.assert_array_equal(shallow, np.round(image / 257).astype(np.uint8))


# -- sources
# ---------------------------------------------------------------------------------------------


def test_only_files_of_given_folders_are_served(tmp_path):
    folder, outside = tmp_path / "in", tmp_path / "secret.png"
    folder.mkdir()
    for path in (folder / "a.png", outside):
        cv2.imwrite(str(path), np.zeros((4, 4, 3), np.uint8))
    (folder / "link.png").symlink_to(outside)
    (folder / "notes.txt").write_text("no picture")
    with TestClient(create_app(Studio(Sources(folders=[folder]))), base_url=LOCAL) as client:
        assert [s["name"] for s in client.get("/api/start").json()["sources"]] == ["a.png"]
        assert client.get("/api/image", params={"id": "0/a.png"}).status_code == 200
        for id in ("0/link.png", "0/../secret.png", str(outside), "0/notes.txt", "..", "\0"):
            assert client.get("/api/image", params={"id": id}).status_code == 404


def test_slow_pages_do_not_delay_shared_stream(tmp_path, monkeypatch):
    """Pages that request continuously, one that requests once, and one that never does."""
    source = Sources([str(write_video(tmp_path / "ride.mp4"))]).given[0]
    encodings = []
    monkeypatch.setattr(
        _server_state, "encoded", lambda *arguments: encodings.append(1) or encoded(*arguments)
    )

    async def fast_client(stream, frames: int) -> list[int]:
        numbers, state = [0], None
        while len(numbers) <= frames:
            number, jpeg, state = await stream.after(numbers[-1], state)
            if jpeg is not None:
                assert cv2.imdecode(np.frombuffer(jpeg, np.uint8), 1).shape == (48, 64, 3)
                numbers.append(number)
        return numbers[1:]

    async def slow_client(stream) -> tuple[int, int]:
        first, _, state = await stream.after(0, None)
        while stream.count < first + 3:
            await asyncio.sleep(0.01)
        return first, (await stream.after(first, state))[0]

    async def run_clients():
        streams = Streams()
        async with streams.watch(source) as stream, streams.watch(source) as same:
            assert same is stream  # read once
            results = await asyncio.gather(
                slow_client(stream), *(fast_client(stream, 12) for _ in range(19))
            )
            assert stream.count <= len(encodings) <= stream.count + 2  # some may be in transit
        streams.close()
        return results

    with ThreadPoolExecutor() as pool:  # with its own event loop
        run = pool.submit(lambda: asyncio.run(asyncio.wait_for(run_clients(), 600)))
        (first, later), *other_numbers = run.result()
    assert all(np.all(np.diff(numbers) > 0) for numbers in other_numbers)  # never an older frame
    assert later > first + 1  # intermediate frames are skipped


def test_page_receives_state_and_frames_of_stream(tmp_path):
    studio = Studio(Sources([str(write_video(tmp_path / "ride.mp4"))]))
    with (
        TestClient(create_app(studio), base_url=LOCAL) as client,
        client.websocket_connect("ws://127.0.0.1/api/stream?id=source") as socket,
    ):
        socket.send_text("next")
        states, jpeg = [], None
        while jpeg is None:
            message = socket.receive()
            jpeg = message.get("bytes")
            if jpeg is None:
                states.append(json.loads(message["text"])["state"])
        assert jpeg[:2] == b"\xff\xd8"
        assert states[-1] == "playing"


@pytest.mark.parametrize("stored", [False, True])
def test_orientations_are_applied_unless_pixels_are_requested_as_stored(tmp_path, stored):
    """Images, uploads and videos, compared with the files as OpenCV reads them with and without."""
    folder = tmp_path / "in"
    folder.mkdir()
    image = write_with_orientation(folder / "a.png", IMAGE, 6)
    video = write_rotated(folder / "b.mp4", 90)
    flag = cv2.IMREAD_COLOR | (cv2.IMREAD_IGNORE_ORIENTATION if stored else 0)
    expected = cv2.imread(str(image), flag)
    capture = cv2.VideoCapture(str(video))
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, float(not stored))
    frame = capture.read()[1]
    notes = []
    studio = Studio(Sources(folders=[folder]), stored_orientation=stored, on_note=notes.append)
    with TestClient(create_app(studio), base_url=LOCAL) as client:
        source_png = client.get("/api/image", params={"id": "0/a.png"}).content
        converted_png = client.post(
            "/api/convert", content=image.read_bytes(), params={"name": "a.png"}
        ).content
        assert ("data-stored-orientation" in client.get("/").text[:200]) == stored
        with client.websocket_connect("ws://127.0.0.1/api/stream?id=0/b.mp4") as socket:
            socket.send_text("next")
            while (jpeg := socket.receive().get("bytes")) is None:
                pass
    for png in (source_png, converted_png):
        np.testing.assert_array_equal(
            cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), expected
        )
    streamed_image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert streamed_image.shape == frame.shape
    assert np.abs(streamed_image.astype(int) - frame).mean() < 4
    phrases = (
        ["as stored; the EXIF orientation", "frames as stored"]
        if stored
        else ["according to EXIF", "according to the file"]
    )
    assert len(notes) == 2
    for note, name, phrase in zip(notes, ["a.png", "b.mp4"], phrases, strict=True):
        assert name in note
        assert phrase in note


@pytest.mark.parametrize(("command", "arguments"), [("view", ["a.png"]), ("studio", [])])
def test_commands_pass_the_orientation_to_the_studio(tmp_path, monkeypatch, command, arguments):
    write_with_orientation(tmp_path / "a.png", IMAGE, 6)
    monkeypatch.chdir(tmp_path)
    studios = []
    monkeypatch.setattr(app, "serve", lambda studio, *other_arguments: studios.append(studio))
    for option in ([], ["--set=input.stored_orientation=true"]):
        assert CliRunner().invoke(command_line, [command, *arguments, *option]).exit_code == 0
    assert [studio.stored_orientation for studio in studios] == [False, True]


def test_damaged_video_ends_with_message(tmp_path):
    (tmp_path / "bad.mp4").write_bytes(b"no video")
    studio = Studio(Sources([str(tmp_path / "bad.mp4")]))
    with (
        TestClient(create_app(studio), base_url=LOCAL) as client,
        client.websocket_connect("ws://127.0.0.1/api/stream?id=source") as socket,
    ):
        status = json.loads(socket.receive_text())
        while status["state"] != "ended":
            status = json.loads(socket.receive_text())
        assert "bad.mp4" in status["message"]


# -- OpenAPI interface
# -----------------------------------------------------------------------------------


@pytest.mark.full
@pytest.mark.long
@pytest.mark.parametrize("phases", ["fuzzing", "coverage,fuzzing"])
def test_generated_requests_cause_no_server_error(phases, tmp_path):
    program = Path(sys.executable).with_name("schemathesis")
    if not program.exists():
        pytest.skip("schemathesis is not here")
    with serving(Studio()) as address:
        arguments = f"run {address}openapi.json --phases {phases} --max-examples 4 --seed 1 --request-timeout 600"
        files = (
            "--no-color --exclude-checks positive_data_acceptance"  # not described by any schema
        )
        run = subprocess.run(
            [program, *arguments.split(), *files.split()],
            capture_output=True,
            text=True,
            cwd=tmp_path,
        )
    assert run.returncode == 0, run.stdout[-3000:]
    assert re.search(r"(\d+) selected / \1 total", run.stdout)


# -- raw connections
# -------------------------------------------------------------------------------------


def raw_response(
    address: str, start: bytes, body: bytes = b"\r\n", is_half_closed: bool = False
) -> bytes:
    """Return the response to bytes that no client library would send, up to the end of the
    connection."""
    host = urlsplit(address).netloc.encode()
    with socket.create_connection(("127.0.0.1", urlsplit(address).port), timeout=300) as raw:
        raw.sendall(start + b" HTTP/1.1\r\nHost: " + host + b"\r\nConnection: close\r\n" + body)
        if is_half_closed:
            raw.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: raw.recv(65536), b""))


@pytest.mark.parametrize(
    ("lines", "body", "status"),
    [
        (b"Content-Length: 100\r\n", b"too short", None),
        (b"Content-Length: 3\r\n", b"far too long", 400),
        (b"Content-Length: -5\r\n", b"x", 400),
        (b"Content-Length: many\r\n", b"x", 400),
        (b"Content-Length: 99999999999999\r\n", b"x", 413),
        (b"Content-Length: 1\r\nContent-Length: 2\r\n", b"xx", 400),
        (b"Transfer-Encoding: chunked\r\n", b"5\r\nab", None),
        (b"Transfer-Encoding: chunked\r\n", b"zz\r\nab\r\n", 400),
        (b"Transfer-Encoding: chunked\r\nContent-Length: 1\r\n", b"0\r\n\r\n", 400),
    ],
)
def test_uploads_with_wrong_length_are_rejected_or_dropped(lines, body, status, wire):
    answer = raw_response(
        wire, b"POST /api/convert", lines + b"\r\n" + body, is_half_closed=status is None
    )
    if status is None:
        assert b" 200 " not in answer[:20]  # no recipient remains
    else:
        assert answer.startswith(b"HTTP/1.1 %d " % status), answer[:200]
    assert b"Traceback" not in answer
    assert httpx.get(f"{wire}health").json()["status"] == "ok"


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "//etc/passwd",
        "/api/image?id=../../etc/passwd",
    ],
)
def test_path_traversal_is_rejected(path, wire):
    answer = raw_response(wire, b"GET " + path.encode())
    assert answer.startswith(b"HTTP/1.1 404 ")
    assert b"root:" not in answer


def test_responses_are_sent_without_delayed_acknowledgement():
    async def nodelay_option() -> int:
        option: asyncio.Future[int] = asyncio.get_running_loop().create_future()

        def on_connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            option.set_result(
                writer.get_extra_info("socket").getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            )
            writer.close()

        async with await asyncio.start_server(on_connection, sock=listen("127.0.0.1", 0)) as app:
            _, writer = await asyncio.open_connection(*app.sockets[0].getsockname())
            writer.close()
            return await option

    assert in_a_loop(nodelay_option())


@pytest.fixture(scope="module")
def wire():
    with serving(Studio()) as address:
        yield address


def write_noise_video(path: Path) -> Path:
    """Write twelve frames of noise, large as JPEG, each with its number as a shade in the corner."""
    rng = np.random.default_rng(0)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=20, options={"qscale": "2"})
        stream.width, stream.height, stream.pix_fmt = 480, 360, "yuvj420p"
        for i in range(12):
            image = rng.integers(0, 255, (360, 480, 3), np.uint8)
            image[:64, :64] = 20 * i + 10
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())
    return path


def number_in(jpeg: bytes) -> int:
    corner = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)[8:56, 8:56]
    return round((float(np.median(corner)) - 10) / 20)


@pytest.mark.full
@pytest.mark.long
def test_twenty_clients_share_stream_despite_slow_client(tmp_path):
    from websockets.asyncio.client import connect

    async def fast_client(url: str, frames: int) -> list[int]:
        async with connect(url, max_queue=1) as socket:
            assert (
                not socket.protocol.extensions
            )  # not compressed again, although every page offers it
            await socket.send("next")
            numbers: list[int] = []
            async for message in socket:
                if isinstance(message, bytes):
                    numbers.append(number_in(message))
                    if len(numbers) == frames:
                        return numbers
                    await socket.send("next")
        return numbers

    async def slow_client(url: str) -> None:
        """Client that sends requests and reads no response: output accumulates."""
        async with connect(url, max_queue=1) as socket:
            try:
                while True:
                    await socket.send("next")
                    await asyncio.sleep(0.01)
            finally:
                socket.transport.abort()  # without a close frame

    async def run_clients(url: str) -> list[list[int]]:
        slow_task = asyncio.create_task(slow_client(url))
        numbers = await asyncio.gather(*(fast_client(url, 40) for _ in range(19)))
        slow_task.cancel()
        await asyncio.wait([slow_task])
        return numbers

    with serving(Studio(Sources([str(write_noise_video(tmp_path / "noise.avi"))]))) as address:
        url = f"{address.replace('http', 'ws')}api/stream?id=source"
        with ThreadPoolExecutor() as pool:  # with its own event loop
            numbers = pool.submit(
                lambda: asyncio.run(asyncio.wait_for(run_clients(url), 600))
            ).result()
    assert [len(s) for s in numbers] == [40] * 19
    repeat_rates = [np.mean(np.diff(s) == 0) for s in numbers]
    assert (
        max(repeat_rates) < 0.5
    )  # frames differ, except rarely for the same one of a later loop of the video
