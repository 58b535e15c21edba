"""Server responses for the Calibrate tab: against the engine, and against the truth of rendered
images."""

from __future__ import annotations

import asyncio
import io
import json
import struct
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from PIL import Image
from starlette.testclient import TestClient

import omnimirror as om
from omnimirror.apps.studio._board_detection_process import detection_message
from omnimirror.apps.studio._calibration_boards import taken, together
from omnimirror.apps.studio._calibration_process import perform
from omnimirror.apps.studio._workers import BoardDetectorPool
from omnimirror.apps.studio.app import create_app
from omnimirror.apps.studio.calibration_messages import (
    BoardDetection,
    BoardDetectionRequest,
    BoardSpec,
    CalibrationRequest,
    MultiImageRequest,
)
from omnimirror.base.errors import InvalidParameter
from omnimirror.calibration.targets.board_detection import compared
from omnimirror.optics.camera_files import parse_camera

from .boards import BLANK, BOARD, BOARD_REQUEST, CAMERA, COMPLETE_COUNT, photograph, png

LOCAL = "http://127.0.0.1"
CALIBRATION_REQUEST = {
    "board": BOARD_REQUEST,
    "images": COMPLETE_COUNT,
    "model": "unified",
    "optics": "mirror",
    "camera_looks": "up",
    "image_flipped": False,
    "centre_px": None,
    "rim_radius_px": None,
    "flat_board": True,
    "command": "omnimirror <here>",
}


@pytest.fixture(scope="module")
def client():
    with TestClient(create_app(), base_url=LOCAL) as client:
        yield client


@pytest.fixture(scope="module")
def board_detections() -> list[BoardDetection]:
    return [
        detection_message(om.find_board(photograph(i).image, BOARD, name=f"{i}.png"))
        for i in range(COMPLETE_COUNT)
    ]


@pytest.fixture(scope="module")
def messages(client, board_detections) -> list[dict]:
    """Return all messages of a calibration."""
    with client.websocket_connect("ws://127.0.0.1/api/calibrate/work") as socket:
        socket.send_text(json.dumps(CALIBRATION_REQUEST))
        for detection in board_detections:
            socket.send_text(detection.model_dump_json())
        replies = [json.loads(socket.receive_text())]
        while replies[-1]["state"] not in ("report", "failed"):
            replies.append(json.loads(socket.receive_text()))
    return replies


def detect_board(client, data: bytes, **parameters):
    return client.post(
        "/api/calibrate/look",
        params={**BOARD_REQUEST, "name": "here.png", **parameters},
        content=data,
    )


def test_board_detection_process_imports_few_modules():
    code = "import sys, omnimirror.apps.studio._board_detection_process; print(*sys.modules)"
    loaded = set(
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.split()
    )
    assert "omnimirror.calibration.targets.board_detection" in loaded
    assert not loaded & {
        "fastapi",
        "starlette",
        "matplotlib",
        "omnimirror.calibration.estimation",
        "omnimirror.optics.sensor",
    }


def test_board_detection_in_uploaded_image(client):
    response = detect_board(client, png(0)).json()
    expected = om.find_board(photograph(0).image, BOARD)
    np.testing.assert_array_equal(response["ids"], expected.ids)
    np.testing.assert_allclose(response["corners_px"], expected.corners_px, atol=1e-4)
    error_px = np.linalg.norm(
        response["corners_px"] - photograph(0).corners_px[:, None], axis=2
    ).min(axis=0)
    assert len(error_px) == BOARD.corner_count
    assert error_px.max() < 0.3
    quick = detect_board(client, png(0), fast=True).json()
    np.testing.assert_allclose(quick["corners_px"], response["corners_px"])


@pytest.mark.full
def test_partial_board_returns_visible_corners(client):
    response = detect_board(client, png(COMPLETE_COUNT)).json()
    error_px = np.nanmin(
        np.linalg.norm(
            response["corners_px"] - photograph(COMPLETE_COUNT).corners_px[:, None], axis=2
        ),
        axis=0,
    )
    assert BOARD.corner_count / 2 < len(error_px) < BOARD.corner_count
    assert error_px.max() < 0.5


@pytest.mark.parametrize("kind", ["GIF", "PPM"])
def test_image_formats_of_calibration_datasets(kind, client):
    """OCamCalib sets contain GIFs; machine-vision programs write PGM."""
    file = io.BytesIO()
    Image.open(io.BytesIO(png(0))).convert("L").save(file, kind)
    assert detect_board(client, file.getvalue(), fast=True).json()["ids"] == list(
        range(BOARD.corner_count)
    )


