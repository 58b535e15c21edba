"""Element omnimirrordewarp in pipelines of GStreamer, compared with the Dewarper."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OutsideField, SpecError
from omnimirror.interop.gstreamer.frames import PLUGIN_PATH, FrameLayout, ViewSettings

NAME, SIZE = "paper-spherical", (1024, 1024)
VIEW = "width=322 height=240 pan-deg=30 hfov-deg=70"
SETTINGS = ViewSettings(NAME, pan_deg=30.0, hfov_deg=70.0, width=322, height=240)
"""The settings of VIEW; rows of 322 RGB pixels have two bytes of padding in GStreamer."""
SYSTEM_PYTHON = "/usr/bin/python3"
STEER = """
import sys
import gi
gi.require_version("Gst", "1.0")
from gi.repository import Gst

Gst.init(None)
pipeline = Gst.parse_launch(sys.argv[1])
element = pipeline.get_by_name("dewarp")
steps = [line.split("=") for line in sys.argv[2:]]
count = 0

def before_frame(pad, info):
    global count
    if count:
        element.set_property(steps[count - 1][0], float(steps[count - 1][1]))
    count += 1
    return Gst.PadProbeReturn.OK

element.get_static_pad("sink").add_probe(Gst.PadProbeType.BUFFER, before_frame)
pipeline.set_state(Gst.State.PLAYING)
kinds = Gst.MessageType.EOS | Gst.MessageType.ERROR | Gst.MessageType.WARNING
while True:
    message = pipeline.get_bus().timed_pop_filtered(100 * Gst.SECOND, kinds)
    if message is None or message.type == Gst.MessageType.EOS:
        break
    if message.type == Gst.MessageType.ERROR:
        sys.exit(str(message.parse_error()))
    print(message.parse_warning().gerror.message)
pipeline.set_state(Gst.State.NULL)
"""

CHANGE_VIEW = """
import json, sys
import gi
gi.require_version("Gst", "1.0")
from gi.repository import Gst

Gst.init(None)
pipeline = Gst.parse_launch(sys.argv[1])
element, sink = pipeline.get_by_name("dewarp"), pipeline.get_by_name("sink")
pipeline.set_state(Gst.State.PLAYING)
with open(sys.argv[3], "wb") as file:
    for change in json.loads(sys.argv[2]):
        for name, value in change.items():
            element.set_property(name, value)
        for _ in range(6):  # frames of the previous view are queued
            sample = sink.emit("pull-sample")
        buffer, caps = sample.get_buffer(), sample.get_caps().get_structure(0)
        file.write(buffer.extract_dup(0, buffer.get_size()))
        print(caps.get_value("width"), caps.get_value("height"))
pipeline.set_state(Gst.State.NULL)
"""
"""Program that changes properties of a running pipeline and writes one frame of each view."""


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Return the environment in which GStreamer finds the element."""
    variables = os.environ | {
        "VIRTUAL_ENV": sys.prefix,
        "GST_PLUGIN_PATH": str(PLUGIN_PATH),
        "GST_REGISTRY": str(tmp_path_factory.mktemp("gstreamer") / "registry.bin"),
    }
    if not shutil.which("gst-inspect-1.0") or not Path(SYSTEM_PYTHON).exists():
        pytest.skip("GStreamer is not installed: make programs")
    command = "import sys; print(sys.version_info[:2])"
    run = subprocess.run([SYSTEM_PYTHON, "-c", command], capture_output=True, text=True)
    if run.stdout.strip() != str(sys.version_info[:2]):
        pytest.skip(f"GStreamer uses Python {run.stdout.strip()}, the tests another version")
    if subprocess.run(["gst-inspect-1.0", "python"], capture_output=True).returncode:
        pytest.skip("the Python loader of GStreamer is not installed: make programs")
    return variables


@pytest.fixture(scope="module")
def image():
    sensor = om.load_sensor(NAME)
    return om.render_image(sensor, om.Room(), samples=1)


def source(path, frames, kind):
    path.write_bytes(frames.tobytes())
    return (
        f"filesrc location={path} ! rawvideoparse format={kind} width={SIZE[0]} height={SIZE[1]} "
        "framerate=30/1 colorimetry=bt601"
    )


def launch(pipeline, environment):
    return subprocess.run(
        ["gst-launch-1.0", "-q", *pipeline.split()], capture_output=True, text=True, env=environment
    )


def dewarped_bytes(pipeline, environment, output):
    run = launch(f"{pipeline} ! filesink location={output}", environment)
    assert "ERROR" not in run.stderr, run.stderr
    assert run.returncode == 0, run.stderr
    return np.fromfile(output, np.uint8)


