"""Streaming gateway: streams, steering, access control, limits and publishing."""

from __future__ import annotations

import asyncio
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2
import httpx
import numpy as np
import pytest
import yaml
from starlette.testclient import TestClient

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OutsideField
from omnimirror.interop.gateway import live_views, routes, stream_outputs
from omnimirror.interop.gateway.live_views import Gateway, LiveView
from omnimirror.interop.gateway.routes import create_app
from omnimirror.interop.gateway.stream_outputs import Chunk
from omnimirror.interop.named_views import parse_view
from omnimirror.io.live_sources import LiveSource
from omnimirror.io.video_frames import frame_of_image, image_of_frame
from omnimirror.io.video_reader import VideoReader
from omnimirror.io.video_writer import VideoWriter
from omnimirror.optics.image_sensor import Imager
from tests.commands import fails, reset_signals
from tests.everyday import few
from tests.io.test_live_sources import HEAD, free_port, paced
from tests.io.test_live_sources import server as streaming
from tests.io.test_video import write_rotated
from tests.serving import in_a_loop, served

SIDE = 256
VIEWS = {
    "front": om.NamedView("front", options={"size": (160, 96), "hfov_deg": 70.0}),
    "eye": om.NamedView("eye", options={"size": (128, 96), "hfov_deg": 60.0}, steerable=True),
    "around": om.NamedView(
        "around", "panorama", {"size": (320, 64), "elevation_deg": (-50.0, 20.0)}
    ),
}
PAGE = (Path(__file__).parents[3] / "docs" / "gateway.md").read_text(encoding="utf-8")
DOCUMENTED_VIEWS = re.search(r"```toml\n(.*?)```", PAGE, re.DOTALL)[1]
PLAYERS = {"mjpg": "mpjpeg", "ts": "mpegts", "m3u8": "hls"}
"""FFmpeg format names by URL suffix."""


@pytest.fixture(scope="module")
def camera():
    full = om.load_sensor("paper-spherical")
    return replace(
        full, imager=Imager(SIDE, SIDE, full.imager.pixel_pitch_um * full.image_size[0] / SIDE)
    )


@pytest.fixture(scope="module")
def film(camera, tmp_path_factory):
    """Two seconds of a static room, blurred because JPEG and H.264 subsample chroma."""
    image = cv2.GaussianBlur(om.render_image(camera, om.Room(), samples=1), (0, 0), 3)
    path = tmp_path_factory.mktemp("gateway") / "room.ts"
    with VideoWriter(
        path, (SIDE, SIDE), 25, crf=8, options={"g": "10", "tune": "zerolatency"}
    ) as video:
        for _ in range(50):
            video.write(frame_of_image(image))
    return path


@pytest.fixture
def gateway(film, camera):
    return Gateway(str(film), False, camera, VIEWS, workers=2)


def wait_for(state) -> None:
    """Wait until a condition holds; pytest limits the time of a test."""
    while not state():
        time.sleep(0.02)


def image_of(film) -> np.ndarray:
    return image_of_frame(next(VideoReader(str(film), with_audio=False).frames()))


def decoded_image(jpeg: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def mean_difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a.astype(int) - b).mean())


# -- streams -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", few(VIEWS, "around"))
def test_image_equals_the_dewarper(gateway, camera, film, name):
    with served(create_app(gateway, None)) as address:
        answer = httpx.get(f"{address}{name}.jpg", timeout=300)
    assert answer.headers["content-type"] == "image/jpeg"
    straight = om.Dewarper(camera, VIEWS[name](camera))(image_of(film))
    assert mean_difference(decoded_image(answer.content), straight) < 2.5


@pytest.mark.parametrize("suffix", few(PLAYERS, "ts"))
def test_ffmpeg_decodes_all_stream_types(gateway, camera, film, suffix):
    straight = om.Dewarper(camera, VIEWS["front"](camera))(image_of(film))
    with (
        served(create_app(gateway, None)) as address,
        av.open(f"{address}front.{suffix}", timeout=300) as player,
    ):
        assert player.format.name.partition(",")[0] == PLAYERS[suffix]
        frames = []
        for frame in player.decode(video=0):
            frames.append(frame)
            if len(frames) == 30:
                break
        assert mean_difference(image_of_frame(frames[-1]), straight) < 2.5
        if suffix != "mjpg":  # MJPEG has no time stamps
            steps = np.diff([float(frame.pts * frame.time_base) for frame in frames])
            assert steps.min() > 0
            assert steps.mean() > 0.9 / 25  # source rate, or less on a busy machine


