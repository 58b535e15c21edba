"""Attacks on the server over loopback: files, memory and requests that must be refused."""

from __future__ import annotations

import asyncio
import base64
import errno
import os
import resource
import socket
import struct
import threading
import time
import zlib
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
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import omnimirror as om
from omnimirror.apps.studio import _server_state, _uploads
from omnimirror.apps.studio._bench_files import coarser
from omnimirror.apps.studio._search_process import perform
from omnimirror.apps.studio._server_state import Sources, Studio
from omnimirror.apps.studio.app import create_app
from omnimirror.apps.studio.bench_messages import SearchTask
from omnimirror.base.errors import MediaError
from omnimirror.interop.http_server import limits, server
from omnimirror.interop.http_server.auth import AccessGuard, is_loopback
from omnimirror.interop.http_server.limits import MAX_MESSAGE_BYTES
from omnimirror.interop.http_server.server import server_addresses
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.mirrors import MIRRORS, SECONDARIES
from omnimirror.optics.sensor_files import tables_of
from tests.serving import in_a_loop

from .browser import open_page, serving
from .test_bench_page import WITHOUT_PICTURES

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


def spies(path: str) -> list[dict]:
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


def answers(client: TestClient, tables: dict) -> list[str]:
    """Return the server responses to tables, by every upload route."""
    wanted = tables if "field" in tables else {}
    on, distance = {"tables": SPHERE if wanted else tables}, {"object_distance_mm": None}
    questions = {
        "requirements": {**on, "requirements": wanted},
        "file": {**on, **distance, "kind": "sensor"},
        "picture": {**on, "width_px": 32, "samples": 1},
        "change": {**on, **distance, "what": "mirror", "to": "cone"},
    }
    said = [
        client.post(way, content=tomli_w.dumps(tables)).text
        for way in ("/api/sensors", "/api/bench/open")
    ]
    asked = ("requirements",) if wanted else questions
    said += [client.post(f"/api/bench/{way}", json=questions[way]).text for way in asked]
    with client.websocket_connect("ws://127.0.0.1/api/bench/ask") as socket:
        plain = {"slot": 0, "number": 1, "follows": False, "section": False, "squares": False}
        socket.send_json({**plain, **on, **distance, "requirements": wanted or None})
        said.append(str(socket.receive()))
    search = {
        "what": "design",
        "merit": "worst_blur_deg",
        "shape": "spline",
        "terms": 1,
        "starts": 1,
    }
    perform(
        SearchTask(**search, **on, **distance, requirements=wanted or None),
        lambda news: said.append(news.sentence),
    )
    return said


def test_what_may_name_a_file_is_tried():
    assert {"sampled", "tabulated-mapping"} <= {kind for kind, _ in FILES}
    assert set(MIRRORS) <= set(SECONDARIES)


@pytest.mark.parametrize("number", range(len(spies(""))))
def test_the_server_opens_no_file_that_an_upload_names(number, client, tmp_path):
    """Responses are equal for a file with columns, an invalid file, a missing file, a folder, and a
    pipe."""
    (tmp_path / "columns").write_text(f"{SECRET}\n" * 9)
    (tmp_path / "words").write_text("secret words")
    os.mkfifo(tmp_path / "pipe")  # opening it blocks
    places = [str(tmp_path / name) for name in ("columns", "words", "absent", ".", "pipe")]
    said = [answers(client, spies(place)[number]) for place in places]
    same = [
        [text.replace(place, "PLACE") for text in texts]
        for place, texts in zip(places, said, strict=True)
    ]
    assert same.count(same[0]) == len(same)
    assert "must not name a file" in "".join(same[0])
    assert not any("1.25" in text for text in same[0])


