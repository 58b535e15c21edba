"""ROS 2 node: published views equal the Dewarper, with messages that rclpy accepts."""

from __future__ import annotations

import array
import configparser
import importlib.util
import re
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError
from omnimirror.interop.ros_bags.dewarping import ENCODINGS
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.sensor_files import save_sensor

from .ros_modules import modules

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "ros" / "omnimirror_ros"
SIZE = 240
VIEWS = """
[front]
pan_deg = 20.0
hfov_deg = 70
size = [96, 72]

[around]
view = "panorama"
size = [180, 45]
"""


def load(monkeypatch, path: Path, **others: ModuleType) -> ModuleType:
    """Import a file of the ROS package with stand-ins for the modules of ROS."""
    for name, module in (modules() | others).items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def sensor():
    full = om.load_sensor("paper-spherical")
    pitch_um = full.imager.pixel_pitch_um * full.image_size[0] / SIZE
    return replace(full, imager=Imager(SIZE, SIZE, pitch_um))


@pytest.fixture
def create(monkeypatch, sensor, tmp_path):
    """Create a node with parameters."""
    save_sensor(sensor, tmp_path / "mine.toml")
    (tmp_path / "views.toml").write_text(VIEWS)
    node_file = load(monkeypatch, PACKAGE / "omnimirror_ros" / "dewarp_node.py")

    def create(**parameters):
        files = {"sensor": str(tmp_path / "mine.toml"), "views": str(tmp_path / "views.toml")}
        monkeypatch.setattr(node_file.Node, "overrides", files | parameters)
        return node_file.DewarpNode()

    create.module = node_file
    return create


@pytest.fixture
def image():
    return np.random.default_rng(3).integers(0, 255, (SIZE, SIZE, 3), np.uint8)


def message(create, values, encoding="rgb8", frame="omni_optical_frame"):
    types = create.module._message_types()
    stamp = types["builtin_interfaces/msg/Time"](sec=1_700_000_000, nanosec=123_456_789)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)
    height, width = values.shape[:2]
    return types["sensor_msgs/msg/Image"](
        header=header,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=values.nbytes // height,
        data=values.ravel(),
    )


def pixels(sent) -> np.ndarray:
    return np.frombuffer(sent.data, np.uint8).reshape(sent.height, sent.width, -1)


def test_published_views_equal_the_dewarper(create, sensor, image):
    node = create()
    assert (node.subscription.topic, node.subscription.qos) == (
        "/rover/cam/image_raw",
        "sensor data",
    )
    node.subscription.callback(message(create, image))
    assert node.publishers.keys() == {
        "/tf_static",
        "/rover/cam/front/image_rect",
        "/rover/cam/front/camera_info",
        "/rover/cam/around/image_rect",
    }
    (front,) = node.publishers["/rover/cam/front/image_rect"].messages
    view = om.views.perspective((96, 72), pan_deg=20.0, hfov_deg=70)
    np.testing.assert_array_equal(pixels(front), om.Dewarper(sensor, view)(image))
    (around,) = node.publishers["/rover/cam/around/image_rect"].messages
    view = om.views.panorama(sensor, size=(180, 45))
    expected = om.Dewarper(sensor, view, keep_map=True)(image)
    np.testing.assert_array_equal(pixels(around), expected)
    assert front.header.frame_id == "omni_front_optical_frame"
    assert (front.header.stamp.sec, front.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    (info,) = node.publishers["/rover/cam/front/camera_info"].messages
    focal_px = 48 / np.tan(np.radians(35))
    np.testing.assert_allclose(
        info.k.reshape(3, 3), [[focal_px, 0, 47.5], [0, focal_px, 35.5], [0, 0, 1]], atol=1e-9
    )
    transforms = node.publishers["/tf_static"]
    assert transforms.qos.durability == "transient local"
    frames = {t.child_frame_id: t.header.frame_id for t in transforms.messages[0].transforms}
    assert frames == {
        "omni_optical_frame_mirror": "omni_optical_frame",
        "omni_front_optical_frame": "omni_optical_frame_mirror",
    }


def test_views_move_while_the_node_runs(create, sensor, image):
    node = create(**{"front.tilt_deg": -15.0})
    node.subscription.callback(message(create, image))
    published = node.publishers["/rover/cam/front/image_rect"].messages
    for name, value in (("pan_deg", 140.0), ("size", array.array("q", [64, 48]))):
        assert node.set_parameter(f"front.{name}", value).successful
    view = om.views.perspective((64, 48), pan_deg=140.0, tilt_deg=-15.0, hfov_deg=70)
    expected = om.Dewarper(sensor, view)(image)
    np.testing.assert_array_equal(pixels(published[-1]), expected)
    for name, value, reason in (
        ("front.hfov_deg", 300.0, "hfov_deg must be"),
        ("front.colour", "red", "options of a perspective view must be from"),
        ("rear.pan_deg", 180.0, "unknown view rear"),
        ("image_transport", "compressed", "restart"),
        ("sensor", "missing.toml", "missing.toml"),
    ):
        result = node.set_parameter(name, value)
        assert not result.successful
        assert reason in result.reason
    node.subscription.callback(message(create, image))
    np.testing.assert_array_equal(pixels(published[-1]), expected)
    assert node.errors == []


@pytest.mark.parametrize("encoding", ["bgr8", "rgba8", "mono8"])
def test_encodings_are_preserved(create, sensor, encoding):
    shape = (SIZE, SIZE, ENCODINGS[encoding].channels)
    values = np.random.default_rng(3).integers(0, 255, shape, np.uint8)
    node = create()
    node.subscription.callback(message(create, values, encoding))
    (front,) = node.publishers["/rover/cam/front/image_rect"].messages
    assert front.encoding == encoding
    view = om.views.perspective((96, 72), pan_deg=20.0, hfov_deg=70)
    expected = om.Dewarper(sensor, view)(values.squeeze())  # sampling ignores the channel order
    np.testing.assert_array_equal(pixels(front).squeeze(), expected)


def test_compressed_images(create, sensor, image):
    node = create(image_transport="compressed")
    assert node.subscription.topic == "/rover/cam/image_raw/compressed"
    types = create.module._message_types()
    png = cv2.imencode(".png", image[..., ::-1])[1].ravel()
    header = message(create, image).header
    sent = types["sensor_msgs/msg/CompressedImage"](header=header, format="png", data=png)
    node.subscription.callback(sent)
    (front,) = node.publishers["/rover/cam/front/image_rect/compressed"].messages
    view = om.views.perspective((96, 72), pan_deg=20.0, hfov_deg=70)
    decoded = cv2.imdecode(np.frombuffer(front.data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_array_equal(decoded, om.Dewarper(sensor, view)(image))


def test_invalid_images_are_reported(create, image):
    node = create()
    node.subscription.callback(message(create, image[:100]))
    node.subscription.callback(message(create, image, encoding="bayer_abcd8"))
    assert "240 x 240" in node.errors[0]
    assert "encoding" in node.errors[1]
    node.subscription.callback(message(create, image))
    assert len(node.publishers["/rover/cam/front/image_rect"].messages) == 1


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"sensor": ""}, "sensor must be a sensor file"),
        ({"image_transport": "theora"}, "image_transport must be raw or compressed"),
        ({"front.hfov_deg": "wide"}, "hfov_deg"),
        ({"interpolation": "fast"}, "interpolation"),
    ],
)
def test_invalid_parameters_raise(create, image, parameters, text):
    with pytest.raises(OmnimirrorError, match=text):
        create(**parameters)._rig.dewarp(message(create, image))