@pytest.mark.full
def test_late_client_starts_with_a_key_frame(gateway):
    """A key frame is encoded for each new client."""
    with (
        served(create_app(gateway, None)) as address,
        httpx.stream("GET", f"{address}front.ts", timeout=300) as first,
    ):
        chunks = first.iter_raw()
        next(chunks)
        for _ in range(3):
            with av.open(f"{address}front.ts", timeout=300) as player:
                assert next(player.demux(video=0)).is_keyframe


def test_clients_of_one_view_share_dewarping(gateway):
    with (
        served(create_app(gateway, None)) as address,
        httpx.stream("GET", f"{address}front.mjpg", timeout=300) as one,
        httpx.stream("GET", f"{address}front.mjpg", timeout=300) as other,
    ):
        view, readers = gateway.views["front"], [one.iter_raw(), other.iter_raw()]
        for _ in range(10):
            for reader in readers:
                next(reader)
        assert view.clients == 2
        assert view.frames_dewarped <= gateway.frames_received


# -- idle views ---------------------------------------------------------------------------------------


def test_view_without_clients_is_not_dewarped(gateway):
    with served(create_app(gateway, None)) as address:
        assert (
            httpx.get(f"{address}api/views").json()["frames_received"] == 0
        )  # the source is not open
        front, others = gateway.views["front"], [gateway.views["eye"], gateway.views["around"]]
        with httpx.stream("GET", f"{address}front.mjpg", timeout=300):
            wait_for(lambda: front.frames_dewarped >= 10)
        wait_for(lambda: front.clients == 0)
        received = gateway.frames_received
        wait_for(lambda: gateway.frames_received >= received + 3)  # queued frames are done
        count, received = front.frames_dewarped, gateway.frames_received
        wait_for(lambda: gateway.frames_received >= received + 20)
        assert front.frames_dewarped == count
        assert [view.frames_dewarped for view in others] == [0, 0]


def test_idle_source_is_closed(gateway, monkeypatch):
    monkeypatch.setattr(live_views, "SOURCE_TIMEOUT_S", 0.0)
    monkeypatch.setattr(live_views, "CHECK_INTERVAL_S", 0.05)
    with served(create_app(gateway, None)) as address:
        for _ in range(2):  # the source is reopened for the second client
            assert httpx.get(f"{address}front.jpg", timeout=300).status_code == 200
            wait_for(lambda: gateway.state.endswith("is idle, no clients"))
            received = gateway.frames_received
            time.sleep(0.3)
            assert gateway.frames_received <= received + 1


def test_hls_client_remains_active_after_a_request(gateway, monkeypatch):
    with served(create_app(gateway, None)) as address:
        playlist = httpx.get(f"{address}front.m3u8", timeout=300).text
        assert re.search(r"#EXTINF:\d\.\d+,\nfront/0\.ts\n", playlist)
        assert httpx.get(f"{address}front/0.ts").content[0] == 0x47  # sync byte of MPEG-TS
        assert httpx.get(f"{address}front/99.ts").status_code == 404
        assert gateway.views["front"].is_active
        gateway.views["front"].transport._hls_until = 0.0
        assert not gateway.views["front"].is_active


# -- lost sources -------------------------------------------------------------------------------------


@pytest.mark.full
def test_clients_stay_connected_while_a_source_is_lost(film, camera):
    data, messages = film.read_bytes(), []
    plans = [HEAD, *paced(data, 2.0)], [], [HEAD, *paced(data, 2.0), *paced(data, 2.0), 60.0]
    with streaming(*plans) as url:
        gateway = Gateway(url, True, camera, VIEWS, on_status=messages.append)
        with (
            served(create_app(gateway, None)) as address,
            httpx.stream("GET", f"{address}front.mjpg", timeout=300) as watched,
        ):
            parts = watched.iter_raw()
            while not any("is reconnected after" in message for message in messages):
                next(parts)
            count = gateway.views["front"].frames_dewarped
            while gateway.views["front"].frames_dewarped < count + 5:
                next(parts)
    assert re.search(r"live\.ts is disconnected: .*; reconnecting in 0.25 s", messages[0])


