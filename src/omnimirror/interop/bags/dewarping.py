"""A recording straightened: the pictures of one topic become those of virtual cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from ...arguments import checked, file_name
from ...cameras import Camera
from ...dewarp import Dewarper
from ...dewarp import views as makers
from ...dewarp.contracts import Interpolation
from ...dewarp.screens import Plane, View
from ...errors import InvalidParameter, MediaError
from ...files import is_same_file
from ...media import interrupts
from ...media.progress import FrameProgress, Meter
from ...straighten import Straightening
from ...straighten.border import AskedBorder, BorderColour
from ...straighten.request import Size
from ..named_views import check_name
from ..pinholes import Pinhole, pinhole_of
from .files import damage_told, is_ros1, reading, rosbags, writing
from .messages import STATIC, TF, Messages, mirror_in_optical
from .pictures import COMPRESSED, KINDS, Unpacked, compressed_bytes, picture_of, raw_values

Views: TypeAlias = Mapping[str, View | Callable[[Camera], View]]
"""By name, views, or functions of the camera that give them."""

PANORAMA: Views = {"panorama": makers.panorama}
FAR_MM = 1000.0
"""At which the error of a distant view is told."""
EXACT_PX = 0.005


@dataclass(frozen=True)
class DewarpedBag:
    """What became of a recording.

    Examples
    --------
    >>> done = DewarpedBag("/camera/image_raw", ("/camera/front/image_rect",), pictures=900, passed=0)
    >>> done.exit_code
    0
    """

    topic: str
    """Whose pictures were straightened."""
    topics: tuple[str, ...]
    """What was written of it."""
    pictures: int
    """How many there were."""
    passed: int
    """Messages of other topics."""
    notes: tuple[str, ...] = ()
    """What whoever uses it should know, in sentences."""
    exit_code: int = 0
    """0 where it came to its end; 130 or 143 where it was asked to stop, and what was done is kept."""


@checked
def dewarp_bag(
    source: str | Path,
    output: str | Path,
    *,
    camera: Camera | Callable[[Size], Camera],
    views: Views = PANORAMA,
    topic: str | None = None,
    keep_topics: Sequence[str] = (),
    frame: str | None = None,
    interpolation: Interpolation = "auto",
    border: AskedBorder | None = None,
    keep_lean: bool = False,
    progress: Callable[[FrameProgress], None] | None = None,
) -> DewarpedBag:
    """Straighten the pictures of a recording: rosbag2, MCAP, or a bag of ROS 1; no ROS is needed.

    Of pictures on ``/camera/image_raw`` a view ``front`` becomes ``/camera/front/image_rect``, with
    ``/camera/front/camera_info`` where it is a perspective one, and its frame in ``/tf_static``. Times stay as they
    are, to the nanosecond; so do encodings (what is Bayer or YUV becomes rgb8), and what is compressed stays so.

    Parameters
    ----------
    source
        A file .mcap, .db3 or .bag, or a folder of rosbag2.
    output
        A file .mcap or .db3 (ROS 2), a file .bag (ROS 1), or a new folder (ROS 2).
    camera
        Which took the pictures: a sensor, or a calibrated camera; or a function of the picture's (width, height) in px
        that gives it.
    views
        By name, screens of :mod:`omnimirror.screens` or functions of the camera that give them, such as
        :func:`omnimirror.load_views` reads; a panorama by default.
    topic
        Of the pictures; not needed where there is one only.
    keep_topics
        Other topics to copy unchanged: names, or patterns such as ``"/odom*"``; source and output are then of the
        same ROS version.
    frame
        A frame of the robot that is the mirror's: x forward, y left, z up, from its vertex. By default one is made,
        where the camera's own optical frame (that of the pictures) has it.
    interpolation
        As for :class:`omnimirror.Dewarper`.
    border
        The colour outside the field; black by default.
    keep_lean
        Draw the views as the camera leans, not level.
    progress
        Told a few times a second how far it is.

    Returns
    -------
    DewarpedBag
        What was written.

    Raises
    ------
    InvalidParameter
        There is no such topic, or several of pictures and none was chosen; or pictures are not of the camera's size.
    MediaError
        The recording cannot be read, or has pictures of an encoding that is not known.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.dewarp_bag("nowhere.mcap", "straight.mcap", camera=om.load_sensor("paper-spherical"))
    Traceback (most recent call last):
    ...
    omnimirror.errors.MediaError: there is no recording nowhere.mcap
    """
    colour = None if border is None else BorderColour.of(border)
    how = Straightening(camera, interpolation=interpolation, border=colour, keep_lean=keep_lean)
    chosen = Chosen(views, topic, tuple(keep_topics), frame)
    return straighten_bag(file_name("source", source), file_name("output", output), how, chosen, progress)


@dataclass(frozen=True)
class Chosen:
    """What is made of a recording; as for :func:`dewarp_bag`."""

    views: Views
    topic: str | None = None
    keep_topics: tuple[str, ...] = ()
    frame: str | None = None

    def __post_init__(self) -> None:
        for name in self.views:
            check_name(name)


def straighten_bag(
    source: Path,
    output: Path,
    how: Straightening,
    chosen: Chosen,
    progress: Callable[[FrameProgress], None] | None = None,
) -> DewarpedBag:
    """The same, asked for as a whole; the view of ``how`` is left to those chosen."""
    if is_same_file(source, output):
        raise InvalidParameter(f"{output} is the recording to straighten; write to another name")
    with reading(source) as reader:
        pictures = _pictures(reader, chosen.topic, source)
        others = _others(reader, chosen.keep_topics, source, output)
        meter = Meter(progress, pictures.msgcount or None)
        with interrupts.deferred(), writing(output, source) as writer:
            rig = _Rig(how, chosen, pictures, _Recorder(writer, is_ros1(output)))
            passed = _run(reader, pictures, others, rig, meter, source)
            exit_code = interrupts.exit_code()
    meter.report()
    return DewarpedBag(pictures.topic, tuple(rig.recorder.topics), meter.done, passed, tuple(rig.notes), exit_code)


def _pictures(reader: Any, topic: str | None, source: Path) -> Any:
    """The connection whose pictures are straightened."""
    shown = {c.topic: c for c in reader.connections if c.msgtype in KINDS}
    known = f"topics with pictures are {', '.join(sorted(shown))}" if shown else "no topic of it has pictures"
    if topic is not None:
        if topic in shown:
            return shown[topic]
        if other := next((c.msgtype for c in reader.connections if c.topic == topic), None):
            raise InvalidParameter(f"the topic {topic} of {source} holds {other} and no pictures; {known}")
        raise InvalidParameter(f"{source} has no topic {topic}; {known}")
    if len(shown) != 1:
        raise InvalidParameter(f"say which topic of {source} is to be straightened; {known}")
    return next(iter(shown.values()))


def _others(reader: Any, patterns: Iterable[str], source: Path, output: Path) -> list[Any]:
    """Return the connections to copy; messages of ROS 1 and ROS 2 are not converted into each other."""
    found: dict[tuple[str, str], Any] = {}
    for pattern in patterns:
        fit = [c for c in reader.connections if fnmatchcase(c.topic, pattern)]
        if not fit:
            there = ", ".join(sorted({c.topic for c in reader.connections}))
            raise InvalidParameter(f"no topic of {source} is called {pattern}; there are {there}")
        found |= {(c.topic, c.msgtype): c for c in fit}
    if found and reader.is2 == is_ros1(output):
        versions = ("ROS 2", "ROS 1", ".bag") if is_ros1(output) is False else ("ROS 1", "ROS 2", ".mcap or .db3")
        raise InvalidParameter(
            f"{output} is a bag of {versions[0]}, and the topics to keep are messages of {versions[1]}; "
            f"write {versions[2]}, keep no topics, or convert {source} with rosbags-convert first"
        )
    return list(found.values())


def _run(reader: Any, pictures: Any, others: list[Any], rig: _Rig, meter: Meter, source: Path) -> int:
    """Straighten every picture, and pass on what is kept; how many messages that were."""
    kept, shown, passed = set(map(_key, others)), _key(pictures), 0
    wanted = [c for c in reader.connections if _key(c) in kept | {shown}]
    for connection, timestamp, data in _messages(reader, wanted, source):
        if _key(connection) in kept:
            rig.recorder.pass_on(reader, connection, timestamp, data)
            passed += 1
        if _key(connection) == shown:
            with damage_told(source):
                message = reader.deserialize(data, connection.msgtype)
            rig.straighten(message, timestamp)
            meter.step()
        if interrupts.is_pending():
            return passed
    if not meter.done:
        raise MediaError(f"the topic {pictures.topic} of {source} holds no message")
    return passed


def _key(connection: Any) -> tuple[str, str]:
    return connection.topic, connection.msgtype


def _messages(reader: Any, wanted: list[Any], source: Path) -> Any:
    """The messages of a bag; that it is damaged further on is told where it shows."""
    messages = reader.messages(connections=wanted)
    while True:
        with damage_told(source):
            found = next(messages, None)
        if found is None:
            return
        yield found


def _store(of_ros1: bool) -> Any:
    """Return the message types of ROS 1 Noetic, with those of TF, or of ROS 2 Humble."""
    types = rosbags().typesys
    store = types.get_typestore(types.Stores.ROS1_NOETIC if of_ros1 else types.Stores.ROS2_HUMBLE)
    if TF not in store.types:
        store.register(types.get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


class _Recorder:
    """Writer of messages to a bag of ROS 1 or ROS 2, one connection per topic."""

    def __init__(self, writer: Any, of_ros1: bool) -> None:
        self.messages = Messages(_store(of_ros1), of_ros1)
        self.topics: dict[str, Any] = {}
        self._writer = writer

    def write(self, topic: str, message: Any, timestamp: int, *, is_latched: bool = False) -> None:
        """Write a message made by :attr:`messages`."""
        if topic not in self.topics:
            delivery = {"latching": int(is_latched)} if self.messages.is_ros1 else _quality(is_latched)
            self.topics[topic] = self._writer.add_connection(
                topic, message.__msgtype__, typestore=self.messages.store, **delivery
            )
        elif self.topics[topic].msgtype != message.__msgtype__:
            raise InvalidParameter(
                f"the topic {topic} of a view is also kept, with type {self.topics[topic].msgtype}; do not keep it"
            )
        self._writer.write(self.topics[topic], timestamp, self.messages.serialized(message))

    def pass_on(self, reader: Any, connection: Any, timestamp: int, data: bytes) -> None:
        """Write a message of the source unchanged; both bags are of the same ROS version."""
        if connection.topic not in self.topics:
            if self.messages.is_ros1:
                as_before = {
                    "msgdef": connection.msgdef.data, "md5sum": connection.digest,
                    "callerid": connection.ext.callerid, "latching": connection.ext.latching,
                }  # fmt: skip
            else:
                as_before = {"typestore": reader.typestore, "offered_qos_profiles": connection.ext.offered_qos_profiles}
            self.topics[connection.topic] = self._writer.add_connection(
                connection.topic, connection.msgtype, **as_before
            )
        self._writer.write(self.topics[connection.topic], timestamp, data)


def _quality(is_latched: bool) -> dict[str, Any]:
    return {"offered_qos_profiles": [_latched()] if is_latched else ()}


class _VirtualCamera(NamedTuple):
    """One view."""

    name: str
    dewarp: Dewarper
    pinhole: Pinhole | None
    """None of a view that is no perspective one."""


class _Rig:
    """The virtual cameras of a recording."""

    def __init__(self, how: Straightening, chosen: Chosen, pictures: Any, recorder: _Recorder) -> None:
        self.how, self.chosen, self.topic, self.recorder = how, chosen, pictures.topic, recorder
        self.notes: list[str] = []
        base = self.topic.removesuffix("/compressed") if pictures.msgtype == COMPRESSED else self.topic
        self._space = base.rpartition("/")[0]
        self._cameras: list[_VirtualCamera] = []

    def straighten(self, message: Any, timestamp: int) -> None:
        """Write every view of the picture in a message."""
        picture = picture_of(message, self.topic)
        stamp, optical = message.header.stamp, message.header.frame_id
        if not self._cameras:
            self._set_up(picture, stamp, optical, timestamp)
        for camera in self._cameras:
            header = self.recorder.messages.header(stamp, _frame_of(optical, camera.name))
            straight = camera.dewarp(picture.image)
            topic = f"{self._space}/{camera.name}/image_rect"
            if picture.coding.startswith("."):
                of = self.recorder.messages.compressed(header, *compressed_bytes(straight, picture.coding))
                self.recorder.write(f"{topic}/compressed", of, timestamp)
            else:
                of = self.recorder.messages.image(header, *raw_values(straight, picture.coding))
                self.recorder.write(topic, of, timestamp)
            if camera.pinhole is not None:
                info = self.recorder.messages.camera_info(header, camera.pinhole)
                self.recorder.write(f"{self._space}/{camera.name}/camera_info", info, timestamp)

    def _set_up(self, picture: Unpacked, stamp: Any, optical: str, timestamp: int) -> None:
        """Once the first picture tells what there is: how views are drawn, and where they stand."""
        height, width = picture.image.shape[:2]
        camera = self.how.drawing(self.how.camera_of((width, height)))
        border = self.how.border.of_picture(picture.image) if self.how.border else 0
        frame, make, transforms = self.chosen.frame, self.recorder.messages, []
        mirror = frame or f"{optical or 'camera'}_mirror"
        if frame is None and (place := mirror_in_optical(camera)) is not None:
            transforms.append(make.transform(stamp, optical or "camera", mirror, *place))
        for name, wanted in self.chosen.views.items():
            view = wanted(camera) if callable(wanted) else wanted
            dewarp = self.how.dewarper(camera, view, border, keep_map=True)
            pinhole = pinhole_of(camera, view, self.how.viewpoint) if isinstance(view, Plane) else None
            self._cameras.append(_VirtualCamera(name, dewarp, pinhole))
            if pinhole is None:
                self.notes.append(f"{name}: no camera_info can express the {view}, and it has none")
                continue
            self.notes.append(_told(name, view, pinhole))
            child = _frame_of(optical, name)
            transforms.append(make.transform(stamp, mirror, child, pinhole.rotation, pinhole.position_mm))
        if any(camera.pinhole for camera in self._cameras):
            self.recorder.write(STATIC, make.tree(transforms), timestamp, is_latched=True)


def _frame_of(optical: str, name: str) -> str:
    """The frame of a view's pictures, by REP 103's suffix."""
    return f"{optical.removesuffix('_optical_frame') or 'camera'}_{name}_optical_frame"


def _told(name: str, view: Any, pinhole: Pinhole) -> str:
    if view.is_distant:
        return f"{name}: its camera_info is exact far away, and up to {pinhole.error_px(FAR_MM):.2g} px off at 1 m"
    at, far = view.distance_mm, 2 * view.distance_mm
    off = pinhole.error_px(at)
    there = "exact" if off < EXACT_PX else f"up to {off:.2g} px off"  # as where all is seen from a single viewpoint
    return (
        f"{name}: its camera_info is {there} at {at:g} mm, and up to {pinhole.error_px(far):.2g} px off at {far:g} mm"
    )


def _latched() -> Any:
    """The quality of service of /tf_static: whoever comes late hears it too."""
    from rosbags import interfaces as of

    never = of.QosTime(9223372036, 854775807)
    return of.Qos(
        of.QosHistory.KEEP_LAST, 1, of.QosReliability.RELIABLE, of.QosDurability.TRANSIENT_LOCAL, never, never,
        of.QosLiveliness.AUTOMATIC, never, False,
    )  # fmt: skip