def test_default_view_is_perspective(create, image):
    node = create(views="")
    node.subscription.callback(message(create, image))
    assert "/rover/cam/front/camera_info" in node.publishers


def test_files_of_the_package_agree():
    package = ElementTree.parse(PACKAGE / "package.xml").getroot()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    setup = (PACKAGE / "setup.py").read_text()
    node = (PACKAGE / "omnimirror_ros" / "dewarp_node.py").read_text()
    assert package.findtext("version") == re.search('version="(.*)"', setup)[1]
    assert package.findtext("version") == om.__version__
    assert package.findtext("license") == project["license"]
    needed = {d.text for d in package.findall("exec_depend")}
    imported = set(re.findall(r"^(?:from|import) (\w+)", node, re.M)) - sys.stdlib_module_names
    assert imported - {"numpy", "omnimirror"} <= needed
    for file in re.findall(r'"((?:config|launch)/.*?|package\.xml)"', setup):
        assert (PACKAGE / file).is_file()
    assert (PACKAGE / "resource" / package.findtext("name")).is_file()
    scripts = configparser.ConfigParser()
    scripts.read(PACKAGE / "setup.cfg")
    assert scripts["install"]["install_scripts"] == "$base/lib/omnimirror_ros"


def test_launch_file_starts_the_node(monkeypatch, create):
    record = lambda **values: SimpleNamespace(**values)  # noqa: E731
    substitution = lambda *names: names  # noqa: E731
    stubs = {
        name: ModuleType(name) for name in ("launch", "launch.actions", "launch.substitutions")
    }
    stubs |= {name: ModuleType(name) for name in ("launch_ros.actions", "launch_ros.substitutions")}
    stubs["launch_ros"] = ModuleType("launch_ros")
    stubs["launch"].LaunchDescription = list
    stubs["launch.actions"].DeclareLaunchArgument = lambda name, **values: record(
        name=name, **values
    )
    stubs["launch.substitutions"].LaunchConfiguration = substitution
    stubs["launch.substitutions"].PathJoinSubstitution = substitution
    stubs["launch_ros.actions"].Node = record
    stubs["launch_ros.substitutions"].FindPackageShare = substitution
    launch = load(monkeypatch, PACKAGE / "launch" / "dewarp.launch.py", **stubs)
    *arguments, node = launch.generate_launch_description()
    assert {a.name for a in arguments} == {"image", "sensor", "views", "image_transport"}
    assert (node.package, node.executable) == ("omnimirror_ros", "dewarp")
    assert set(node.parameters[0]) <= set(create.module.SETTINGS)
    assert om.load_views(PACKAGE / "config" / "views.toml").keys() == {"front", "around"}