def test_frames_of_another_size_are_reported(film):
    messages = []
    gateway = Gateway(
        str(film), False, om.load_sensor("paper-spherical"), VIEWS, on_status=messages.append
    )
    with (
        served(create_app(gateway, None)) as address,
        httpx.stream("GET", f"{address}front.mjpg", timeout=300),
    ):
        wait_for(lambda: messages)
        assert (
            "must have the size of the camera, 1024 x 1024 px; got 256 x 256 px"
            in httpx.get(f"{address}api/views").json()["state"]
        )


@pytest.mark.parametrize("stored", [False, True])
def test_rotation_of_a_video_is_applied_unless_frames_are_requested_as_stored(tmp_path, stored):
    """The camera has the size of the frames as OpenCV reads them with and without the rotation."""
    film = write_rotated(tmp_path / "turned.mp4", 90)
    capture = cv2.VideoCapture(str(film))
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, float(not stored))
    frame = capture.read()[1][..., ::-1]
    height, width = frame.shape[:2]
    ball = om.MirrorBall(
        centre_px=(width / 2 - 0.5, height / 2 - 0.5),
        rim_radius_px=22.0,
        field_deg=300.0,
        image_size=(width, height),
    )
    views = {"front": VIEWS["front"]}
    messages = []
    gateway = Gateway(
        str(film), False, ball, views, on_status=messages.append, stored_orientation=stored
    )
    with served(create_app(gateway, None)) as address:
        output = decoded_image(httpx.get(f"{address}front.jpg", timeout=300).content)
    expected = om.Dewarper(ball, views["front"](ball))(np.ascontiguousarray(frame))
    assert mean_difference(output, expected) < 6
    assert [
        ("as stored" if stored else "according to the file") in message for message in messages
    ] == [True]


def test_encoding_error_does_not_stop_the_view(gateway, monkeypatch):
    view = gateway.views["front"]
    encode, failed, errors = view.jpeg._encode, [], []

    def fail_twice(frame):
        if len(failed) < 2:
            failed.append(frame)
            raise av.error.InvalidDataError(0, "it is broken")
        errors.append(view.error)
        return encode(frame)

    monkeypatch.setattr(view.jpeg, "_encode", fail_twice)
    with served(create_app(gateway, None)) as address:
        assert httpx.get(f"{address}front.jpg", timeout=300).status_code == 200
        wait_for(lambda: not view.error)
    assert "it is broken" in errors[0]


# -- steering ------------------------------------------------------------------------------------------


def test_steered_view_equals_the_dewarper(gateway, camera, film):
    with served(create_app(gateway, None)) as address:
        eye = f"{address}api/views/eye"
        status = httpx.post(eye, json={"pan_deg": 80.0, "tilt_deg": -20.0}).json()
        assert (status["pan_deg"], status["tilt_deg"], status["hfov_deg"], status["zoom"]) == (
            80.0,
            -20.0,
            60.0,
            1.0,
        )
        straight = om.Dewarper(camera, om.screens.Plane((128, 96), 80.0, -20.0, hfov_deg=60.0))(
            image_of(film)
        )
        assert (
            mean_difference(
                decoded_image(httpx.get(f"{address}eye.jpg", timeout=300).content), straight
            )
            < 2.5
        )
        status = httpx.post(eye, json={"pan_deg": 10.0, "zoom": 1.2, "relative": True}).json()
        assert status["pan_deg"] == 90.0
        assert np.tan(np.radians(30)) / np.tan(np.radians(status["hfov_deg"] / 2)) == pytest.approx(
            1.2
        )
        assert httpx.get(eye).json() == status | {
            "clients": 0,
            "frames_dewarped": gateway.views["eye"].frames_dewarped,
        }


