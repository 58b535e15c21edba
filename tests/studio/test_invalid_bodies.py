"""Invalid JSON on every route: the answer is 422 or a closed WebSocket, and nothing is logged."""

from __future__ import annotations

import json
import logging
import struct
from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.routing import APIRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

import omnimirror as om
from omnimirror.specs import tables_of
from omnimirror.studio.app import api, create_app
from omnimirror.studio.studio import Studio
from tests.everyday import few

from .boards import ASKED, BLANK

LOCAL = "http://127.0.0.1"
TABLES = tables_of(om.load_sensor("paper-spherical"))
FOLLOWS = {"tables": TABLES, "follows": False}
DISTANCE = {"object_distance_mm": None}
REQUIRED = {"field": {"omega_max_deg": 90.0}, "limits": [{"quantity": "length_mm", "at_most": 300.0}]}
MOUNT = {"camera_looks": "up", "forward_azimuth_deg": -90.0, "image_flipped": False}
FITTED = {
    "id": "paper-spherical", "mount": MOUNT, "image_size": [64, 64], "centre_px": [31.5, 31.5], "rim_radius_px": 30.0,
}  # fmt: skip
SEEN = {
    "name": "a.png", "image_size": [480, 480], "ids": [0, 1], "corners_px": [[1.0, 2.0], [3.0, 4.0]],
    "sigma_px": [0.1, 0.1], "reason": None, "blur_px": 1.0, "is_reversed": None, "begins_white": None,
    "is_part": False, "time_s": None,
}  # fmt: skip
PLACE = {
    "picture": "a.png", "rotation": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], "shift_mm": [0.0, 0.0, 300.0],
    "low_mm": [0.0, 0.0], "high_mm": [90.0, 60.0], "margin_mm": 5.0, "px_per_mm": 1.0, "is_upwards": True,
}  # fmt: skip
SLIDES = [{"path": ["lens", "focal_length_mm"], "values": [11.0, 12.0]}]
ALLOWED = [{"name": "decentre_mm", "tolerance": 0.1}]

BODIES: dict[str, Any] = {
    "/api/sensor-file": FITTED,
    "/api/bench/slides": {**FOLLOWS, "requirements": REQUIRED, "slides": SLIDES},
    "/api/bench/change": {"tables": TABLES, **DISTANCE, "what": "mirror", "to": "cone"},
    "/api/bench/making": {"tables": TABLES, **DISTANCE, "kind": "table"},
    "/api/bench/file": {"tables": TABLES, **DISTANCE, "kind": "sensor"},
    "/api/bench/requirements": {"tables": TABLES, "requirements": REQUIRED},
    "/api/bench/picture": {"tables": TABLES, "width_px": 32, "samples": 1},
    "/api/bench/errors": {"tables": TABLES},
    "/api/bench/built": {"tables": TABLES, "values": {"decentre_mm": 0.1}, "refocus": "none"},
    "/api/bench/yield": {
        "tables": TABLES, "errors": ALLOWED, "refocus": "none", "merit": "worst_blur_px", "limit": 3.0, "trials": 1,
        "seed": 0,
    },
    "/api/calibrate/together": {
        "board": ASKED, "pictures": [SEEN], "centre_px": None, "radius_px": None, "candidate": None,
    },
}  # fmt: skip
BEFORE_FILES: dict[str, Any] = {
    "/api/level": {**FITTED, "name": "a.png"},
    "/api/restore": {**FITTED, "name": "a.png", **DISTANCE},
    "/api/calibrate/straight": {"camera_file": "", "place": PLACE, "name": "a.png"},
}
"""Messages that stand before a file in the body."""
FILES = {"/api/sensors", "/api/bench/open", "/api/pictures", "/api/rim", "/api/calibrate/look"}
"""Routes whose body is a file."""
SOCKETS: dict[str, Any] = {
    "/api/bench/ask": {
        "slot": 0, "number": 1, **FOLLOWS, **DISTANCE, "section": False, "squares": False, "requirements": REQUIRED,
    },
    "/api/bench/work": {
        "what": "design", "tables": TABLES, "requirements": REQUIRED, **DISTANCE, "merit": "worst_blur_deg",
        "shape": "spline", "terms": 1, "starts": 1,
    },
    "/api/calibrate/work": {
        "board": ASKED, "pictures": 2, "model": "unified", "optics": "mirror", "camera_looks": "up",
        "image_flipped": False, "centre_px": None, "rim_radius_px": None, "flat_board": True, "command": "",
    },
}  # fmt: skip

NOT_JSON = {
    "NaN": "NaN", "infinity": "Infinity", "minus infinity": "-Infinity", "overflow": "1e999",
    "lone surrogate": '"\\ud800"', "surrogate as a name": '{"\\udfff": 1}', "400 digits": "1" + "0" * 400,
    "5000 digits": "7" * 5000, "65 bits": str(2**64), "deep list": "[" * 99 + "]" * 99, "bottomless": "[" * 100_000,
    "deep table": '{"a":' * 99 + "1" + "}" * 99, "name twice": '{"a": 1, "a": 2}', "comment": "1 // one",
}  # fmt: skip
"""Values that make a body invalid wherever they stand."""
UNEXPECTED = [
    "null", "true", '"x"', '"nan"', '"inf"', '"-Infinity"', '"1e999"', "-1", "0", "1e308", "-1e308", "5e-324", "0.5",
    "9223372036854775807", "[]", "{}", "[[]]", '[{"a": [1]}]', '""', '"\\u0000"', json.dumps("𝒳" * 5000),
]  # fmt: skip
"""Valid JSON of other types and magnitudes."""


