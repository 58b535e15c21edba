"""Messages between server and Look tab: cameras as tables, sources, streams."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ...cameras.camera import CameraLooks
from .messages import ClientMessage, Message

Vector = tuple[float, float, float]
Size = tuple[int, int]
Pixel = tuple[float, float]
Kind = Literal["sensor", "ocam", "ball"]
Side = Annotated[int, Field(ge=1, le=16384)]


class MountInfo(ClientMessage):
    """Mount of a camera."""

    camera_looks: CameraLooks
    forward_azimuth_deg: float
    image_flipped: bool
    pitch_deg: float = 0.0
    roll_deg: float = 0.0


class CameraRequest(ClientMessage):
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
    title: str = Field(description="one-line description")
    kind: Kind
    mount: MountInfo


class TableLayout(Message):
    """Layout of the float32 values of camera tables, in this order; absent tables have count 0."""

    first: float = Field(description="sin(Omega/2) of the first radius")
    last: float = Field(description="sin(Omega/2) of the last radius, or of the lattice boundary")
    viewpoint_mm: float = Field(description="approximate viewpoint for near objects along the axis")
    radii: int = Field(description="number of image radii, px, at equidistant sin(Omega/2)")
    origins: int = Field(
        description="number of ray origins, mm: distances from the axis, then positions along it"
    )
    lattice: int = Field(
        description="side length of the lattice of pixels (u, v) over sin(Omega/2) (cos, sin) of the azimuth"
    )
    limits: int = Field(
        description="number of boundary values sin(Omega/2) at equidistant azimuths"
    )
    starts: int = Field(
        description="side length of the lattice of ray origins over the same disc: mm along axis, right, down"
    )


class CameraInfo(Message):
    """Description of a camera for interactive views."""

    id: str
    name: str
    title: str
    kind: Kind
    options: tuple[str, ...] = Field(description="command-line options of the camera")
    mount: MountInfo
    mount_in_file: MountInfo
    image_size: Size
    centre_px: Pixel = Field(description="image of the axis")
    rim_radius_px: float = Field(
        description="image radius of the field boundary, or its mean if it is not circular"
    )
    axis: Vector
    right: Vector
    down: Vector
    tilt_min_deg: float
    tilt_max_deg: float
    pixels_per_degree: float
    pole: Literal["nadir", "zenith"]
    is_image_reversed: bool
    is_adjustable: bool = Field(description="whether its circle can be fitted to an image")
    tables: TableLayout


class SensorFileRequest(ClientMessage):
    """Sensor file request: a known sensor with its image circle fitted to an image."""

    id: str
    mount: MountInfo
    image_size: Size
    centre_px: Pixel
    rim_radius_px: float = Field(gt=0)


class LevelRequest(SensorFileRequest):
    """Levelling request; the image follows, and the image circle may be fitted to it."""

    name: str


class RestoreRequest(SensorFileRequest):
    """Restoration request; the image follows, and the image circle of the sensor may be fitted to
    it."""

    name: str
    object_distance_mm: float | None = Field(gt=0, description="object distance; null: infinite")


class FittedCameraRequest(SensorFileRequest):
    """Request for a camera whose image circle may be fitted to an image."""

    is_fitted: bool = Field(
        description="whether the image circle was fitted to the image; the uncertainty of the "
        "camera file does not apply to it"
    )


class ViewRequest(ClientMessage):
    """View with the parameters of its function in ``omnimirror.views``; null if not applicable."""

    view: Literal["panorama", "perspective", "dome", "planet", "ground", "mosaic"]
    size: tuple[Side, Side | None] = Field(description="size in px; null: from the width")
    pan_deg: float
    tilt_deg: float | None = None
    hfov_deg: float | None = None
    span_deg: float | None = None
    elevation_deg: tuple[float, float] | None = None
    omega_deg: tuple[float, float] | None = None
    pole: Literal["nadir", "zenith"] | None = None
    height_mm: float | None = None
    mm_per_px: float | None = None
    distance_mm: float | None = Field(None, description="object distance; null: infinite")


class ImageExportRequest(FittedCameraRequest):
    """Export of a view, or of a light probe, from the original image that follows."""

    name: str
    format: Literal["png", "jpg", "tif", "exr", "hdr"]
    view: ViewRequest | None = Field(description="null: light probe")


class MeasureRequest(FittedCameraRequest):
    """Measurement request: two pixels of an image, and the plane of their points."""

    pixels: tuple[Pixel, Pixel]
    height_mm: float | None = Field(
        description="height above the floor, or minus the depth below the ceiling; null: neither"
    )
    wall_mm: float | None = Field(description="distance from the wall; null: no wall")
    wall_pan_deg: float
    plane_sigma_mm: float
    plane_sigma_deg: float
    pixel_sigma_px: float


class MeasurementResult(Message):
    """Measured angle and distance with standard uncertainties; null if unknown."""

    angle_deg: float
    angle_sigma_deg: float | None
    distance_mm: float | None
    distance_sigma_mm: float | None


class DetectedOutline(Message):
    """Detected mirror outline in an image."""

    centre_px: Pixel
    radius_px: float
    confidence: float = Field(description="agreement between working resolutions, 0 to 1")
    is_reliable: bool = Field(description="whether the confidence is sufficient for automatic use")
    image_size: Size = Field(description="size of the analysed image")


class ImageTaskStatus(Message):
    """Progress of a task with an image; the last message contains a report or an error."""

    state: Literal["waiting", "running", "done", "failed"]
    message: str
    fraction: float = Field(default=0.0, description="completed fraction, 0 to 1")


class OutlineSearchStatus(ImageTaskStatus):
    """Progress of an outline search; the last message contains the outline or an error."""

    outline: DetectedOutline | None = None


class EstimatedTilt(Message):
    """Tilt of the camera of an image, estimated from vertical edges."""

    pitch_deg: float
    roll_deg: float
    sigma_deg: float = Field(description="standard error of the vertical direction")
    vertical_edges: int = Field(description="number of vertical edges")
    is_reliable: bool = Field(description="whether it is reliable enough for automatic use")


class Source(Message):
    """Image, video, camera or stream on the server."""

    id: str
    name: str
    kind: Literal["image", "video", "live"]
    command: str = Field(
        description="path for the command line, relative to the working directory of the server"
    )


class PageStart(Message):
    """Initial data of the page."""

    version: str
    sources: tuple[Source, ...]
    sensors: tuple[SensorEntry, ...]
    source: str | None = Field(description="initial source")
    sensor: str | None = Field(description="initial camera")


class StreamState(Message):
    """State of a stream; frames are sent separately as binary messages."""

    state: Literal["waiting", "playing", "lost", "ended"]
    message: str


class EmbeddedImage(Message):
    """Data embedded in a page without a server."""

    camera: CameraInfo
    tables: str = Field(description="float32 values, little-endian, in base64")
    media: str = Field(
        description="URL of the image or video: a data URL, or a file next to the page"
    )
    is_video: bool
    name: str


class StandaloneCamera(Message):
    """Camera of a page without a server, for any mount."""

    entry: SensorEntry
    untilted: tuple[CameraInfo, ...] = Field(
        description="models without tilt, with the image top forward: each orientation, flipped and not flipped"
    )
    tables: str = Field(description="float32 values, little-endian, in base64")
    room: str = Field(description="rendered image of a room as a data URL; empty if there is none")


class StandalonePage(Message):
    """Data of a page without a server for arbitrary images."""

    version: str
    cameras: tuple[StandaloneCamera, ...]
