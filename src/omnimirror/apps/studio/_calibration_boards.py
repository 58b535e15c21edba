"""Boards of the Calibrate tab: detections as messages, field coverage, and the dewarped frontal view."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...calibration.estimation.observation_checks import (
    MIN_CORNERS_PER_CELL,
    Coverage,
    coverage,
    recommendations,
)
from ...calibration.estimation.observations import Observation
from ...calibration.targets import Board, Detection
from ...calibration.targets.board_detection import compared
from ...calibration.targets.frame_selection import redundancy_reason
from ...cameras.models.camera_model import CameraModel
from ...dewarp import Dewarper
from ...optics.camera_files import parse_camera
from ._board_detection_process import board_of
from ._uploads import eight_bits, encoded, image_in
from .calibration_messages import (
    BoardDetection,
    BoardPose,
    BoardViewRequest,
    CoverageInfo,
    MultiImageRequest,
    MultiImageSummary,
)

# -- Conversion and joint analysis of detections ---------------------------------------------------


def taken(detected: BoardDetection, board: Board) -> Detection:
    """Convert the message of one image to a detection, if usable.

    Raises
    ------
    InvalidParameter
        If the corners are outside the board or outside the image.
    """
    ids, corners = (
        np.asarray(detected.ids, dtype=int),
        np.asarray(detected.corners_px, dtype=float).reshape(-1, 2),
    )
    sigma = None if detected.sigma_px is None else np.asarray(detected.sigma_px, dtype=float)
    size = np.array(detected.image_size)
    good = len(ids) == len(corners) == len(set(detected.ids)) and (
        sigma is None or len(sigma) == len(ids)
    )
    good = good and bool(np.all((ids >= 0) & (ids < board.corner_count)))
    if not (good and np.all((corners >= -0.5) & (corners <= size - 0.5))):
        raise InvalidParameter(
            f"the detection in {detected.name} is invalid: its corners do not match a board of {board}"
        )
    blur = math.nan if detected.blur_px is None else detected.blur_px
    return Detection(
        detected.name,
        detected.image_size,
        ids,
        corners,
        detected.reason,
        sigma,
        blur,
        detected.is_reversed,
        detected.begins_white,
        detected.is_part,
        detected.time_s,
    )


def together(message: MultiImageRequest) -> MultiImageSummary:
    """Analyse images of one camera together: consistency, field coverage and the recommended next
    image.

    Raises
    ------
    InvalidParameter
        If the board is invalid or does not match the detections.
    """
    board = board_of(message.board)
    detections = compared([taken(detected, board) for detected in message.detections], board)
    used = [d for d in detections if d.used]
    spread = _coverage(used, message) if used else None
    return MultiImageSummary(
        reasons=tuple(d.reason for d in detections),
        coverage=coverage_message(spread) if spread else None,
        advice=recommendations(spread, len(used)) if spread else (),
        candidate_reason=None
        if message.candidate is None
        else redundancy_reason(taken(message.candidate, board), used, board),
    )


def _coverage(used: list[Detection], message: MultiImageRequest) -> Coverage:
    width, height = used[0].image_size
    centre = ((width - 1) / 2, (height - 1) / 2) if message.centre_px is None else message.centre_px
    observations = [Observation(d.name, d.corners_px, np.zeros((len(d.ids), 3))) for d in used]
    return coverage(observations, centre, message.radius_px)


def coverage_message(spread: Coverage) -> CoverageInfo:
    """Convert a coverage to a message."""
    return CoverageInfo(
        centre_px=(float(spread.centre_px[0]), float(spread.centre_px[1])),
        radii_px=tuple(float(r) for r in spread.radii_px),
        counts=tuple(tuple(int(c) for c in ring) for ring in spread.counts),
        min_corners=MIN_CORNERS_PER_CELL,
    )


# -- Dewarped frontal view -------------------------------------------------------------------------

MARGIN = 1.5  # margin around the board, squares
VIEW_OVERSAMPLING = 2.5  # pixels of the view per pixel of the image
MAX_VIEW_PX = 1200
MAX_BOARD_MM = 1e5
MIN_LINE_CORNERS = 3  # minimum number of corners for a straightness residual


@dataclass(frozen=True)
class BoardScreen:
    """Board plane as a frontal perspective view.

    Parameters
    ----------
    pose
        Pose of the board.

    Examples
    --------
    >>> rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    >>> pose = BoardPose(
    ...     image="a", rotation=rotation, shift_mm=(0, 0, 500), low_mm=(0, 0), high_mm=(40, 20), margin_mm=10,
    ...     px_per_mm=2.0, is_upwards=False,
    ... )
    >>> screen = BoardScreen(pose)
    >>> screen.size, screen.targets_at(np.array([20.0]), np.array([20.0]))
    ((121, 81), array([[  0.,   0., 500.]]))
    """

    pose: BoardPose

    @property
    def sides_mm(self) -> Array:
        """Width and height of the view, mm."""
        return np.subtract(self.pose.high_mm, self.pose.low_mm) + 2 * self.pose.margin_mm

    @property
    def _px_per_mm(self) -> float:
        return float(min(self.pose.px_per_mm, (MAX_VIEW_PX - 1) / self.sides_mm.max()))

    @property
    def size(self) -> tuple[int, int]:
        """Size (width, height) in pixels."""
        width, height = np.ceil(self.sides_mm * self._px_per_mm).astype(int) + 1
        return max(int(width), 2), max(int(height), 2)

    is_distant = False

    def targets_at(self, u: Array, v: Array) -> Array:
        """Return world points (..., 3), mm."""
        x = self.pose.low_mm[0] - self.pose.margin_mm + np.asarray(u) / self._px_per_mm
        down = np.asarray(v) / self._px_per_mm - self.pose.margin_mm
        y = self.pose.high_mm[1] - down if self.pose.is_upwards else self.pose.low_mm[1] + down
        points = np.stack(np.broadcast_arrays(x, y, 0.0), axis=-1)
        turned: Array = points @ np.reshape(self.pose.rotation, (3, 3)).T + self.pose.shift_mm
        return turned

    def __str__(self) -> str:
        return f"the board in {self.pose.image}"


def pose_of(observation: Observation, model: CameraModel, board: Board) -> BoardPose:
    """Return the pose of an observed board in the world frame."""
    assert observation.pose is not None
    to_world = model.mount.rotation()
    low, high = board.points_mm.min(axis=0), board.points_mm.max(axis=0)
    return BoardPose(
        image=observation.name,
        rotation=tuple(float(x) for x in (to_world @ observation.pose.rotation).ravel()),
        shift_mm=tuple(float(x) for x in to_world @ observation.pose.translation_mm),  # type: ignore[arg-type]  # three numbers
        low_mm=(float(low[0]), float(low[1])),
        high_mm=(float(high[0]), float(high[1])),
        margin_mm=MARGIN * board.square_mm,
        px_per_mm=VIEW_OVERSAMPLING * _px_per_mm(observation),
        is_upwards=board.kind == "aprilgrid",
    )


def _px_per_mm(observation: Observation) -> float:
    """Return the image scale of a board, from the square root of area ratios."""
    areas = [
        np.linalg.det(np.cov(values.T))
        for values in (observation.pixels, observation.points[:, :2])
    ]
    return float((areas[0] / areas[1]) ** 0.25)


def on_board_mm(observation: Observation, model: CameraModel, board: Board) -> Array:
    """Intersect the rays of the observed corners with the board plane; return (k, 2), mm."""
    pose = pose_of(observation, model, board)
    rays = model.backproject(observation.pixels)
    rotation = np.reshape(pose.rotation, (3, 3))
    origins, ways = (rays.origins - pose.shift_mm) @ rotation, rays.directions @ rotation
    with np.errstate(invalid="ignore", divide="ignore"):
        met: Array = origins[:, :2] - (origins[:, 2] / ways[:, 2])[:, None] * ways[:, :2]
    return np.where(rays.valid[:, None], met, np.nan)


def line_deviation_px(observation: Observation, model: CameraModel, board: Board) -> float:
    """Return the largest distance of a corner from the best-fit line of its row or column on the
    dewarped board.

    The unit is the mean pixel size of the image on the board.
    """
    met = on_board_mm(observation, model, board) * _px_per_mm(observation)
    points = observation.points[:, :2]
    worst = 0.0
    for axis in (0, 1):
        for at in np.unique(points[:, axis]):
            line = met[(points[:, axis] == at) & np.isfinite(met).all(axis=1)]
            if len(line) >= MIN_LINE_CORNERS:
                from_middle = line - line.mean(axis=0)
                worst = max(
                    worst, float(np.abs(from_middle @ np.linalg.svd(from_middle)[2][1]).max())
                )
    return worst


def render_board_view(message: BoardViewRequest, data: bytes) -> bytes:
    """Render the frontal view of a board as JPEG.

    Raises
    ------
    OmnimirrorError
        If the image is unreadable, the camera or board is invalid, or the image size differs from
        that of the camera.
    """
    screen = BoardScreen(message.pose)
    if not np.all((screen.sides_mm > 0) & (screen.sides_mm < MAX_BOARD_MM)):
        raise InvalidParameter(
            f"the board in {message.pose.image} must be larger than 0 and smaller than "
            f"{MAX_BOARD_MM:g} mm; its corners extend from {message.pose.low_mm} to "
            f"{message.pose.high_mm} mm"
        )
    pixels = eight_bits(image_in(data, message.name))
    camera = parse_camera(message.camera_file, source="the camera")
    return encoded(Dewarper(camera, screen)(pixels), ".jpg")
