"""Views of a stream as ordinary cameras: what players, programs and people who steer get, and what nobody costs."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import signal
import subprocess
import sys
import time
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
from starlette.testclient import TestClient

import omnimirror as om
from omnimirror.errors import InvalidParameter, OutsideField
from omnimirror.imagers import Imager
from omnimirror.interop.gateway import gateway as gateway_module
from omnimirror.interop.gateway import outlets, routes
from omnimirror.interop.gateway.coders import Chunk
from omnimirror.interop.gateway.gateway import Gateway
from omnimirror.interop.gateway.live_view import LiveView
from omnimirror.interop.gateway.routes import create_app
from omnimirror.media.live.sources import LiveSource
from omnimirror.media.video.frames import frame_of_image, image_of_frame
from omnimirror.media.video.reader import VideoReader
from omnimirror.media.video.writer import VideoWriter
from tests.commands import fails
from tests.everyday import few
from tests.media.live.test_live import HEAD, free_port, paced
from tests.media.live.test_live import server as streaming
from tests.serving import in_a_loop, served

SIDE = 256
VIEWS = {
    "front": om.NamedView("front", options={"size": (160, 96), "hfov_deg": 70.0}),
    "eye": om.NamedView("eye", options={"size": (128, 96), "hfov_deg": 60.0}, steered=True),
    "around": om.NamedView("around", "panorama", {"size": (320, 64), "elevation_deg": (-50.0, 20.0)}),
}
PLAYERS = {"mjpg": "mpjpeg", "ts": "mpegts", "m3u8": "hls"}
"""The formats by whose names FFmpeg knows them."""


@pytest.fixture(scope="module")
def camera():
    full = om.load_sensor("paper-spherical")
    return replace(full, imager=Imager(SIDE, SIDE, full.imager.pixel_pitch_um * full.image_size[0] / SIDE))


@pytest.fixture(scope="module")
def film(camera, tmp_path_factory):
    """Two seconds of a room that does not change, smooth enough for what JPEG and H.264 do to colours."""
    picture = cv2.GaussianBlur(om.take_picture(camera, om.Room(), samples=1), (0, 0), 3)
    path = tmp_path_factory.mktemp("gateway") / "room.ts"
    with VideoWriter(path, (SIDE, SIDE), 25, crf=8, options={"g": "10", "tune": "zerolatency"}) as video:
        for _ in range(50):
            video.write(frame_of_image(picture))
    return path


@pytest.fixture
def gateway(film, camera):
    return Gateway(str(film), False, camera, VIEWS, workers=2)


def until(state) -> None:
    """Wait for something to become true; a test that waits too long is ended from outside."""
    while not state():
        time.sleep(0.02)


def picture_of(film) -> np.ndarray:
    return image_of_frame(next(VideoReader(str(film), with_sound=False).frames()))


def as_picture(jpeg: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def off(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a.astype(int) - b).mean())


# -- what is seen --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", few(VIEWS, "around"))
def test_a_picture_is_the_dewarpers(gateway, camera, film, name):
    with served(create_app(gateway, None)) as address:
        answer = httpx.get(f"{address}{name}.jpg", timeout=300)
    assert answer.headers["content-type"] == "image/jpeg"
    straight = om.Dewarper(camera, VIEWS[name](camera))(picture_of(film))
    assert off(as_picture(answer.content), straight) < 2.5


@pytest.mark.parametrize("suffix", few(PLAYERS, "ts"))
def test_players_open_every_address(gateway, camera, film, suffix):
    straight = om.Dewarper(camera, VIEWS["front"](camera))(picture_of(film))
    with served(create_app(gateway, None)) as address, av.open(f"{address}front.{suffix}", timeout=300) as player:
        assert player.format.name.partition(",")[0] == PLAYERS[suffix]
        frames = []
        for frame in player.decode(video=0):
            frames.append(frame)
            if len(frames) == 30:
                break
        assert off(image_of_frame(frames[-1]), straight) < 2.5
        if suffix != "mjpg":  # which tells no times
            steps = np.diff([float(frame.pts * frame.time_base) for frame in frames])
            assert steps.min() > 0
            assert steps.mean() > 0.9 / 25  # as they come, or fewer where the machine is busy


@pytest.mark.full
def test_a_player_that_comes_late_begins_at_once(gateway):
    """A key frame is made for it: it need not wait for the next second, nor see the stream's beginning."""
    with served(create_app(gateway, None)) as address, httpx.stream("GET", f"{address}front.ts", timeout=300) as first:
        chunks = first.iter_raw()
        next(chunks)
        for _ in range(3):
            with av.open(f"{address}front.ts", timeout=300) as player:
                assert next(player.demux(video=0)).is_keyframe