@pytest.mark.parametrize(
    ("name", "to", "status", "message"),
    [
        ("front", {"pan_deg": 3}, 400, "the view 'front' must be steerable"),
        ("eye", {"tilt_deg": 90, "hfov_deg": 20}, 400, "is outside the field of the camera"),
        pytest.param(
            "eye",
            {"hfov_deg": 200},
            422,
            "hfov_deg must be less than 180; got 200",
            marks=pytest.mark.full,
        ),
        ("eye", {"zoom": 50}, 400, "the resolution of the camera; got 50"),
        pytest.param(
            "eye",
            {"zoom": 2, "hfov_deg": 30},
            400,
            "zoom and hfov_deg must not be given together",
            marks=pytest.mark.full,
        ),
        ("eye", {"yaw": 2}, 422, '{"detail":"the keys must be from pan_deg, '),
        ("eye", {"pan_deg": "west"}, 422, "pan_deg must be a number; got 'west'"),
        pytest.param(
            "eye",
            {"pan_deg": [3]},
            422,
            "pan_deg must be a number; got [3]",
            marks=pytest.mark.full,
        ),
        pytest.param(
            "eye",
            {"relative": 7},
            422,
            "relative must be true or false; got 7",
            marks=pytest.mark.full,
        ),
        ("eye", [], 422, "the body must be a JSON object such as"),
        ("nose", {"pan_deg": 3}, 404, "the view must be one of front, eye, around; got 'nose'"),
    ],
)
def test_invalid_steering_is_rejected(gateway, name, to, status, message):
    with served(create_app(gateway, None)) as address:
        before = gateway.views["eye"].view
        answer = httpx.post(f"{address}api/views/{name}", json=to)
    assert answer.status_code == status
    assert message in answer.text
    assert gateway.views["eye"].view == before


def test_views_unsuitable_for_video_raise(camera):
    with pytest.raises(
        InvalidParameter, match="'a' must be at most 8192 px for video; got 100000 x 50000 px"
    ):
        LiveView(om.NamedView("a", options={"size": (100_000, 50_000)}), camera, "auto", print)
    odd, nothing = ({"size": (161, 96)}, {"size": (160, 96), "tilt_deg": 90.0, "hfov_deg": 20.0})
    with pytest.raises(
        InvalidParameter, match=r"'a' must be even for video.*; use for example size = \[162, 96\]"
    ):
        LiveView(om.NamedView("a", options=odd), camera, "auto", print)
    with pytest.raises(OutsideField, match="outside the field"):
        LiveView(om.NamedView("a", options=nothing), camera, "auto", print)


# -- access and limits --------------------------------------------------------------------------------


def test_token_is_required(gateway):
    with served(create_app(gateway, "secret")) as address:
        for path in (
            "",
            "api/views",
            "front.mjpg",
            "front.ts",
            "front.m3u8",
            "front.jpg",
            "front/0.ts",
        ):
            answer = httpx.get(address + path)
            assert (answer.status_code, answer.headers["www-authenticate"]) == (
                401,
                'Basic realm="omnimirror"',
            )
        assert httpx.get(f"{address}front.jpg", auth=("anyone", "wrong")).status_code == 401
        assert httpx.get(f"{address}api/views", auth=("anyone", "secret")).status_code == 200
        assert (
            httpx.get(f"{address}api/views", headers={"authorization": "Bearer secret"}).status_code
            == 200
        )
        assert httpx.get(f"{address}api/views?token=secret").status_code == 200
        foreign = httpx.post(
            f"{address}api/views/eye",
            json={"pan_deg": 1},
            auth=("a", "secret"),
            headers={"origin": "http://evil"},
        )
        assert foreign.status_code == 403
        assert gateway.frames_received == 0
        inside = address.replace("http://", "http://viewer:secret@")
        for url in (
            *(f"{inside}front.{suffix}" for suffix in PLAYERS),
            f"{address}front.m3u8?token=secret",
        ):
            with av.open(url, timeout=300) as player:
                assert next(player.decode(video=0)).width == 160


