"""Printable boards: detection by other programs, and true size in all file formats."""

from __future__ import annotations

import re
import zlib

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.calibration.targets.printing import sheet_of
from tests.calibration.targets.rendering import photographed, pose
from tests.commands import omnimirror

BOARDS = {
    "chessboard": om.Board("chessboard", 8, 5, 20.0),
    "charuco": om.Board("charuco", 7, 6, 20.0, family="4X4_50"),
    "charuco-legacy": om.Board("charuco", 7, 6, 20.0, family="4X4_50", legacy=True),
    "aprilgrid": om.Board("aprilgrid", 4, 3, 30.0),
}


@pytest.mark.parametrize("name", BOARDS)
def test_corners_are_detected_at_drawn_positions(name):
    board, scale = BOARDS[name], 3.0
    sheet = sheet_of(board)
    detection = om.find_board(
        cv2.GaussianBlur(om.draw_board(board, px_per_mm=scale), (0, 0), 0.8), board
    )
    flat = board.points_mm[detection.ids, :2] * ([1, -1] if board.kind == "aprilgrid" else [1, 1])
    np.testing.assert_allclose(
        detection.corners_px, (flat + sheet.first_corner_mm) * scale - 0.5, atol=0.02
    )
    assert len(detection.ids) == board.corner_count
    assert not detection.is_reversed


@pytest.mark.parametrize("legacy", [False, True])
def test_opencv_detects_the_charuco_boards(legacy):
    board = BOARDS["charuco-legacy" if legacy else "charuco"]
    reference = cv2.aruco.CharucoBoard(
        (7, 6), 20.0, 15.0, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    )
    reference.setLegacyPattern(legacy)
    corners, ids, *_ = cv2.aruco.CharucoDetector(reference).detectBoard(
        om.draw_board(board, px_per_mm=5.0)
    )
    assert ids.ravel().tolist() == list(range(30))
    expected = (board.points_mm[:, :2] + sheet_of(board).first_corner_mm) * 5.0 - 0.5
    np.testing.assert_allclose(corners.reshape(-1, 2), expected, atol=0.5)


def test_tags_of_an_april_grid_are_kalibrs():
    """First codes of Kalibr's generator, which draws bits from the lower right, row by row, black
    for 0."""
    board = BOARDS["aprilgrid"]
    board_image, sheet = om.draw_board(board, px_per_mm=2.0), sheet_of(board)
    for tag, code in enumerate([0xD5D628584, 0xD97F18B49, 0xDD280910E]):
        left = sheet.first_corner_mm[0] + tag * 39.0
        cells = 3.0 * (np.arange(10) + 0.5)  # mm: six bits and a frame of two on both sides
        rows = np.round((sheet.first_corner_mm[1] - 30 + cells) * 2 - 0.5).astype(int)
        columns = np.round((left + cells) * 2 - 0.5).astype(int)
        black = board_image[np.ix_(rows, columns)] == 0
        bits = sum(1 << (6 * i + j) for i in range(6) for j in range(6) if not black[7 - i, 7 - j])
        assert bits == code
        assert black[[0, 1, 8, 9]].all()


@pytest.mark.full
@pytest.mark.long
@pytest.mark.parametrize(
    ("board", "board_pose"),
    [
        pytest.param(om.Board("charuco", 8, 6, 40.0), (130, -30, 330, -20, 15, 30), id="charuco"),
        pytest.param(
            om.Board("aprilgrid", 4, 4, 50.0), (300, -20, 330, 180, 20, -20), id="aprilgrid"
        ),
    ],
)
def test_marked_boards_are_detected_in_reversed_and_flipped_images(board, board_pose):
    """A mirror reverses its image, and a flip compensates for it."""
    sensor = om.load_sensor("prototype-hyperboloidal")
    photograph = photographed(sensor, board, pose(board, *board_pose), sheet=printed(board))
    flipped = (
        np.ascontiguousarray(photograph.image[:, ::-1]),
        [1023, 0] + [-1, 1] * photograph.corners_px,
    )
    for image, corners, is_reversed in ((*photograph, True), (*flipped, False)):
        detection = om.find_board(image, board)
        error = detection.corners_px - corners[detection.ids]
        assert detection.is_reversed == is_reversed
        assert len(detection.ids) > 0.9 * board.corner_count
        assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.05
        assert np.abs(error.mean(axis=0)).max() < 0.012


def printed(board):
    """Return the brightness of points of a printed board, mm."""
    scale = 10.0
    board_image, corner = om.draw_board(board, px_per_mm=scale), sheet_of(board).first_corner_mm

    def brightness(points):
        down = points * ([1, -1] if board.kind == "aprilgrid" else [1, 1])
        u, v = np.floor((down + corner) * scale).astype(int).T
        inside = (u >= 0) & (v >= 0) & (u < board_image.shape[1]) & (v < board_image.shape[0])
        return np.where(inside, 30 + 180.0 * (board_image[v * inside, u * inside] > 0), np.nan)

    return brightness


def test_flipped_images_are_reported():
    board = BOARDS["charuco"]
    image = om.draw_board(board, px_per_mm=2.5)
    detections = om.find_boards([image, image[:, ::-1], image], board, names=["a", "b", "c"])
    assert [d.used for d in detections] == [True, False, True]
    assert detections[1].reason == "it is a mirror image, unlike the others: it was flipped"


