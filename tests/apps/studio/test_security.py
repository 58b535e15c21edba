"""Attacks on the server over loopback: files, memory and requests that must be refused."""

from __future__ import annotations

import asyncio
import base64
import errno
import hashlib
import json
import os
import resource
import socket
import struct
import threading
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import replace
from io import BytesIO
from urllib.parse import urlsplit

import cv2
import httpx
import numpy as np
import pytest
import tomli_w
from PIL import Image
from starlette.requests import Request
from starlette.responses import Response
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import omnimirror as om
from omnimirror.apps.studio import _design_files, _server_state, _uploads
from omnimirror.apps.studio._design_files import coarser, sensor_report
from omnimirror.apps.studio._design_sensors import sensor_from_tables
from omnimirror.apps.studio._search_process import perform
from omnimirror.apps.studio._server_state import Sources, Studio
from omnimirror.apps.studio._workers import Restorations
from omnimirror.apps.studio.app import create_app
from omnimirror.apps.studio.design_messages import SearchTask
from omnimirror.base.errors import InvalidParameter, MediaError
from omnimirror.interop.http_server import limits, server
from omnimirror.interop.http_server.auth import (
    AccessGuard,
    content_security_policy,
    is_loopback,
)
from omnimirror.interop.http_server.limits import MAX_MESSAGE_BYTES
from omnimirror.interop.http_server.server import server_addresses
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.mirrors import MIRRORS, SECONDARIES
from omnimirror.optics.sensor_files import tables_of
from tests.serving import in_a_loop

from .browser import open_page, serving
from .test_design_page import WITHOUT_IMAGES
from .test_invalid_bodies import FITTED

LOCAL = "http://127.0.0.1"
SECRET = "1.25, 2.5"
SPHERE = tables_of(om.load_sensor("paper-spherical"))
FIELD = {"field": {"omega_max_deg": 90.0}, "lens": {"theta_max_deg": 12.0}}
FILES = [(kind, file.entry) for kind, cls in SECONDARIES.items() for file in cls.FILES]


@pytest.fixture
def client():
    with TestClient(create_app(), base_url=LOCAL) as client:
        yield client


# -- files named in uploads
# -----------------------------------------------------------------------------


def file_naming_tables(path: str) -> list[dict]:
    """Return tables of sensors and requirements that name a file, at all possible positions."""
    mirrors = [{"kind": kind, entry: path, "theta_max_deg": 12.0} for kind, entry in FILES]
    folded = tables_of(om.load_sensor("folded-spherical"))
    second = {k: v for k, v in folded["secondary"].items() if k != "radius_mm"}
    return [
        *({**SPHERE, "mirror": mirror} for mirror in mirrors),
        *({**folded, "secondary": {**second, **mirror}} for mirror in mirrors),
        {**FIELD, "mirror": {"mapping_csv": path, "rim_radius_mm": 40.0}},
        {
            **FIELD,
            "mirror": {"mapping": "tabulated-mapping", "mapping_csv": path, "rim_radius_mm": 40.0},
        },
    ]


def upload_responses(client: TestClient, tables: dict) -> list[str]:
    """Return the server responses to tables, by every upload route."""
    requirements = tables if "field" in tables else {}
    tables_body, distance = (
        {"tables": SPHERE if requirements else tables},
        {"object_distance_mm": None},
    )
    bodies = {
        "requirements": {**tables_body, "requirements": requirements},
        "file": {**tables_body, **distance, "kind": "sensor"},
        "image": {**tables_body, "width_px": 32, "samples": 1},
        "change": {**tables_body, **distance, "target": "mirror", "to": "cone"},
    }
    responses = [
        client.post(route, content=tomli_w.dumps(tables)).text
        for route in ("/api/sensors", "/api/design/open")
    ]
    routes = ("requirements",) if requirements else bodies
    responses += [client.post(f"/api/design/{route}", json=bodies[route]).text for route in routes]
    with client.websocket_connect("ws://127.0.0.1/api/design/ask") as socket:
        defaults = {
            "slot": 0,
            "number": 1,
            "follows_mapping": False,
            "include_section": False,
            "include_squares": False,
        }
        socket.send_json(
            {**defaults, **tables_body, **distance, "requirements": requirements or None}
        )
        responses.append(str(socket.receive()))
    search = {
        "kind": "design",
        "merit": "worst_blur_deg",
        "shape": "spline",
        "terms": 1,
        "starts": 1,
    }
    perform(
        SearchTask(**search, **tables_body, **distance, requirements=requirements or None),
        lambda message: responses.append(message.message),
    )
    return responses


def test_every_entry_that_names_a_file_is_tested():
    assert {"sampled", "tabulated-mapping"} <= {kind for kind, _ in FILES}
    assert set(MIRRORS) <= set(SECONDARIES)


@pytest.mark.parametrize("number", range(len(file_naming_tables(""))))
def test_server_opens_no_file_named_by_an_upload(number, client, tmp_path):
    """Responses are equal for a file with columns, an invalid file, a missing file, a folder, and a
    pipe."""
    (tmp_path / "columns").write_text(f"{SECRET}\n" * 9)
    (tmp_path / "words").write_text("secret words")
    os.mkfifo(tmp_path / "pipe")  # opening it blocks
    paths = [str(tmp_path / name) for name in ("columns", "words", "absent", ".", "pipe")]
    responses = [upload_responses(client, file_naming_tables(path)[number]) for path in paths]
    same = [
        [text.replace(path, "PLACE") for text in texts]
        for path, texts in zip(paths, responses, strict=True)
    ]
    assert same.count(same[0]) == len(same)
    assert "must not name a file" in "".join(same[0])
    assert not any("1.25" in text for text in same[0])


def test_command_line_reads_files_beside_sensor_file(tmp_path):
    """A profile in a separate file, relative to the folder of the sensor file."""
    profile = [f"{x},{x * x / 100}" for x in range(30)]
    (tmp_path / "profile.csv").write_text("\n".join(profile))
    (tmp_path / "s.toml").write_text(
        tomli_w.dumps({**SPHERE, "mirror": {"kind": "sampled", "profile_csv": "profile.csv"}})
    )
    assert om.load_sensor(tmp_path / "s.toml").mirror.x_mm[-1] == 29.0