def test_two_that_watch_one_view_share_its_work(gateway):
    with (
        served(create_app(gateway, None)) as address,
        httpx.stream("GET", f"{address}front.mjpg", timeout=300) as one,
        httpx.stream("GET", f"{address}front.mjpg", timeout=300) as other,
    ):
        view, readers = gateway.views["front"], [one.iter_raw(), other.iter_raw()]
        for _ in range(10):
            for reader in readers:
                next(reader)
        assert view.watchers == 2
        assert view.dewarped <= gateway.received


# -- what nobody watches -------------------------------------------------------------------------------


def test_a_view_that_nobody_watches_is_not_drawn(gateway):
    with served(create_app(gateway, None)) as address:
        assert httpx.get(f"{address}api/views").json()["received"] == 0  # the source is not even opened
        front, others = gateway.views["front"], [gateway.views["eye"], gateway.views["around"]]
        with httpx.stream("GET", f"{address}front.mjpg", timeout=300):
            until(lambda: front.dewarped >= 10)
        until(lambda: front.watchers == 0)
        received = gateway.received
        until(lambda: gateway.received >= received + 3)  # what was under way is done
        drawn, received = front.dewarped, gateway.received
        until(lambda: gateway.received >= received + 20)
        assert front.dewarped == drawn
        assert [view.dewarped for view in others] == [0, 0]


def test_the_source_is_let_go_when_nobody_watches_for_a_while(gateway, monkeypatch):
    monkeypatch.setattr(gateway_module, "LINGER_S", 0.0)
    monkeypatch.setattr(gateway_module, "CHECK_EVERY_S", 0.05)
    with served(create_app(gateway, None)) as address:
        for _ in range(2):  # and read again for who comes later
            assert httpx.get(f"{address}front.jpg", timeout=300).status_code == 200
            until(lambda: gateway.state.startswith("nobody watches"))
            received = gateway.received
            time.sleep(0.3)
            assert gateway.received <= received + 1


def test_who_asked_for_hls_watches_for_a_while(gateway, monkeypatch):
    with served(create_app(gateway, None)) as address:
        playlist = httpx.get(f"{address}front.m3u8", timeout=300).text
        assert re.search(r"#EXTINF:\d\.\d+,\nfront/0\.ts\n", playlist)
        assert httpx.get(f"{address}front/0.ts").content[0] == 0x47  # how packets of a transport stream begin
        assert httpx.get(f"{address}front/99.ts").status_code == 404
        assert gateway.views["front"].is_wanted
        gateway.views["front"].transport._hls_until = 0.0
        assert not gateway.views["front"].is_wanted


# -- a source that is lost -----------------------------------------------------------------------------


@pytest.mark.full
def test_a_source_that_is_lost_comes_back_and_watchers_stay(film, camera):
    data, told = film.read_bytes(), []
    plans = [HEAD, *paced(data, 2.0)], [], [HEAD, *paced(data, 2.0), *paced(data, 2.0), 60.0]
    with streaming(*plans) as url:
        gateway = Gateway(url, True, camera, VIEWS, tell=told.append)
        with (
            served(create_app(gateway, None)) as address,
            httpx.stream("GET", f"{address}front.mjpg", timeout=300) as watched,
        ):
            pictures = watched.iter_raw()
            while not any("is back after" in sentence for sentence in told):
                next(pictures)
            drawn = gateway.views["front"].dewarped
            while gateway.views["front"].dewarped < drawn + 5:
                next(pictures)
    assert re.search(r"live\.ts is lost: .*; trying again in 0.25 s", told[0])


def test_pictures_of_another_size_are_told_and_not_drawn(film):
    told = []
    gateway = Gateway(str(film), False, om.load_sensor("paper-spherical"), VIEWS, tell=told.append)
    with served(create_app(gateway, None)) as address, httpx.stream("GET", f"{address}front.mjpg", timeout=300):
        until(lambda: told)
        assert "256 x 256 px, and the camera's have 1024 x 1024" in httpx.get(f"{address}api/views").json()["state"]