def test_the_command_line_still_follows_files_beside_its_own(tmp_path):
    """A profile in a separate file, relative to the folder of the sensor file."""
    profile = [f"{x},{x * x / 100}" for x in range(30)]
    (tmp_path / "profile.csv").write_text("\n".join(profile))
    (tmp_path / "s.toml").write_text(
        tomli_w.dumps({**SPHERE, "mirror": {"kind": "sampled", "profile_csv": "profile.csv"}})
    )
    assert om.load_sensor(tmp_path / "s.toml").mirror.x_mm[-1] == 29.0


# -- size limits
# ----------------------------------------------------------------------------------------


def test_no_question_is_larger_than_what_is_taken(client):
    """Limit of the announced length."""
    huge = b" " * (MAX_MESSAGE_BYTES + 1)
    for path in (
        "/api/bench/change",
        "/api/bench/file",
        "/api/bench/requirements",
        "/api/sensor-file",
        "/api/sensors",
    ):
        answer = client.post(path, content=huge, headers={"content-type": "application/json"})
        assert (answer.status_code, "must be at most 1 MB" in answer.json()["detail"]) == (
            413,
            True,
        )


async def status_of(bounded: limits.RequestLimits, receive, name: str = "") -> int:
    """Return the response status of a request without an announced length."""
    said: list = []

    async def send(message):
        said.append(message)

    await bounded({"type": "http", "name": name, "path": "/", "headers": []}, receive, send)
    return said[0]["status"]


def test_the_bounds_are_those_of_the_documentation():
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
def test_the_announced_length_is_refused_unread(headers, is_refused):
    """Exact to the byte, for the header of that name only; without a valid length the chunks are
    counted."""
    said, reads = [], []

    async def receive():
        reads.append(1)
        return {"type": "http.request", "body": bytes(1000), "more_body": False}

    async def send(message):
        said.append(message)

    bounded = limits.RequestLimits(reads_and_answers, {"/large": 1000})
    in_a_loop(bounded({"type": "http", "path": "/large", "headers": headers}, receive, send))
    assert said[0]["status"] == (413 if is_refused else 200)
    assert bool(reads) != is_refused
    assert bounded.pending_bytes == 0
    if is_refused:
        assert dict(said[0]["headers"])[b"connection"] == b"close"


@pytest.mark.parametrize(
    ("pieces", "status"), [((600, 400), 200), ((600, 401), 413), ((1001,), 413)]
)
def test_pieces_are_counted_to_the_byte(pieces, status):
    left = list(pieces)

    async def receive():
        size = left.pop(0)
        return {"type": "http.request", "body": bytes(size), "more_body": bool(left)}

    bounded = limits.RequestLimits(reads_and_answers, {"/": 1000})
    assert in_a_loop(status_of(bounded, receive)) == status
    assert bounded.pending_bytes == 0


@pytest.mark.parametrize(("held", "status"), [(1000, 200), (999, 503)])
def test_the_room_of_the_server_is_used_to_the_byte(held, status, monkeypatch):
    monkeypatch.setattr(limits, "MAX_PENDING_BYTES", held)

    async def receive():
        return {"type": "http.request", "body": bytes(1000), "more_body": False}

    assert in_a_loop(status_of(limits.RequestLimits(reads_and_answers, {}), receive)) == status


def test_the_end_of_a_complete_request_may_take_any_time(monkeypatch):
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


def test_what_is_fast_enough_may_take_longer_than_the_grace(monkeypatch):
    """Received bytes extend the time: 0.05 s and 1 s per 1024 bytes."""
    monkeypatch.setattr(limits, "GRACE_PERIOD_S", 0.05)
    pieces = [4096, 1, 1]

    async def receive():
        if len(pieces) < 3:
            await asyncio.sleep(0.06)
        size = pieces.pop(0)
        return {"type": "http.request", "body": bytes(size), "more_body": bool(pieces)}

    assert in_a_loop(status_of(limits.RequestLimits(reads_and_answers, {}), receive)) == 200


def test_other_connections_than_requests_pass_untouched():
    passed = []

    async def app(*connection):
        passed.append(connection)

    connection = ({"type": "websocket", "path": "/"}, object(), object())
    in_a_loop(limits.RequestLimits(app, {})(*connection))
    assert passed == [connection]