# -- size limits
# ----------------------------------------------------------------------------------------


def test_requests_are_within_accepted_size(client):
    """Limit of the announced length."""
    content = b" " * (MAX_MESSAGE_BYTES + 1)
    for path in (
        "/api/design/change",
        "/api/design/file",
        "/api/design/requirements",
        "/api/sensor-file",
        "/api/sensors",
    ):
        answer = client.post(path, content=content, headers={"content-type": "application/json"})
        assert (answer.status_code, "must be at most 1 MB" in answer.json()["detail"]) == (
            413,
            True,
        )


async def status_of(bounded: limits.RequestLimits, receive, name: str = "") -> int:
    """Return the response status of a request without an announced length."""
    sent_messages: list = []

    async def send(message):
        sent_messages.append(message)

    await bounded({"type": "http", "name": name, "path": "/", "headers": []}, receive, send)
    return sent_messages[0]["status"]


def test_bounds_agree_with_documentation():
    """Bytes and seconds, written explicitly."""
    sizes = (
        limits.MAX_MESSAGE_BYTES,
        limits.MAX_IMAGE_BYTES,
        limits.MAX_DETECTIONS_BYTES,
        limits.MAX_PENDING_BYTES,
    )
    assert sizes == (1_048_576, 134_217_728, 16_777_216, 536_870_912)
    assert (limits.GRACE_PERIOD_S, limits.MIN_RATE_BYTES_PER_S, limits.MAX_QUEUED_JOBS) == (
        30.0,
        1024.0,
        16,
    )


@pytest.mark.parametrize(
    ("headers", "is_refused"),
    [
        ([(b"content-length", b"1000")], False),
        ([(b"accept", b"9999"), (b"content-length", b"1001"), (b"host", b"a")], True),
        ([(b"host", b"5000")], False),
        ([(b"content-length", b"-5000")], False),
        ([], False),
    ],
)
def test_excessive_announced_length_is_rejected_unread(headers, is_refused):
    """Exact to the byte, for the header of that name only; without a valid length the chunks are
    counted."""
    messages, reads = [], []

    async def receive():
        reads.append(1)
        return {"type": "http.request", "body": bytes(1000), "more_body": False}

    async def send(message):
        messages.append(message)

    bounded = limits.RequestLimits(read_and_respond, {"/large": 1000})
    in_a_loop(bounded({"type": "http", "path": "/large", "headers": headers}, receive, send))
    assert messages[0]["status"] == (413 if is_refused else 200)
    assert bool(reads) != is_refused
    assert bounded.pending_bytes == 0
    if is_refused:
        assert dict(messages[0]["headers"])[b"connection"] == b"close"


@pytest.mark.parametrize(
    ("pieces", "status"), [((600, 400), 200), ((600, 401), 413), ((1001,), 413)]
)
def test_size_of_pieces_is_exact(pieces, status):
    left = list(pieces)

    async def receive():
        size = left.pop(0)
        return {"type": "http.request", "body": bytes(size), "more_body": bool(left)}

    bounded = limits.RequestLimits(read_and_respond, {"/": 1000})
    assert in_a_loop(status_of(bounded, receive)) == status
    assert bounded.pending_bytes == 0


@pytest.mark.parametrize(("max_bytes", "status"), [(1000, 200), (999, 503)])
def test_room_of_server_is_exact(max_bytes, status, monkeypatch):
    monkeypatch.setattr(limits, "MAX_PENDING_BYTES", max_bytes)

    async def receive():
        return {"type": "http.request", "body": bytes(1000), "more_body": False}

    assert in_a_loop(status_of(limits.RequestLimits(read_and_respond, {}), receive)) == status


def test_end_of_complete_request_has_no_time_limit(monkeypatch):
    """A client that has sent everything waits for its response without a timeout."""
    monkeypatch.setattr(limits, "GRACE_PERIOD_S", 0.02)
    messages = [{"type": "http.request", "body": b"x"}, {"type": "http.disconnect"}]

    async def receive():
        if len(messages) == 1:
            await asyncio.sleep(0.1)
        return messages.pop(0)

    async def app(scope, receive, send):
        assert (await receive())["type"] == "http.request"
        assert (await receive())["type"] == "http.disconnect"
        await Response("done")(scope, receive, send)

    assert in_a_loop(status_of(limits.RequestLimits(app, {}), receive)) == 200


def test_fast_uploads_may_exceed_grace_period(monkeypatch):
    """Received bytes extend the time: 0.05 s and 1 s per 1024 bytes."""
    monkeypatch.setattr(limits, "GRACE_PERIOD_S", 0.05)
    pieces = [4096, 1, 1]

    async def receive():
        if len(pieces) < 3:
            await asyncio.sleep(0.06)
        size = pieces.pop(0)
        return {"type": "http.request", "body": bytes(size), "more_body": bool(pieces)}

    assert in_a_loop(status_of(limits.RequestLimits(read_and_respond, {}), receive)) == 200


def test_other_connections_are_unchanged():
    connections = []

    async def app(*connection):
        connections.append(connection)

    connection = ({"type": "websocket", "path": "/"}, object(), object())
    in_a_loop(limits.RequestLimits(app, {})(*connection))
    assert connections == [connection]


async def read_and_respond(scope, receive, send):
    await read_body(scope, receive, send)
    await Response("taken")(scope, receive, send)


async def read_body(scope, receive, send):
    while (await receive()).get("more_body"):
        pass


def test_endless_pieces_are_stopped():
    async def endless():
        return {"type": "http.request", "body": bytes(1 << 16), "more_body": True}

    assert in_a_loop(status_of(limits.RequestLimits(read_body, {}), endless)) == 413


