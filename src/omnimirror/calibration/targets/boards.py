"""Calibration boards and detections: kinds, corner positions, neighbourhoods and markers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import check_fields, choice, integer, number
from ...base.errors import InvalidParameter
from ...base.results import Columns, Result
from ...base.typing import Array

# -- Boards ----------------------------------------------------------------------------------------

Kind = Literal["chessboard", "charuco", "aprilgrid"]

KINDS: tuple[str, ...] = get_args(Kind)
MAX_COUNT = 200
"""Maximum number of corners, squares or tags along a side."""
MARKER_SHARE = 0.75
"""Default ratio of the marker side to the ChArUco square."""
FAMILIES = {"charuco": "5X5_1000", "aprilgrid": "APRILTAG_36H11"}
"""Default marker families by kind of board: Kalibr's, and an OpenCV family with a low error rate.
"""
APRIL_BITS = 6
BORDER_BITS = {"charuco": 1, "aprilgrid": 2}
"""Width of the black frame of a marker, in bits."""


class CornerWindow(NamedTuple):
    """Region around a corner that contains only its four quarters, in :attr:`Board.square_mm`."""

    half: float = 0.45
    """0.5 times the side of a square around the corner."""
    arm: float = np.inf
    """0.5 times the width of the marker-free cross along the edges."""


@dataclass(frozen=True)
class Board:
    """Flat calibration board with known corner positions.

    Sizes follow the programs that such boards are printed with: inner corners of a chessboard and
    squares of a ChArUco board (OpenCV), tags of an April grid (Kalibr). In the frame of the board,
    X points right for the viewer and Z = 0; Y points down for chessboards and ChArUco boards, and
    up for April grids, as in those programs. The origin is the first corner: upper left, for April
    grids lower left.

    Parameters
    ----------
    kind
        ``"chessboard"``, ``"charuco"`` or ``"aprilgrid"``.
    columns, rows
        Number of inner corners, squares or tags, at least 2 (for a chessboard at least 3 in one
        direction).
    square_mm : mm
        Side of a square, or of a tag to the outer edge of its black frame.
    marker_mm : mm, optional
        ChArUco: side of a marker; by default 0.75 times the square.
    spacing
        April grid: ratio of the gap between tags to their side, Kalibr's ``tagSpacing``.
    family
        Marker family by OpenCV's name without DICT\\_: ``"4X4_50"``. By default ``"5X5_1000"``, for
        April grids ``"APRILTAG_36H11"``.
    legacy
        ChArUco: whether the first square of a board with an even number of rows is white, as before
        OpenCV 4.6.

    Raises
    ------
    InvalidParameter
        If a value is out of range or does not apply to this kind of board.

    Examples
    --------
    >>> board = Board("chessboard", 11, 7, 30.0)
    >>> len(board.points_mm), board.points_mm[12]
    (77, array([30., 30.,  0.]))
    """

    kind: Kind = "chessboard"
    columns: int = 11
    rows: int = 7
    square_mm: float = 30.0
    marker_mm: float | None = None
    spacing: float = 0.3
    family: str | None = None
    legacy: bool = False

    def __post_init__(self) -> None:
        check_fields(self)
        choice("kind", self.kind, KINDS)
        integer("columns", self.columns, 2, MAX_COUNT)
        integer("rows", self.rows, 2, MAX_COUNT)
        number("square_mm", self.square_mm, above=0, unit="mm")
        number("spacing", self.spacing, above=0, high=1)
        if self.marker_mm is not None:
            number("marker_mm", self.marker_mm, above=0, unit="mm")
            if self.kind != "charuco":
                raise InvalidParameter(f"marker_mm requires kind = 'charuco'; got {self.kind!r}")
            if self.marker_mm >= self.square_mm:
                raise InvalidParameter(
                    f"marker_mm must be below square_mm = {self.square_mm:g}; got {self.marker_mm:g}"
                )
        if self.kind == "chessboard":
            if self.family is not None:
                raise InvalidParameter(
                    f"family requires a board with markers; got {self.family!r} for a chessboard"
                )
            if max(self.columns, self.rows) < 3:
                raise InvalidParameter("a chessboard must have at least 3 x 2 corners; got 2 x 2")
        elif self.family is not None:
            choice("family", self.family.upper(), families())
            if self.marker_count > (family_size := capacity(self.family)):
                raise InvalidParameter(
                    f"family must have at least {self.marker_count} markers for a board of "
                    f"{self}; {self.family} has {family_size}"
                )

    def __str__(self) -> str:
        unit = {"chessboard": "corners", "charuco": "squares", "aprilgrid": "tags"}[self.kind]
        return f"{self.columns} x {self.rows} {unit}"

    @property
    def lattice_size(self) -> tuple[int, int]:
        """Number of columns and rows of corners."""
        if self.kind == "charuco":
            return self.columns - 1, self.rows - 1
        if self.kind == "aprilgrid":
            return 2 * self.columns, 2 * self.rows
        return self.columns, self.rows

    @property
    def corner_count(self) -> int:
        """Number of corners."""
        return int(np.prod(self.lattice_size))

    @property
    def lattice(self) -> NDArray[np.int_]:
        """Column and row (n, 2) of each corner, indexed by corner id."""
        columns, rows = self.lattice_size
        return np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)

    @property
    def points_mm(self) -> Array:
        """Corners (n, 3) in mm in the frame of the board, indexed by corner id."""
        flat = self._along_mm(self.lattice.T).T
        return np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)

    @property
    def marker_side_mm(self) -> float:
        """Side of a marker in mm, to the outer edge of its black frame."""
        if self.kind == "charuco" and self.marker_mm is None:
            return MARKER_SHARE * self.square_mm
        return self.square_mm if self.marker_mm is None else self.marker_mm

    @property
    def marker_family(self) -> str:
        """Marker family; ``""`` for a chessboard."""
        return (self.family or FAMILIES.get(self.kind, "")).upper()

    @property
    def border_bits(self) -> int:
        """Width of the black frame of the markers, in bits."""
        return BORDER_BITS.get(self.kind, 0)

    @property
    def has_markers(self) -> bool:
        """True if the board has markers that identify its corners."""
        return self.kind != "chessboard"

    @property
    def is_symmetric(self) -> bool:
        """True if a 180 deg rotation maps the board to itself.

        The order of its corners is then ambiguous.
        """
        return self.kind == "chessboard" and (self.columns + self.rows) % 2 == 0

    @property
    def surroundings(self) -> CornerWindow:
        """Region around a corner without markers or other corners."""
        if self.kind == "charuco":
            return CornerWindow(arm=(1 - self.marker_side_mm / self.square_mm) / 2)
        if self.kind == "aprilgrid":
            return CornerWindow(
                min(0.7 * self.spacing, 0.45),
                self.border_bits / (APRIL_BITS + 2 * self.border_bits),
            )
        return CornerWindow()

    @property
    def polarity(self) -> NDArray[np.int_]:
        """Sign (n,) of each corner's contrast.

        It is -1 if the quarter towards the origin of x and y is black.
        """
        first = 1 if self.kind == "charuco" and self.legacy and self.rows % 2 == 0 else -1
        return np.asarray(first * (1 - 2 * (self.lattice.sum(axis=1) % 2)))

    @property
    def marker_count(self) -> int:
        """Number of markers; their numbers start at 0."""
        if self.kind == "chessboard":
            return 0
        return self.columns * self.rows // (2 if self.kind == "charuco" else 1)

    def _along_mm(self, positions: NDArray[Any]) -> Array:
        """Return positions of columns or rows along their side."""
        if self.kind == "aprilgrid":
            return np.asarray(
                self.square_mm * ((positions // 2) * (1 + self.spacing) + positions % 2),
                dtype=float,
            )
        return self.square_mm * np.asarray(positions, dtype=float)


def families() -> list[str]:
    """Return the marker families of OpenCV.

    >>> "4X4_50" in families()
    True
    """
    import cv2

    return sorted(
        {name.removeprefix("DICT_").upper() for name in dir(cv2.aruco) if name.startswith("DICT_")}
    )


def capacity(family: str) -> int:
    """Return the number of markers in a family."""
    return len(dictionary(family).bytesList)


def dictionary(family: str) -> Any:
    """Return OpenCV's marker dictionary of a family."""
    import cv2

    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{family.upper()}"))


