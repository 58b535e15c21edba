"""Invalid JSON on every route: the response is 422 or a closed WebSocket, without log entries."""

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
from omnimirror.apps.studio import _http_messages
from omnimirror.apps.studio._server_state import Studio
from omnimirror.apps.studio.app import api, create_app
from omnimirror.apps.studio.design_messages import ApiError
from omnimirror.base.files import MAX_NESTING
from omnimirror.interop.http_server import request_bodies
from omnimirror.optics.sensor_files import tables_of
from tests.everyday import few
from tests.serving import in_a_loop

from .boards import BLANK, BOARD_REQUEST

LOCAL = "http://127.0.0.1"
TABLES = tables_of(om.load_sensor("paper-spherical"))
DESIGN = {"tables": TABLES, "follows_mapping": False}
DISTANCE = {"object_distance_mm": None}
REQUIRED = {
    "field": {"omega_max_deg": 90.0},
    "limits": [{"quantity": "length_mm", "at_most": 300.0}],
}
MOUNT = {"camera_looks": "up", "forward_azimuth_deg": -90.0, "image_flipped": False}
FITTED = {
    "id": "paper-spherical",
    "mount": MOUNT,
    "image_size": [64, 64],
    "centre_px": [31.5, 31.5],
    "rim_radius_px": 30.0,
}
DETECTION = {
    "name": "a.png",
    "image_size": [480, 480],
    "ids": [0, 1],
    "corners_px": [[1.0, 2.0], [3.0, 4.0]],
    "sigma_px": [0.1, 0.1],
    "reason": None,
    "blur_px": 1.0,
    "is_reversed": None,
    "begins_white": None,
    "is_part": False,
    "time_s": None,
}
POSE = {
    "image": "a.png", "rotation": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], "shift_mm": [0.0, 0.0, 300.0],
    "low_mm": [0.0, 0.0], "high_mm": [90.0, 60.0], "margin_mm": 5.0, "px_per_mm": 1.0, "is_upwards": True,
}  # fmt: skip
SLIDES = [{"path": ["lens", "focal_length_mm"], "values": [11.0, 12.0]}]
ALLOWED = [{"name": "decentre_mm", "tolerance": 0.1}]