def test_requests_together_stay_within_memory_limit(monkeypatch):
    """Two images that are allowed individually but not together; the first is accepted after the
    second has ended."""
    monkeypatch.setattr(limits, "MAX_PENDING_BYTES", 1500)

    async def run_requests():
        is_started, is_released = asyncio.Event(), asyncio.Event()

        async def app(scope, receive, send):
            body = (await receive())["body"]
            is_started.set()
            if scope["name"] == "first":
                await is_released.wait()
            await Response(str(len(body)))(scope, receive, send)

        async def receive():
            return {"type": "http.request", "body": bytes(900), "more_body": False}

        bounded = limits.RequestLimits(app, {"/": 1000})
        first = asyncio.create_task(status_of(bounded, receive, "first"))
        await is_started.wait()
        second_status = await status_of(bounded, receive)
        is_released.set()
        return second_status, await first, await status_of(bounded, receive)

    assert in_a_loop(run_requests()) == (503, 200, 200)


@pytest.mark.parametrize("pause_s", [0.01, 1.0])
def test_slowly_sent_requests_are_abandoned(pause_s, monkeypatch):
    """Also before the first byte."""
    monkeypatch.setattr(limits, "GRACE_PERIOD_S", 0.05)

    async def dribble():
        await asyncio.sleep(pause_s)
        return {"type": "http.request", "body": b"x", "more_body": pause_s < 1}

    assert in_a_loop(status_of(limits.RequestLimits(read_and_respond, {}), dribble)) == 408


@pytest.mark.parametrize(
    ("suffix", "pixel"),
    [
        (".tif", np.zeros(3, np.uint16)),
        (".png", np.zeros(4, np.uint16)),
        (".png", np.zeros(4, "u1")),
    ],
)
def test_images_are_limited_by_bytes_in_memory(suffix, pixel, monkeypatch):
    """Exact to the byte: an image of maximum size is read, and one with another row is rejected
    beforehand."""
    monkeypatch.setattr(_uploads, "MAX_DECODED_BYTES", 40 * 30 * pixel.nbytes)

    def file(rows: int) -> bytes:
        return cv2.imencode(suffix, np.tile(pixel, (rows, 40, 1)))[1].tobytes()

    assert _uploads.browser_image(file(30), "fits")[0].startswith(b"\x89PNG")
    with pytest.raises(MediaError, match=r"the decoded pixels of .* must take at most"):
        _uploads.browser_image(file(31), "large")


def test_small_file_of_huge_image_needs_little_memory():
    """9990 x 9990 x 3 of 16 bits, 600 MB, in a TIFF of 1 MB."""
    side, row = 9990, zlib.compress(bytes(9990 * 6), 9)
    head = struct.pack("<2sHI", b"II", 42, 8)
    data = 8 + 2 + 9 * 12 + 4
    lists = data + 8 + 8 * side
    entries = [
        (256, 4, 1, side), (257, 4, 1, side), (258, 3, 3, data), (259, 3, 1, 8), (262, 3, 1, 2),
        (273, 4, side, data + 8), (277, 3, 1, 3), (278, 4, 1, 1), (279, 4, side, data + 8 + 4 * side),
    ]  # fmt: skip
    tags = (
        struct.pack("<H", 9)
        + b"".join(struct.pack("<HHII", *entry) for entry in entries)
        + bytes(4)
    )
    tables = struct.pack("<3H2x", 16, 16, 16) + struct.pack(f"<{side}I", *[lists] * side)
    tables += struct.pack(f"<{side}I", *[len(row)] * side)
    with pytest.raises(MediaError, match=r"decoded pixels of .* must take at most 512 MB"):
        _uploads.browser_image(head + tags + tables + row, "bomb.tif")


def test_strips_are_converted_like_whole_image():
    image = np.random.default_rng(0).integers(0, 65536, (700, 9, 3), np.uint16)
    assert np.array_equal(_uploads.eight_bits(image), np.round(image / 257).astype(np.uint8))
    light = np.array([[-1.0, 0.0, 0.25, 0.5, 1.0, 7.0, np.nan, np.inf]], np.float32)
    assert _uploads.eight_bits(light).tolist() == [[0, 0, 64, 128, 255, 255, 0, 255]]
    assert _uploads.eight_bits(light.astype(np.float64)).tolist() == [
        [0, 0, 64, 128, 255, 255, 0, 255]
    ]
    shallow = np.arange(256, dtype=np.uint8).reshape(16, 16)
    assert np.shares_memory(_uploads.eight_bits(shallow), shallow)


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("a" * 99 + ".png", "a" * 80),
        ("._-a b?c-_.", "a_b_c"),
        ("/x/y\\z.tar.gz", "z.tar.gz"),
        ("Größe 1.png", "Größe_1.png"),
        ("a/", "file"),
        ("", "file"),
    ],
)
def test_names_of_uploads_are_escaped(name, safe):
    assert _uploads.safe_name(name) == safe


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF", "WEBP", "BMP", "GIF", "PPM"])
@pytest.mark.parametrize("mode", ["L", "RGB", "P"])
def test_images_of_every_kind_are_limited_by_pillow_header(kind, mode, monkeypatch):
    """Files written by Pillow: a palette counts as four channels, PPM as 16 bits, all others as
    stored."""
    if kind in ("JPEG", "WEBP", "PPM") and mode == "P":
        pytest.skip("the format has no palette")
    file = BytesIO()
    Image.new(mode, (10, 6), 3).save(file, kind)
    data = file.getvalue()
    with Image.open(BytesIO(data)) as image:
        channels = 4 if image.mode == "P" else len(image.getbands())
    size = 10 * 6 * channels * (2 if kind == "PPM" else 1)
    monkeypatch.setattr(_uploads, "MAX_DECODED_BYTES", size)
    assert _uploads.image_in(data, "a").shape[:2] == (6, 10)
    monkeypatch.setattr(_uploads, "MAX_DECODED_BYTES", size - 1)
    with pytest.raises(MediaError, match="pixels of a must take at most"):
        _uploads.image_in(data, "a")


def test_invalid_images_are_reported_with_valid_kinds():
    with pytest.raises(
        MediaError, match=r"image a: it must be an undamaged image file \(PNG, JPEG, TIFF, WebP"
    ):
        _uploads.image_in(b"no picture", "a")
    with pytest.raises(MediaError, match="it must be an undamaged image file"):
        _uploads.image_in(b"P6\nabc 2\n255\n", "a")