def paths(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of all values in JSON data."""
    yield path
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in parts:
        yield from paths(part, (*path, key))


def with_raw(value: Any, path: tuple[Any, ...], raw: str) -> str:
    """The JSON text of data with raw text in place of one value."""

    def replaced(part: Any, rest: tuple[Any, ...]) -> Any:
        if not rest:
            return "@here@"
        copy = dict(part) if isinstance(part, dict) else list(part)
        copy[rest[0]] = replaced(part[rest[0]], rest[1:])
        return copy

    return json.dumps(replaced(value, path)).replace('"@here@"', raw)


def broken(sample: Any) -> list[bytes]:
    """Bodies that are not JSON at all: cut off, in another encoding, continued."""
    text = json.dumps(sample).encode()
    cut = [text[:length] for length in (0, 1, len(text) // 2, len(text) - 1)]
    return [*cut, text + b"]", b"\xff" + text, text.replace(b'"', b'"\xc3\x28', 1), text.decode().encode("utf-16")]


def everyday_paths(sample: Any) -> list[tuple[Any, ...]]:
    """The whole, the first entry and the deepest."""
    found = list(paths(sample))
    return [(), found[1], max(found, key=len)]


def framed(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text + BLANK


def frame(path: str, text: bytes) -> bytes:
    """The body of a request to a route."""
    return framed(text) if path in BEFORE_FILES else text


ALL = BODIES | BEFORE_FILES


@pytest.fixture(scope="module")
def client():
    with TestClient(create_app(), base_url=LOCAL) as client:  # raises what a server would log
        yield client


@pytest.fixture(autouse=True)
def quiet_log(caplog):
    """Nothing is logged that a test does not expect."""
    caplog.set_level(logging.WARNING)
    yield
    assert not caplog.records


def posted(client: TestClient, path: str, body: bytes, kind: str = "application/json") -> Any:
    return client.post(path, content=body, headers={"content-type": kind})


def check_refusal(answer: Any) -> None:
    assert answer.status_code == 422, answer.text
    detail = answer.json()["detail"]
    assert isinstance(detail, str)
    assert "\n" not in detail


def test_every_route_with_a_body_is_tried():
    routes = [route for route in api(Studio()).routes if isinstance(route, APIRoute)]
    posts = {route.path for route in routes if "POST" in route.methods}
    assert posts == set(ALL) | FILES
    sockets = {route.path for route in api(Studio()).routes} - {route.path for route in routes}
    assert {path for path in sockets if path.startswith("/api")} == {*SOCKETS, "/api/stream"}


@pytest.mark.parametrize("path", ALL)
def test_invalid_json_is_refused(path, client):
    sample = ALL[path]
    for body in broken(sample):
        check_refusal(posted(client, path, frame(path, body)))
    for where in everyday_paths(sample):
        for raw in NOT_JSON.values():
            check_refusal(posted(client, path, frame(path, with_raw(sample, where, raw).encode())))


@pytest.mark.full
@pytest.mark.parametrize("path", ALL)
def test_invalid_json_is_refused_wherever_it_stands(path, client):
    for where in paths(ALL[path]):
        for raw in NOT_JSON.values():
            check_refusal(posted(client, path, frame(path, with_raw(ALL[path], where, raw).encode())))


@pytest.mark.parametrize(
    "path", few(ALL, "/api/sensor-file", "/api/bench/change", "/api/bench/requirements", "/api/calibrate/together")
)
def test_unexpected_values_are_refused_or_answered(path, client, request):
    sample = ALL[path]
    is_full = request.node.get_closest_marker("full") is not None
    for where in paths(sample):
        for raw in UNEXPECTED if is_full else UNEXPECTED[::4]:
            answer = posted(client, path, frame(path, with_raw(sample, where, raw).encode()))
            assert answer.status_code in (200, 400, 404, 422), (where, raw[:40], answer.text)


@pytest.mark.parametrize("kind", ["text/plain", "application/octet-stream", "application/x-www-form-urlencoded", ""])
def test_bodies_of_other_types_are_refused(kind, client):
    for path in BODIES:
        for body in (b"\xff\xfe", json.dumps(BODIES[path]).encode(), b"a=b"):
            check_refusal(posted(client, path, body, kind))


@pytest.mark.parametrize("value", ["nan", "inf", "-Infinity", "1e999", "9" * 5000, "", b"\xed\xa0\x80"])
def test_parameters_that_are_no_finite_numbers_are_refused(value, client):
    for name in ("forward_azimuth_deg", "pitch_deg", "roll_deg"):
        check_refusal(client.get("/api/camera", params={"id": "paper-spherical", name: value}))
    for name in ("columns", "square_mm", "spacing"):
        check_refusal(client.post("/api/calibrate/look", params={**ASKED, name: value}, content=BLANK))


@pytest.mark.parametrize("path", SOCKETS)
def test_invalid_messages_close_a_socket(path, client):
    sample = SOCKETS[path]
    texts = [with_raw(sample, where, raw) for where in everyday_paths(sample) for raw in NOT_JSON.values()]
    texts += [body.decode("latin-1") for body in broken(sample)] + ["[]", "{}", '{"slot": "nan"}', "\x00"]
    for message in [*texts, b"\xff", json.dumps(sample).encode()]:
        with client.websocket_connect(f"ws://127.0.0.1{path}") as socket:
            (socket.send_text if isinstance(message, str) else socket.send_bytes)(message)
            with pytest.raises(WebSocketDisconnect) as closed:
                socket.receive_text()
            assert closed.value.code == 1003
            assert 0 < len(closed.value.reason.encode()) <= 123