def test_a_frame_that_cannot_be_coded_does_not_end_the_view(gateway, monkeypatch):
    view = gateway.views["front"]
    code, failed, told = view.jpeg._code, [], []

    def breaks_twice(frame):
        if len(failed) < 2:
            failed.append(frame)
            raise av.error.InvalidDataError(0, "it is broken")
        told.append(view.problem)
        return code(frame)

    monkeypatch.setattr(view.jpeg, "_code", breaks_twice)
    with served(create_app(gateway, None)) as address:
        assert httpx.get(f"{address}front.jpg", timeout=300).status_code == 200
        until(lambda: not view.problem)
    assert "it is broken" in told[0]


# -- steering ------------------------------------------------------------------------------------------


def test_a_view_is_steered_and_shows_what_is_there(gateway, camera, film):
    with served(create_app(gateway, None)) as address:
        eye = f"{address}api/views/eye"
        told = httpx.post(eye, json={"pan_deg": 80.0, "tilt_deg": -20.0}).json()
        assert (told["pan_deg"], told["tilt_deg"], told["hfov_deg"], told["zoom"]) == (80.0, -20.0, 60.0, 1.0)
        straight = om.Dewarper(camera, om.screens.Plane((128, 96), 80.0, -20.0, hfov_deg=60.0))(picture_of(film))
        assert off(as_picture(httpx.get(f"{address}eye.jpg", timeout=300).content), straight) < 2.5
        told = httpx.post(eye, json={"pan_deg": 10.0, "zoom": 1.2, "relative": True}).json()
        assert told["pan_deg"] == 90.0
        assert np.tan(np.radians(30)) / np.tan(np.radians(told["hfov_deg"] / 2)) == pytest.approx(1.2)
        assert httpx.get(eye).json() == told | {"watchers": 0, "dewarped": gateway.views["eye"].dewarped}


@pytest.mark.parametrize(
    ("name", "to", "status", "sentence"),
    [
        ("front", {"pan_deg": 3}, 400, "the view 'front' is not steered"),
        ("eye", {"tilt_deg": 90, "hfov_deg": 20}, 400, "sees nothing of the camera's field"),
        pytest.param(
            "eye", {"hfov_deg": 200}, 400, "hfov_deg = 200 is valid above 0 and below 180 deg", marks=pytest.mark.full
        ),
        ("eye", {"zoom": 50}, 400, "zoom = 50 goes past what the camera resolves; it is valid up to"),
        pytest.param(
            "eye",
            {"zoom": 2, "hfov_deg": 30},
            400,
            "zoom and hfov_deg say the same thing twice",
            marks=pytest.mark.full,
        ),
        ("eye", {"yaw": 2}, 422, '{"detail":"yaw is not known; valid are pan_deg, '),
        ("eye", {"pan_deg": "west"}, 422, "pan_deg = 'west' is not a number"),
        pytest.param("eye", {"pan_deg": [3]}, 422, "pan_deg = [3] is not a number", marks=pytest.mark.full),
        pytest.param("eye", {"relative": 7}, 422, "relative = 7 is not true or false", marks=pytest.mark.full),
        ("eye", [], 422, "what was sent is no JSON such as"),
        ("nose", {"pan_deg": 3}, 404, "there is no view 'nose'; there are front, eye, around"),
    ],
)
def test_what_cannot_be_shown_is_refused_and_the_view_stays(gateway, name, to, status, sentence):
    with served(create_app(gateway, None)) as address:
        before = gateway.views["eye"].view
        answer = httpx.post(f"{address}api/views/{name}", json=to)
    assert answer.status_code == status
    assert sentence in answer.text
    assert gateway.views["eye"].view == before


def test_views_of_odd_sizes_and_of_nothing_are_refused_at_the_start(camera):
    with pytest.raises(InvalidParameter, match="'a' has 100000 x 50000 px; video is valid up to 8192 a side"):
        LiveView(om.NamedView("a", options={"size": (100_000, 50_000)}), camera, "auto", print)
    odd, nothing = ({"size": (161, 96)}, {"size": (160, 96), "tilt_deg": 90.0, "hfov_deg": 20.0})
    with pytest.raises(
        InvalidParameter, match=r"'a' has 161 x 96 px.*valid are even sides, such as size = \[162, 96\]"
    ):
        LiveView(om.NamedView("a", options=odd), camera, "auto", print)
    with pytest.raises(OutsideField, match="sees nothing"):
        LiveView(om.NamedView("a", options=nothing), camera, "auto", print)


# -- who may watch, and how many -----------------------------------------------------------------------


