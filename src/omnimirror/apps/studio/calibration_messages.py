"""Messages between server and Calibrate tab; the types of the page are generated from them.

The page stores the images and their detections and uploads them with each request; a restart of the
server loses no data. Non-finite numbers are transferred as null.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from .messages import ClientMessage, Message

Pixel = tuple[float, float]
STOP = "stop"
"""Message that ends a calibration early with its best result."""
MAX_IMAGES = 200
"""Maximum number of images of a calibration, including video frames."""


class BoardSpec(ClientMessage):
    """Calibration board with the parameters of :class:`omnimirror.Board`."""

    kind: Literal["chessboard", "charuco", "aprilgrid"] = "chessboard"
    columns: int
    rows: int
    square_mm: float
    marker_mm: float | None = None
    spacing: float = 0.3
    family: str | None = Field(default=None, max_length=40)
    legacy: bool = False


class BoardDetectionRequest(BoardSpec):
    """Board detection request for one image."""

    name: str = Field(default="image", max_length=200)
    fast: bool = Field(default=False, description="fast detection for live cameras")


class BoardDetection(ClientMessage):
    """Board detection in an image, or the reason for its failure."""

    name: str = Field(max_length=250)
    image_size: tuple[int, int]
    ids: tuple[int, ...]
    corners_px: tuple[Pixel, ...]
    sigma_px: tuple[float, ...] | None
    reason: str | None = Field(max_length=1000)
    blur_px: float | None
    is_reversed: bool | None
    begins_white: bool | None
    is_part: bool
    time_s: float | None = Field(description="time of a video frame")


class MultiImageRequest(ClientMessage):
    """Analysis request for several images of one camera."""

    board: BoardSpec
    detections: tuple[BoardDetection, ...] = Field(max_length=MAX_IMAGES)
    centre_px: Pixel | None = Field(description="centre of the field; null: image centre")
    radius_px: float | None = Field(
        gt=0, description="radius of the field; null: distance of the farthest corner"
    )
    candidate: BoardDetection | None = Field(
        description="detection in the current frame of a live camera"
    )


class CoverageInfo(Message):
    """Distribution of corners over the image: rings of equal area, sectors from the right clockwise
    (via the bottom)."""

    centre_px: Pixel
    radii_px: tuple[float, ...]
    counts: tuple[tuple[int, ...], ...]
    min_corners: int = Field(description="recommended minimum number of corners per cell")


class MultiImageSummary(Message):
    """Joint analysis of images of one camera."""

    reasons: tuple[str | None, ...] = Field(
        description="reason for the rejection of each image; null if used"
    )
    coverage: CoverageInfo | None
    advice: tuple[str, ...]
    candidate_reason: str | None = Field(
        description="reason against the candidate; null if it adds information"
    )


class CalibrationRequest(ClientMessage):
    """Calibration request; followed by one message per image with its detection."""

    board: BoardSpec
    images: int = Field(ge=1, le=MAX_IMAGES)
    model: str = Field(max_length=60)
    optics: Literal["mirror", "fisheye"]
    camera_looks: Literal["up", "down", "forward"]
    image_flipped: bool
    centre_px: Pixel | None
    rim_radius_px: float | None = Field(gt=0)
    flat_board: bool
    command: str = Field(max_length=30_000, description="equivalent command line for the report")


class CalibrationImage(Message):
    """Calibration result of one image."""

    name: str
    corners: int
    used: bool
    reason: str | None
    rms_px: float | None
    held_out_rms_px: float | None = Field(
        description="RMS in a fit without this image (cross-validation)"
    )
    line_deviation_px: float | None = Field(
        description="maximum deviation of corners from straight lines on the undistorted board"
    )
    residuals: tuple[tuple[float, float, float, float], ...] = Field(
        description="corner u, v and residual du, dv, px"
    )


class ParameterEstimate(Message):
    """Estimated parameter of the camera or the board."""

    name: str
    value: float
    sigma: float | None = Field(description="standard deviation; null for fixed parameters")
    unit: str


class ModelComparisonRow(Message):
    """Camera model of the model comparison."""

    kind: str
    parameters: int
    rms_px: float
    held_out_rms_px: float | None
    reason: str


class OutlierCorner(Message):
    """Outlier corner."""

    image: str
    corner: int
    residual_px: float


class BoardPose(ClientMessage):
    """Pose of a board, used for its dewarped image."""

    image: str
    rotation: tuple[float, ...] = Field(
        min_length=9, max_length=9, description="rotation from the board frame to the world frame"
    )
    shift_mm: tuple[float, float, float]
    low_mm: tuple[float, float] = Field(description="first corner of the board")
    high_mm: tuple[float, float]
    margin_mm: float = Field(ge=0, description="margin around the corners")
    px_per_mm: float = Field(gt=0, description="resolution of the image at the board")
    is_upwards: bool = Field(description="whether the y axis of the board points up")


class CalibrationResult(Message):
    """Result of a camera calibration."""

    kind: str
    summary: str
    rms_px: float
    held_out_rms_px: float | None
    corners: int
    seconds: float
    is_complete: bool
    image_size: tuple[int, int]
    images: tuple[CalibrationImage, ...]
    parameters: tuple[ParameterEstimate, ...]
    models: tuple[ModelComparisonRow, ...]
    outliers: tuple[OutlierCorner, ...]
    notes: tuple[str, ...]
    advice: tuple[str, ...]
    coverage: CoverageInfo
    poses: tuple[BoardPose, ...]
    camera_file: str = Field(max_length=1 << 20)


class CalibrationStatus(Message):
    """Progress of a calibration: status, estimated camera, report, or error."""

    state: Literal["waiting", "running", "done", "report", "failed"]
    message: str
    fraction: float | None = None
    result: CalibrationResult | None = None
    report: str | None = None


class BoardViewRequest(ClientMessage):
    """Dewarp request for an image of a board; the image follows."""

    camera_file: str = Field(max_length=1 << 20)
    pose: BoardPose
    name: str = Field(max_length=250)


class CalibrationOptions(Message):
    """Initial data of the tab."""

    models: tuple[str, ...] = Field(description="camera models, in increasing complexity")
    mirrors_only: tuple[str, ...] = Field(description="models for mirrors only")
    families: tuple[str, ...] = Field(description="marker families")