@pytest.mark.parametrize(
    ("data", "parameters", "message"),
    [
        (
            b"no picture",
            {},
            "cannot read the image here.png: it must be an undamaged image file (PNG, JPEG, TIFF, "
            "WebP, AVIF, JPEG 2000, BMP, GIF, PPM, HDR, EXR)",
        ),
        (b"", {}, "the uploaded file is empty"),
        (BLANK, {"columns": 1}, "columns must be an integer between 2 and 200; got 1"),
        (BLANK, {"marker_mm": 3}, "marker_mm requires kind = 'charuco'; got 'chessboard'"),
    ],
)
def test_invalid_detection_requests_are_rejected(data, parameters, message, client):
    answer = detect_board(client, data, **parameters)
    assert (answer.status_code, answer.json()["detail"]) == (400, message)


def test_image_without_board_returns_reason(client):
    assert detect_board(client, BLANK).json()["reason"] == "the image is blank"
    reason = detect_board(client, png(0), columns=6).json()["reason"]
    assert reason == "a board of 7 x 5 corners was detected instead of 6 x 5 corners"


@pytest.mark.full
def test_disconnect_cancels_detection():
    class DisconnectedClient:
        async def receive(self):
            return {"type": "http.disconnect"}

    class ConnectedClient:
        async def receive(self):
            await asyncio.Event().wait()

    async def both() -> BoardDetection:
        board_detectors, request = (
            BoardDetectorPool(),
            BoardDetectionRequest(**BOARD_REQUEST, name="here.png"),
        )
        try:
            with pytest.raises(InvalidParameter, match=r"detection in here\.png was interrupted"):
                await board_detectors.look(request, png(0), DisconnectedClient())
            assert board_detectors._idle == []  # its process has ended too
            return await board_detectors.look(request, BLANK, ConnectedClient())
        finally:
            board_detectors.close()

    with ThreadPoolExecutor(
        1
    ) as executor:  # a separate thread: page tests leave a running event loop in theirs
        assert executor.submit(asyncio.run, both()).result().reason == "the image is blank"


def test_joint_analysis_of_images(board_detections):
    small = detection_message(om.find_board(photograph(1).image[:400], BOARD, name="small.png"))
    request = MultiImageRequest(
        board=BoardSpec(**BOARD_REQUEST),
        detections=(*board_detections, small),
        centre_px=CAMERA.centre_px,
        radius_px=200.0,
        candidate=board_detections[2],
    )
    answer = together(request)
    assert answer.reasons[:-1] == (None,) * len(board_detections)
    assert (
        answer.reasons[-1]
        == "its size of 480 x 400 px differs from that of the others, 480 x 480 px"
    )
    assert sum(map(sum, answer.coverage.counts)) == sum(len(s.ids) for s in board_detections)
    assert answer.candidate_reason == "its view of the board is similar to 2.png"
    assert answer.advice[0].startswith("Capture more images: 6 are used")
    short_answer = together(request.model_copy(update={"detections": tuple(board_detections[:2])}))
    assert short_answer.candidate_reason is None
    empty = np.sum(np.array(short_answer.coverage.counts) < short_answer.coverage.min_corners)
    assert empty > np.sum(np.array(answer.coverage.counts) < answer.coverage.min_corners)


@pytest.mark.parametrize(
    "changes",
    [
        {"ids": (0, 0)},
        {"ids": (0, 99)},
        {"ids": (0,)},
        {"corners_px": ((1.0, 1.0), (1e9, 0.0))},
        {"sigma_px": (1.0,)},
    ],
)
def test_invalid_corners_are_rejected(changes, client, board_detections):
    short = board_detections[0].model_copy(
        update={"ids": (0, 1), "corners_px": ((1.0, 1.0), (2.0, 2.0)), "sigma_px": (0.1, 0.1)}
    )
    assert len(taken(short, BOARD).ids) == 2
    body = {
        "board": BOARD_REQUEST,
        "detections": [short.model_copy(update=changes).model_dump()],
        "centre_px": None,
        "radius_px": None,
    }
    answer = client.post("/api/calibrate/together", json=body | {"candidate": None})
    assert answer.status_code == 400
    assert answer.json()["detail"].startswith("the detection in 0.png is invalid")


def test_calibration_reports_progress_and_camera(messages, board_detections):
    assert [n["state"] for n in messages[-2:]] == ["done", "report"]
    shares = [n["fraction"] for n in messages[:-1]]
    assert all(n["state"] == "running" and n["message"] for n in messages[:-2])
    assert shares == sorted(shares)
    result = messages[-2]["result"]
    detections = compared(
        [taken(s, BOARD) for s in board_detections], BOARD
    )  # as for jointly detected images
    direct = om.calibrate_camera(detections, BOARD, model="unified", board_shape=False)
    assert result["rms_px"] == pytest.approx(direct.rms_px, rel=1e-6)
    assert result["held_out_rms_px"] == pytest.approx(direct.held_out_rms_px, rel=1e-6)
    assert result["rms_px"] < 0.15
    camera = parse_camera(result["camera_file"])
    assert (
        np.linalg.norm(np.subtract(camera.centre_px, CAMERA.centre_px)) < 0.5
    )  # px, relative to the truth
    residuals = [r for p in result["images"] for r in p["residuals"]]
    assert np.sqrt(np.mean(np.sum(np.array(residuals)[:, 2:] ** 2, axis=1))) == pytest.approx(
        result["rms_px"], rel=1e-3
    )
    assert {p["name"] for p in result["parameters"]} >= {"xi"}