BODIES: dict[str, Any] = {
    "/api/sensor-file": FITTED,
    "/api/design/slides": {**DESIGN, "requirements": REQUIRED, "sliders": SLIDES},
    "/api/design/change": {"tables": TABLES, **DISTANCE, "target": "mirror", "to": "cone"},
    "/api/design/file": {"tables": TABLES, **DISTANCE, "kind": "sensor"},
    "/api/design/requirements": {"tables": TABLES, "requirements": REQUIRED},
    "/api/design/image": {"tables": TABLES, "width_px": 32, "samples": 1},
    "/api/design/errors": {"tables": TABLES},
    "/api/design/built": {"tables": TABLES, "values": {"decentre_mm": 0.1}, "refocus": "none"},
    "/api/design/yield": {
        "tables": TABLES,
        "errors": ALLOWED,
        "refocus": "none",
        "merit": "worst_blur_px",
        "limit": 3.0,
        "trials": 1,
        "seed": 0,
    },
    "/api/calibrate/together": {
        "board": BOARD_REQUEST,
        "detections": [DETECTION],
        "centre_px": None,
        "radius_px": None,
        "candidate": None,
    },
}
MEASURED: dict[str, Any] = {
    **FITTED,
    "is_fitted": False,
    "pixels": [[600.0, 500.0], [500.0, 600.0]],
    "height_mm": 1500.0,
    "wall_mm": None,
    "wall_pan_deg": 0.0,
    "plane_sigma_mm": 0.0,
    "plane_sigma_deg": 0.0,
    "pixel_sigma_px": 0.0,
}
BODIES["/api/measure"] = MEASURED
FRAMED_BODIES: dict[str, Any] = {
    "/api/level": {**FITTED, "name": "a.png"},
    "/api/restore": {**FITTED, "name": "a.png", **DISTANCE},
    "/api/export": {
        **FITTED,
        "is_fitted": True,
        "name": "a.png",
        "format": "png",
        "view": {
            "view": "perspective",
            "size": [64, 48],
            "pan_deg": 0.0,
            "tilt_deg": -20.0,
            "hfov_deg": 60.0,
        },
    },
    "/api/calibrate/straight": {"camera_file": "", "pose": POSE, "name": "a.png"},
}
"""Messages that precede a file in the body."""
FILES = {"/api/sensors", "/api/design/open", "/api/convert", "/api/outline", "/api/calibrate/look"}
"""Routes whose body is a file."""
SOCKETS: dict[str, Any] = {
    "/api/design/ask": {
        "slot": 0,
        "number": 1,
        **DESIGN,
        **DISTANCE,
        "include_section": False,
        "include_squares": False,
        "requirements": REQUIRED,
    },
    "/api/design/export/run": {
        "tables": TABLES,
        "requirements": REQUIRED,
        **DISTANCE,
        "formats": ["csv"],
        "is_archive": False,
        "workshop": {"mirror": {"form_um": 0.2}},
        "tolerances": {
            "errors": ALLOWED,
            "refocus": "none",
            "merit": "motion_px",
            "limit": 3.0,
        },
    },
    "/api/design/work": {
        "kind": "design",
        "tables": TABLES,
        "requirements": REQUIRED,
        **DISTANCE,
        "merit": "worst_blur_deg",
        "shape": "spline",
        "terms": 1,
        "starts": 1,
    },
    "/api/calibrate/work": {
        "board": BOARD_REQUEST,
        "images": 2,
        "model": "unified",
        "optics": "mirror",
        "camera_looks": "up",
        "image_flipped": False,
        "centre_px": None,
        "rim_radius_px": None,
        "flat_board": True,
        "command": "",
    },
}

NOT_JSON = {
    "NaN": "NaN",
    "infinity": "Infinity",
    "minus infinity": "-Infinity",
    "overflow": "1e999",
    "lone surrogate": '"\\ud800"',
    "surrogate as a name": '{"\\udfff": 1}',
    "400 digits": "1" + "0" * 400,
    "5000 digits": "7" * 5000,
    "65 bits": str(2**64),
    "deep list": "[" * 99 + "]" * 99,
    "bottomless": "[" * 100_000,
    "deep table": '{"a":' * 99 + "1" + "}" * 99,
    "name twice": '{"a": 1, "a": 2}',
    "comment": "1 // one",
}
"""Values that make a body invalid at any position."""
UNEXPECTED = [
    "null",
    "true",
    '"x"',
    '"nan"',
    '"inf"',
    '"-Infinity"',
    '"1e999"',
    "-1",
    "0",
    "1e308",
    "-1e308",
    "5e-324",
    "0.5",
    "9223372036854775807",
    "[]",
    "{}",
    "[[]]",
    '[{"a": [1]}]',
    '""',
    '"\\u0000"',
    json.dumps("𝒳" * 5000),
]
"""Valid JSON of other types and magnitudes."""