def test_who_does_not_know_the_token_is_asked_for_it(gateway):
    with served(create_app(gateway, "secret")) as address:
        for path in ("", "api/views", "front.mjpg", "front.ts", "front.m3u8", "front.jpg", "front/0.ts"):
            answer = httpx.get(address + path)
            assert (answer.status_code, answer.headers["www-authenticate"]) == (401, 'Basic realm="omnimirror"')
        assert httpx.get(f"{address}front.jpg", auth=("anyone", "wrong")).status_code == 401
        assert httpx.get(f"{address}api/views", auth=("anyone", "secret")).status_code == 200
        assert httpx.get(f"{address}api/views", headers={"authorization": "Bearer secret"}).status_code == 200
        assert httpx.get(f"{address}api/views?token=secret").status_code == 200
        foreign = httpx.post(
            f"{address}api/views/eye", json={"pan_deg": 1}, auth=("a", "secret"), headers={"origin": "http://evil"}
        )
        assert foreign.status_code == 403
        assert gateway.received == 0
        inside = address.replace("http://", "http://viewer:secret@")
        for url in (*(f"{inside}front.{suffix}" for suffix in PLAYERS), f"{address}front.m3u8?token=secret"):
            with av.open(url, timeout=300) as player:
                assert next(player.decode(video=0)).width == 160


def test_what_a_playlist_names_needs_no_password(gateway):
    """VLC and others ask for segments without the password that the playlist was asked for with."""
    with served(create_app(gateway, "a secret+")) as address:
        playlist = httpx.get(f"{address}front.m3u8", auth=("anyone", "a secret+"), timeout=300).text
        named = [line for line in playlist.splitlines() if not line.startswith("#")]
        assert httpx.get(address + named[0]).content[:1] == b"G"


def shown_by_vlc(url: str) -> np.ndarray:
    """The fifth picture that VLC shows; as somebody else than root, since it refuses that."""
    with TemporaryDirectory() as folder:
        os.chmod(folder, 0o777)
        scene = f"--video-filter=scene --scene-format=png --scene-path={folder} --scene-ratio=1 --scene-prefix=p"
        words = ["cvlc", "--quiet", "--no-audio", "--vout=dummy", *scene.split(), url]
        nobody = {"user": "nobody"} if os.getuid() == 0 else {}
        environment = {"PATH": os.environ["PATH"], "HOME": folder}
        vlc = subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **nobody)
        try:
            until(lambda: len(list(Path(folder).glob("p*.png"))) > 5 or vlc.poll() is not None)
            return om.read_image(sorted(Path(folder).glob("p*.png"))[4])[..., :3]
        finally:
            vlc.kill()
            vlc.wait()


@pytest.mark.parametrize("suffix", PLAYERS)
def test_vlc_shows_every_address(gateway, camera, film, suffix):
    if not shutil.which("cvlc"):
        pytest.skip("VLC is not here: make programs")
    straight = om.Dewarper(camera, VIEWS["front"](camera))(picture_of(film))
    with served(create_app(gateway, "secret")) as address:
        shown = shown_by_vlc(address.replace("http://", "http://viewer:secret@") + f"front.{suffix}")
    assert off(shown[:96, :160], straight) < 2.5  # H.264's pictures are 98 rows here, as coded


def test_more_than_can_be_served_are_turned_away(gateway, monkeypatch):
    monkeypatch.setattr(routes, "MOST_WATCHERS", 1)
    with served(create_app(gateway, None)) as address, httpx.stream("GET", f"{address}front.mjpg", timeout=300):
        until(lambda: gateway.views["front"].watchers == 1)
        answer = httpx.get(f"{address}eye.ts")
        assert (answer.status_code, answer.json()["detail"]) == (503, "1 are watching already, and no more can")


def test_clients_that_come_at_once_are_counted_before_their_streams_begin(gateway, monkeypatch):
    """Of five that ask in the same moment two are admitted, and their seats are free again afterwards."""
    monkeypatch.setattr(routes, "MOST_WATCHERS", 2)

    async def statuses(address: str) -> list[int]:
        async with AsyncExitStack() as opened, httpx.AsyncClient(timeout=300) as client:
            asked = [client.stream("GET", f"{address}{name}.ts") for name in ("front", "eye", "around", "front", "eye")]
            answers = await asyncio.gather(*(opened.enter_async_context(one) for one in asked))
            return [answer.status_code for answer in answers]

    with served(create_app(gateway, None)) as address:
        for _ in range(2):
            assert sorted(in_a_loop(statuses(address))) == [200, 200, 503, 503, 503]
            until(lambda: not any(view.watchers for view in gateway.views.values()))