def addresses_of(configuration):
    """Return the addresses of views in the configuration of a video recorder or media server."""
    if "paths" in configuration:  # MediaMTX
        assert all(path["sourceOnDemand"] is True for path in configuration["paths"].values())
        return {name: path["source"] for name, path in configuration["paths"].items()}
    streams = configuration.get("go2rtc", configuration)["streams"]
    for name, camera in configuration.get("cameras", {}).items():  # Frigate reads from its go2rtc
        (source,) = camera["ffmpeg"]["inputs"]
        assert source["path"].rpartition("/")[2] == name
        assert name in streams
    return streams


def test_documented_configurations_of_recorders_open_the_views(film, camera):
    views = tomllib.loads(DOCUMENTED_VIEWS)
    configurations = [
        yaml.safe_load(block) for block in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    ]
    assert len(configurations) == 3
    addresses = [a for c in configurations for a in addresses_of(c).items()]
    players = re.findall(r"^    (?:ffplay|vlc) (http://\S+/(\w+)\.ts)$", PAGE, re.MULTILINE)
    assert len(players) == 2
    addresses += [(name, url) for url, name in players]
    served_views = {name: parse_view(name, table) for name, table in views.items()}
    gateway = Gateway(str(film), False, camera, served_views, workers=2)
    with served(create_app(gateway, "TOKEN")) as address:
        for name, url in sorted(set(addresses)):
            local = url.replace(
                "http://me:TOKEN@machine:8090/", address.replace("//", "//me:TOKEN@")
            )
            with av.open(local, timeout=300) as player:
                frame = next(player.decode(video=0))
            assert [frame.width, frame.height] == views[name]["size"]


def test_documented_python_call_and_curl_commands(tmp_path):
    """Serve the documented views by the documented call, and turn one of them, whose zoom requires
    1024 px."""
    (call,) = re.findall(r"^om\.serve_views.*$", PAGE, re.MULTILINE)
    curl_commands = re.findall(r"^    (curl .*)$", PAGE, re.MULTILINE)
    assert len(curl_commands) == 2
    om.save_sensor(om.load_sensor("paper-spherical"), tmp_path / "mine.toml")
    (tmp_path / "views.toml").write_text(DOCUMENTED_VIEWS)
    with VideoWriter(tmp_path / "room.ts", (1024, 1024), 25) as video:
        for _ in range(10):
            video.write(frame_of_image(np.full((1024, 1024, 3), 128, np.uint8)))
    port = str(free_port())
    call = call.replace("rtsp://roof/1", "room.ts").replace("8090", port)
    with subprocess.Popen(
        [sys.executable, "-c", f"import omnimirror as om\n{call}"],
        stdout=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
    ) as process:
        try:
            assert f"http://127.0.0.1:{port}/" in process.stdout.readline()
            image = httpx.get(f"http://127.0.0.1:{port}/door.jpg", timeout=300).content
            assert decoded_image(image).shape == (360, 640, 3)
            if not shutil.which("curl"):
                pytest.skip("curl is not installed")
            pans = []
            for line in curl_commands:
                words = shlex.split(line.replace("8090", port))
                answer = subprocess.run([*words, "-sS"], capture_output=True, text=True).stdout
                pans.append(json.loads(answer).get("pan_deg", answer))
            assert pans == [40, 35]
        finally:
            process.kill()


def test_segments_need_no_password(gateway):
    """VLC and others request segments without the password of the playlist."""
    with served(create_app(gateway, "a secret+")) as address:
        playlist = httpx.get(f"{address}front.m3u8", auth=("anyone", "a secret+"), timeout=300).text
        named = [line for line in playlist.splitlines() if not line.startswith("#")]
        assert httpx.get(address + named[0]).content[:1] == b"G"


def vlc_process(*arguments: str, home: str) -> subprocess.Popen[str]:
    """Start VLC, which must not run as root."""
    return subprocess.Popen(
        ["cvlc", *arguments],
        env={"PATH": os.environ["PATH"], "HOME": home},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        user="nobody" if os.getuid() == 0 else None,
    )


def vlc_version() -> str:
    with TemporaryDirectory() as folder:
        os.chmod(folder, 0o777)
        return vlc_process("--version", home=folder).communicate()[0].split()[2]