# -- Detections ------------------------------------------------------------------------------------

Ids = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class Detection(Result):
    """Corners of a board in one image, or the reason for a failed detection.

    Parameters
    ----------
    name
        Name of the image, for messages and tables.
    image_size
        Width and height of the image, px.
    ids : (k,)
        Corner ids, as in :attr:`Board.points_mm`; empty if the board was not found.
    corners_px : (k, 2)
        Corner positions in the image as delivered.
    reason
        Reason for a failed detection, or against the use of the image, in one phrase; None if it is
        used.
    sigma_px : (k,) or None
        Standard deviation of a coordinate of each corner, from image noise and the scatter of the
        corners around a smooth mapping; None before refinement.
    blur_px
        Standard deviation of the edge blur, measured at the board's edges if found.
    is_reversed
        Whether the image is a mirror image according to the markers; None if unknown.
    begins_white
        Whether the square before a chessboard's first corner is white. For a board that is
        symmetric under a 180 deg rotation and not square, images that differ in it are mirror
        images of each other.
    is_part
        Whether it is a part of a chessboard, numbered as if it were the centre.
    time_s
        Time of the frame in its video.

    Examples
    --------
    >>> Detection("a.png", (640, 480), reason="no board was found").found
    False
    """

    name: str
    image_size: tuple[int, int]
    ids: Ids = field(default_factory=lambda: np.empty(0, dtype=int))
    corners_px: Array = field(default_factory=lambda: np.empty((0, 2)))
    reason: str | None = None
    sigma_px: Array | None = None
    blur_px: float = float("nan")
    is_reversed: bool | None = None
    begins_white: bool | None = None
    is_part: bool = False
    time_s: float | None = None

    def _table(self) -> Columns:
        columns = {"id": self.ids, "u_px": self.corners_px[:, 0], "v_px": self.corners_px[:, 1]}
        return columns if self.sigma_px is None else columns | {"sigma_px": self.sigma_px}

    @property
    def found(self) -> bool:
        """True if corners were found."""
        return len(self.ids) > 0

    @property
    def used(self) -> bool:
        """True if the detection is suitable for calibration: found, without a reason against it."""
        return self.found and self.reason is None

    @property
    def sharpness(self) -> float:
        """Inverse of :attr:`blur_px`."""
        return 1.0 / self.blur_px