def paths(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the paths of all values in JSON data."""
    yield path
    parts = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, part in parts:
        yield from paths(part, (*path, key))


def replace_value(value: Any, path: tuple[Any, ...], raw: str) -> str:
    """Return the JSON text of data with raw text replacing one value."""

    def replace(part: Any, keys: tuple[Any, ...]) -> Any:
        if not keys:
            return "@here@"
        copy = dict(part) if isinstance(part, dict) else list(part)
        copy[keys[0]] = replace(part[keys[0]], keys[1:])
        return copy

    return json.dumps(replace(value, path)).replace('"@here@"', raw)


def invalid_bodies(sample: Any) -> list[bytes]:
    """Return bodies that are not JSON: truncated, in another encoding, continued."""
    text = json.dumps(sample).encode()
    truncated = [text[:length] for length in (0, 1, len(text) // 2, len(text) - 1)]
    return [
        *truncated,
        text + b"]",
        b"\xff" + text,
        text.replace(b'"', b'"\xc3\x28', 1),
        text.decode().encode("utf-16"),
    ]


def sample_paths(sample: Any) -> list[tuple[Any, ...]]:
    """Return the whole, the first entry and the deepest."""
    all_paths = list(paths(sample))
    return [(), all_paths[1], max(all_paths, key=len)]


def frame_with_file(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text + BLANK


def frame(path: str, text: bytes) -> bytes:
    """Return the body of a request to a route."""
    return frame_with_file(text) if path in FRAMED_BODIES else text


ALL = BODIES | FRAMED_BODIES


@pytest.fixture(scope="module")
def client():
    with TestClient(
        create_app(), base_url=LOCAL
    ) as client:  # raises exceptions that a server would log
        yield client


@pytest.fixture(autouse=True)
def quiet_log(caplog):
    """Fail on unexpected log entries."""
    caplog.set_level(logging.WARNING)
    yield
    assert not caplog.records


def post(client: TestClient, path: str, body: bytes, kind: str = "application/json") -> Any:
    return client.post(path, content=body, headers={"content-type": kind})


def check_refusal(answer: Any) -> None:
    assert answer.status_code == 422, answer.text
    detail = answer.json()["detail"]
    assert isinstance(detail, str)
    assert "\n" not in detail


def test_every_route_with_body_is_tested():
    routes = [route for route in api(Studio()).routes if isinstance(route, APIRoute)]
    posts = {route.path for route in routes if "POST" in route.methods}
    assert posts == set(ALL) | FILES
    sockets = {route.path for route in api(Studio()).routes} - {route.path for route in routes}
    assert {path for path in sockets if path.startswith("/api")} == {*SOCKETS, "/api/stream"}


@pytest.mark.parametrize("path", ALL)
def test_invalid_json_is_rejected(path, client):
    sample = ALL[path]
    for body in invalid_bodies(sample):
        check_refusal(post(client, path, frame(path, body)))
    for keys in sample_paths(sample):
        for raw in NOT_JSON.values():
            check_refusal(
                post(client, path, frame(path, replace_value(sample, keys, raw).encode()))
            )


@pytest.mark.full
@pytest.mark.parametrize("path", ALL)
def test_invalid_json_is_rejected_at_any_position(path, client):
    for keys in paths(ALL[path]):
        for raw in NOT_JSON.values():
            check_refusal(
                post(client, path, frame(path, replace_value(ALL[path], keys, raw).encode()))
            )


@pytest.mark.parametrize(
    "path",
    few(
        ALL,
        "/api/sensor-file",
        "/api/design/change",
        "/api/design/requirements",
        "/api/calibrate/together",
    ),
)
def test_unexpected_values_are_rejected_or_processed(path, client, request):
    sample = ALL[path]
    is_full = request.node.get_closest_marker("full") is not None
    for keys in paths(sample):
        for raw in UNEXPECTED if is_full else UNEXPECTED[::4]:
            answer = post(client, path, frame(path, replace_value(sample, keys, raw).encode()))
            assert answer.status_code in (200, 400, 404, 422), (keys, raw[:40], answer.text)


@pytest.mark.parametrize(
    "kind", ["text/plain", "application/octet-stream", "application/x-www-form-urlencoded", ""]
)
def test_bodies_of_other_types_are_rejected(kind, client):
    for path in BODIES:
        for body in (b"\xff\xfe", json.dumps(BODIES[path]).encode(), b"a=b"):
            check_refusal(post(client, path, body, kind))


@pytest.mark.parametrize(
    "value", ["nan", "inf", "-Infinity", "1e999", "9" * 5000, "", b"\xed\xa0\x80"]
)
def test_non_finite_parameters_are_rejected(value, client):
    for name in ("forward_azimuth_deg", "pitch_deg", "roll_deg"):
        check_refusal(client.get("/api/camera", params={"id": "paper-spherical", name: value}))
    for name in ("columns", "square_mm", "spacing"):
        check_refusal(
            client.post("/api/calibrate/look", params={**BOARD_REQUEST, name: value}, content=BLANK)
        )


@pytest.mark.parametrize("path", SOCKETS)
def test_invalid_messages_close_socket(path, client):
    sample = SOCKETS[path]
    texts = [
        replace_value(sample, keys, raw)
        for keys in sample_paths(sample)
        for raw in NOT_JSON.values()
    ]
    texts += [body.decode("latin-1") for body in invalid_bodies(sample)] + [
        "[]",
        "{}",
        '{"slot": "nan"}',
        "\x00",
    ]
    for message in [*texts, b"\xff", json.dumps(sample).encode()]:
        with client.websocket_connect(f"ws://127.0.0.1{path}") as socket:
            (socket.send_text if isinstance(message, str) else socket.send_bytes)(message)
            with pytest.raises(WebSocketDisconnect) as closed:
                socket.receive_text()
            assert closed.value.code == 1003
            assert 0 < len(closed.value.reason.encode()) <= 123


# -- parser
# -------------------------------------------------------------------------------------------


def nested(levels: int) -> str:
    return "[" * levels + "1" + "]" * levels


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "null",
        '"Größe 🪞"',
        '{"a": [1, -2.5, true, {"b": null}]}',
        f"[{2**63 - 1}, {-(2**63)}, 1e308]",
        nested(MAX_NESTING),
    ],
)
def test_json_is_parsed_as_by_python(text):
    assert (
        request_bodies.parse_body(text)
        == request_bodies.parse_body(text.encode())
        == json.loads(text)
    )


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b"\xff", "the body must be JSON in UTF-8"),
        (b'{"a": }', "the body must be JSON: Expecting value at character 6"),
        (b"", "the body must be JSON: Expecting value at character 0"),
        (nested(MAX_NESTING + 1), f"the body must have at most {MAX_NESTING} nested levels"),
        (nested(200_000), f"the body must have at most {MAX_NESTING} nested levels"),
        ("9" * 5000, "integers in the body must have at most 64 bits"),
        (f'{{"a": [{2**63}]}}', f"integers in the body must have at most 64 bits; got {2**63}"),
        (
            f"[[{-(2**63) - 1}]]",
            f"integers in the body must have at most 64 bits; got {-(2**63) - 1}",
        ),
        ("[1e999]", "numbers in the body must be finite; got inf"),
        ('{"a": {"b": -Infinity}}', "numbers in the body must be finite; got -inf"),
        ('["\\ud800"]', "text in the body must be valid Unicode; got a surrogate in '\\ud800'"),
        ('{"\\ud800": 1}', "text in the body must be valid Unicode; got a surrogate in '\\ud800'"),
        ('{"a": 1, "b": 2, "b": 3}', "names in the body must be unique; got 'b' twice"),
        ('{"a": 1, "a": 1}', "names in the body must be unique; got 'a' twice"),
    ],
)
def test_invalid_json_is_rejected_with_reason(body, reason):
    with pytest.raises(request_bodies.InvalidMessage) as error:
        request_bodies.parse_body(body)
    assert str(error.value) == reason


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        ({"message": "no"}, "path must be given"),
        ({"path": [], "message": "no", "more": 1}, "more is unknown; remove it"),
        ({"path": [], "message": 3}, "message must be a valid string; got 3"),
        ([], "the body must be a valid dictionary or instance of ApiError; got []"),
    ],
)
def test_invalid_entry_is_named(message, reason):
    with pytest.raises(request_bodies.InvalidMessage) as error:
        request_bodies.parse_message(json.dumps(message), ApiError)
    assert str(error.value) == reason


def test_first_invalid_entry_is_named_without_location():
    entry = {
        "type": "value_error",
        "loc": ("body", "lens", 2, "kind"),
        "msg": "Value error, no lens",
        "input": "x",
    }
    missing = {"type": "missing", "loc": ("query", "id"), "msg": "Field required", "input": None}
    assert (
        request_bodies.validation_message([entry, missing])
        == "lens.2.kind is invalid: value error, no lens; got 'x'"
    )
    assert request_bodies.validation_message([missing, entry]) == "id must be given"
    for loc, name in (
        (("path", "id"), "id"),
        (("header", "id"), "header.id"),
        (("body",), "the body"),
    ):
        assert (
            request_bodies.validation_message([{**missing, "loc": loc}]) == f"{name} must be given"
        )
    body_error = {"type": "value_error", "loc": (), "msg": "Lens"}
    assert request_bodies.validation_message([body_error]) == "the body is invalid: lens; got None"


class Socket:
    """One side of a WebSocket that has received a message."""

    def __init__(self, message: dict[str, Any]) -> None:
        self.message, self.closed = message, None

    async def receive(self) -> dict[str, Any]:
        return self.message

    async def close(self, code: int, reason: str) -> None:
        self.closed = code, reason


def test_socket_message_is_text_or_disconnect():
    text = '{"path": [], "message": "no"}'
    message_in = in_a_loop(
        request_bodies.receive_message(
            Socket({"type": "websocket.receive", "text": text}), ApiError
        )
    )
    assert message_in == ApiError(path=(), message="no")
    with pytest.raises(
        request_bodies.InvalidMessage, match="must be JSON text; got a binary message"
    ):
        in_a_loop(
            request_bodies.receive_message(
                Socket({"type": "websocket.receive", "bytes": b"{}"}), ApiError
            )
        )
    for message, code in (({}, 1005), ({"code": 1001, "reason": "gone"}, 1001)):
        with pytest.raises(WebSocketDisconnect) as disconnect:
            in_a_loop(
                request_bodies.receive_message(
                    Socket({"type": "websocket.disconnect", **message}), ApiError
                )
            )
        assert (disconnect.value.code, disconnect.value.reason) == (
            code,
            message.get("reason") or "",
        )


def test_close_reason_fits_frame_and_ends_with_complete_character():
    """123 bytes: 61 two-byte letters; half of the next one is omitted."""
    socket = Socket({})
    in_a_loop(request_bodies.close_invalid(socket, request_bodies.InvalidMessage("ö" * 90)))
    assert socket.closed == (1003, "ö" * 61)


@pytest.mark.parametrize("reason", ["", "a", "ab", "abc", "ö" * 300])
def test_framed_message_has_documented_layout(reason):
    message, parts = ApiError(path=("lens",), message=reason), (b"\x00\x01", b"", b"file")
    data = _http_messages.framed(message, *parts)
    (length,) = struct.unpack("<I", data[:4])
    assert length % 4 == 0
    assert json.loads(data[4 : 4 + length]) == {"path": ["lens"], "message": reason}
    assert len(data[4 : 4 + length].rstrip()) > length - 4
    assert data[4 + length :] == b"".join(parts)
    assert _http_messages.unframed(data, ApiError) == (message, b"".join(parts))


@pytest.mark.parametrize("size", range(5))
def test_frame_without_message_is_rejected(size):
    with pytest.raises(
        request_bodies.InvalidMessage,
        match="length of a JSON message" if size < 4 else "must be JSON",
    ):
        _http_messages.unframed(bytes(size), ApiError)


def test_openapi_describes_framed_bodies_and_refusals():
    """The statuses that the server may return for any route, names of files, and files as bodies."""
    schema = api(Studio()).openapi()
    route = schema["paths"]["/api/convert"]["post"]
    assert set(route["responses"]) == {
        "200",
        "400",
        "403",
        "404",
        "408",
        "413",
        "422",
        "503",
        "507",
    }
    for status in sorted(set(route["responses"]) - {"200"}):
        content = route["responses"][status]["content"]
        assert content["application/json"]["schema"] == {"$ref": "#/components/schemas/Problem"}
    assert route["requestBody"]["required"] is True
    assert list(route["requestBody"]["content"]) == ["application/octet-stream"]
    lengths = {p["name"]: p["schema"].get("maxLength") for p in route["parameters"]}
    assert lengths["name"] == 200