def rows(values, width, height, channels=3):
    """Return the image of a buffer whose rows are padded to multiples of four bytes."""
    stride = -(-width * channels // 4) * 4
    return values.reshape(height, stride)[:, : width * channels].reshape(height, width, channels)


def test_rgb_equals_the_dewarper(image, environment, tmp_path, beside):
    output = dewarped_bytes(
        f"{source(tmp_path / 'in.rgb', image, 'rgb')} ! omnimirrordewarp sensor={NAME} {VIEW}",
        environment,
        tmp_path / "out.rgb",
    )
    differing = (rows(output, 322, 240) != SETTINGS.dewarper()(image)).mean()
    version = subprocess.run(
        ["gst-launch-1.0", "--version"], capture_output=True, text=True
    ).stdout.split("\n")[1]
    beside(
        "GStreamer",
        "differing values of a view by the element omnimirrordewarp",
        100 * differing,
        0,
        "%",
        version.removeprefix("GStreamer "),
    )


def nv12_of(i420):
    luma, chroma = np.split(i420.ravel(), [SIZE[0] * SIZE[1]])
    return np.concatenate([luma, chroma.reshape(2, -1).T.ravel()])


def luma_of(values):
    """Return the luma of a 4:2:0 frame of 322 x 240 px; rows are padded to 324 bytes."""
    return values[: 324 * 240].reshape(240, 324)[:, :322]


@pytest.mark.parametrize("kind", ["i420", "nv12"])
def test_yuv_equals_the_dewarped_rgb_image_converted_by_opencv(image, environment, tmp_path, kind):
    i420 = cv2.cvtColor(image, cv2.COLOR_RGB2YUV_I420)
    frames = i420 if kind == "i420" else nv12_of(i420)
    output = dewarped_bytes(
        f"{source(tmp_path / 'in.yuv', frames, kind)} ! omnimirrordewarp sensor={NAME} {VIEW}",
        environment,
        tmp_path / "out.yuv",
    )
    dewarper = SETTINGS.dewarper()
    expected = cv2.cvtColor(dewarper(image), cv2.COLOR_RGB2YUV_I420)
    visible = cv2.erode(dewarper.valid.astype(np.uint8), np.ones((5, 5))) > 0
    deviation = np.abs(luma_of(output).astype(int) - expected[:240])
    assert deviation[visible].max() <= 2
    assert (luma_of(output)[~dewarper.valid] == 16).all()
    chroma = output[324 * 240 :]
    if kind == "i420":  # chroma rows of 161 bytes are padded to 164
        u, v = chroma.reshape(2, 120, 164)[:, :, :161]
    else:
        u, v = np.moveaxis(chroma.reshape(120, 324)[:, :322].reshape(120, 161, 2), -1, 0)
    for plane, other in zip((u, v), expected[240:].reshape(2, 120, 161), strict=True):
        inside = visible.reshape(120, 2, 161, 2).all((1, 3))
        assert np.abs(plane.astype(int) - other)[inside].mean() < 1


def test_view_moves_while_the_pipeline_runs(image, environment, tmp_path):
    frames = np.stack([image] * 3)
    pipeline = (
        f"{source(tmp_path / 'in.rgb', frames, 'rgb')} ! omnimirrordewarp name=dewarp "
        f"sensor={NAME} {VIEW} ! filesink location={tmp_path / 'out.rgb'}"
    )
    run = subprocess.run(
        [SYSTEM_PYTHON, "-c", STEER, pipeline, "pan-deg=-60", "tilt-deg=90"],
        capture_output=True,
        text=True,
        env=environment,
    )
    assert run.returncode == 0, run.stderr
    first, second, third = np.fromfile(tmp_path / "out.rgb", np.uint8).reshape(3, -1)
    assert np.array_equal(rows(first, 322, 240), SETTINGS.dewarper()(image))
    assert np.array_equal(
        rows(second, 322, 240), replace(SETTINGS, pan_deg=-60.0).dewarper()(image)
    )
    assert np.array_equal(
        rows(third, 322, 240), rows(second, 322, 240)
    )  # an invalid view is reported and not applied
    assert "outside the field of the camera" in run.stdout


def test_type_and_size_of_the_view_change_while_the_pipeline_runs(image, environment, tmp_path):
    """Every change of the size negotiates the caps again; rows have no padding at these widths."""
    sensor, output = om.load_sensor(NAME), tmp_path / "views.rgb"
    om.write_image(tmp_path / "in.png", image)
    pipeline = (
        f"filesrc location={tmp_path / 'in.png'} ! pngdec ! videoconvert ! video/x-raw,format=RGB "
        f"! imagefreeze ! omnimirrordewarp name=dewarp sensor={NAME} width=320 height=240 "
        "! appsink name=sink max-buffers=1 sync=false"
    )
    size = {"width": 240, "height": 240}
    changes = [
        {"pan-deg": 90.0},
        {"view": "panorama", "width": 640, "height": 160},
        {"view": "ground", "options": "height_mm = 900, mm_per_px = 8", **size},
    ]
    views = [
        om.screens.Plane((320, 240), 90.0),
        om.views.panorama(sensor, (640, 160), pan_deg=90.0),
        om.views.ground(sensor, 900.0, size=(240, 240), mm_per_px=8.0, pan_deg=90.0),
    ]
    run = subprocess.run(
        [SYSTEM_PYTHON, "-c", CHANGE_VIEW, pipeline, json.dumps(changes), str(output)],
        capture_output=True,
        text=True,
        env=environment,
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.split("\n")[:-1] == [f"{view.size[0]} {view.size[1]}" for view in views]
    expected = b"".join(om.Dewarper(sensor, view)(image).tobytes() for view in views)
    assert output.read_bytes() == expected


PAGE = Path(__file__).parents[2] / "docs" / "interoperability.md"
PIPELINES = re.findall(r"^    (gst-launch-1.0 .*omnimirrordewarp.*)$", PAGE.read_text(), re.M)
CAMERA = "videotestsrc num-buffers=3 ! video/x-raw,width=1024,height=1024,framerate=30/1"
SUBSTITUTES = {
    "v4l2src": CAMERA,
    "filesrc location=ride.mp4 ! decodebin": CAMERA,
    "rtspsrc location=rtsp://roof/1 ! decodebin": CAMERA.replace("1024", "512"),
    "videoscale": "videoscale ! video/x-raw,width=1024,height=1024",
    "autovideosink": "pngenc snapshot=true ! filesink location=view.png",
    "x264enc ! mp4mux": "videoconvert ! pngenc snapshot=true",
    "location=around.mp4": "location=view.png",
}
"""Elements that replace cameras, displays and the codecs that Debian installs separately."""


@pytest.mark.parametrize("pipeline", PIPELINES, ids=["perspective", "panorama", "half-panorama"])
def test_documented_pipelines(environment, tmp_path, pipeline):
    sensor = om.load_sensor(NAME)
    om.save_sensor(sensor, tmp_path / "mine.toml")
    options = dict(re.findall(r"(width|height)=(\d+)", pipeline))
    for documented, substitute in SUBSTITUTES.items():
        pipeline = pipeline.replace(documented, substitute)
    run = subprocess.run(
        shlex.split(pipeline), cwd=tmp_path, capture_output=True, text=True, env=environment
    )
    assert run.returncode == 0, run.stderr
    view = om.read_image(tmp_path / "view.png")
    assert view.any()
    if options:
        assert view.shape[:2] == (int(options["height"]), int(options["width"]))


def test_panorama_with_options_in_toml(image, environment, tmp_path):
    output = dewarped_bytes(
        f"{source(tmp_path / 'in.rgb', image, 'rgb')} ! omnimirrordewarp sensor={NAME} "
        "view=panorama width=400 options=span_deg=180",
        environment,
        tmp_path / "out.rgb",
    )
    sensor = om.load_sensor(NAME)
    expected = om.Dewarper(sensor, om.views.panorama(sensor, (400, None), span_deg=180.0))(image)
    assert np.array_equal(rows(output, 400, expected.shape[0]), expected)


@pytest.mark.parametrize(
    ("properties", "message"),
    [("", "sensor must be"), (f"sensor={NAME} view=cylindre", "view must be one of")],
)
def test_invalid_properties_end_the_pipeline_with_a_message(environment, properties, message):
    run = launch(
        f"videotestsrc num-buffers=1 ! omnimirrordewarp {properties} ! fakesink", environment
    )
    assert run.returncode
    assert message in run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"options": "span_deg 180"}, "options must be valid TOML"),
        ({"options": "span_deg = 180"}, "options of a perspective view"),
        ({"tilt_deg": 90.0}, "outside the field"),
    ],
)
def test_invalid_settings_raise(changes, message):
    with pytest.raises((InvalidParameter, OutsideField, SpecError), match=message):
        replace(SETTINGS, **changes).dewarper()


def test_planes_share_the_memory_of_the_buffer():
    buffer = bytearray(range(24))
    y, u, v = FrameLayout("I420", (4, 2), [0, 8, 16], [4, 8, 8]).planes(buffer)
    assert (y[1, 3], u[0, 1], v[0, 1]) == (7, 9, 17)
    y[0, 0] = 99
    assert buffer[0] == 99


def test_module_prints_the_plugin_path():
    run = subprocess.run(
        [sys.executable, "-m", "omnimirror.interop.gstreamer"], capture_output=True, text=True
    )
    assert (Path(run.stdout.strip()) / "python" / "omnimirrordewarp.py").is_file()
