"""Messages between server and Look tab: cameras as tables, sources, streams."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ...cameras.frames import CameraLooks
from .messages import ClientMessage, Message

Vector = tuple[float, float, float]
Size = tuple[int, int]
Pixel = tuple[float, float]
Kind = Literal["sensor", "ocam", "ball"]


class MountOf(ClientMessage):
    """Mount of a camera."""

    camera_looks: CameraLooks
    forward_azimuth_deg: float
    image_flipped: bool
    pitch_deg: float = 0.0
    roll_deg: float = 0.0


class CameraAsk(ClientMessage):
    """Camera request with an optional mount; missing values are those of the camera file."""

    id: str
    camera_looks: CameraLooks | None = None
    forward_azimuth_deg: float | None = Field(None, ge=-360, le=360)
    image_flipped: bool | None = None
    pitch_deg: float | None = Field(None, ge=-90, le=90)
    roll_deg: float | None = Field(None, ge=-180, le=180)


class SensorEntry(Message):
    """Selectable camera."""

    id: str
    name: str
    title: str = Field(description="what it is, in a line")
    kind: Kind
    mount: MountOf


class TableLayout(Message):
    """Layout of the float32 values of camera tables, in this order; absent tables have count 0."""

    first: float = Field(description="sin(Omega/2) of the first radius")
    last: float = Field(description="sin(Omega/2) of the last radius, or where the lattice ends")
    eye_mm: float = Field(description="about where along the axis near things are seen from")
    radii: int = Field(description="image radii, px, at even steps of sin(Omega/2)")
    origins: int = Field(
        description="origins of rays, mm: so many from the axis, then so many along it"
    )
    lattice: int = Field(
        description="side of a lattice of pixels (u, v) over sin(Omega/2) (cos, sin) of the azimuth"
    )
    limits: int = Field(
        description="sin(Omega/2) where the field ends, at even steps of the azimuth"
    )
    starts: int = Field(
        description="side of a lattice, over the same disk, of where rays start: mm along axis, right, down"
    )


class CameraShown(Message):
    """Description of a camera for interactive views."""

    id: str
    name: str
    title: str
    kind: Kind
    options: tuple[str, ...] = Field(description="what names it on the command line")
    mount: MountOf
    mount_in_file: MountOf
    image_size: Size
    centre_px: Pixel = Field(description="image of the axis")
    rim_radius_px: float = Field(
        description="image radius of the end of the field; its mean where it is no circle"
    )
    axis: Vector
    right: Vector
    down: Vector
    tilt_min_deg: float
    tilt_max_deg: float
    pixels_per_degree: float
    pole: Literal["nadir", "zenith"]
    is_image_reversed: bool
    is_adjustable: bool = Field(description="whether its circle may be moved to fit a picture")
    tables: TableLayout


class SensorFile(ClientMessage):
    """Sensor file request: a known sensor with its image circle fitted to an image."""

    id: str
    mount: MountOf
    image_size: Size
    centre_px: Pixel
    rim_radius_px: float = Field(gt=0)


class LevelAsk(SensorFile):
    """Levelling request; the image follows, and the image circle may be fitted to it."""

    name: str


class RestoreAsk(SensorFile):
    """Restoration request; the image follows, and the image circle of the sensor may be fitted to
    it."""

    name: str
    object_distance_mm: float | None = Field(gt=0, description="of what is seen; none: far away")


class RimFound(Message):
    """Detected mirror outline in an image."""

    centre_px: Pixel
    radius_px: float
    confidence: float
    is_sure: bool


class LevelFound(Message):
    """Tilt of the camera of an image, estimated from vertical edges."""

    pitch_deg: float
    roll_deg: float
    sigma_deg: float = Field(description="standard error of the plumb line")
    upright: int = Field(description="edges that stand upright")
    is_sure: bool = Field(description="it may be taken unasked")


class Source(Message):
    """Image, video, camera or stream on the server."""

    id: str
    name: str
    kind: Literal["picture", "video", "live"]
    command: str = Field(
        description="how the command line names it, from where the server was started"
    )


class Start(Message):
    """Initial data of the page."""

    version: str
    sources: tuple[Source, ...]
    sensors: tuple[SensorEntry, ...]
    source: str | None = Field(description="the source to open first")
    sensor: str | None = Field(description="the camera to begin with")


class StreamState(Message):
    """State of a stream; frames are sent separately as binary messages."""

    state: Literal["waiting", "playing", "lost", "ended"]
    sentence: str


class Embedded(Message):
    """Data embedded in a page without a server."""

    camera: CameraShown
    tables: str = Field(description="float32 values, little-endian, in base64")
    media: str = Field(
        description="address of the picture or video: with it inside, or of a file beside the page"
    )
    is_video: bool
    name: str


class CameraAlone(Message):
    """Camera of a page without a server, for any mount."""

    entry: SensorEntry
    standing: tuple[CameraShown, ...] = Field(
        description="plumb, with the top of the picture forward: each way to look, reversed left to right and not"
    )
    tables: str = Field(description="float32 values, little-endian, in base64")
    room: str = Field(
        description="the picture that it takes of a room, in its address; none if empty"
    )


class Alone(Message):
    """Data of a page without a server for arbitrary images."""

    version: str
    cameras: tuple[CameraAlone, ...]