@pytest.mark.parametrize("token", ["\u00fcber", "\u65e5\u672c", "two words", "line\nbreak", "tab\t"])
def test_a_token_that_headers_cannot_carry_is_refused_at_the_start(film, camera, token):
    with pytest.raises(om.errors.InvalidParameter, match="token must consist of ASCII letters") as refused:
        om.serve_views(str(film), VIEWS, camera=camera, token=token)
    assert token not in str(refused.value)


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"pan_deg": 1e308}, "pan_deg must be less than or equal to 360; got 1e+308"),
        ({"pan_deg": -360.5}, "pan_deg must be greater than or equal to -360; got -360.5"),
        ({"tilt_deg": 1e9}, "tilt_deg must be less than or equal to 90; got 1000000000.0"),
        ({"tilt_deg": -91}, "tilt_deg must be greater than or equal to -90; got -91"),
        ({"roll_deg": 1e5}, "roll_deg must be less than or equal to 360; got 100000.0"),
        ({"hfov_deg": 180}, "hfov_deg must be less than 180; got 180"),
        ({"hfov_deg": -1e9, "relative": True}, "hfov_deg must be greater than -180; got -1000000000.0"),
        ({"zoom": 0}, "zoom must be greater than 0; got 0"),
        ({"zoom": 1e300}, "zoom must be less than or equal to 1000000; got 1e+300"),
        ({"pan_deg": "nan"}, "pan_deg = 'nan' is not a number"),
        ({"zoom": True}, "zoom = True is not a number"),
    ],
)
def test_steering_is_range_checked(gateway, asked, sentence):
    with TestClient(create_app(gateway, None), base_url="http://127.0.0.1") as client:
        before = client.get("/api/views/eye").json()
        answer = client.post("/api/views/eye", json=asked)
        assert (answer.status_code, answer.json()["detail"]) == (422, sentence)
        assert client.get("/api/views/eye").json() == before


@pytest.mark.parametrize(
    "body",
    [
        "[NaN]", '{"pan_deg": Infinity}', '{"pan_deg": 1e999}', '{"zoom": ' + "9" * 5000 + "}", "[" * 99999,
        '{"zoom": 1, "zoom": 2}', '"\\ud800"', "{",
    ],
)  # fmt: skip
def test_bodies_that_are_no_json_are_refused(gateway, body):
    with TestClient(create_app(gateway, None), base_url="http://127.0.0.1") as client:
        answer = client.post("/api/views/eye", content=body, headers={"content-type": "application/json"})
        assert answer.status_code == 422
        assert answer.json()["detail"].startswith("the body must ")
        assert client.get(f"/front/{'9' * 5000}.ts").status_code in (404, 422)


def test_steps_lead_around_and_not_over_the_top(gateway):
    with TestClient(create_app(gateway, None), base_url="http://127.0.0.1") as client:
        step = {"pan_deg": 90, "relative": True}
        pans = [client.post("/api/views/eye", json=step).json()["pan_deg"] for _ in range(9)]
        assert all(abs(pan) <= 360 for pan in pans)
        assert {pan % 360 for pan in pans} == {(pans[0] + turn) % 360 for turn in (0, 90, 180, 270)}
        answers = [client.post("/api/views/eye", json={"tilt_deg": -89, "relative": True}) for _ in range(2)]
        assert answers[1].status_code == 400
        assert answers[1].json()["detail"].startswith("tilt_deg must be from -90 to 90")


def test_a_watcher_that_is_slow_goes_on_with_a_key_frame():
    async def watch():
        outlet = outlets.TransportOutlet((64, 48), lambda: None)
        stream = outlet.chunks()
        coming = asyncio.ensure_future(anext(stream))
        await asyncio.sleep(0)
        outlet._publish(Chunk(b"early", False, 0.0))
        outlet._publish(Chunk(b"key 1", True, 0.04))
        first = await coming
        for i in range(outlets.BEHIND + 5):  # it takes none of them
            outlet._publish(Chunk(b"missed", False, 0.1 + 0.04 * i))
        is_asked = outlet._key_is_asked
        outlet._publish(Chunk(b"key 2", True, 9.0))
        second = await anext(stream)
        await stream.aclose()
        return first, is_asked, second, outlet.watchers

    with ThreadPoolExecutor(1) as own:  # a browser's tests leave a loop running in this thread
        seen = own.submit(asyncio.run, watch()).result()
    assert seen == (b"key 1", True, b"key 2", 0)


