"""Dewarped ROS bags, read back by rosbags and mcap and compared with the Dewarper."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

import omnimirror as om
from omnimirror.base import interrupts
from omnimirror.base.errors import InvalidParameter, MediaError
from omnimirror.optics.image_sensor import Imager
from tests.commands import fails, omnimirror
from tests.everyday import few

STORE = get_typestore(Stores.ROS2_HUMBLE)
SIZE = 240
TOPIC = "/rover/cam/image_raw"
STAMPS = (1_700_000_000_123_456_789, 1_700_000_000_163_456_788, 1_700_000_001_000_000_001)
"""Times of the messages, ns; stamps in headers are 7 ns earlier."""
VIEWS = {
    "front": om.screens.Plane((96, 72), pan_deg=20.0, tilt_deg=-10.0, hfov_deg=70.0),
    "around": om.screens.Cylinder((180, 60), -60.0, 30.0),
}


@pytest.fixture(scope="module")
def sensor():
    full = om.load_sensor("paper-spherical")
    return replace(
        full, imager=Imager(SIZE, SIZE, full.imager.pixel_pitch_um * full.image_size[0] / SIZE)
    )


@pytest.fixture(scope="module")
def images(sensor):
    """Images along a path through the room."""
    room = om.Room()
    return [
        om.render_image(
            sensor, om.PosedScene(room, om.Pose(200.0 * i, pan_deg=10.0 * i)), samples=1
        )
        for i in range(len(STAMPS))
    ]


def header(stamp_ns, frame="omni_optical_frame"):
    time = STORE.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns - 7, 10**9))
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def raw(stamp_ns, encoding, values, *, padding=0, big=False):
    """Return an Image, optionally with padded rows or big-endian."""
    height, width = values.shape[:2]
    rows = (
        values.astype(values.dtype.newbyteorder(">" if big else "<"))
        .reshape(height, -1)
        .view(np.uint8)
    )
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    return STORE.types["sensor_msgs/msg/Image"](
        header(stamp_ns),
        height,
        width,
        encoding,
        int(big),
        rows.shape[1],
        np.ascontiguousarray(rows).ravel(),
    )


def compressed(stamp_ns, kind, image):
    success, data = cv2.imencode({"jpeg": ".jpg", "png": ".png"}[kind], image[..., ::-1])
    assert success
    return STORE.types["sensor_msgs/msg/CompressedImage"](
        header(stamp_ns), f"rgb8; {kind} compressed bgr8", data
    )


def write(path, topics, storage=StoragePlugin.MCAP, compression=CompressionMode.NONE):
    """Write a rosbag2 folder of messages by topic in the order of STAMPS."""
    writer = Writer(path, version=8, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        for topic, messages in topics.items():
            connection = writer.add_connection(topic, messages[0].__msgtype__, typestore=STORE)
            for stamp_ns, message in zip(STAMPS, messages, strict=False):
                writer.write(
                    connection, stamp_ns, STORE.serialize_cdr(message, message.__msgtype__)
                )
    return path


def single(folder, suffix=".mcap"):
    return next(Path(folder).glob(f"*{suffix}"))


def read(path):
    """Return times and messages by topic."""
    messages = {}
    with AnyReader([Path(path)]) as reader:
        for connection, stamp_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            messages.setdefault(connection.topic, []).append((stamp_ns, message))
    return messages


def values(message):
    shape = (message.height, message.width, -1)
    depth = np.uint16 if "16" in message.encoding else np.uint8
    return message.data.view(depth).reshape(shape)


@pytest.fixture(scope="module")
def ride(images, tmp_path_factory):
    """Bag of an image topic and a string topic."""
    odometry = [STORE.types["std_msgs/msg/String"](f"at {i}") for i in range(3)]
    image_messages = [raw(s, "rgb8", p, padding=13) for s, p in zip(STAMPS, images, strict=True)]
    return write(
        tmp_path_factory.mktemp("bags") / "ride", {TOPIC: image_messages, "/where": odometry}
    )


# -- images ---------------------------------------------------------------------------------------


def test_views_equal_the_dewarper_and_times_are_exact(sensor, images, ride, tmp_path):
    result = om.dewarp_bag(
        single(ride), tmp_path / "views.mcap", camera=sensor, views=VIEWS, topic=TOPIC
    )
    topics = read(tmp_path / "views.mcap")
    assert (
        set(topics)
        == set(result.output_topics)
        == {
            "/rover/cam/front/image_rect",
            "/rover/cam/front/camera_info",
            "/rover/cam/around/image_rect",
            "/tf_static",
        }
    )
    for name, view in VIEWS.items():
        dewarp = om.Dewarper(sensor, view, keep_map=True)
        messages = topics[f"/rover/cam/{name}/image_rect"]
        assert tuple(stamp for stamp, _ in messages) == STAMPS
        for (stamp_ns, message), image in zip(messages, images, strict=True):
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp_ns - 7
            assert message.header.frame_id == f"omni_{name}_optical_frame"
            assert np.array_equal(values(message), dewarp(image))
    assert [stamp for stamp, _ in topics["/rover/cam/front/camera_info"]] == list(STAMPS)


@pytest.mark.parametrize(
    ("encoding", "of", "encoding_after", "back"),
    [
        ("bgr8", lambda p: p[..., ::-1], "bgr8", lambda p: p[..., ::-1]),
        ("8UC3", lambda p: p[..., ::-1], "8UC3", lambda p: p[..., ::-1]),
        ("mono8", lambda p: p[..., 1], "mono8", lambda p: p),
        ("rgba8", lambda p: np.dstack([p, p[..., 0]]), "rgba8", lambda p: p),
        ("mono16", lambda p: p[..., 1].astype(np.uint16) * 257, "mono16", lambda p: p),
        ("bgr16", lambda p: p[..., ::-1].astype(np.uint16) * 257, "bgr16", lambda p: p[..., ::-1]),
    ],
)
@pytest.mark.parametrize("big", few([False, True], True))
def test_encodings_are_preserved(sensor, images, tmp_path, encoding, of, encoding_after, back, big):
    bag = write(tmp_path / "ride", {TOPIC: [raw(STAMPS[0], encoding, of(images[0]), big=big)]})
    om.dewarp_bag(bag, tmp_path / "out.mcap", camera=sensor, views=VIEWS)
    (_, message), *_ = read(tmp_path / "out.mcap")["/rover/cam/front/image_rect"]
    assert message.encoding == encoding_after
    rgb = np.ascontiguousarray(back(of(images[0])))
    expected = back(om.Dewarper(sensor, VIEWS["front"], keep_map=True)(rgb))
    assert np.array_equal(values(message).squeeze(), expected)


CELLS = {"rggb": "rggb", "bggr": "bggr", "gbrg": "gbrg", "grbg": "grbg"}


@pytest.mark.parametrize("pattern", CELLS)
def test_bayer_patterns_become_rgb(sensor, images, tmp_path, pattern):
    """Mosaics sampled from a blurred image by the letters of the pattern."""
    smooth = cv2.GaussianBlur(images[0], (0, 0), 6)
    mosaic = np.zeros((SIZE, SIZE), np.uint8)
    for i, letter in enumerate(pattern):
        rows, columns = slice(i // 2, None, 2), slice(i % 2, None, 2)
        mosaic[rows, columns] = smooth[rows, columns, "rgb".index(letter)]
    bag = write(tmp_path / "ride", {TOPIC: [raw(STAMPS[0], f"bayer_{pattern}8", mosaic)]})
    om.dewarp_bag(bag, tmp_path / "out.mcap", camera=sensor, views=VIEWS)
    (_, message), *_ = read(tmp_path / "out.mcap")["/rover/cam/front/image_rect"]
    straight = om.Dewarper(sensor, VIEWS["front"])(smooth)
    assert message.encoding == "rgb8"
    assert np.abs(values(message).astype(int) - straight).mean() < 1.5


@pytest.mark.parametrize(("encoding", "luma_first"), [("yuv422", False), ("yuv422_yuy2", True)])
def test_yuv422_becomes_rgb(sensor, images, tmp_path, encoding, luma_first):
    """Images coded by the formulas of BT.601 in limited range."""
    smooth = cv2.GaussianBlur(images[0], (0, 0), 4)
    r, g, b = np.moveaxis(smooth / 255.0, -1, 0)
    y = 16 + 65.481 * r + 128.553 * g + 24.966 * b
    u = 128 - 37.797 * r - 74.203 * g + 112.0 * b
    v = 128 + 112.0 * r - 93.786 * g - 18.214 * b
    colours = np.empty_like(y)
    colours[:, ::2], colours[:, 1::2] = u[:, ::2], v[:, ::2]
    pairs = np.rint(np.dstack([y, colours] if luma_first else [colours, y])).astype(np.uint8)
    bag = write(tmp_path / "ride", {TOPIC: [raw(STAMPS[0], encoding, pairs)]})
    om.dewarp_bag(bag, tmp_path / "out.mcap", camera=sensor, views=VIEWS)
    (_, message), *_ = read(tmp_path / "out.mcap")["/rover/cam/front/image_rect"]
    assert message.encoding == "rgb8"
    straight = om.Dewarper(sensor, VIEWS["front"])(smooth)
    assert np.abs(values(message).astype(int) - straight).mean() < 1.5


@pytest.mark.parametrize(("kind", "tolerance"), [("png", 0.0), ("jpeg", 1.5)])
def test_compression_is_preserved(sensor, images, tmp_path, kind, tolerance):
    smooth = cv2.GaussianBlur(images[0], (0, 0), 3)  # JPEG subsamples chroma
    bag = write(tmp_path / "ride", {f"{TOPIC}/compressed": [compressed(STAMPS[0], kind, smooth)]})
    om.dewarp_bag(bag, tmp_path / "out.mcap", camera=sensor, views=VIEWS)
    (stamp_ns, message), *_ = read(tmp_path / "out.mcap")["/rover/cam/front/image_rect/compressed"]
    assert stamp_ns == STAMPS[0]
    assert message.format == f"rgb8; {kind} compressed bgr8"
    straight = om.Dewarper(sensor, VIEWS["front"], keep_map=True)(smooth)
    decoded = cv2.imdecode(message.data, cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert np.abs(decoded.astype(int) - straight).mean() <= tolerance


# -- cameras and frames ----------------------------------------------------------------------------


def matrix_of(transform):
    q, t = transform.transform.rotation, transform.transform.translation
    full = np.eye(4)
    full[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    full[:3, 3] = t.x, t.y, t.z
    return full


def test_camera_info_and_tf_project_points_consistently(sensor, ride, tmp_path):
    """Transform points through the TF tree, project them with P, and compare with the map of the view."""
    om.dewarp_bag(ride, tmp_path / "out.mcap", camera=sensor, views=VIEWS)
    topics = read(tmp_path / "out.mcap")
    info = topics["/rover/cam/front/camera_info"][0][1]
    assert (info.distortion_model, info.d.tolist(), info.width, info.height) == (
        "plumb_bob",
        [0.0] * 5,
        96,
        72,
    )
    assert info.r.tolist() == np.eye(3).ravel().tolist()
    tree = {t.child_frame_id: t for t in topics["/tf_static"][0][1].transforms}
    assert {child: t.header.frame_id for child, t in tree.items()} == {
        "omni_optical_frame_mirror": "omni_optical_frame",
        "omni_front_optical_frame": "omni_optical_frame_mirror",
    }
    mirror, front = (
        matrix_of(tree[name]) for name in ("omni_optical_frame_mirror", info.header.frame_id)
    )
    # the vertex is on the optical axis in front of the lens; forward is image top
    assert mirror[:3, 3] == pytest.approx([0, 0, sensor.mirror_distance_mm / 1000])
    assert mirror[:3, :3] @ [1, 0, 0] == pytest.approx([0, -1, 0], abs=1e-12)
    p, k = info.p.reshape(3, 4), info.k.reshape(3, 3)
    assert np.array_equal(p[:, :3], k)
    source = om.Dewarper(sensor, VIEWS["front"]).coordinates(exact=True)
    for u, v in ((10, 10), (48, 36), (90, 65)):
        far_m = 1e6 * np.linalg.solve(k, [u, v, 1.0])
        world_mm = 1000 * (front @ [*far_m, 1.0])[:3]
        projected = sensor.project(world_mm[None]).pixels[0]
        assert projected == pytest.approx(source[v, u], abs=1e-3)


def test_existing_mirror_frame_is_used(sensor, ride, tmp_path):
    om.dewarp_bag(ride, tmp_path / "out.mcap", camera=sensor, views=VIEWS, mirror_frame="mast")
    (_, tree), *_ = read(tmp_path / "out.mcap")["/tf_static"]
    assert [(t.header.frame_id, t.child_frame_id) for t in tree.transforms] == [
        ("mast", "omni_front_optical_frame")
    ]


def test_accuracy_of_camera_info_is_reported(sensor, ride, tmp_path):
    result = om.dewarp_bag(ride, tmp_path / "out.mcap", camera=sensor, views=VIEWS)
    assert len(result.notes) == 2
    assert "front: camera_info is exact at infinity, error up to 0." in result.notes[0]
    assert "around: no camera_info, because the panorama" in result.notes[1]


# -- files -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("storage", few(StoragePlugin, StoragePlugin.MCAP))
@pytest.mark.parametrize(
    "compression", [CompressionMode.NONE, CompressionMode.MESSAGE, CompressionMode.FILE]
)
def test_source_storage_is_preserved(sensor, images, tmp_path, storage, compression):
    messages = [raw(s, "rgb8", p) for s, p in zip(STAMPS, images, strict=True)]
    bag = write(tmp_path / "ride", {TOPIC: messages}, storage, compression)
    om.dewarp_bag(bag, tmp_path / "views", camera=sensor, views=VIEWS)
    suffix = {StoragePlugin.MCAP: "mcap", StoragePlugin.SQLITE3: "db3"}[storage]
    assert {p.name for p in (tmp_path / "views").iterdir()} == {"metadata.yaml", f"views.{suffix}"}
    assert [s for s, _ in read(tmp_path / "views")["/rover/cam/around/image_rect"]] == list(STAMPS)
    assert {p.name for p in tmp_path.iterdir()} == {"ride", "views"}


@pytest.fixture(scope="module")
def ros1_bag(images, tmp_path_factory):
    """A bag of ROS 1 with images and a topic whose type no type store contains."""
    store, path = get_typestore(Stores.ROS1_NOETIC), tmp_path_factory.mktemp("bags") / "ride.bag"
    store.register(get_types_from_msg("uint8 a", "my_msgs/msg/Odd"))
    of = store.types
    with Writer1(path) as writer:
        connection = writer.add_connection(TOPIC, "sensor_msgs/msg/Image", typestore=store)
        other = writer.add_connection("/where", "my_msgs/msg/Odd", typestore=store, latching=1)
        for seq, (stamp_ns, image) in enumerate(zip(STAMPS, images, strict=True)):
            time = of["builtin_interfaces/msg/Time"](*divmod(stamp_ns - 7, 10**9))
            head = of["std_msgs/msg/Header"](seq, time, "omni_optical_frame")
            message = of["sensor_msgs/msg/Image"](
                head, SIZE, SIZE, "rgb8", 0, 3 * SIZE, image.ravel()
            )
            writer.write(connection, stamp_ns, store.serialize_ros1(message, message.__msgtype__))
            writer.write(other, stamp_ns, bytes([seq]))
    return path


@pytest.mark.parametrize("suffix", [".db3", ".bag"])
def test_ros1_bag_is_read(sensor, images, ros1_bag, tmp_path, suffix):
    om.dewarp_bag(ros1_bag, tmp_path / f"out{suffix}", camera=sensor, views=VIEWS)
    messages = read(tmp_path / f"out{suffix}")["/rover/cam/front/image_rect"]
    dewarp = om.Dewarper(sensor, VIEWS["front"], keep_map=True)
    assert [s for s, _ in messages] == list(STAMPS)
    assert all(
        np.array_equal(values(m), dewarp(p)) for (_, m), p in zip(messages, images, strict=True)
    )


def test_ros1_and_ros2_bags_have_equal_content(sensor, ride, tmp_path):
    """Images, camera_info and transforms of both versions, read by rosbags."""
    for name in ("out.mcap", "out.bag"):
        om.dewarp_bag(ride, tmp_path / name, camera=sensor, views=VIEWS)
    new, old = read(tmp_path / "out.mcap"), read(tmp_path / "out.bag")
    assert set(old) == set(new)
    for topic in new:
        assert [stamp for stamp, _ in old[topic]] == [stamp for stamp, _ in new[topic]]
    (_, a), (_, b) = new["/rover/cam/front/camera_info"][0], old["/rover/cam/front/camera_info"][0]
    assert np.array_equal(a.k, b.K)
    assert np.array_equal(a.p, b.P)
    assert (a.header.frame_id, a.header.stamp.nanosec) == (
        b.header.frame_id,
        b.header.stamp.nanosec,
    )
    pairs = zip(new["/tf_static"][0][1].transforms, old["/tf_static"][0][1].transforms, strict=True)
    assert all(np.array_equal(matrix_of(a), matrix_of(b)) for a, b in pairs)
    with AnyReader([tmp_path / "out.bag"]) as reader:
        assert {c.topic: c.ext.latching for c in reader.connections}["/tf_static"] == 1


def test_ros1_topics_are_copied_to_ros1_bags(sensor, ride, ros1_bag, tmp_path):
    result = om.dewarp_bag(
        ros1_bag, tmp_path / "out.bag", camera=sensor, views=VIEWS, keep_topics=["/where"]
    )
    assert result.copied == 3
    with AnyReader([tmp_path / "out.bag"]) as reader:
        (connection,) = (c for c in reader.connections if c.topic == "/where")
        assert (connection.msgtype, connection.msgdef.data.strip(), connection.ext.latching) == (
            "my_msgs/msg/Odd",
            "uint8 a",
            1,
        )
        assert [(s, bytes(d)) for _, s, d in reader.messages(connections=[connection])] == [
            (stamp, bytes([i])) for i, stamp in enumerate(STAMPS)
        ]
    with pytest.raises(
        InvalidParameter,
        match=r"out.db3 is a ROS 2 bag and the topics are ROS 1 messages; write .bag",
    ):
        om.dewarp_bag(ros1_bag, tmp_path / "out.db3", camera=sensor, keep_topics=["*"])
    with pytest.raises(
        InvalidParameter, match=r"two.bag is a ROS 1 bag .* ROS 2 messages; write .mcap or .db3"
    ):
        om.dewarp_bag(
            ride, tmp_path / "two.bag", camera=sensor, topic=TOPIC, keep_topics=["/where"]
        )
    assert {p.name for p in tmp_path.iterdir()} == {"out.bag"}


def test_other_topics_are_copied_byte_by_byte(sensor, ride, tmp_path):
    result = om.dewarp_bag(
        ride, tmp_path / "out.mcap", camera=sensor, views=VIEWS, keep_topics=["/wh*", TOPIC]
    )

    def digests(path):
        with AnyReader([path]) as reader:
            connections = [c for c in reader.connections if c.topic in ("/where", TOPIC)]
            return [
                (c.topic, s, hashlib.sha256(data).digest())
                for c, s, data in reader.messages(connections=connections)
            ]

    assert sorted(digests(tmp_path / "out.mcap")) == sorted(digests(ride))
    assert result.copied == 6


def test_mcap_reader_reads_the_bag(sensor, ride, tmp_path):
    om.dewarp_bag(ride, tmp_path / "out.mcap", camera=sensor, views=VIEWS, keep_topics=["/where"])
    with (tmp_path / "out.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        messages = [
            (channel.topic, schema.name, message.log_time)
            for schema, channel, message in reader.iter_messages()
        ]
    assert [t for topic, _, t in messages if topic == "/where"] == list(STAMPS)
    assert {schema for topic, schema, _ in messages if topic.endswith("camera_info")} == {
        "sensor_msgs/msg/CameraInfo"
    }


# -- errors ---------------------------------------------------------------------------------------


def test_interrupt_keeps_the_dewarped_messages(sensor, ride, tmp_path):
    def stop(camera):
        interrupts.request()
        return VIEWS["front"]

    result = om.dewarp_bag(ride, tmp_path / "out.mcap", camera=sensor, views={"front": stop})
    assert (result.exit_code, result.images) == (130, 1)
    assert [s for s, _ in read(tmp_path / "out.mcap")["/rover/cam/front/image_rect"]] == [STAMPS[0]]


@pytest.mark.parametrize("topic", ["/missing", "/where"])
def test_unknown_topics_raise_with_the_available_ones(sensor, ride, tmp_path, topic):
    with pytest.raises(InvalidParameter, match=rf"\(image topics: {TOPIC}\); got {topic}"):
        om.dewarp_bag(ride, tmp_path / "out.mcap", camera=sensor, topic=topic)
    with pytest.raises(
        InvalidParameter,
        match=rf"keep_topics must match a topic of .* \({TOPIC}, /where\); got /odd",
    ):
        om.dewarp_bag(ride, tmp_path / "out.mcap", camera=sensor, keep_topics=["/odd"])


def test_topic_is_required_for_several_image_topics(sensor, images, tmp_path):
    message = raw(STAMPS[0], "rgb8", images[0])
    bag = write(tmp_path / "ride", {"/b/image": [message], "/a/image": [message]})
    with pytest.raises(
        InvalidParameter, match=r"topic must be given .*\(image topics: /a/image, /b/image\)"
    ):
        om.dewarp_bag(bag, tmp_path / "out.mcap", camera=sensor)


@pytest.mark.parametrize(
    ("encoding", "change", "message"),
    [
        ("32FC7", {}, "must be one of mono8, mono16.*; got '32FC7'"),
        (
            "rgb8",
            {"step": 100},
            "must hold 240 x 240 px of rgb8 in rows of 100 bytes; got 172800 bytes",
        ),
        (
            "rgb8",
            {"height": 9},
            "must hold 240 x 9 px of rgb8 in rows of 720 bytes; got 172800 bytes",
        ),
    ],
)
def test_invalid_images_raise_and_leave_no_output(
    sensor, images, tmp_path, encoding, change, message
):
    ros_message = replace(raw(STAMPS[0], encoding, images[0]), **change)
    bag = write(tmp_path / "ride", {TOPIC: [ros_message]})
    with pytest.raises(MediaError, match=message):
        om.dewarp_bag(bag, tmp_path / "out.mcap", camera=sensor)
    assert [p.name for p in tmp_path.iterdir()] == ["ride"]


def test_images_of_another_size_raise(ride, tmp_path):
    with pytest.raises(InvalidParameter, match="240 x 240"):
        om.dewarp_bag(ride, tmp_path / "out.mcap", camera=om.load_sensor("paper-spherical"))


@pytest.mark.parametrize("storage", list(StoragePlugin))
@pytest.mark.parametrize("share", [0.0, 0.2, 0.9])
def test_truncated_bags_raise(sensor, images, tmp_path, storage, share):
    suffix = {StoragePlugin.MCAP: ".mcap", StoragePlugin.SQLITE3: ".db3"}[storage]
    messages = [raw(s, "rgb8", p) for s, p in zip(STAMPS, images, strict=True)]
    whole = single(write(tmp_path / "ride", {TOPIC: messages}, storage), suffix).read_bytes()
    cut = tmp_path / f"cut{suffix}"
    cut.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(MediaError, match=r"cut\.\w+: it is damaged or truncated"):
        om.dewarp_bag(cut, tmp_path / "out.mcap", camera=sensor)
    assert not (tmp_path / "out.mcap").exists()


def test_source_and_existing_folders_are_not_overwritten(sensor, ride, tmp_path):
    with pytest.raises(InvalidParameter, match="output must differ from source"):
        om.dewarp_bag(single(ride), single(ride), camera=sensor)
    with pytest.raises(MediaError, match="the output folder must not exist"):
        om.dewarp_bag(ride, tmp_path, camera=sensor)


# -- command ---------------------------------------------------------------------------------------


def test_command_equals_the_function(sensor, ride, tmp_path):
    om.save_sensor(sensor, tmp_path / "small.toml")
    (tmp_path / "views.toml").write_text(
        "[front]\npan_deg=20\ntilt_deg=-10\nhfov_deg=80\nsize=[96, 72]"
    )
    run = omnimirror(
        "dewarp",
        single(ride),
        "--sensor",
        "small.toml",
        "--views",
        "views.toml",
        "--set",
        "front.hfov_deg=70",
        "-o",
        "out.mcap",
        "--set",
        "bag.keep_topics=/where",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    assert "out.mcap: 3 images of /rover/cam/image_raw, 3 copied messages" in run.stdout
    om.dewarp_bag(ride, tmp_path / "same.mcap", camera=sensor, views={"front": VIEWS["front"]})
    function_messages, command_messages = (
        read(tmp_path / name)["/rover/cam/front/image_rect"] for name in ("same.mcap", "out.mcap")
    )
    assert all(
        np.array_equal(a[1].data, b[1].data)
        for a, b in zip(function_messages, command_messages, strict=True)
    )
    run = omnimirror(
        "dewarp", ride, "--sensor", "small.toml", "--view", "dome", "-o", "dome", cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    assert "/rover/cam/dome/image_rect" in run.stdout


def test_options_for_other_sources_raise(ride, tmp_path):
    arguments = ("dewarp", ride, "--sensor", "paper-spherical", "-o", tmp_path / "out.mcap")
    assert "--set video.crf requires videos; got the recording" in fails(
        *arguments, "--set", "video.crf=20"
    )
    assert "--restore requires images; got the recording" in fails(*arguments, "--restore")
    assert "--pan-deg must not be given with --views" in fails(
        *arguments, "--views", "v.toml", "--pan-deg", "3"
    )
    assert "--set bag.topic requires a ROS bag; got a.png" in fails(
        "dewarp", "a.png", "--sensor", "paper-spherical", "-o", "b.png", "--set", "bag.topic=/a"
    )
    assert fails("dewarp", "nowhere.mcap", *arguments[2:]).endswith(
        "cannot read nowhere.mcap: the file or folder does not exist"
    )