def test_uploads_of_huge_sides_are_rejected_by_header():
    """30000 x 30000 px exceed the limit of Pillow, which raises an exception."""
    header = struct.pack(">II5B", 30000, 30000, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
    data = b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in chunks
    )
    with pytest.raises(MediaError, match="decoded pixels of a must take at most 512 MB"):
        _uploads.image_in(data, "a")


def test_uploads_without_bits_per_sample_have_one_bit(monkeypatch):
    """TIFF 6.0: BitsPerSample is 1 by default; pixels take one byte in memory."""
    entries = [
        (256, 4, 1, 16), (257, 4, 1, 2), (259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 1, 98),
        (278, 4, 1, 2), (279, 4, 1, 4),
    ]  # fmt: skip
    data = struct.pack("<2sHIH", b"II", 42, 8, 7)
    data += b"".join(struct.pack("<HHII", *entry) for entry in entries) + bytes(4)
    data += b"\xff\x00\x00\xff"
    monkeypatch.setattr(_uploads, "MAX_DECODED_BYTES", 32)
    assert (_uploads.image_in(data, "a").reshape(2, 16, -1)[:, [0, 15], 0] > 0).tolist() == [
        [True, False],
        [False, True],
    ]


def test_orientation_of_uploads_is_applied_unless_stored():
    """EXIF orientation 6: rows of the stored image are columns."""
    file, exif = BytesIO(), Image.Exif()
    exif[0x0112], exif[0x010F] = 6, "maker"
    Image.new("RGB", (40, 30)).save(file, "JPEG", exif=exif)
    data = file.getvalue()
    for options, shape in (({}, (40, 30, 3)), ({"stored_orientation": True}, (30, 40, 3))):
        assert _uploads.image_in(data, "a", **options).shape == shape
        assert _uploads.uploaded(data, "a", **options)[0].shape == shape
        with Image.open(BytesIO(_uploads.browser_image(data, "a", **options)[0])) as png:
            assert png.size == shape[1::-1]
            assert png.getexif()


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg"])
def test_truncated_uploads_are_reported_by_their_name(suffix):
    """The internal file name of the upload is not disclosed."""
    data = cv2.imencode(suffix, np.random.default_rng(0).integers(0, 256, (40, 50, 3), np.uint8))[
        1
    ].tobytes()
    with pytest.raises(
        MediaError,
        match=r"my picture\.tif(: it must be an undamaged image file|: the file is truncated)",
    ) as error:
        _uploads.image_in(data[: len(data) // 2], "my picture.tif")
    assert "/" not in str(error.value)


def test_encoded_images_preserve_pixels_and_quality():
    image = np.random.default_rng(1).integers(0, 256, (40, 50, 3), np.uint8)
    with Image.open(BytesIO(_uploads.encoded(image, ".png"))) as png:
        assert np.array_equal(np.asarray(png), image)
    with Image.open(BytesIO(_uploads.encoded(image, ".jpg"))) as default:
        expected = BytesIO()
        Image.new("RGB", (8, 8)).save(expected, "JPEG", quality=90)
        with Image.open(expected) as reference:
            assert default.quantization == reference.quantization
    assert len(_uploads.encoded(image, ".jpg", 30)) < len(_uploads.encoded(image, ".jpg"))


def test_request_without_file_is_rejected():
    async def of(data: bytes) -> bytes:
        async def receive():
            return {"type": "http.request", "body": data, "more_body": False}

        return await _uploads.uploaded_file(Request({"type": "http"}, receive))

    assert in_a_loop(of(b"file")) == b"file"
    with pytest.raises(MediaError, match="the uploaded file is empty"):
        in_a_loop(of(b""))


@pytest.mark.parametrize("size", [(40_000, 40_000), (1, 100_000), (100_000, 1)])
def test_image_size_of_page_limits_memory(size, client):
    """The room of a camera and its report are refused; the preview is reduced for any aspect ratio."""
    width, height = size
    imager = {"width_px": width, "height_px": height, "pixel_pitch_um": 4000 / max(size)}
    tables = {**SPHERE, "imager": imager}
    sensor_id = client.post("/api/sensors", content=tomli_w.dumps(tables)).json()["id"]
    if width * height > 1e9:
        response = client.get("/api/room", params={"id": sensor_id})
        assert (
            response.status_code,
            "must have at most 16 million pixels" in response.json()["detail"],
        ) == (400, True)
    with pytest.raises(InvalidParameter, match=f"{width} x {height} px"):
        sensor_report(sensor_from_tables(tables), lambda step, fraction: None)
    small = coarser(om.load_sensor("paper-spherical"), 64)
    assert max(coarser(replace(small, imager=Imager(*size, 1.0)), 64).imager.size) == 64


def test_equal_work_is_shared_and_queue_is_limited(monkeypatch):
    monkeypatch.setattr(limits, "MAX_QUEUED_JOBS", 2)
    runs: list[str] = []

    async def run_tasks():
        queue, is_started, is_released = limits.JobQueue(), asyncio.Event(), threading.Event()
        loop = asyncio.get_running_loop()

        def work(name: str) -> str:
            loop.call_soon_threadsafe(is_started.set)
            is_released.wait()
            runs.append(name)
            return name

        tasks = [asyncio.create_task(queue.run("room", lambda: work("room"))) for _ in range(20)]
        other_task = asyncio.create_task(queue.run("other", lambda: work("other")))
        await is_started.wait()
        with pytest.raises(limits.ServerBusy, match="the server is busy"):
            await queue.run("third", lambda: work("third"))
        tasks[0].cancel()  # a disconnected page does not affect the others
        is_released.set()
        return await asyncio.gather(*tasks[1:], other_task)

    assert in_a_loop(run_tasks()) == ["room"] * 19 + ["other"]
    assert runs == ["room", "other"]


def test_work_is_sequential_and_repeatable():
    runs: list[str] = []

    def work(name: str) -> str:
        runs.append(f"begin {name}")
        time.sleep(0.01)
        runs.append(f"end {name}")
        return name

    async def run_tasks():
        queue = limits.JobQueue()
        for _ in range(2):
            results = await asyncio.gather(
                *(queue.run(name, lambda name=name: work(name)) for name in "ab")
            )
            assert results == ["a", "b"]
        with pytest.raises(ZeroDivisionError):
            await queue.run("a", lambda: 1 // 0)
        return await queue.run("a", lambda: "again")

    assert in_a_loop(run_tasks()) == "again"
    assert runs == ["begin a", "end a", "begin b", "end b"] * 2


def test_pages_are_served_in_turn():
    """Ten jobs of one page delay the job of another page by one job only."""
    runs: list[str] = []

    async def run_tasks():
        queue = limits.JobQueue()

        async def of_page(page: str, job: int) -> None:
            limits.current_page.set(page)
            await queue.run((page, job), lambda: runs.append(f"{page}{job}"))

        tasks = [asyncio.create_task(of_page("a", job)) for job in range(10)]
        tasks += [asyncio.create_task(of_page("b", job)) for job in range(2)]
        await asyncio.gather(*tasks)

    in_a_loop(run_tasks())
    assert runs[:5] == ["a0", "a1", "b0", "a2", "b1"]
    assert runs[5:] == [f"a{job}" for job in range(3, 10)]


def test_cancelled_waiting_client_keeps_no_slot():
    async def run_tasks():
        slots = limits.FairSlots()
        order: list[str] = []

        async def hold(name: str) -> None:
            async with slots.slot(name):
                order.append(name)
                await asyncio.sleep(0.01)

        tasks = [asyncio.create_task(hold(name)) for name in "abc"]
        await asyncio.sleep(0)
        tasks[1].cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        assert not slots.is_full
        return order

    assert in_a_loop(run_tasks()) == ["a", "c"]


def test_restoration_and_outline_search_do_not_block_each_other(client, monkeypatch):
    """A restoration of one page continues while another page converts and detects images."""
    is_started, is_released = threading.Event(), threading.Event()

    async def restored(*args):
        is_started.set()
        assert await asyncio.to_thread(is_released.wait, 60)
        yield b""

    monkeypatch.setattr(Restorations, "run", restored)
    message = {**FITTED, "name": "a.png", "object_distance_mm": None}
    header = json.dumps(message).encode()
    body = (
        struct.pack("<I", len(header))
        + header
        + cv2.imencode(".png", np.zeros((8, 8, 3)))[1].tobytes()
    )
    with ThreadPoolExecutor() as pool:
        restoration = pool.submit(client.post, "/api/restore", content=body)
        assert is_started.wait(60)
        tiff = cv2.imencode(".tif", np.zeros((4, 4, 3), np.uint16))[1].tobytes()
        assert client.post("/api/convert", content=tiff).status_code == 200
        assert client.get("/api/room", params={"id": "paper-spherical"}).status_code == 200
        assert not restoration.done()
        is_released.set()
        assert restoration.result().status_code == 200


def test_full_disk_is_reported(client, monkeypatch):
    def full(*args, **kwargs):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(_design_files.tempfile, "TemporaryDirectory", full)
    tables = tables_of(om.load_sensor("paper-spherical"))
    request = {"tables": tables, "kind": "table", "object_distance_mm": None}
    answer = client.post("/api/design/file", json=request)
    assert answer.status_code == 507
    assert (
        answer.json()["detail"]
        == "the server could not read or write a file: No space left on device"
    )


# -- origin of requests
# ---------------------------------------------------------------------------------


def fetch(client: TestClient, path: str, site: str, mode: str = "no-cors") -> int:
    headers = {"sec-fetch-site": site, "sec-fetch-mode": mode}
    return client.get(path, headers=headers, follow_redirects=False).status_code


def test_requests_that_other_sites_embed_are_rejected(client):
    """An image, script or frame of the studio in a foreign page; links to the page may be followed."""
    for site in ("cross-site", "same-site"):
        assert fetch(client, "/api/room?id=ball:123.4", site) == 403
        assert fetch(client, "/design.js", site) == 403
        assert fetch(client, "/api/start", site, "navigate") == 403
        assert fetch(client, "/", site) == 403
        assert fetch(client, "/", site, "navigate") == 200
    assert fetch(client, "/api/start", "same-origin", "cors") == 200
    assert fetch(client, "/api/start", "none", "navigate") == 200


def test_token_moves_from_address_to_cookie_of_port():
    with TestClient(
        create_app(Studio(token="secret")), base_url="http://192.168.1.7:8080"
    ) as client:
        answer = client.get("/?a=1%202&token=secret&b=", follow_redirects=False)
        assert (answer.status_code, answer.headers["location"]) == (303, "/?a=1+2&b=")
        assert answer.headers["cache-control"] == "no-store"
        cookie = answer.headers["set-cookie"]
        assert cookie.startswith("omnimirror-token-8080=secret;")
        assert "httponly" in cookie.lower()
        assert (
            "samesite=lax" in cookie.lower()
        )  # strict cookies are not sent after a link in a mail
        page = client.get("/?token=secret")
        assert (page.status_code, str(page.url)) == (200, "http://192.168.1.7:8080/")
        assert "secret" not in page.text
        assert client.get("/api/start").status_code == 200
        other_port = client.get(
            "http://192.168.1.7:9090/api/start"
        )  # another studio on the same machine
        assert other_port.status_code == 403
        assert client.get("/?token=wrong").status_code == 403


def test_token_does_not_admit_invalid_hosts(client):
    with TestClient(create_app(Studio(token="secret")), base_url="http://door") as client:
        for host in ("user@door", "door:80@evil.example", "a b", "door:123456"):
            assert client.get("/?token=secret", headers={"host": host}).status_code == 403


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("localhost", True),
        ("127.0.0.1", True),
        ("127.255.255.254", True),
        ("::1", True),
        ("128.0.0.1", False),
        ("::2", False),
        ("10.0.0.1", False),
        ("localhost.example.org", False),
        ("example.org", False),
        ("127.0.0.1.example.org", False),
        ("", False),
    ],
)
def test_loopback_addresses_require_no_token(host, expected):
    """RFC 1122, 3.2.1.3, and RFC 4291, 2.5.3; other names may resolve to any address."""
    assert is_loopback(host) is expected


def basic(text: str | bytes) -> dict[str, str]:
    """Return the header of HTTP basic authentication (RFC 7617)."""
    return {
        "authorization": "Basic "
        + base64.b64encode(text if isinstance(text, bytes) else text.encode()).decode()
    }


GUARD_CASES = [
    # path, headers, status without a token, with a token, and with a token that also applies to
    # programs
    ("/", {}, 200, 403, 401),
    ("/health", {}, 200, 200, 200),
    ("/api", {"host": "127.0.0.1:81"}, 200, 403, 401),
    ("/api", {"host": "[::1]:81"}, 200, 403, 401),
    ("/api", {"host": "DOOR"}, 200, 403, 401),
    ("/api", {"host": "evil.example"}, 403, 403, 401),
    ("/api?token=secret", {"host": "evil.example"}, 403, 200, 200),
    ("/api?token=secret", {"host": ""}, 403, 403, 403),
    ("/api?token=secret", {"host": "a@door"}, 403, 403, 403),
    ("/api?token=secret", {"host": "door:123456"}, 403, 403, 403),
    ("/health", {"host": "a b"}, 403, 403, 403),
    ("/api?token=secret", {}, 200, 200, 200),
    ("/api?token=Secret", {}, 200, 403, 401),
    ("/api?token=", {}, 200, 403, 401),
    ("/api", {"cookie": "omnimirror-token-80=secret"}, 200, 200, 200),
    ("/api", {"cookie": "a=b; omnimirror-token-80=secret"}, 200, 200, 200),
    ("/api", {"cookie": "omnimirror-token-81=secret"}, 200, 403, 401),
    ("/api", {"cookie": "omnimirror-token-81=secret", "host": "door:81"}, 200, 200, 200),
    ("/api", {"cookie": "omnimirror-token-80=secrets"}, 200, 403, 401),
    ("/api", {"cookie": "=;=\x01,"}, 200, 403, 401),
    ("/api", basic("anyone:secret"), 200, 403, 200),
    ("/api", basic(":secret"), 200, 403, 200),
    ("/api", basic("secret:anyone"), 200, 403, 401),
    ("/api", basic("secret"), 200, 403, 401),
    ("/api", basic(b"a:\xff"), 200, 403, 401),
    (
        "/api",
        {"authorization": "basic " + basic("a:secret")["authorization"].split()[1]},
        200,
        403,
        200,
    ),
    ("/api", {"authorization": "Basic a"}, 200, 403, 401),
    ("/api", {"authorization": "Basic %%%%"}, 200, 403, 401),
    (  # "a:secret", with a character that is not of the alphabet
        "/api",
        {"authorization": "Basic YTpz*ZWNyZXQ="},
        200,
        403,
        401,
    ),
    ("/api", {"authorization": "Bearer secret"}, 200, 403, 200),
    ("/api", {"authorization": "bearer  secret "}, 200, 403, 200),
    ("/api", {"authorization": "Bearer secrets"}, 200, 403, 401),
    ("/api", {"authorization": "Digest secret"}, 200, 403, 401),
    ("/api", {"authorization": "secret"}, 200, 403, 401),
    ("/api?token=secret", {"origin": "http://door"}, 200, 200, 200),
    ("/api?token=secret", {"origin": "HTTP://DOOR"}, 200, 200, 200),
    ("/api?token=secret", {"origin": "https://door"}, 403, 403, 403),
    ("/api?token=secret", {"origin": "http://door:81"}, 403, 403, 403),
    ("/api?token=secret", {"origin": "null"}, 403, 403, 403),
    ("/api?token=secret", {"sec-fetch-site": "same-origin"}, 200, 200, 200),
    ("/api?token=secret", {"sec-fetch-site": "none"}, 200, 200, 200),
    ("/api?token=secret", {"sec-fetch-site": "same-site"}, 403, 403, 403),
    ("/api?token=secret", {"sec-fetch-site": "cross-site"}, 403, 403, 403),
    (
        "/api?token=secret",
        {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"},
        403,
        403,
        403,
    ),
    ("/?token=secret", {"sec-fetch-site": "cross-site", "sec-fetch-mode": "cors"}, 403, 403, 403),
    ("/", {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}, 200, 403, 401),
    ("/?token=secret", {}, 200, 200, 200),  # with a token after a redirect
    ("/?token=wrong", {}, 200, 403, 401),
    ("/api?a=1&token=secret&b=", {}, 200, 200, 200),
    ("/api?token=secret", {"host": "door:12345", "origin": "http://door:12345"}, 200, 200, 200),
    ("/api", {"cookie": "omnimirror-token-80="}, 200, 403, 401),
]


@pytest.mark.parametrize(("path", "headers", "public", "token", "programs"), GUARD_CASES)
def test_guard_admits_known_clients(path, headers, public, token, programs):
    """The guard alone, in front of an application that accepts everything."""
    for status, secret, accept_passwords in (
        (public, None, False),
        (token, "secret", False),
        (programs, "secret", True),
    ):
        guard = AccessGuard(
            Response("inside"), ["door"], secret, "default-src 'none'", accept_passwords
        )
        answer = TestClient(guard, base_url="http://door").get(path, headers=headers)
        assert answer.status_code == status
        assert (answer.text == "inside") == (status == 200)
        assert answer.headers.get("www-authenticate") == (
            'Basic realm="omnimirror"' if status == 401 else None
        )


def test_guard_adds_headers_to_responses():
    """Responses of the application keep their own headers; refusals have none of the page."""

    async def app(scope, receive, send):
        headers = {"cache-control": "max-age=9"} if scope["path"] == "/kept" else {}
        await Response("inside", headers=headers)(scope, receive, send)

    client = TestClient(AccessGuard(app, [], None, "default-src 'none'"), base_url="http://[::1]:8")
    for path, cache in (("/", "no-store"), ("/kept", "max-age=9"), ("/?token=a", "no-store")):
        answer = client.get(path, follow_redirects=False)
        assert (answer.status_code, answer.text) == (200, "inside")
        response_headers = {name: answer.headers.get_list(name) for name in answer.headers}
        assert response_headers.pop("content-length") == ["6"]
        assert response_headers == {
            "content-security-policy": ["default-src 'none'"],
            "x-content-type-options": ["nosniff"],
            "referrer-policy": ["no-referrer"],
            "cross-origin-resource-policy": ["same-origin"],
            "cache-control": [cache],
        }
    refusal = client.get("/", headers={"host": "evil.example"})
    assert refusal.json() == {
        "detail": "the host name must be one of this server; got 'evil.example'"
    }
    locked = TestClient(AccessGuard(app, [], "secret", "policy"), base_url="http://door")
    assert locked.get("/", headers=basic("me:secret")).status_code == 403  # not for programs
    redirect = locked.get("/?token=secret", follow_redirects=False)
    assert (redirect.status_code, redirect.headers["location"]) == (303, "/")
    assert redirect.headers["content-security-policy"] == "policy"
    assert redirect.headers["set-cookie"].startswith("omnimirror-token-80=secret; HttpOnly; ")


@pytest.mark.parametrize(
    ("scheme", "headers", "query", "reason"),
    [
        ("ws", {"origin": "http://door"}, "", None),
        ("wss", {"origin": "https://door"}, "", None),
        ("ws", {"origin": "https://door"}, "", "the origin must be this server; got https://door"),
        ("ws", {"origin": "ws://door"}, "", "the origin must be this server; got ws://door"),
        ("ws", {"host": "b"}, "", "the host name must be one of this server; got 'b'"),
        (
            "ws",
            {"sec-fetch-site": "cross-site"},
            "",
            "requests from pages of other sites are refused",
        ),
        ("ws", {}, "token=a", None),
    ],
)
def test_guard_closes_sockets_with_reason(scheme, headers, query, reason):
    """Close code 4403 after the handshake message; other connections pass unchanged."""
    scopes, sent_messages, receive_calls = [], [], []

    async def app(*connection):
        scopes.append(connection[0])

    async def receive():
        receive_calls.append(1)
        return {"type": "websocket.connect"}

    async def send(message):
        sent_messages.append(message)

    guard = AccessGuard(app, ["DOOR"], None, "")
    scope = {
        "type": "websocket",
        "scheme": scheme,
        "path": "/",
        "query_string": query.encode(),
        "headers": [(k.encode(), v.encode()) for k, v in ({"host": "door"} | headers).items()],
    }
    in_a_loop(guard(scope, receive, send))
    assert scopes == ([scope] if reason is None else [])
    close_message = {"type": "websocket.close", "code": 4403, "reason": reason}
    assert sent_messages == ([] if reason is None else [close_message])
    assert len(receive_calls) == (reason is not None)
    lifespan = {"type": "lifespan"}
    in_a_loop(guard(lifespan, receive, send))
    assert scopes[-1] is lifespan


def test_guard_requires_token_for_sockets_of_programs():
    """Without the challenge of HTTP, which browsers would show as a password dialogue."""
    guard = AccessGuard(Response("inside"), [], "secret", "", accept_passwords=True)
    with (
        pytest.raises(WebSocketDisconnect) as closed,
        TestClient(guard, base_url="http://door").websocket_connect("/"),
    ):
        pass
    assert (closed.value.code, closed.value.reason) == (
        4403,
        "a token is required; it is part of the link that the server printed at start",
    )


def test_policy_by_guard_admits_scripts_and_styles_of_page():
    """SHA-256 digests in Base64 of each inline script and style, over several lines."""

    digests = [
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        for text in ("1\n2", "ü", "p {\n}")
    ]
    page = "<style a='b'>p {\n}</style><script>1\n2</script><script type='x'>ü</script><scripts>0</scripts>"
    rules = dict(rule.split(" ", 1) for rule in content_security_policy(page).split("; "))
    assert rules == {
        "default-src": "'none'",
        "script-src": f"'self' 'sha256-{digests[0]}' 'sha256-{digests[1]}'",
        "style-src": f"'sha256-{digests[2]}'",
        "img-src": "'self' blob: data:",
        "media-src": "'self' blob: mediastream:",
        "connect-src": "'self' blob: data:",
        "base-uri": "'none'",
        "form-action": "'none'",
        "frame-ancestors": "'none'",
    }


def test_server_on_all_interfaces_prints_reachable_addresses():
    names = server_addresses("0.0.0.0")
    assert names[-1] == "127.0.0.1"  # for the local browser
    assert all(not is_loopback(name) for name in names[:-1])
    for name in names[:-1]:
        with socket.socket() as probe:
            probe.bind((name, 0))  # an address of this machine
    assert server_addresses("door.local") == ["door.local"]


def test_browser_is_redirected_to_address_without_token(browser):
    """The fragment is preserved, and page, requests and sockets are authorised by the cookie."""
    with serving(Studio(token="secret")) as address:
        page = open_page(browser, f"{address}?token=secret#tab=design", 900, 700, WITHOUT_IMAGES)
        page.wait_for_function("location.search === '' && document.querySelector('canvas')")
        assert "secret" not in page.url
        assert "tab=design" in page.url
        result = page.evaluate("""() => new Promise((resolve) => {
          const socket = new WebSocket(location.href.split(/[?#]/)[0].replace(/^http/, "ws") + "api/stream?id=none");
          socket.onmessage = (message) => resolve(JSON.parse(message.data).message);
          socket.onerror = () => resolve("refused");
        })""")
        assert result == "unknown stream 'none'"
        assert not page.problems
        page.context.close()


# -- page caching
# ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", ["/", "/design.js", "/space.js", "/calibrate.js", "/webgpu.js"])
def test_page_is_compressed_and_cached(path, client):
    uncompressed = client.get(path, headers={"accept-encoding": "identity"})
    compressed = client.get(path, headers={"accept-encoding": "gzip"})
    assert "content-encoding" not in uncompressed.headers
    assert compressed.headers["content-encoding"] == "gzip"
    assert int(compressed.headers["content-length"]) < 0.45 * int(
        uncompressed.headers["content-length"]
    )
    assert compressed.content == uncompressed.content  # decompressed by the client
    assert compressed.headers["cache-control"] == "no-cache"
    assert compressed.headers["vary"] == "accept-encoding"
    cached = client.get(path, headers={"if-none-match": compressed.headers["etag"]})
    assert (cached.status_code, cached.content) == (304, b"")
    assert "default-src 'none'" in cached.headers["content-security-policy"]
    assert client.get(path, headers={"if-none-match": '"other"'}).status_code == 200


def test_responses_are_not_cached(client):
    for path in ("/api/start", "/api/camera/tables?id=paper-spherical", "/api/design"):
        assert client.get(path).headers["cache-control"] == "no-store"


# -- connections
# ----------------------------------------------------------------------------------------


def test_incomplete_requests_do_not_block_other_clients(monkeypatch):
    """Enough to fill the server; it still responds, and closes the oldest of them."""
    monkeypatch.setattr(server, "connection_limit", lambda: 20)
    monkeypatch.setattr(server, "REQUEST_TIMEOUT_S", 3600)
    with serving(Studio()) as address, ExitStack() as connections:
        port = urlsplit(address).port
        sockets = [
            connections.enter_context(socket.create_connection(("127.0.0.1", port)))
            for _ in range(60)
        ]
        for connection in sockets:
            with suppress(OSError):
                connection.sendall(b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ")
        assert httpx.get(f"{address}health", timeout=300).json()["status"] == "ok"
        for connection in sockets[
            :40
        ]:  # all but the newest 20 are closed, independent of the clock
            with suppress(ConnectionError):
                assert connection.recv(1) == b""


def test_idle_sockets_do_not_block_other_clients(monkeypatch):
    """More than the server accepts: those idle for longest are closed, and the newest is served."""
    monkeypatch.setattr(server, "connection_limit", lambda: 20)
    with serving(Studio()) as address, ExitStack() as connections:
        url = address.replace("http", "ws") + "api/design/ask"
        sockets = [connections.enter_context(connect(url, open_timeout=300)) for _ in range(30)]
        assert httpx.get(f"{address}health", timeout=300).json()["status"] == "ok"
        for closed_socket in sockets[:10]:
            with pytest.raises(ConnectionClosed):
                closed_socket.recv()
        sockets[-1].send("no question")
        with pytest.raises(ConnectionClosed) as closed:
            sockets[-1].recv()
        assert closed.value.rcvd.code == 1003


def test_idle_socket_is_closed(monkeypatch):
    monkeypatch.setattr(server, "IDLE_TIMEOUT_S", 0.2)
    with (
        serving(Studio()) as address,
        connect(address.replace("http", "ws") + "api/design/ask") as idle,
    ):
        with pytest.raises(ConnectionClosed) as closed:
            idle.recv()
        assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (1001, "idle timeout")


@pytest.mark.parametrize("pieces", [[b"\xff{}"], [b'{"a": "\xc3', b'\x28"}']])
def test_invalid_utf_8_closes_socket_without_traceback(pieces, caplog):
    with (
        serving(Studio()) as address,
        connect(address.replace("http", "ws") + "api/design/ask") as bad,
    ):
        bad.send(pieces if len(pieces) > 1 else pieces[0], text=True)
        with pytest.raises(ConnectionClosed) as closed:
            bad.recv()
        assert closed.value.rcvd.code == 1007
    assert not caplog.records


def test_endless_header_is_abandoned(monkeypatch):
    monkeypatch.setattr(server, "REQUEST_TIMEOUT_S", 0.2)
    with (
        serving(Studio()) as address,
        socket.create_connection(("127.0.0.1", urlsplit(address).port)) as slow,
    ):
        request = f"GET /health HTTP/1.1\r\nHost: {urlsplit(address).netloc}\r\n".encode()
        slow.sendall(request + b"\r\n")
        assert slow.recv(65536).startswith(b"HTTP/1.1 200")
        slow.sendall(request)  # a second, incomplete one
        with suppress(ConnectionError):
            while slow.recv(65536):
                pass


@pytest.mark.parametrize("files", [100, 1024, resource.RLIM_INFINITY])
def test_connection_limit_leaves_file_descriptors(files, monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda resource_id: (files, files))
    max_connections = server.connection_limit.__wrapped__()
    assert 8 <= max_connections <= 256
    assert max_connections + 50 < files or files == resource.RLIM_INFINITY


# -- live sources
# ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("http://", "must contain a host"),
        ("rtsp://", "must contain a host"),
        ("udp://door", "must contain a port"),
        ("file:///no/such.ts", "must be the address of an existing file"),
    ],
)
def test_invalid_streams_are_rejected_before_page_opens(source, message):
    with pytest.raises(MediaError, match=message):
        Sources([source], live=[source])


def test_passwords_of_streams_are_not_sent_to_pages():
    studio = Studio(
        Sources(["rtsp://me:secret@127.0.0.1:9/live"], live=["rtsp://me:secret@127.0.0.1:9/live"])
    )
    with TestClient(create_app(studio), base_url=LOCAL) as client:
        assert client.get("/api/start").json()["sources"][0]["name"] == "rtsp://127.0.0.1:9/live"


def test_unresponsive_stream_ends_with_message(monkeypatch):
    monkeypatch.setattr(_server_state, "OPENING_S", 0.3)
    with socket.socket() as silent_socket:
        silent_socket.bind(("127.0.0.1", 0))  # and does not listen
        address = f"http://127.0.0.1:{silent_socket.getsockname()[1]}/live.ts"
        studio = Studio(Sources([address], live=[address]))
        with (
            TestClient(create_app(studio), base_url=LOCAL) as client,
            client.websocket_connect("ws://127.0.0.1/api/stream?id=source") as page,
        ):
            status = page.receive_json()
            while status["state"] != "ended":
                status = page.receive_json()
    assert status["message"].startswith(f"no frame from {address} for")