def test_report_is_self_contained_and_escaped(messages):
    report = messages[-1]["report"]
    assert report.lstrip().startswith("<!doctype html>")
    assert "omnimirror &lt;here&gt;" in report


@pytest.mark.parametrize("number", [0, pytest.param(4, marks=pytest.mark.full)])
def test_undistorted_board_is_regular(number, client, messages):
    """Corners detected in the view form a lattice, unlike those in the image."""
    result = messages[-2]["result"]
    pose = next(p for p in result["poses"] if p["image"] == f"{number}.png")
    header = json.dumps(
        {"camera_file": result["camera_file"], "pose": pose, "name": "here.png"}
    ).encode()
    answer = client.post(
        "/api/calibrate/straight", content=struct.pack("<I", len(header)) + header + png(number)
    )
    assert answer.headers["content-type"] == "image/jpeg"
    view = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_GRAYSCALE)
    detection = om.find_board(view, BOARD)
    assert detection.used, detection.reason
    scale = pose["px_per_mm"]
    lattice = scale * (BOARD.points_mm[detection.ids, :2] + pose["margin_mm"])
    rotated = scale * (
        BOARD.points_mm[::-1][detection.ids, :2] + pose["margin_mm"]
    )  # either end is valid
    error_px = min(np.abs(detection.corners_px - points).max() for points in (lattice, rotated))
    assert error_px < 1.0
    outcome = result["images"][number]
    assert 0 < outcome["line_deviation_px"] < 0.5


def test_invalid_framed_requests_are_rejected(client):
    short, empty = "the body must be the length of a JSON message", "camera_file must be given"
    messages = {
        b"abc": short,
        struct.pack("<I", 2) + b"{}": empty,
        struct.pack("<I", 999) + b"{}": empty,
    }
    for data, message in messages.items():
        answer = client.post("/api/calibrate/straight", content=data)
        assert answer.status_code == 422
        assert answer.json()["detail"].startswith(message)


def test_board_without_extent_is_rejected(client, messages):
    result = messages[-2]["result"]
    for high in ([-900.0, 10.0], [1e308, 1e308]):
        pose = result["poses"][0] | {"high_mm": high}
        header = json.dumps(
            {"camera_file": result["camera_file"], "pose": pose, "name": "here.png"}
        ).encode()
        answer = client.post(
            "/api/calibrate/straight", content=struct.pack("<I", len(header)) + header + png(0)
        )
        assert answer.status_code == 400
        assert "0.png must be larger than 0" in answer.json()["detail"]


def calibration_messages(
    body: dict, board_detections: list[BoardDetection], steps: int = 10**6
) -> list:
    """Return the messages of a calibration that is stopped after several steps."""
    replies = []
    perform(
        CalibrationRequest(**body), board_detections, replies.append, lambda: len(replies) > steps
    )
    return replies


def test_stopped_calibration_keeps_result(board_detections):
    *_, result_message, report_message = calibration_messages(
        CALIBRATION_REQUEST, board_detections, 2
    )
    assert (result_message.state, report_message.state) == ("done", "report")
    assert not result_message.result.is_complete
    assert "stopped early" in result_message.result.notes[0]
    assert (
        calibration_messages(CALIBRATION_REQUEST, board_detections, -1)[-1].message
        == "the calibration was stopped before the first fit"
    )


def test_failed_calibration_reports_image_names(board_detections):
    blank = detection_message(
        om.find_board(np.full((480, 480), 90, np.uint8), BOARD, name="dark.png")
    )
    *_, message = calibration_messages(CALIBRATION_REQUEST, [*board_detections[:2], blank])
    assert message.state == "failed"
    assert "in 2 of 3 images" in message.message
    assert "dark.png: the image is blank" in message.message


@pytest.mark.full
def test_similar_video_frames_are_used_once(board_detections):
    frames = [
        s.model_copy(update={"name": f"{n} {s.name}", "time_s": n + i})
        for n in (0, 9)
        for i, s in enumerate(board_detections)
    ]
    *_, result_message, _ = calibration_messages(
        CALIBRATION_REQUEST | {"images": len(frames)}, frames
    )
    used_images = [p for p in result_message.result.images if p.used]
    assert len(used_images) == len(board_detections)
    assert all("is similar to" in p.reason for p in result_message.result.images if not p.used)


def test_invalid_calibration_request_closes_socket(client):
    from starlette.websockets import WebSocketDisconnect

    with client.websocket_connect("ws://127.0.0.1/api/calibrate/work") as socket:
        socket.send_text("{}")
        with pytest.raises(WebSocketDisconnect) as closed:
            socket.receive_text()
    assert closed.value.reason == "board must be given"