def shown_by_vlc(url: str) -> np.ndarray:
    """Return the fifth frame displayed by VLC."""
    with TemporaryDirectory() as folder:
        os.chmod(folder, 0o777)
        scene = f"--video-filter=scene --scene-format=png --scene-path={folder} --scene-ratio=1 --scene-prefix=p"
        arguments = ["--quiet", "--no-audio", "--vout=dummy", *scene.split(), url]
        vlc = vlc_process(*arguments, home=folder)
        try:
            wait_for(lambda: len(list(Path(folder).glob("p*.png"))) > 5 or vlc.poll() is not None)
            return om.read_image(sorted(Path(folder).glob("p*.png"))[4])[..., :3]
        finally:
            vlc.kill()
            vlc.communicate()


@pytest.mark.parametrize("suffix", PLAYERS)
def test_vlc_plays_all_stream_types(gateway, camera, film, suffix, beside):
    if not shutil.which("cvlc"):
        pytest.skip("VLC is not installed: make programs")
    straight = om.Dewarper(camera, VIEWS["front"](camera))(image_of(film))
    with served(create_app(gateway, "secret")) as address:
        output = shown_by_vlc(
            address.replace("http://", "http://viewer:secret@") + f"front.{suffix}"
        )
    difference = mean_difference(output[:96, :160], straight)  # the coded H.264 frame has 98 rows
    label = "displayed streams of a view, mean difference in grey levels"
    beside("VLC", label, difference, 2.5, "", vlc_version())


def test_number_of_clients_is_limited(gateway, monkeypatch):
    monkeypatch.setattr(routes, "MAX_CLIENTS", 1)
    with (
        served(create_app(gateway, None)) as address,
        httpx.stream("GET", f"{address}front.mjpg", timeout=300),
    ):
        wait_for(lambda: gateway.views["front"].clients == 1)
        answer = httpx.get(f"{address}eye.ts")
        assert (answer.status_code, answer.json()["detail"]) == (
            503,
            "the number of clients must be at most 1",
        )


def test_simultaneous_clients_are_counted_at_admission(gateway, monkeypatch):
    """Two of five simultaneous clients are admitted; their slots are free afterwards."""
    monkeypatch.setattr(routes, "MAX_CLIENTS", 2)

    async def statuses(address: str) -> list[int]:
        async with AsyncExitStack() as opened, httpx.AsyncClient(timeout=300) as client:
            requests = [
                client.stream("GET", f"{address}{name}.ts")
                for name in ("front", "eye", "around", "front", "eye")
            ]
            answers = await asyncio.gather(*(opened.enter_async_context(one) for one in requests))
            return [answer.status_code for answer in answers]

    with served(create_app(gateway, None)) as address:
        for _ in range(2):
            assert sorted(in_a_loop(statuses(address))) == [200, 200, 503, 503, 503]
            wait_for(lambda: not any(view.clients for view in gateway.views.values()))


@pytest.mark.parametrize(
    "token", ["\u00fcber", "\u65e5\u672c", "two words", "line\nbreak", "tab\t"]
)
def test_token_must_be_printable_ascii(film, camera, token):
    with pytest.raises(
        om.base.errors.InvalidParameter, match="token must consist of ASCII letters"
    ) as error:
        om.serve_views(str(film), VIEWS, camera=camera, token=token)
    assert token not in str(error.value)


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        ({"pan_deg": 1e308}, "pan_deg must be less than or equal to 360; got 1e+308"),
        ({"pan_deg": -360.5}, "pan_deg must be greater than or equal to -360; got -360.5"),
        ({"tilt_deg": 1e9}, "tilt_deg must be less than or equal to 90; got 1000000000.0"),
        ({"tilt_deg": -91}, "tilt_deg must be greater than or equal to -90; got -91"),
        ({"roll_deg": 1e5}, "roll_deg must be less than or equal to 360; got 100000.0"),
        ({"hfov_deg": 180}, "hfov_deg must be less than 180; got 180"),
        (
            {"hfov_deg": -1e9, "relative": True},
            "hfov_deg must be greater than -180; got -1000000000.0",
        ),
        ({"zoom": 0}, "zoom must be greater than 0; got 0"),
        ({"zoom": 1e300}, "zoom must be less than or equal to 1000000; got 1e+300"),
        ({"pan_deg": "nan"}, "pan_deg must be a number; got 'nan'"),
        ({"zoom": True}, "zoom must be a number; got True"),
    ],
)
def test_steering_is_range_checked(gateway, payload, message):
    with TestClient(create_app(gateway, None), base_url="http://127.0.0.1") as client:
        before = client.get("/api/views/eye").json()
        answer = client.post("/api/views/eye", json=payload)
        assert (answer.status_code, answer.json()["detail"]) == (422, message)
        assert client.get("/api/views/eye").json() == before


