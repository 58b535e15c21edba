"""Printing of boards at true scale, with a reference line for checking the scale."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import choice, file_name, number, validate_arguments
from ...base.errors import InvalidParameter, MediaError
from ...base.escaping import xml_text
from ...base.files import atomic_output
from ...base.typing import Array
from .boards import Board, dictionary

SUFFIXES = (".pdf", ".svg", ".png")
PAPERS_MM = {
    "A0": (1189, 841), "A1": (841, 594), "A2": (594, 420), "A3": (420, 297), "A4": (297, 210), "letter": (279.4, 215.9),
}  # fmt: skip
"""Longer and shorter side."""
MAX_PX = 30_000
RULER_MM, TEXT_MM, LINE_MM = 100.0, 3.0, 0.3
POINTS_PER_MM = 72 / 25.4
WHITE_MARGIN = 1.0  # in squares; detectors require a white border around a board


class BoardSheet(NamedTuple):
    """Printed sheet, in mm from the upper left corner of the paper."""

    size_mm: tuple[float, float]
    """Width and height."""
    black_mm: Array
    """Black rectangles (k, 4): left, top, width and height."""
    first_corner_mm: tuple[float, float]
    """Position of corner 0 of the board."""
    text: str
    """Text at the foot of the sheet."""


def sheet_of(
    board: Board, *, margin_mm: float | None = None, paper: str | None = None
) -> BoardSheet:
    """Arrange a board on paper.

    Parameters
    ----------
    board
        Board to print.
    margin_mm
        White margin; by default one square.
    paper
        Paper size from :data:`PAPERS_MM`, in the orientation that fits; by default the size of the
        board with its margin.

    Raises
    ------
    InvalidParameter
        If the board does not fit on the paper, or paper or margin are invalid.
    """
    black, (width, height), corner = _drawn(board)
    margin = number(
        "margin_mm",
        WHITE_MARGIN * board.square_mm if margin_mm is None else margin_mm,
        low=0,
        unit="mm",
    )
    if paper is None:
        size = (width + 2 * margin, height + 2 * margin)
    else:
        choice("paper", paper, PAPERS_MM)
        size = PAPERS_MM[paper] if width >= height else PAPERS_MM[paper][::-1]
        if width > size[0] or height > size[1]:
            raise InvalidParameter(
                f"paper must be larger than the board of {width:g} x {height:g} mm; got "
                f"{paper} ({size[0]:g} x {size[1]:g} mm); use smaller squares or a larger "
                "paper"
            )
    left, top = (size[0] - width) / 2, (size[1] - height) / 2
    return BoardSheet(
        size,
        black + np.array([left, top, 0, 0]),
        (left + corner[0], top + corner[1]),
        words_of(board),
    )


def words_of(board: Board) -> str:
    """Return the description of a board, with the values for the command line and Python.

    >>> words_of(Board("chessboard", 11, 7, 30.0))
    'omnimirror chessboard 11x7, squares of 30 mm; reference line 100 mm'
    """
    unit = "tags" if board.kind == "aprilgrid" else "squares"
    markers = (
        f", markers of {board.marker_side_mm:g} mm {board.marker_family}"
        if board.kind == "charuco"
        else ""
    )
    gaps = (
        f", spacing {board.spacing:g}, {board.marker_family}" if board.kind == "aprilgrid" else ""
    )
    size = f"{board.columns}x{board.rows}, {unit} of {board.square_mm:g} mm"
    return f"omnimirror {board.kind} {size}{markers}{gaps}; reference line {RULER_MM:g} mm"


@validate_arguments
def draw_board(
    board: Board, *, px_per_mm: float = 4.0, margin_mm: float | None = None
) -> NDArray[np.uint8]:
    """Draw a board, black on white.

    Parameters
    ----------
    board
        Board to draw.
    px_per_mm
        Pixels per mm; edges are rounded to whole pixels.
    margin_mm
        White margin; by default one square.

    Returns
    -------
    (height, width) array of bytes

    Raises
    ------
    InvalidParameter
        If the image would be larger than 30000 px in one dimension.

    Examples
    --------
    >>> draw_board(Board("chessboard", 11, 7, 30.0), px_per_mm=2.0).shape
    (600, 840)
    """
    return _raster(
        sheet_of(board, margin_mm=margin_mm), number("px_per_mm", px_per_mm, above=0, high=1e4)
    )


@validate_arguments
def write_board(
    board: Board,
    path: str | Path,
    *,
    margin_mm: float | None = None,
    paper: str | None = None,
    dpi: float = 300.0,
) -> Path:
    """Write a board for printing at true scale.

    Print without scaling to the page and check the scale by measurement. PDF and SVG contain
    rectangles in mm, and a reference line of 100 mm with a description of the board. PNG files
    contain their resolution.

    Parameters
    ----------
    board
        Board to print.
    path
        Output file; the suffix selects the format: ``.pdf``, ``.svg`` or ``.png``.
    margin_mm
        White margin; by default one square, or with a paper size the remaining space.
    paper
        ``"A0"`` to ``"A4"`` or ``"letter"``; by default the size of the board with its margin.
    dpi
        Resolution of a PNG file in dots per inch.

    Returns
    -------
    Path
        Written file.

    Raises
    ------
    InvalidParameter
        If the board does not fit on the paper, or the image size is out of range.
    MediaError
        If the suffix is not supported.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = write_board(Board("aprilgrid", 6, 6, 88.0), f"{folder}/grid.pdf")
    ...     path.read_bytes()[:8]
    b'%PDF-1.4'
    """
    path = file_name("path", path)
    if path.suffix.lower() not in SUFFIXES:
        raise MediaError(f"cannot write {path}: boards are written as {', '.join(SUFFIXES)}")
    sheet = sheet_of(board, margin_mm=margin_mm, paper=paper)
    match path.suffix.lower():
        case ".pdf":
            data = _pdf(sheet)
        case ".svg":
            data = _svg(sheet).encode()
        case _:
            data = _png(_raster(sheet, number("dpi", dpi, above=0) / 25.4), dpi)
    with atomic_output(path) as temporary:
        temporary.write_bytes(data)
    return path


# -- layout -----------------------------------------------------------------------------------


def _drawn(board: Board) -> tuple[Array, tuple[float, float], tuple[float, float]]:
    """Return black rectangles (k, 4), board size, and corner 0, in mm from the upper left, Y down."""
    side = board.square_mm
    if board.kind == "aprilgrid":
        gap = board.spacing * side
        size = (board.columns * (side + gap) + gap, board.rows * (side + gap) + gap)
        return np.array(list(_april(board, gap, size[1]))), size, (gap, size[1] - gap)
    additional = 1 if board.kind == "chessboard" else 0
    columns, rows = board.columns + additional, board.rows + additional
    first = 1 if board.legacy and board.kind == "charuco" and rows % 2 == 0 else 0
    squares = [(c, r) for r in range(rows) for c in range(columns)]
    black = [(c * side, r * side, side, side) for c, r in squares if (c + r) % 2 == first]
    if board.kind == "charuco":
        inset = (side - board.marker_side_mm) / 2
        white = [(c, r) for c, r in squares if (c + r) % 2 != first]
        for marker, (c, r) in enumerate(white):
            cells = _marker(board, marker)
            black += _cells(
                cells, c * side + inset, r * side + inset, board.marker_side_mm / len(cells)
            )
    return np.array(black), (columns * side, rows * side), (side, side)


def _april(board: Board, gap: float, height: float) -> Iterator[tuple[float, float, float, float]]:
    """Yield the rectangles of an April grid as printed by Kalibr.

    Tags start at the lower left and are rotated by 180 deg, with black squares at the crossings of
    the gaps.
    """
    side = board.square_mm
    for row in range(board.rows + 1):
        for column in range(board.columns + 1):
            left, top = column * (side + gap), height - row * (side + gap) - gap
            yield left, top, gap, gap
            if row < board.rows and column < board.columns:
                cells = np.rot90(_marker(board, row * board.columns + column), 2)
                yield from _cells(cells, left + gap, top - side, side / len(cells))


def _marker(board: Board, number: int) -> NDArray[np.bool_]:
    """Return the mask of black cells of a marker."""
    import cv2

    family = dictionary(board.marker_family)
    cells = int(family.markerSize) + 2 * board.border_bits
    marker_image = cv2.aruco.generateImageMarker(
        family, number, cells, borderBits=board.border_bits
    )
    return np.asarray(marker_image) < 128


def _cells(
    black: NDArray[np.bool_], left: float, top: float, side: float
) -> list[tuple[float, float, float, float]]:
    """Return black cells as rectangles, merged along rows."""
    rectangles = []
    for row, cells in enumerate(black):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], cells.astype(int), [0]])))
        rectangles += [
            (left + a * side, top + row * side, (b - a) * side, side)
            for a, b in edges.reshape(-1, 2)
        ]
    return rectangles


# -- files ------------------------------------------------------------------------------------


def _raster(sheet: BoardSheet, px_per_mm: float) -> NDArray[np.uint8]:
    width, height = (round(min(length * px_per_mm, 1e9)) for length in sheet.size_mm)
    if not 1 <= min(width, height) <= max(width, height) <= MAX_PX:
        raise InvalidParameter(
            f"the image must have 1 to {MAX_PX} px per side; got {width} x {height} px"
        )
    image = np.full((height, width), 255, np.uint8)
    corners = np.concatenate(
        [sheet.black_mm[:, :2], sheet.black_mm[:, :2] + sheet.black_mm[:, 2:]], axis=1
    )
    for left, top, right, bottom in np.rint(corners * px_per_mm).astype(int):
        image[top:bottom, left:right] = 0
    return image


def _png(image: NDArray[np.uint8], dpi: float) -> bytes:
    """Return a PNG file with its resolution in pixels per metre, for printing at true scale."""
    from ...io.images import encoded

    data = encoded(image, ".png")
    head = 8 + 25  # signature and first chunk, both of fixed length
    metre = round(dpi / 0.0254)
    chunk = b"pHYs" + struct.pack(">IIB", metre, metre, 1)
    return (
        data[:head]
        + struct.pack(">I", 9)
        + chunk
        + struct.pack(">I", zlib.crc32(chunk))
        + data[head:]
    )


def _foot(sheet: BoardSheet) -> tuple[float, float, float]:
    """Return left end, height and length of the reference line; length 0 if there is no space."""
    width, height = sheet.size_mm
    below = height - float((sheet.black_mm[:, 1] + sheet.black_mm[:, 3]).max())
    has_room = below >= 4 * TEXT_MM and width >= RULER_MM + 2 * TEXT_MM
    return (
        max(TEXT_MM, float(sheet.black_mm[:, 0].min())),
        height - TEXT_MM,
        RULER_MM if has_room else 0.0,
    )


def _svg(sheet: BoardSheet) -> str:
    width, height = sheet.size_mm
    bars = "".join(f"M{x:.6g} {y:.6g}h{w:.6g}v{h:.6g}h{-w:.6g}z" for x, y, w, h in sheet.black_mm)
    left, bottom, ruler = _foot(sheet)
    foot = (
        f'<path d="M{left:.6g} {bottom:.6g}h{ruler:g}" stroke="black" '
        f'stroke-width="{LINE_MM}"/><text x="{left:.6g}" y="{bottom - 1.5:.6g}" '
        f'font-family="sans-serif" font-size="{TEXT_MM}">{xml_text(sheet.text)}</text>'
        if ruler
        else ""
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.6g}mm" '
        f'height="{height:.6g}mm" viewBox="0 0 {width:.6g} {height:.6g}"><path d="M0 '
        f'0h{width:.6g}v{height:.6g}h{-width:.6g}z" fill="white"/><path d="{bars}" '
        f'shape-rendering="crispEdges"/>{foot}</svg>\n'
    )


def _pdf(sheet: BoardSheet) -> bytes:
    """Return a PDF page of rectangles; PDF coordinates are points from the lower left."""
    width, height = sheet.size_mm
    scale = POINTS_PER_MM
    lines = [f"{scale:.9f} 0 0 {scale:.9f} 0 0 cm 0 g"]
    lines += [
        f"{x:.5f} {height - y - h:.5f} {w:.5f} {h:.5f} re" for x, y, w, h in sheet.black_mm
    ] + ["f"]
    left, bottom, ruler = _foot(sheet)
    if ruler:
        lines.append(
            f"{LINE_MM} w {left:.5f} {height - bottom:.5f} m {left + ruler:.5f} {height - bottom:.5f} l S"
        )
        lines.append(
            f"BT /F {TEXT_MM} Tf {left:.5f} {height - bottom + 1.5:.5f} Td ({sheet.text}) Tj ET"
        )
    content = zlib.compress("\n".join(lines).encode("latin-1"))
    box = f"[0 0 {width * scale:.5f} {height * scale:.5f}]"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences 6 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R ".encode()
        + b"/Resources << /Font << /F 5 0 R >> >> >>",
        f"<< /Length {len(content)} /Filter /FlateDecode >>\nstream\n".encode()
        + content
        + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        b"<< /PrintScaling /None >>",
    ]

    data, starts = b"%PDF-1.4\n", []
    for index, body in enumerate(objects, 1):
        starts.append(len(data))
        data += f"{index} 0 obj\n".encode() + body + b"\nendobj\n"
    table = "".join(f"{start:010d} 00000 n \n" for start in starts)
    count = len(objects) + 1
    trailer = f"trailer\n<< /Size {count} /Root 1 0 R >>\nstartxref\n{len(data)}\n%%EOF\n"
    return data + f"xref\n0 {count}\n0000000000 65535 f \n{table}{trailer}".encode()