async def reads_and_answers(scope, receive, send):
    await reads_all(scope, receive, send)
    await Response("taken")(scope, receive, send)


async def reads_all(scope, receive, send):
    while (await receive()).get("more_body"):
        pass


def test_pieces_without_end_are_stopped():
    async def endless():
        return {"type": "http.request", "body": bytes(1 << 16), "more_body": True}

    assert in_a_loop(status_of(limits.RequestLimits(reads_all, {}), endless)) == 413


def test_requests_together_hold_no_more_than_the_server_has_room_for(monkeypatch):
    """Two images that are allowed individually but not together; the first is accepted after the
    second has ended."""
    monkeypatch.setattr(limits, "MAX_PENDING_BYTES", 1500)

    async def both():
        first_came, go_on = asyncio.Event(), asyncio.Event()

        async def app(scope, receive, send):
            body = (await receive())["body"]
            first_came.set()
            if scope["name"] == "first":
                await go_on.wait()
            await Response(str(len(body)))(scope, receive, send)

        async def receive():
            return {"type": "http.request", "body": bytes(900), "more_body": False}

        bounded = limits.RequestLimits(app, {"/": 1000})
        first = asyncio.create_task(status_of(bounded, receive, "first"))
        await first_came.wait()
        refused = await status_of(bounded, receive)
        go_on.set()
        return refused, await first, await status_of(bounded, receive)

    assert in_a_loop(both()) == (503, 200, 200)


@pytest.mark.parametrize("pause_s", [0.01, 1.0])
def test_what_comes_too_slowly_is_given_up(pause_s, monkeypatch):
    """Also before the first byte."""
    monkeypatch.setattr(limits, "GRACE_PERIOD_S", 0.05)

    async def dribble():
        await asyncio.sleep(pause_s)
        return {"type": "http.request", "body": b"x", "more_body": pause_s < 1}

    assert in_a_loop(status_of(limits.RequestLimits(reads_and_answers, {}), dribble)) == 408


@pytest.mark.parametrize(
    ("suffix", "pixel"),
    [
        (".tif", np.zeros(3, np.uint16)),
        (".png", np.zeros(4, np.uint16)),
        (".png", np.zeros(4, "u1")),
    ],
)
def test_pictures_are_bounded_by_their_bytes_in_memory(suffix, pixel, monkeypatch):
    """Exact to the byte: an image of maximum size is read, and one with another row is rejected
    beforehand."""
    monkeypatch.setattr(_uploads, "MAX_DECODED_BYTES", 40 * 30 * pixel.nbytes)

    def file(rows: int) -> bytes:
        return cv2.imencode(suffix, np.tile(pixel, (rows, 40, 1)))[1].tobytes()

    assert _uploads.browser_picture(file(30), "fits").startswith(b"\x89PNG")
    with pytest.raises(MediaError, match=r"the decoded pixels of .* must take at most"):
        _uploads.browser_picture(file(31), "large")


def test_a_small_file_of_a_huge_picture_takes_little_memory():
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
    with pytest.raises(MediaError, match=r"decoded pixels of .* must take at most 256 MB"):
        _uploads.browser_picture(head + tags + tables + row, "bomb.tif")


def test_strips_are_converted_like_the_whole():
    deep = np.random.default_rng(0).integers(0, 65536, (700, 9, 3), np.uint16)
    assert np.array_equal(_uploads.eight_bits(deep), np.round(deep / 257).astype(np.uint8))
    light = np.array([[-1.0, 0.0, 0.25, 0.5, 1.0, 7.0, np.nan, np.inf]], np.float32)
    assert _uploads.eight_bits(light).tolist() == [[0, 0, 64, 128, 255, 255, 0, 255]]
    shallow = np.arange(256, dtype=np.uint8).reshape(16, 16)
    assert np.array_equal(_uploads.eight_bits(shallow), shallow)


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
def test_names_of_uploads_are_harmless(name, safe):
    assert _uploads.safe_name(name) == safe