def opencv_grid(border_bits):
    """Return a grid of 6 x 5 upright tags as drawn by OpenCV: numbered to the right and down."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11)
    grid_image = cv2.aruco.GridBoard((6, 5), 1.0, 0.3, family).generateImage(
        (600, 510), marginSize=30, borderBits=border_bits
    )
    return np.pad(grid_image, 60, constant_values=255)


@pytest.mark.parametrize("turn", [np.asarray, np.fliplr, np.rot90])
def test_tag_grids_of_other_programs_are_reported(turn):
    """Their tags would be decoded and confused with others."""
    board = om.Board("aprilgrid", 6, 5, 30.0)
    detection = om.find_board(np.ascontiguousarray(turn(opencv_grid(2))), board)
    assert detection.reason == (
        "the order of its tags is not that of an April grid of 6 x 5 tags: right of tag N is N+1 and below it "
        "N+6; Kalibr's order is N-1 and N+6"
    )
    thin = om.find_board(np.ascontiguousarray(turn(opencv_grid(1))), board)
    assert thin.reason == (
        "30 of its tags have a frame of 1 bit, as in AprilTag and OpenCV; tags of Kalibr's April grid have 2 bits"
    )


def test_inverted_tag_is_rejected():
    """Its axes are exactly those of its neighbours, reversed."""
    board = om.Board("aprilgrid", 6, 5, 30.0)
    image = om.draw_board(board, px_per_mm=2.0)
    corners = om.find_board(image, board).corners_px.reshape(5, 2, 6, 2, 2)[2, :, 2].reshape(4, 2)
    (left, top), (right, bottom) = (
        corners.min(axis=0).round().astype(int) - 4,
        corners.max(axis=0).round().astype(int) + 5,
    )
    image[top:bottom, left:right] = image[top:bottom, left:right][::-1, ::-1].copy()
    detection = om.find_board(image, board)
    assert detection.used
    assert len(detection.ids) >= board.corner_count - 4


def test_april_grids_of_other_size_or_spacing_are_reported():
    image = om.draw_board(om.Board("aprilgrid", 6, 5, 30.0), px_per_mm=2.0)
    assert om.find_board(image, om.Board("aprilgrid", 6, 5, 30.0)).used
    other = om.find_board(image, om.Board("aprilgrid", 7, 5, 30.0))
    assert other.reason.startswith(
        "the order of its tags is not that of an April grid of 7 x 5 tags"
    )
    assert other.reason.endswith("N-1 and below it N+6; Kalibr's order is N-1 and N+7")
    wide = om.find_board(image, om.Board("aprilgrid", 6, 5, 30.0, spacing=0.8))
    assert re.fullmatch(
        r"the gaps between its tags are 0\.3\d times the tag side; got spacing = 0\.8",
        wide.reason,
    )


def test_files_have_the_true_size(tmp_path):
    """Squares of 20 mm: in points of a PDF, millimetres of an SVG, and pixels per metre of a PNG."""
    board = BOARDS["chessboard"]
    pdf = om.write_board(board, tmp_path / "b.pdf").read_bytes()
    content = zlib.decompress(re.search(rb"stream\n(.*?)\nendstream", pdf, re.S)[1]).decode()
    scale = float(content.split()[0])
    sides = {
        tuple(map(float, line.split()[2:4]))
        for line in content.splitlines()
        if line.endswith(" re")
    }
    assert sides == {(20.0, 20.0)}
    assert scale == pytest.approx(72 / 25.4)
    box = re.search(rb"MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf)
    assert [float(side) for side in box.groups()] == pytest.approx(
        [220 * 72 / 25.4, 160 * 72 / 25.4], abs=1e-4
    )
    for number, start in enumerate(re.findall(rb"(\d{10}) 00000 n", pdf), 1):
        assert pdf[int(start) :].startswith(f"{number} 0 obj".encode())

    svg = om.write_board(board, tmp_path / "b.svg").read_text()
    assert 'width="220mm" height="160mm" viewBox="0 0 220 160"' in svg
    assert "M20 20h20v20h-20z" in svg

    png = om.write_board(board, tmp_path / "b.png", dpi=254).read_bytes()
    at = png.index(b"pHYs")
    assert int.from_bytes(png[at + 4 : at + 8]) == 10_000  # 0.1 mm
    assert zlib.crc32(png[at : at + 13]) == int.from_bytes(png[at + 13 : at + 17])
    assert om.read_image(tmp_path / "b.png").shape == (1600, 2200)


def test_invalid_print_parameters_raise(tmp_path):
    with pytest.raises(
        om.base.errors.InvalidParameter,
        match=r"paper must be larger than the board of 360 x 240 mm; got A4 \(297 x 210 mm\)",
    ):
        om.write_board(om.Board("chessboard", 11, 7, 30.0), tmp_path / "b.pdf", paper="A4")
    with pytest.raises(om.base.errors.MediaError, match=r"boards are written as .pdf, .svg, .png"):
        om.write_board(BOARDS["chessboard"], tmp_path / "b.dxf")


def test_command_and_python_write_equal_files(tmp_path):
    board = om.Board("charuco", 7, 5, 25.0, marker_mm=18.0, family="4X4_50")
    args = [
        "--target",
        "charuco",
        "--board",
        "7x5",
        "--square-mm",
        "25",
        "--set",
        "board.marker_mm=18",
        "--set",
        "board.family=4x4_50",
    ]
    run = omnimirror("board", *args, "-o", "board.svg", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "board.svg").read_text() == om.write_board(
        board, tmp_path / "same.svg"
    ).read_text()
    assert "board.svg" in run.stdout