@pytest.mark.parametrize(
    "body",
    [
        "[NaN]",
        '{"pan_deg": Infinity}',
        '{"pan_deg": 1e999}',
        '{"zoom": ' + "9" * 5000 + "}",
        "[" * 99999,
        '{"zoom": 1, "zoom": 2}',
        '"\\ud800"',
        "{",
    ],
)
def test_invalid_json_is_rejected(gateway, body):
    with TestClient(create_app(gateway, None), base_url="http://127.0.0.1") as client:
        answer = client.post(
            "/api/views/eye", content=body, headers={"content-type": "application/json"}
        )
        assert answer.status_code == 422
        assert "the body" in answer.json()["detail"]
        assert client.get(f"/front/{'9' * 5000}.ts").status_code in (404, 422)


def test_relative_steps_wrap_in_pan_and_are_limited_in_tilt(gateway):
    with TestClient(create_app(gateway, None), base_url="http://127.0.0.1") as client:
        step = {"pan_deg": 90, "relative": True}
        pans = [client.post("/api/views/eye", json=step).json()["pan_deg"] for _ in range(9)]
        assert all(abs(pan) <= 360 for pan in pans)
        assert {pan % 360 for pan in pans} == {(pans[0] + turn) % 360 for turn in (0, 90, 180, 270)}
        answers = [
            client.post("/api/views/eye", json={"tilt_deg": -89, "relative": True})
            for _ in range(2)
        ]
        assert answers[1].status_code == 400
        assert answers[1].json()["detail"].startswith("tilt_deg must be between -90 and 90 deg")


def test_slow_client_continues_with_a_key_frame():
    async def watch():
        output = stream_outputs.TransportOutput((64, 48), lambda: None)
        stream = output.chunks()
        pending = asyncio.ensure_future(anext(stream))
        await asyncio.sleep(0)
        output._publish(Chunk(b"early", False, 0.0))
        output._publish(Chunk(b"key 1", True, 0.04))
        first = await pending
        for i in range(stream_outputs.MAX_QUEUED_CHUNKS + 5):  # none is consumed
            output._publish(Chunk(b"missed", False, 0.1 + 0.04 * i))
        is_requested = output._key_requested
        output._publish(Chunk(b"key 2", True, 9.0))
        second = await anext(stream)
        await stream.aclose()
        return first, is_requested, second, output.clients

    with ThreadPoolExecutor(1) as own:  # browser tests leave a running event loop in this thread
        result = own.submit(asyncio.run, watch()).result()
    assert result == (b"key 1", True, b"key 2", 0)


# -- command -------------------------------------------------------------------------------------------


@contextmanager
def command(film, camera, folder, *more):
    om.save_sensor(camera, folder / "small.toml")
    (folder / "views.toml").write_text(
        "[front]\nsize = [160, 96]\nhfov_deg = 70\n[left]\nsize = [64, 48]\npan_deg = -90"
    )
    arguments = ("serve", film, "--sensor", "small.toml", "--views", "views.toml", *more)
    with subprocess.Popen(
        [sys.executable, "-m", "omnimirror", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        preexec_fn=reset_signals,
    ) as process:
        try:
            yield process, re.search(r"http://\S+", process.stdout.readline())[0]
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("number", "code"),
    few([(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)], (signal.SIGTERM, 143)),
)
def test_command_serves_until_a_signal(film, camera, tmp_path, number, code):
    with command(film, camera, tmp_path) as (process, address):
        with httpx.stream("GET", f"{address}front.mjpg", timeout=300) as watched:
            parts = watched.iter_raw()
            next(parts)
            process.send_signal(number)
            process.wait()
        assert process.returncode == code


