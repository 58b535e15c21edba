"""Dewarping of ROS bags: the images of one topic become those of virtual cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...base import interrupts
from ...base.arguments import file_name, validate_arguments
from ...base.errors import InvalidParameter, MediaError
from ...base.files import is_same_file
from ...base.logs import OnProgress
from ...base.results import Result
from ...base.typing import Array
from ...cameras.camera import Camera, Mount
from ...dewarp import Dewarper
from ...dewarp import views as view_functions
from ...dewarp.interfaces import Interpolation
from ...dewarp.request import BorderArgument, BorderColour, DewarpRequest, Size
from ...dewarp.screens import Plane, View
from ...io.images import decoded, encoded
from ...io.progress import ProgressMeter
from ...optics.sensor import Sensor
from ..named_views import check_view_name
from ..pinholes import EquivalentPinhole, equivalent_pinhole
from .bag_files import create_bag, is_ros1, open_bag, read_errors, rosbags

Views: TypeAlias = Mapping[str, View | Callable[[Camera], View]]
"""Views, or functions of the camera that return them, by name."""

PANORAMA: Views = {"panorama": view_functions.panorama}
PARALLAX_DISTANCE_MM = 1000.0
"""Object distance at which the camera_info error of a distant view is reported."""
EXACT_PX = 0.005
"""Error below which a view is reported as exact."""


@dataclass(frozen=True)
class DewarpedBag(Result):
    """Result of :func:`dewarp_bag`.

    Examples
    --------
    >>> result = DewarpedBag("/camera/image_raw", ("/camera/front/image_rect",), images=900, copied=0)
    >>> result.exit_code
    0
    """

    topic: str
    """Topic of the dewarped images."""
    output_topics: tuple[str, ...]
    """Topics in the output bag."""
    images: int
    """Number of dewarped images."""
    copied: int
    """Number of messages copied from other topics."""
    notes: tuple[str, ...] = ()
    """Accuracy of camera_info, one sentence per view."""
    exit_code: int = 0
    """0 after the end of the bag; 130 or 143 after SIGINT or SIGTERM, with a valid partial bag."""


@dataclass(frozen=True)
class BagSelection:
    """Views and topics of the output bag; parameters as for :func:`dewarp_bag`."""

    views: Views
    topic: str | None = None
    keep_topics: tuple[str, ...] = ()
    mirror_frame: str | None = None


@validate_arguments
def dewarp_bag(
    source: str | Path,
    output: str | Path,
    *,
    camera: Camera | Callable[[Size], Camera],
    views: Views = PANORAMA,
    topic: str | None = None,
    keep_topics: Sequence[str] = (),
    mirror_frame: str | None = None,
    interpolation: Interpolation = "auto",
    border: BorderArgument | None = None,
    keep_tilt: bool = False,
    on_progress: OnProgress | None = None,
) -> DewarpedBag:
    """Dewarp the images of a rosbag2, MCAP or ROS 1 bag without a ROS installation.

    A view ``front`` of images on ``/camera/image_raw`` is written to ``/camera/front/image_rect``.
    A perspective view also has ``/camera/front/camera_info`` and a frame in ``/tf_static``. Time
    stamps are preserved to the nanosecond. Encodings are preserved (Bayer and YUV become rgb8), as
    is compression.

    Parameters
    ----------
    source
        File .mcap, .db3 or .bag, or rosbag2 folder.
    output
        File .mcap or .db3 (ROS 2), file .bag (ROS 1), or new folder (ROS 2).
    camera
        Sensor or calibrated camera of the images, or a function of the image size (width, height)
        in px that returns it.
    views
        Views by name: screens of :mod:`omnimirror.screens`, or functions of the camera, such as
        the result of :func:`omnimirror.load_views`; default: a panorama.
    topic
        Topic of the images; may be omitted if the bag has only one image topic.
    keep_topics
        Names or patterns such as ``"/odom*"`` of other topics to copy unchanged; requires that
        source and output are of the same ROS version.
    mirror_frame
        Existing TF frame of the mirror (x forward, y left, z up, origin at the vertex); default: a
        new frame below the optical frame of the images.
    interpolation
        As for :class:`omnimirror.Dewarper`.
    border
        Colour outside the field; default: black.
    keep_tilt
        Keep the tilt of the camera instead of levelling the views.
    on_progress
        Called several times per second.

    Returns
    -------
    DewarpedBag
        Written topics and number of messages.

    Raises
    ------
    InvalidParameter
        If the topic does not exist or is ambiguous, or the images do not have the size of the
        camera.
    MediaError
        If the bag cannot be read or an image encoding is unknown.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.dewarp_bag("missing.mcap", "views.mcap", camera=om.load_sensor("paper-spherical"))
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.MediaError: cannot read missing.mcap: the file or folder does not exist
    """
    colour = None if border is None else BorderColour.of(border)
    dewarping = DewarpRequest(
        camera, interpolation=interpolation, border=colour, keep_tilt=keep_tilt
    )
    for name in views:
        check_view_name(name)
    selection = BagSelection(views, topic, tuple(keep_topics), mirror_frame)
    source, output = file_name("source", source), file_name("output", output)
    return run_bag_dewarping(source, output, dewarping, selection, on_progress)


def run_bag_dewarping(
    source: Path,
    output: Path,
    dewarping: DewarpRequest,
    selection: BagSelection,
    on_progress: OnProgress | None = None,
) -> DewarpedBag:
    """Dewarp a bag as specified by a selection; the view of ``dewarping`` is not used."""
    if is_same_file(source, output):
        raise InvalidParameter(f"output must differ from source; got {output}")
    with open_bag(source) as reader:
        connection = _image_connection(reader, selection.topic, source)
        others = _copied_connections(reader, selection.keep_topics, source, output)
        meter = ProgressMeter(on_progress, connection.msgcount or None)
        with interrupts.deferred(), create_bag(output, source) as writer:
            recorder = _Recorder(writer, is_ros1(output))
            rig = VirtualRig(
                dewarping, selection.views, connection.topic, recorder, selection.mirror_frame
            )
            copied = _process_messages(reader, connection, others, rig, recorder, meter, source)
            exit_code = interrupts.exit_code()
    meter.report()
    topics = tuple(recorder.connections)
    return DewarpedBag(connection.topic, topics, meter.done, copied, tuple(rig.notes), exit_code)


def _image_connection(reader: Any, topic: str | None, source: Path) -> Any:
    """Return the connection of the images to dewarp."""
    candidates = {c.topic: c for c in reader.connections if c.msgtype in IMAGE_TYPES}
    available = ", ".join(sorted(candidates))
    topics = f"image topics: {available}" if candidates else "it has no image topics"
    if topic is not None:
        if topic not in candidates:
            raise InvalidParameter(
                f"topic must be an image topic of {source} ({topics}); got {topic}"
            )
        return candidates[topic]
    if len(candidates) != 1:
        raise InvalidParameter(f"topic must be given for {source} ({topics})")
    return next(iter(candidates.values()))


def _copied_connections(
    reader: Any, patterns: Iterable[str], source: Path, output: Path
) -> list[Any]:
    """Return the connections to copy; messages are not converted between ROS 1 and ROS 2."""
    selected: dict[tuple[str, str], Any] = {}
    for pattern in patterns:
        matches = [c for c in reader.connections if fnmatchcase(c.topic, pattern)]
        if not matches:
            available = ", ".join(sorted({c.topic for c in reader.connections}))
            raise InvalidParameter(
                f"keep_topics must match a topic of {source} ({available}); got {pattern}"
            )
        selected |= {_key(c): c for c in matches}
    if selected and reader.is2 == is_ros1(output):
        written, retained, suffix = "ROS 2", "ROS 1", ".bag"
        if is_ros1(output):
            written, retained, suffix = "ROS 1", "ROS 2", ".mcap or .db3"
        raise InvalidParameter(
            f"topics to keep must be of the ROS version of the output; {output} is a "
            f"{written} bag and the topics are {retained} messages; write {suffix}, keep no "
            f"topics, or convert {source} with rosbags-convert"
        )
    return list(selected.values())


def _process_messages(
    reader: Any,
    images: Any,
    others: list[Any],
    rig: VirtualRig,
    recorder: _Recorder,
    meter: ProgressMeter,
    source: Path,
) -> int:
    """Dewarp all images and copy other messages; return the number of copied messages."""
    keys, image_key, copied = set(map(_key, others)), _key(images), 0
    connections = [c for c in reader.connections if _key(c) in keys | {image_key}]
    for connection, timestamp, data in _messages(reader, connections, source):
        if _key(connection) in keys:
            recorder.copy(reader, connection, timestamp, data)
            copied += 1
        if _key(connection) == image_key:
            with read_errors(source):
                message = reader.deserialize(data, connection.msgtype)
            rig.dewarp(message, timestamp)
            meter.step()
        if interrupts.is_pending():
            return copied
    if not meter.done:
        raise MediaError(f"the topic {images.topic} of {source} has no messages")
    return copied


def _key(connection: Any) -> tuple[str, str]:
    return connection.topic, connection.msgtype


def _messages(reader: Any, connections: list[Any], source: Path) -> Any:
    """Yield the messages of connections; read errors become MediaError."""
    messages = reader.messages(connections=connections)
    while True:
        with read_errors(source):
            message = next(messages, None)
        if message is None:
            return
        yield message


class _Recorder:
    """Writer of messages to a bag of ROS 1 or ROS 2 with one connection per topic."""

    def __init__(self, writer: Any, ros1: bool) -> None:
        self.factory = MessageFactory(_type_store(ros1), ros1)
        self.connections: dict[str, Any] = {}
        self._writer = writer

    def write(self, topic: str, message: Any, timestamp: int, *, latched: bool = False) -> None:
        """Write a message of :attr:`factory`."""
        if topic not in self.connections:
            if self.factory.ros1:
                delivery: dict[str, Any] = {"latching": int(latched)}
            else:
                delivery = {"offered_qos_profiles": [_latched_qos()] if latched else ()}
            self.connections[topic] = self._writer.add_connection(
                topic, message.__msgtype__, typestore=self.factory.store, **delivery
            )
        elif self.connections[topic].msgtype != message.__msgtype__:
            raise InvalidParameter(
                f"keep_topics must not include the topic {topic} of a view; it has the "
                f"type {self.connections[topic].msgtype}"
            )
        self._writer.write(self.connections[topic], timestamp, self.factory.serialize(message))

    def copy(self, reader: Any, connection: Any, timestamp: int, data: bytes) -> None:
        """Write a message of the source unchanged; both bags are of the same ROS version."""
        if connection.topic not in self.connections:
            ext = connection.ext
            if self.factory.ros1:
                options = {
                    "msgdef": connection.msgdef.data,
                    "md5sum": connection.digest,
                    "callerid": ext.callerid,
                    "latching": ext.latching,
                }
            else:
                options = {
                    "typestore": reader.typestore,
                    "offered_qos_profiles": ext.offered_qos_profiles,
                }
            self.connections[connection.topic] = self._writer.add_connection(
                connection.topic, connection.msgtype, **options
            )
        self._writer.write(self.connections[connection.topic], timestamp, data)


def _type_store(ros1: bool) -> Any:
    """Return the message types of ROS 1 Noetic, with those of TF, or of ROS 2 Humble."""
    types = rosbags().typesys
    store = types.get_typestore(types.Stores.ROS1_NOETIC if ros1 else types.Stores.ROS2_HUMBLE)
    if TF_MESSAGE not in store.types:
        definition = "geometry_msgs/TransformStamped[] transforms"
        store.register(types.get_types_from_msg(definition, TF_MESSAGE))
    return store


def _latched_qos() -> Any:
    """Return the quality of service of /tf_static: transient local, so late subscribers get it."""
    from rosbags import interfaces as ros

    infinite = ros.QosTime(9223372036, 854775807)
    return ros.Qos(
        ros.QosHistory.KEEP_LAST,
        1,
        ros.QosReliability.RELIABLE,
        ros.QosDurability.TRANSIENT_LOCAL,
        infinite,
        infinite,
        ros.QosLiveliness.AUTOMATIC,
        infinite,
        False,
    )


class _VirtualCamera(NamedTuple):
    """One view of the bag."""

    name: str
    dewarper: Dewarper
    pinhole: EquivalentPinhole | None
    """None for views that are not perspective."""


class MessageSink(Protocol):
    """Destination of messages: a bag or the publishers of a node."""

    factory: MessageFactory

    def write(self, topic: str, message: Any, timestamp: int, *, latched: bool = False) -> None:
        """Write a message of :attr:`factory`."""


class VirtualRig:
    """Virtual cameras that dewarp the images of a topic, created with the first image.

    Parameters
    ----------
    dewarping
        Camera and resampling.
    views
        Views by name.
    topic
        Topic of the images; outputs are in its namespace.
    sink
        Destination of images, camera_info and transforms.
    mirror_frame
        Existing TF frame of the mirror; None for a new frame.
    """

    def __init__(
        self,
        dewarping: DewarpRequest,
        views: Views,
        topic: str,
        sink: MessageSink,
        mirror_frame: str | None = None,
    ) -> None:
        self.dewarping, self.views, self.topic = dewarping, views, topic
        self.sink, self.mirror_frame = sink, mirror_frame
        self.notes: list[str] = []
        self._namespace = topic.removesuffix("/compressed").rpartition("/")[0]
        self._cameras: list[_VirtualCamera] = []

    def dewarp(self, message: Any, timestamp: int = 0) -> None:
        """Write every view of the image in a message.

        Raises
        ------
        InvalidParameter
            If the image does not have the size of the camera, or a view is outside the field.
        MediaError
            If the encoding is unknown, or the message is inconsistent.
        """
        source = decode_image(message, self.topic)
        stamp, optical_frame = message.header.stamp, message.header.frame_id
        if not self._cameras:
            self._create_cameras(source, stamp, optical_frame, timestamp)
        factory = self.sink.factory
        for camera in self._cameras:
            header = factory.header(stamp, _optical_frame(optical_frame, camera.name))
            view = camera.dewarper(source.image)
            namespace = f"{self._namespace}/{camera.name}"
            if source.is_compressed:
                content = encode_compressed(view, source.encoding)
                image = factory.compressed_image(header, *content)
                self.sink.write(f"{namespace}/image_rect/compressed", image, timestamp)
            else:
                image = factory.image(header, *encode_raw(view, source.encoding))
                self.sink.write(f"{namespace}/image_rect", image, timestamp)
            if camera.pinhole is not None:
                info = factory.camera_info(header, camera.pinhole)
                self.sink.write(f"{namespace}/camera_info", info, timestamp)

    def _create_cameras(
        self, source: MessageImage, stamp: Any, optical_frame: str, timestamp: int
    ) -> None:
        """Create the views for the size of the first image and write their frames."""
        height, width = source.image.shape[:2]
        camera = self.dewarping.view_camera(self.dewarping.camera_of((width, height)))
        border = self.dewarping.border.for_image(source.image) if self.dewarping.border else 0
        factory, transforms = self.sink.factory, []
        parent = optical_frame or "camera"
        mirror_frame = self.mirror_frame or f"{parent}_mirror"
        pose = mirror_in_optical_frame(camera)
        if self.mirror_frame is None and pose is not None:
            transforms.append(factory.transform(stamp, parent, mirror_frame, *pose))
        cameras = []
        for name, view in self.views.items():
            screen = view(camera) if callable(view) else view
            dewarper = self.dewarping.dewarper(camera, screen, border, keep_map=True)
            pinhole = None
            if isinstance(screen, Plane):
                pinhole = equivalent_pinhole(camera, screen, self.dewarping.viewpoint)
            cameras.append(_VirtualCamera(name, dewarper, pinhole))
            if pinhole is None:
                self.notes.append(
                    f"{name}: no camera_info, because the {screen} is no pinhole image"
                )
                continue
            self.notes.append(_accuracy_note(name, screen, pinhole))
            child = _optical_frame(optical_frame, name)
            transforms.append(
                factory.transform(stamp, mirror_frame, child, pinhole.rotation, pinhole.position_mm)
            )
        self._cameras = cameras
        if any(camera.pinhole for camera in cameras):
            message = factory.tf_message(transforms)
            self.sink.write(TF_STATIC, message, timestamp, latched=True)


def _optical_frame(optical_frame: str, name: str) -> str:
    """Return the frame of a view with the suffix of REP 103."""
    base = optical_frame.removesuffix("_optical_frame") or "camera"
    return f"{base}_{name}_optical_frame"


def _accuracy_note(name: str, view: Any, pinhole: EquivalentPinhole) -> str:
    """Return the accuracy of the camera_info of a view as a sentence."""
    if view.is_distant:
        error = pinhole.error_px(PARALLAX_DISTANCE_MM)
        return f"{name}: camera_info is exact at infinity, error up to {error:.2g} px at 1 m"
    near, far = view.distance_mm, 2 * view.distance_mm
    error = pinhole.error_px(near)
    accuracy = "exact" if error < EXACT_PX else f"within {error:.2g} px"
    return f"{name}: camera_info is {accuracy} at {near:g} mm, error up to {pinhole.error_px(far):.2g} px at {far:g} mm"


# -- Messages: images and their encodings, camera_info, and transforms of the TF tree --------------


Image = NDArray[Any]

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = (IMAGE, COMPRESSED_IMAGE)
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
TF_STATIC = "/tf_static"

# Images


class Encoding(NamedTuple):
    """Pixel format of an image message."""

    depth: str
    channels: int
    to_rgb: int | None = None
    """OpenCV conversion to RGB, RGBA or grey; None if no conversion is needed."""
    from_rgb: int | None = None
    """Inverse conversion; without one, dewarped images are rgb8 or rgb16."""


ENCODINGS = {
    "mono8": Encoding("uint8", 1),
    "mono16": Encoding("uint16", 1),
    "8UC1": Encoding("uint8", 1),
    "16UC1": Encoding("uint16", 1),
    "rgb8": Encoding("uint8", 3),
    "rgb16": Encoding("uint16", 3),
    "rgba8": Encoding("uint8", 4),
    "bgr8": Encoding("uint8", 3, cv2.COLOR_BGR2RGB, cv2.COLOR_RGB2BGR),
    "8UC3": Encoding("uint8", 3, cv2.COLOR_BGR2RGB, cv2.COLOR_RGB2BGR),
    "bgr16": Encoding("uint16", 3, cv2.COLOR_BGR2RGB, cv2.COLOR_RGB2BGR),
    "bgra8": Encoding("uint8", 4, cv2.COLOR_BGRA2RGBA, cv2.COLOR_RGBA2BGRA),
    "yuv422": Encoding("uint8", 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": Encoding("uint8", 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": Encoding("uint8", 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": Encoding("uint8", 2, cv2.COLOR_YUV2RGB_YUY2),
    # OpenCV names a Bayer pattern by its second row, beginning with the second column.
    **{
        f"bayer_{pattern}{bits}": Encoding(f"uint{bits}", 1, conversion)
        for bits in (8, 16)
        for pattern, conversion in {
            "rggb": cv2.COLOR_BayerBG2RGB,
            "bggr": cv2.COLOR_BayerRG2RGB,
            "gbrg": cv2.COLOR_BayerGR2RGB,
            "grbg": cv2.COLOR_BayerGB2RGB,
        }.items()
    },
}
"""Encodings by ROS name (sensor_msgs/image_encodings.hpp)."""


class MessageImage(NamedTuple):
    """Decoded image of a message."""

    image: Image
    """(h, w), (h, w, 3) or (h, w, 4), RGB(A)."""
    encoding: str
    """Encoding of a raw message, or file suffix of a compressed one."""

    @property
    def is_compressed(self) -> bool:
        """True if the message was a CompressedImage."""
        return self.encoding.startswith(".")


def decode_image(message: Any, topic: str) -> MessageImage:
    """Return the image of a raw or compressed message.

    Raises
    ------
    MediaError
        If the encoding is unknown or the number of bytes does not match the size.
    """
    if hasattr(message, "encoding"):
        return _decode_raw(message, topic)
    return _decode_compressed(message, topic)


def _decode_raw(message: Any, topic: str) -> MessageImage:
    name, width, height, step = message.encoding, message.width, message.height, message.step
    encoding = ENCODINGS.get(name)
    if encoding is None:
        raise MediaError(
            f"the encoding of {topic} must be one of {', '.join(ENCODINGS)}; got {name!r}"
        )
    dtype = np.dtype(encoding.depth).newbyteorder(">" if message.is_bigendian else "<")
    row_bytes = width * encoding.channels * dtype.itemsize
    if not width or not height or step < row_bytes or len(message.data) != height * step:
        raise MediaError(
            f"an image of {topic} must hold {width} x {height} px of {name} in rows of {step} "
            f"bytes; got {len(message.data)} bytes"
        )
    rows = np.asarray(message.data, np.uint8).reshape(height, step)[:, :row_bytes]
    image = np.ascontiguousarray(rows).view(dtype).astype(encoding.depth, copy=False)
    if encoding.channels > 1:
        image = image.reshape(height, width, encoding.channels)
    if encoding.to_rgb is not None:
        image = np.asarray(cv2.cvtColor(image, encoding.to_rgb))
    return MessageImage(image, name)


def _decode_compressed(message: Any, topic: str) -> MessageImage:
    label = message.format.lower()
    suffixes = {"png": ".png", "jpeg": ".jpg", "jpg": ".jpg"}
    suffix = next((suffix for word, suffix in suffixes.items() if word in label), None)
    if suffix is None or "compresseddepth" in label:
        raise MediaError(f"the compression of {topic} must be jpeg or png; got {message.format!r}")
    return MessageImage(decoded(f"of {topic}", bytes(message.data)), suffix)


def encode_raw(image: Image, name: str) -> tuple[str, Image]:
    """Return the encoding of a dewarped image and its values (h, w) or (h, w, c) in that order."""
    encoding = ENCODINGS[name]
    if encoding.to_rgb is None:
        return name, image
    if encoding.from_rgb is None:
        return ("rgb8" if image.dtype == np.uint8 else "rgb16"), image
    return name, np.asarray(cv2.cvtColor(image, encoding.from_rgb))


def encode_compressed(image: Image, suffix: str) -> tuple[str, bytes]:
    """Return the format label of a compressed message, as ROS image_transport, and its data."""
    bits, codec = 8 * image.itemsize, "png" if suffix == ".png" else "jpeg"
    original, stored = ("mono", "mono") if image.ndim == 2 else ("rgb", "bgr")
    label = f"{original}{bits}; {codec} compressed {stored}{bits}"
    return label, encoded(image, suffix)


# Camera information and transforms


class MessageFactory:
    """Factory of messages of ROS 2 or ROS 1.

    Parameters
    ----------
    store
        Type store of rosbags.
    ros1
        Create and serialise messages for a bag of ROS 1.
    """

    def __init__(self, store: Any, ros1: bool = False) -> None:
        self.store, self.types, self.ros1 = store, store.types, ros1

    def serialize(self, message: Any) -> bytes:
        """Return the bytes of a message as stored in a bag."""
        serialize = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        return bytes(serialize(message, message.__msgtype__))

    def header(self, stamp: Any, frame: str) -> Any:
        """Return a Header with a copy of a stamp, which may be of the other ROS version."""
        time = self.types["builtin_interfaces/msg/Time"](sec=stamp.sec, nanosec=stamp.nanosec)
        sequence = {"seq": 0} if self.ros1 else {}
        return self.types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **sequence)

    def camera_info(self, header: Any, pinhole: EquivalentPinhole) -> Any:
        """Return the CameraInfo of a pinhole camera without distortion."""
        width, height = pinhole.size
        roi = self.types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        matrices = {
            "d": np.zeros(5),
            "k": pinhole.matrix.ravel(),
            "r": np.eye(3).ravel(),
            "p": np.hstack([pinhole.matrix, np.zeros((3, 1))]).ravel(),
        }
        if self.ros1:
            matrices = {name.upper(): values for name, values in matrices.items()}
        return self.types[CAMERA_INFO](
            header=header,
            height=height,
            width=width,
            distortion_model="plumb_bob",
            **matrices,
            binning_x=0,
            binning_y=0,
            roi=roi,
        )

    def image(self, header: Any, encoding: str, values: Image) -> Any:
        """Return an Image."""
        height, width = values.shape[:2]
        little_endian = values.astype(values.dtype.newbyteorder("<"), copy=False)
        data = np.ascontiguousarray(little_endian).view(np.uint8).ravel()
        return self.types[IMAGE](
            header=header,
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=data.size // height,
            data=data,
        )

    def compressed_image(self, header: Any, label: str, data: bytes) -> Any:
        """Return a CompressedImage."""
        return self.types[COMPRESSED_IMAGE](
            header=header, format=label, data=np.frombuffer(data, np.uint8)
        )

    def transform(
        self, stamp: Any, parent: str, child: str, rotation: Array, position_mm: Array
    ) -> Any:
        """Return a TransformStamped; the columns of ``rotation`` are the child axes."""
        x, y, z = (float(value) / 1000.0 for value in position_mm)
        qx, qy, qz, qw = (float(value) for value in Rotation.from_matrix(rotation).as_quat())
        types = self.types
        return types["geometry_msgs/msg/TransformStamped"](
            header=self.header(stamp, parent),
            child_frame_id=child,
            transform=types["geometry_msgs/msg/Transform"](
                translation=types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
                rotation=types["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
            ),
        )

    def tf_message(self, transforms: list[Any]) -> Any:
        """Return a TFMessage."""
        return self.types[TF_MESSAGE](transforms=transforms)


def mirror_in_optical_frame(camera: Camera) -> tuple[Array, Array] | None:
    """Return the pose of the mirror frame in the optical frame of the camera below the mirror.

    The mirror frame is x forward, y left, z up, with the origin at the vertex. For calibrated
    models and telecentric lenses, which have no finite mirror distance, both origins coincide.

    Returns
    -------
    rotation, position_mm
        (3, 3) array and (3,) array, mm; None if the mount of the camera is unknown.
    """
    mount = getattr(camera, "mount", None)
    if not isinstance(mount, Mount):
        return None
    distance_mm = camera.mirror_distance_mm if isinstance(camera, Sensor) else 0.0
    if not np.isfinite(distance_mm):
        distance_mm = 0.0
    return mount.rotation().T, np.array([0.0, 0.0, distance_mm])