# -- the command ---------------------------------------------------------------------------------------


@contextmanager
def command(film, camera, folder, *more):
    om.save_sensor(camera, folder / "small.toml")
    (folder / "views.toml").write_text(
        "[front]\nsize = [160, 96]\nhfov_deg = 70\n[left]\nsize = [64, 48]\npan_deg = -90"
    )
    words = ("serve", film, "--sensor", "small.toml", "--views", "views.toml", *more)
    with subprocess.Popen(
        [sys.executable, "-m", "omnimirror", *map(str, words)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder,
    ) as process:  # fmt: skip
        try:
            yield process, re.search(r"http://\S+", process.stdout.readline())[0]
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("number", "code"), few([(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)], (signal.SIGTERM, 143))
)
def test_the_command_serves_until_it_is_told_to_end(film, camera, tmp_path, number, code):
    with command(film, camera, tmp_path) as (process, address):
        with httpx.stream("GET", f"{address}front.mjpg", timeout=300) as watched:
            pictures = watched.iter_raw()
            next(pictures)
            process.send_signal(number)
            process.wait()
        assert process.returncode == code


def test_views_are_pushed_to_a_server(film, camera, tmp_path):
    """FFmpeg's reader is the server here; it takes what is published, as MediaMTX does."""
    port = free_port()
    options = {"rtsp_flags": "listen", "listen_timeout": "300"}
    address = f"rtsp://127.0.0.1:{port}/{{view}}"
    with (
        LiveSource(address.replace("{view}", "front"), 300, 300, 0.05, options=options) as server,
        command(film, camera, tmp_path, "--publish", address),
    ):
        frames = server.frames()
        assert {next(frames).width for _ in range(3)} < {160, 64}  # of the view that got there first


SYSTEM_PYTHON = Path("/usr/bin/python3")  # which has GStreamer's bindings, where anything does
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
"""GStreamer's, which takes what is published at /front and counts it."""


@pytest.fixture(scope="module")
def rtsp_server():
    """Starts GStreamer's RTSP server at a port, and waits until it listens."""
    running = []

    def start(port):
        words = [SYSTEM_PYTHON, "-c", RTSP_SERVER, str(port)]
        running.append(subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True))
        if running[-1].stdout.readline() != "ready\n":
            pytest.skip("there is no RTSP server: apt install gir1.2-gst-rtsp-server-1.0 gstreamer1.0-plugins-good")
        return running[-1]

    if not SYSTEM_PYTHON.exists():
        pytest.skip("there is no Python of the system, which has GStreamer's bindings")
    yield start
    for process in running:
        process.kill()
        process.stdout.close()
        process.wait()


def test_a_server_that_is_killed_gets_the_view_again(film, camera, tmp_path, rtsp_server):
    port = free_port()
    server = rtsp_server(port)
    with command(film, camera, tmp_path, "--publish", f"rtsp://127.0.0.1:{port}/{{view}}"):
        assert server.stdout.readline() == "frames 25\n"
        server.kill()
        server.wait()
        server = rtsp_server(port)
        assert [server.stdout.readline() for _ in range(2)] == ["frames 25\n", "frames 50\n"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["a.png"], "a.png is no camera, stream or video file"),
        pytest.param(["nowhere.mp4"], "nowhere.mp4 is no camera, stream or video file", marks=pytest.mark.full),
        (
            ["0", "--publish", "rtsp://door/1"],
            "rtsp://door/1 is one address for all views to be published; put {view} into it",
        ),
        (["0", "--publish", "gopher://{view}"], "cannot stream to 'gopher://{view}'"),
        pytest.param(["0", "--token", ""], "the token is empty", marks=pytest.mark.full),
        pytest.param(["0"], "there are no views 'views.toml'", marks=pytest.mark.full),
        (["cut.mp4"], "cannot read the video cut.mp4"),
    ],
)
def test_what_cannot_be_served_is_refused(words, sentence, tmp_path):
    if len(words) > 1:
        (tmp_path / "views.toml").write_text("[front]")
    (tmp_path / "cut.mp4").write_bytes(b"\0\0\0 ftypisom")
    assert sentence in fails("serve", *words, "--views", "views.toml", "--sensor", "paper-spherical", cwd=tmp_path)
