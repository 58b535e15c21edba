"""ROS ``camera_info`` YAML, as written by ``camera_calibration_parsers``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

from ...base.errors import OmnimirrorError, SpecError
from ...base.escaping import yaml_string
from ...cameras.models import KannalaBrandt, RationalPinhole, Unified
from ._camera_format import (
    CameraEntry,
    CameraFile,
    CameraFormat,
    Layout,
    Node,
    ReadOptions,
    named_numbers,
    number_row,
)
from ._opencv import camera_matrix, distortion_numbers

Matrix: TypeAlias = tuple[tuple[float, float], tuple[float, float], float]
MATRIX = frozenset({"fx", "fy", "skew", "cx", "cy"})
RATIONAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
COUNTS = {"plumb_bob": (5, 4), "rational_polynomial": (8, 12, 14), "equidistant": (4,)}


def read(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera of the file; matrices of the rectified image are ignored."""
    table = file.entries
    if "camera_matrix" not in table:
        return [_message(table, reading)]
    size = table["image_width"].integer(), table["image_height"].integer()
    focal, centre, skew = camera_matrix(table["camera_matrix"])
    camera = _camera(table, "distortion_coefficients", (focal, centre, skew), size, reading)
    return [CameraEntry(table.label("camera_name"), camera)]


def _message(table: Node, reading: ReadOptions) -> CameraEntry:
    """Read a message ``sensor_msgs/CameraInfo``; ROS 2 writes K and D in lower case."""
    K, D = ("K", "D") if "K" in table else ("k", "d")
    matrix = camera_matrix(Node({"data": table[K]}, table.source, K, table[K].line))
    size = table["width"].integer(), table["height"].integer()
    return CameraEntry("", _camera(table, D, matrix, size, reading), tuple(_cropped(table)))


def _cropped(table: Node) -> Iterator[str]:
    """Yield notes on binning and a region of interest, which the camera matrix does not include."""
    binning = [table[n].integer() for n in ("binning_x", "binning_y") if n in table]
    if any(n > 1 for n in binning):
        yield (
            f"the camera bins {' x '.join(map(str, binning))} pixels; the camera matrix applies to the "
            "image without binning"
        )
    roi = table["roi"] if "roi" in table else Node({}, "")
    region = [
        roi[n].integer() if n in roi else 0 for n in ("x_offset", "y_offset", "width", "height")
    ]
    whole = [0, 0, table["width"].integer(), table["height"].integer()]
    if any(region) and region != whole:
        yield (
            "the camera transmits only the region {2}x{3} at ({0}, {1}); the camera matrix applies to the "
            "whole image"
        ).format(*region)


def _camera(
    table: Node, coefficients: str, matrix: Matrix, size: tuple[int, int], reading: ReadOptions
) -> Any:
    """Create the camera of a distortion model and its coefficients."""
    model = table["distortion_model"].choice(*COUNTS, "fisheye")
    model = "equidistant" if model == "fisheye" else model  # name used by some drivers
    k = distortion_numbers(table[coefficients], *COUNTS[model])
    focal, centre, skew = matrix
    common: dict[str, Any] = {
        "focal_px": focal,
        "centre_px": centre,
        "image_size": size,
        "skew_px": skew,
        **reading.model_arguments,
    }
    try:
        if model == "equidistant":
            return KannalaBrandt(**common, **named_numbers(("k1", "k2", "k3", "k4"), k))
        if model == "rational_polynomial":
            return RationalPinhole(**common, **named_numbers(RATIONAL, k))
        return Unified(xi=0.0, **common, **named_numbers(("k1", "k2", "p1", "p2", "k3"), k))
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None


def _written(camera: Any, name: str, model: str, coefficients: tuple[float, ...]) -> str:
    (fx, fy), (cx, cy), (width, height) = camera.focal_px, camera.centre_px, camera.image_size
    matrices = (
        ("camera_matrix", 3, 3, (fx, camera.skew_px, cx, 0, fy, cy, 0, 0, 1)),
        ("distortion_coefficients", 1, len(coefficients), coefficients),
        ("rectification_matrix", 3, 3, (1, 0, 0, 0, 1, 0, 0, 0, 1)),
        ("projection_matrix", 3, 4, (fx, camera.skew_px, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0)),
    )
    first, second, *others = (
        f"{title}:\n  rows: {rows}\n  cols: {columns}\n  data: [{number_row(numbers)}]\n"
        for title, rows, columns, numbers in matrices
    )
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: {yaml_string(name or 'camera')}\n"
        f"{first}distortion_model: {model}\n{second}{''.join(others)}"
    )


def write_equidistant(camera: KannalaBrandt, name: str = "") -> str:
    """Return the text of an ``equidistant`` camera."""
    return _written(camera, name, "equidistant", (camera.k1, camera.k2, camera.k3, camera.k4))


def write_plumb_bob(camera: Unified, name: str = "") -> str:
    """Return the text of a ``plumb_bob`` camera."""
    return _written(
        camera, name, "plumb_bob", (camera.k1, camera.k2, camera.p1, camera.p2, camera.k3)
    )


def write_rational(camera: RationalPinhole, name: str = "") -> str:
    """Return the text of a ``rational_polynomial`` camera."""
    return _written(
        camera, name, "rational_polynomial", tuple(getattr(camera, k) for k in RATIONAL)
    )


def recognises(file: CameraFile) -> bool:
    """Check for a distortion model with a camera matrix, or with the K of a message."""
    return file.has("distortion_model") and (
        file.has("camera_matrix") or file.has("K", "D") or file.has("k", "d")
    )


FORMAT = CameraFormat(
    "ROS camera_info or CameraInfo message",
    recognises,
    read,
    {
        "ros-equidistant": Layout(
            KannalaBrandt, write_equidistant, "equidistant", MATRIX | {"k1", "k2", "k3", "k4"}, 90.0
        ),
        "ros-plumb-bob": Layout(
            Unified, write_plumb_bob, "plumb_bob", MATRIX | {"k1", "k2", "p1", "p2", "k3"}, 90.0
        ),
        "ros-rational": Layout(
            RationalPinhole, write_rational, "rational_polynomial", MATRIX | {*RATIONAL}, 90.0
        ),
    },
    ("*camera_info*.yaml", "*camera_info*.yml"),
)