@pytest.mark.parametrize("kind", list(_uploads.KINDS))
@pytest.mark.parametrize("mode", ["L", "RGB", "P"])
def test_pictures_of_every_kind_are_bounded_by_pillows_header(kind, mode, monkeypatch):
    """Files written by Pillow: a palette counts as four channels, PPM as 16 bits, all others as
    stored."""
    if kind in ("JPEG", "WEBP", "PPM") and mode == "P":
        pytest.skip("the format has no palette")
    file = BytesIO()
    Image.new(mode, (10, 6), 3).save(file, kind)
    data = file.getvalue()
    with Image.open(BytesIO(data)) as stored:
        channels = 4 if stored.mode == "P" else len(stored.getbands())
    size = 10 * 6 * channels * (2 if kind == "PPM" else 1)
    monkeypatch.setattr(_uploads, "MAX_DECODED_BYTES", size)
    assert _uploads.picture_in(data, "a").shape[:2] == (6, 10)
    monkeypatch.setattr(_uploads, "MAX_DECODED_BYTES", size - 1)
    with pytest.raises(MediaError, match="pixels of a must take at most"):
        _uploads.picture_in(data, "a")


def test_what_is_no_picture_is_named_with_the_kinds():
    with pytest.raises(
        MediaError, match=r"a must be an image in a supported format \(PNG, JPEG, TIFF, WEBP, BMP"
    ):
        _uploads.picture_in(b"no picture", "a")


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg"])
def test_uploads_that_are_cut_short_are_named_as_they_were_sent(suffix):
    """The internal file name of the upload is not disclosed."""
    data = cv2.imencode(suffix, np.random.default_rng(0).integers(0, 256, (40, 50, 3), np.uint8))[
        1
    ].tobytes()
    with pytest.raises(
        MediaError, match=r"my picture\.tif( must be an image|: the file is truncated)"
    ) as refused:
        _uploads.picture_in(data[: len(data) // 2], "my picture.tif")
    assert "/" not in str(refused.value)


def test_encoded_pictures_keep_their_pixels_and_their_quality():
    picture = np.random.default_rng(1).integers(0, 256, (40, 50, 3), np.uint8)
    with Image.open(BytesIO(_uploads.encoded(picture, ".png"))) as png:
        assert np.array_equal(np.asarray(png), picture)
    with Image.open(BytesIO(_uploads.encoded(picture, ".jpg"))) as usual:
        expected = BytesIO()
        Image.new("RGB", (8, 8)).save(expected, "JPEG", quality=90)
        with Image.open(expected) as reference:
            assert usual.quantization == reference.quantization
    assert len(_uploads.encoded(picture, ".jpg", 30)) < len(_uploads.encoded(picture, ".jpg"))


def test_a_request_without_a_file_is_refused():
    async def of(data: bytes) -> bytes:
        async def receive():
            return {"type": "http.request", "body": data, "more_body": False}

        return await _uploads.collected(Request({"type": "http"}, receive))

    assert in_a_loop(of(b"file")) == b"file"
    with pytest.raises(MediaError, match="the uploaded file is empty"):
        in_a_loop(of(b""))


@pytest.mark.parametrize("size", [(40_000, 40_000), (1, 100_000), (100_000, 1)])
def test_imagers_of_any_size_take_no_more_than_a_picture_of_the_page(size, client):
    """The room of a camera and its report are refused; the preview is reduced for any aspect ratio."""
    width, height = size
    imager = {"width_px": width, "height_px": height, "pixel_pitch_um": 4000 / max(size)}
    tables = {**SPHERE, "imager": imager}
    known = client.post("/api/sensors", content=tomli_w.dumps(tables)).json()["id"]
    if width * height > 1e9:
        room = client.get("/api/room", params={"id": known})
        assert (
            room.status_code,
            "must have at most 16 million pixels" in room.json()["detail"],
        ) == (400, True)
    report = client.post(
        "/api/bench/file", json={"tables": tables, "kind": "report", "object_distance_mm": None}
    )
    assert (report.status_code, f"{width} x {height} px" in report.json()["detail"]) == (400, True)
    small = coarser(om.load_sensor("paper-spherical"), 64)
    assert max(coarser(replace(small, imager=Imager(*size, 1.0)), 64).imager.size) == 64


def test_equal_work_is_done_once_and_few_may_wait(monkeypatch):
    monkeypatch.setattr(limits, "MAX_QUEUED_JOBS", 2)
    runs: list[str] = []

    async def all_of_it():
        queue, begun, go_on = limits.JobQueue(), asyncio.Event(), threading.Event()
        loop = asyncio.get_running_loop()

        def make(name: str) -> str:
            loop.call_soon_threadsafe(begun.set)
            go_on.wait()
            runs.append(name)
            return name

        many = [asyncio.create_task(queue.run("room", lambda: make("room"))) for _ in range(20)]
        other = asyncio.create_task(queue.run("other", lambda: make("other")))
        await begun.wait()
        with pytest.raises(limits.ServerBusy, match="the server is busy"):
            await queue.run("third", lambda: make("third"))
        many[0].cancel()  # a disconnected page does not affect the others
        go_on.set()
        return await asyncio.gather(*many[1:], other)

    assert in_a_loop(all_of_it()) == ["room"] * 19 + ["other"]
    assert runs == ["room", "other"]


def test_work_is_done_one_after_the_other_and_again_when_asked_again():
    runs: list[str] = []

    def make(name: str) -> str:
        runs.append(f"begin {name}")
        time.sleep(0.01)
        runs.append(f"end {name}")
        return name

    async def twice():
        queue = limits.JobQueue()
        for _ in range(2):
            found = await asyncio.gather(
                *(queue.run(name, lambda name=name: make(name)) for name in "ab")
            )
            assert found == ["a", "b"]
        with pytest.raises(ZeroDivisionError):
            await queue.run("a", lambda: 1 // 0)
        return await queue.run("a", lambda: "again")

    assert in_a_loop(twice()) == "again"
    assert runs == ["begin a", "end a", "begin b", "end b"] * 2


def test_a_full_disk_is_a_sentence(client, monkeypatch):
    def full(*args, **kwargs):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(_uploads.tempfile, "TemporaryDirectory", full)
    tiff = cv2.imencode(".tif", np.zeros((4, 4, 3), np.uint16))[1].tobytes()
    answer = client.post("/api/pictures", content=tiff)
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


def test_what_other_sites_embed_is_refused(client):
    """An image, script or frame of the studio in a foreign page; links to the page may be followed."""
    for site in ("cross-site", "same-site"):
        assert fetch(client, "/api/room?id=ball:123.4", site) == 403
        assert fetch(client, "/bench.js", site) == 403
        assert fetch(client, "/api/start", site, "navigate") == 403
        assert fetch(client, "/", site) == 403
        assert fetch(client, "/", site, "navigate") == 200
    assert fetch(client, "/api/start", "same-origin", "cors") == 200
    assert fetch(client, "/api/start", "none", "navigate") == 200


def test_the_token_leaves_the_address_and_has_a_cookie_of_its_port():
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
        elsewhere = client.get(
            "http://192.168.1.7:9090/api/start"
        )  # another studio on the same machine
        assert elsewhere.status_code == 403
        assert client.get("/?token=wrong").status_code == 403


def test_a_token_does_not_let_hosts_in_that_are_none(client):
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
def test_loopback_addresses_need_no_token(host, expected):
    """RFC 1122, 3.2.1.3, and RFC 4291, 2.5.3; other names may resolve to any address."""
    assert is_loopback(host) is expected


def basic(text: str | bytes) -> dict[str, str]:
    """Return the header of HTTP basic authentication (RFC 7617)."""
    return {
        "authorization": "Basic "
        + base64.b64encode(text if isinstance(text, bytes) else text.encode()).decode()
    }


GUARDED = [
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
]


@pytest.mark.parametrize(("path", "headers", "public", "token", "programs"), GUARDED)
def test_a_guard_lets_in_whom_it_knows(path, headers, public, token, programs):
    """The guard alone, in front of an application that accepts everything."""
    for status, secret, for_programs in (
        (public, None, False),
        (token, "secret", False),
        (programs, "secret", True),
    ):
        guard = AccessGuard(
            Response("inside"), ["door"], secret, "default-src 'none'", for_programs
        )
        answer = TestClient(guard, base_url="http://door").get(path, headers=headers)
        assert answer.status_code == status
        assert (answer.text == "inside") == (status == 200)
        assert answer.headers.get("www-authenticate") == (
            'Basic realm="omnimirror"' if status == 401 else None
        )


def test_a_server_that_listens_everywhere_is_named_by_addresses_that_can_be_opened():
    names = server_addresses("0.0.0.0")
    assert names[-1] == "127.0.0.1"  # for the local browser
    assert all(not is_loopback(name) for name in names[:-1])
    for name in names[:-1]:
        with socket.socket() as probe:
            probe.bind((name, 0))  # an address of this machine
    assert server_addresses("door.local") == ["door.local"]


def test_a_browser_is_led_to_an_address_without_the_token(browser):
    """The fragment is preserved, and page, requests and sockets are authorised by the cookie."""
    with serving(Studio(token="secret")) as address:
        page = open_page(browser, f"{address}?token=secret#tab=design", 900, 700, WITHOUT_PICTURES)
        page.wait_for_function("location.search === '' && document.querySelector('canvas')")
        assert "secret" not in page.url
        assert "tab=design" in page.url
        told = page.evaluate("""() => new Promise((resolve) => {
          const socket = new WebSocket(location.href.split(/[?#]/)[0].replace(/^http/, "ws") + "api/stream?id=none");
          socket.onmessage = (message) => resolve(JSON.parse(message.data).sentence);
          socket.onerror = () => resolve("refused");
        })""")
        assert told == "unknown stream 'none'"
        assert not page.problems
        page.context.close()


# -- page caching
# ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", ["/", "/bench.js", "/space.js", "/calibrate.js"])
def test_the_page_is_sent_once_and_squeezed(path, client):
    whole = client.get(path, headers={"accept-encoding": "identity"})
    compressed = client.get(path, headers={"accept-encoding": "gzip"})
    assert "content-encoding" not in whole.headers
    assert compressed.headers["content-encoding"] == "gzip"
    assert int(compressed.headers["content-length"]) < 0.45 * int(whole.headers["content-length"])
    assert compressed.content == whole.content  # decompressed by the client
    assert compressed.headers["cache-control"] == "no-cache"
    assert compressed.headers["vary"] == "accept-encoding"
    again = client.get(path, headers={"if-none-match": compressed.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert "default-src 'none'" in again.headers["content-security-policy"]
    assert client.get(path, headers={"if-none-match": '"other"'}).status_code == 200


def test_answers_are_not_kept(client):
    for path in ("/api/start", "/api/camera/tables?id=paper-spherical", "/api/bench"):
        assert client.get(path).headers["cache-control"] == "no-store"


# -- connections
# ----------------------------------------------------------------------------------------


def test_half_requests_are_given_up_and_keep_nobody_out(monkeypatch):
    """Enough to fill the server; it still responds, and closes the oldest of them."""
    monkeypatch.setattr(server, "connection_limit", lambda: 20)
    monkeypatch.setattr(server, "REQUEST_TIMEOUT_S", 3600)
    with serving(Studio()) as address, ExitStack() as open_ones:
        port = urlsplit(address).port
        held = [
            open_ones.enter_context(socket.create_connection(("127.0.0.1", port)))
            for _ in range(60)
        ]
        for half in held:
            with suppress(OSError):
                half.sendall(b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ")
        assert httpx.get(f"{address}health", timeout=300).json()["status"] == "ok"
        for half in held[:40]:  # all but the newest 20 are closed, independent of the clock
            with suppress(ConnectionError):
                assert half.recv(1) == b""


def test_idle_sockets_keep_nobody_out(monkeypatch):
    """More than the server accepts: those idle for longest are closed, and the newest is served."""
    monkeypatch.setattr(server, "connection_limit", lambda: 20)
    with serving(Studio()) as address, ExitStack() as open_ones:
        where = address.replace("http", "ws") + "api/bench/ask"
        held = [open_ones.enter_context(connect(where, open_timeout=300)) for _ in range(30)]
        assert httpx.get(f"{address}health", timeout=300).json()["status"] == "ok"
        for gone in held[:10]:
            with pytest.raises(ConnectionClosed):
                gone.recv()
        held[-1].send("no question")
        with pytest.raises(ConnectionClosed) as closed:
            held[-1].recv()
        assert closed.value.rcvd.code == 1003


def test_an_idle_socket_is_closed(monkeypatch):
    monkeypatch.setattr(server, "IDLE_TIMEOUT_S", 0.2)
    with (
        serving(Studio()) as address,
        connect(address.replace("http", "ws") + "api/bench/ask") as idle,
    ):
        with pytest.raises(ConnectionClosed) as closed:
            idle.recv()
        assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (1001, "idle timeout")


@pytest.mark.parametrize("pieces", [[b"\xff{}"], [b'{"a": "\xc3', b'\x28"}']])
def test_text_that_is_not_utf_8_closes_a_socket_without_a_traceback(pieces, caplog):
    with (
        serving(Studio()) as address,
        connect(address.replace("http", "ws") + "api/bench/ask") as bad,
    ):
        bad.send(pieces if len(pieces) > 1 else pieces[0], text=True)
        with pytest.raises(ConnectionClosed) as closed:
            bad.recv()
        assert closed.value.rcvd.code == 1007
    assert not caplog.records


def test_a_head_that_does_not_end_is_given_up(monkeypatch):
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
def test_the_number_of_connections_leaves_files_to_be_opened(files, monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda which: (files, files))
    most = server.connection_limit.__wrapped__()
    assert 8 <= most <= 256
    assert most + 50 < files or files == resource.RLIM_INFINITY


# -- live sources
# ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("http://", "must contain a host"),
        ("rtsp://", "must contain a host"),
        ("udp://door", "must contain a port"),
        ("file:///no/such.ts", "must be the address of an existing file"),
    ],
)
def test_what_can_be_no_stream_is_refused_before_a_page_opens(source, words):
    with pytest.raises(MediaError, match=words):
        Sources([source], live=[source])


def test_pages_are_told_no_password_of_a_stream():
    studio = Studio(
        Sources(["rtsp://me:secret@127.0.0.1:9/live"], live=["rtsp://me:secret@127.0.0.1:9/live"])
    )
    with TestClient(create_app(studio), base_url=LOCAL) as client:
        assert client.get("/api/start").json()["sources"][0]["name"] == "rtsp://127.0.0.1:9/live"


def test_a_stream_that_never_answers_ends_with_a_sentence(monkeypatch):
    monkeypatch.setattr(_server_state, "OPENING_S", 0.3)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))  # and does not listen
        address = f"http://127.0.0.1:{nobody.getsockname()[1]}/live.ts"
        studio = Studio(Sources([address], live=[address]))
        with (
            TestClient(create_app(studio), base_url=LOCAL) as client,
            client.websocket_connect("ws://127.0.0.1/api/stream?id=source") as page,
        ):
            told = page.receive_json()
            while told["state"] != "ended":
                told = page.receive_json()
    assert told["sentence"].startswith(f"no frame from {address} for")
