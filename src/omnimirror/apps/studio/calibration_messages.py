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
MOST_PICTURES = 200
"""Maximum number of images of a calibration, including video frames."""


class BoardAsked(ClientMessage):
    """Calibration board with the parameters of :class:`omnimirror.Board`."""

    kind: Literal["chessboard", "charuco", "aprilgrid"] = "chessboard"
    columns: int
    rows: int
    square_mm: float
    marker_mm: float | None = None
    spacing: float = 0.3
    family: str | None = Field(default=None, max_length=40)
    legacy: bool = False


class BoardLook(BoardAsked):
    """Board detection request for one image."""

    name: str = Field(default="picture", max_length=200)
    quick: bool = Field(default=False, description="as for pictures of a camera that runs")


class BoardSeen(ClientMessage):
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
    time_s: float | None = Field(description="of a frame of a video")


class TogetherAsk(ClientMessage):
    """Analysis request for several images of one camera."""

    board: BoardAsked
    pictures: tuple[BoardSeen, ...] = Field(max_length=MOST_PICTURES)
    centre_px: Pixel | None = Field(description="of the field; null: the middle of the picture")
    radius_px: float | None = Field(
        gt=0, description="of the field; null: that of the farthest corner"
    )
    candidate: BoardSeen | None = Field(description="what a camera sees now")


class CoverageShown(Message):
    """Distribution of corners over the image: rings of equal area, sectors from the right clockwise
    (via the bottom)."""

    centre_px: Pixel
    radii_px: tuple[float, ...]
    counts: tuple[tuple[int, ...], ...]
    enough: int = Field(description="corners that a cell should have")


class Together(Message):
    """Joint analysis of images of one camera."""

    reasons: tuple[str | None, ...] = Field(description="why each of them is not used")
    coverage: CoverageShown | None
    advice: tuple[str, ...]
    not_new: str | None = Field(description="why the candidate adds nothing; null where it does")


class CalibrationAsk(ClientMessage):
    """Calibration request; followed by one message per image with its detection."""

    board: BoardAsked
    pictures: int = Field(ge=1, le=MOST_PICTURES)
    model: str = Field(max_length=60)
    optics: Literal["mirror", "fisheye"]
    camera_looks: Literal["up", "down", "forward"]
    image_flipped: bool
    centre_px: Pixel | None
    rim_radius_px: float | None = Field(gt=0)
    flat_board: bool
    command: str = Field(max_length=30_000, description="that does the same, for the report")


class PictureOutcome(Message):
    """Calibration result of one image."""

    name: str
    found: int
    used: bool
    reason: str | None
    rms_px: float | None
    held_out_rms_px: float | None = Field(description="in a fit that was made without it")
    off_straight_px: float | None = Field(
        description="how far its corners lie off the lines of the straightened board"
    )
    residuals: tuple[tuple[float, float, float, float], ...] = Field(
        description="corner u, v, and how far it lies off"
    )


class ParameterFound(Message):
    """Estimated parameter of the camera or the board."""

    name: str
    value: float
    sigma: float | None = Field(description="null: it was fixed")
    unit: str


class ModelTried(Message):
    """Camera model of the model comparison."""

    kind: str
    parameters: int
    rms_px: float
    held_out_rms_px: float | None
    why: str


class OutlierFound(Message):
    """Outlier corner."""

    picture: str
    corner: int
    residual_px: float


class BoardPlace(ClientMessage):
    """Pose of a board, used for its dewarped image."""

    picture: str
    rotation: tuple[float, ...] = Field(
        min_length=9, max_length=9, description="from the board's frame to the world's"
    )
    shift_mm: tuple[float, float, float]
    low_mm: tuple[float, float] = Field(description="the board's first corner")
    high_mm: tuple[float, float]
    margin_mm: float = Field(ge=0, description="how much is shown about the corners")
    px_per_mm: float = Field(gt=0, description="as fine as the picture is there")
    is_upwards: bool = Field(description="whether the board's Y points up")


class CalibrationFound(Message):
    """Result of a camera calibration."""

    kind: str
    summary: str
    rms_px: float
    held_out_rms_px: float | None
    corners: int
    seconds: float
    is_complete: bool
    image_size: tuple[int, int]
    pictures: tuple[PictureOutcome, ...]
    parameters: tuple[ParameterFound, ...]
    models: tuple[ModelTried, ...]
    outliers: tuple[OutlierFound, ...]
    notes: tuple[str, ...]
    advice: tuple[str, ...]
    coverage: CoverageShown
    places: tuple[BoardPlace, ...]
    camera_file: str = Field(max_length=1 << 20)


class CalibrationNews(Message):
    """Progress of a calibration: status, estimated camera, report, or error."""

    state: Literal["running", "done", "reported", "failed"]
    sentence: str
    share: float | None = None
    found: CalibrationFound | None = None
    report: str | None = None


class StraightAsk(ClientMessage):
    """Dewarp request for an image of a board; the image follows."""

    camera_file: str = Field(max_length=1 << 20)
    place: BoardPlace
    name: str = Field(max_length=250)


class CalibrateStart(Message):
    """Initial data of the tab."""

    models: tuple[str, ...] = Field(description="kinds that can be estimated, simple ones first")
    mirrors_only: tuple[str, ...] = Field(description="those that no fisheye is")
    families: tuple[str, ...] = Field(description="of markers")