def test_views_are_published(film, camera, tmp_path):
    """FFmpeg acts as the media server."""
    port = free_port()
    options = {"rtsp_flags": "listen", "listen_timeout": "300"}
    address = f"rtsp://127.0.0.1:{port}/{{view}}"
    with (
        LiveSource(address.replace("{view}", "front"), 300, 300, 0.05, options=options) as server,
        command(film, camera, tmp_path, "--publish", address),
    ):
        frames = server.frames()
        assert {next(frames).width for _ in range(3)} < {
            160,
            64,
        }  # width of the view that connected first


SYSTEM_PYTHON = Path("/usr/bin/python3")  # interpreter with the GStreamer bindings
RTSP_SERVER = """
import sys, gi
gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer
Gst.init(None)
if Gst.ElementFactory.find("rtph264depay") is None:
    sys.exit(1)
taken = []
def take(sink, buffer, pad):
    taken.append(buffer.get_size())
    if len(taken) % 25 == 0:
        print("frames", len(taken), flush=True)
factory = GstRtspServer.RTSPMediaFactory()
factory.set_transport_mode(GstRtspServer.RTSPTransportMode.RECORD)
factory.set_launch("( rtph264depay name=depay0 ! fakesink name=sink signal-handoffs=true sync=false )")
factory.connect("media-configure", lambda _, media: media.get_element().get_by_name("sink").connect("handoff", take))
server = GstRtspServer.RTSPServer()
server.set_service(sys.argv[1])
server.get_mount_points().add_factory("/front", factory)
server.attach(None)
print("ready", flush=True)
GLib.MainLoop().run()
"""
"""RTSP server of GStreamer that counts the frames published at /front."""


@pytest.fixture(scope="module")
def rtsp_server():
    """Return a function that starts the RTSP server of GStreamer and waits until it listens."""
    running = []

    def start(port):
        arguments = [SYSTEM_PYTHON, "-c", RTSP_SERVER, str(port)]
        running.append(
            subprocess.Popen(
                arguments, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
            )
        )
        if running[-1].stdout.readline() != "ready\n":
            pytest.skip(
                "no RTSP server: apt install gir1.2-gst-rtsp-server-1.0 gstreamer1.0-plugins-good"
            )
        return running[-1]

    if not SYSTEM_PYTHON.exists():
        pytest.skip("no system Python with the GStreamer bindings")
    yield start
    for process in running:
        process.kill()
        process.stdout.close()
        process.wait()


def test_publishing_resumes_after_a_server_restart(film, camera, tmp_path, rtsp_server):
    port = free_port()
    server = rtsp_server(port)
    with command(film, camera, tmp_path, "--publish", f"rtsp://127.0.0.1:{port}/{{view}}"):
        assert server.stdout.readline() == "frames 25\n"
        server.kill()
        server.wait()
        server = rtsp_server(port)
        assert [server.stdout.readline() for _ in range(2)] == ["frames 25\n", "frames 50\n"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.png"], "source must be a camera, stream or video file; got a.png"),
        pytest.param(
            ["missing.mp4"],
            "source must be a camera, stream or video file; got missing.mp4",
            marks=pytest.mark.full,
        ),
        (
            ["0", "--publish", "rtsp://door/1"],
            "publish_to must contain {view}, the name of the view; got rtsp://door/1",
        ),
        (["0", "--publish", "gopher://{view}"], "got 'gopher://{view}'"),
        pytest.param(
            ["0", "--token", ""], "token must consist of ASCII letters", marks=pytest.mark.full
        ),
        pytest.param(
            ["0"],
            "path must be an existing file of views; got 'views.toml'",
            marks=pytest.mark.full,
        ),
        (["cut.mp4"], "cannot read the video cut.mp4"),
    ],
)
def test_invalid_arguments_of_the_command(arguments, message, tmp_path):
    if len(arguments) > 1:
        (tmp_path / "views.toml").write_text("[front]")
    (tmp_path / "cut.mp4").write_bytes(b"\0\0\0 ftypisom")
    assert message in fails(
        "serve", *arguments, "--views", "views.toml", "--sensor", "paper-spherical", cwd=tmp_path
    )
