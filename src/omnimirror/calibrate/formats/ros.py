"""ROS's ``camera_info`` YAML, as ``camera_calibration_parsers`` writes it: plumb_bob, rational_polynomial, equidistant.

All three are of a camera that looks ahead and projects less than 90 deg from its axis; ``plumb_bob`` and
``rational_polynomial`` are pinholes, of which the picture is infinitely large at 90 deg. The frame is ROS's optical
frame, x right, y down, z ahead.
"""

from __future__ import annotations

import re
from typing import Any

from ...camera_models import KannalaBrandt, RationalPinhole, Unified
from ...errors import OmnimirrorError, SpecError
from ...escaping import yaml_string
from .base import CameraFormat, Layout, Reading, Stored, named, row, text_of
from .entries import read_yaml
from .opencv_omnidir import camera_matrix

MATRIX = frozenset({"fx", "fy", "skew", "cx", "cy"})
RATIONAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
COUNTS = {"plumb_bob": (5, 4), "rational_polynomial": (8,), "equidistant": (4,)}


def read(data: bytes, reading: Reading) -> list[Stored]:
    """The camera of the file; a rectified picture's matrices are left aside."""
    table = read_yaml(text_of(data, reading.source), reading.source)
    size = table["image_width"].whole(), table["image_height"].whole()
    focal, centre, skew = camera_matrix(table["camera_matrix"])
    model = table["distortion_model"].choice(*COUNTS, "fisheye")
    model = "equidistant" if model == "fisheye" else model  # as some drivers call it
    k = table["distortion_coefficients"].row(*COUNTS[model])
    common: dict[str, Any] = {
        "focal_px": focal, "centre_px": centre, "image_size": size, "skew_px": skew, **reading.told,
    }  # fmt: skip
    try:
        if model == "equidistant":
            camera: Any = KannalaBrandt(**common, **named(("k1", "k2", "k3", "k4"), k))
        elif model == "rational_polynomial":
            camera = RationalPinhole(**common, **named(RATIONAL, k))
        else:
            names = ("k1", "k2", "p1", "p2", "k3")
            camera = Unified(0.0, **common, **named(names, k))
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None
    return [Stored(table["camera_name"].word() if "camera_name" in table else "", camera)]


def _written(camera: Any, name: str, model: str, coefficients: tuple[float, ...]) -> str:
    (fx, fy), (cx, cy), (width, height) = camera.focal_px, camera.centre_px, camera.image_size
    matrices = (
        ("camera_matrix", 3, 3, (fx, camera.skew_px, cx, 0, fy, cy, 0, 0, 1)),
        ("distortion_coefficients", 1, len(coefficients), coefficients),
        ("rectification_matrix", 3, 3, (1, 0, 0, 0, 1, 0, 0, 0, 1)),
        ("projection_matrix", 3, 4, (fx, camera.skew_px, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0)),
    )
    first, second, *others = (
        f"{title}:\n  rows: {rows}\n  cols: {columns}\n  data: [{row(numbers)}]\n"
        for title, rows, columns, numbers in matrices
    )
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: {yaml_string(name or 'camera')}\n"
        f"{first}distortion_model: {model}\n{second}{''.join(others)}"
    )


def write_equidistant(camera: KannalaBrandt, name: str = "") -> str:
    """The text of an ``equidistant`` camera."""
    return _written(camera, name, "equidistant", (camera.k1, camera.k2, camera.k3, camera.k4))


def write_plumb_bob(camera: Unified, name: str = "") -> str:
    """The text of a ``plumb_bob`` camera."""
    return _written(camera, name, "plumb_bob", (camera.k1, camera.k2, camera.p1, camera.p2, camera.k3))


def write_rational(camera: RationalPinhole, name: str = "") -> str:
    """The text of a ``rational_polynomial`` camera."""
    return _written(camera, name, "rational_polynomial", tuple(getattr(camera, k) for k in RATIONAL))


def recognises(name: str, data: bytes) -> bool:
    """Whether it has a camera matrix and a distortion model."""
    return b"camera_matrix" in data and re.search(rb"^distortion_model\s*:", data, re.M) is not None


FORMAT = CameraFormat(
    "ROS camera_info YAML",
    recognises,
    read,
    {
        "ros-equidistant": Layout(
            KannalaBrandt, write_equidistant, "equidistant", MATRIX | {"k1", "k2", "k3", "k4"}, 90.0
        ),
        "ros-plumb-bob": Layout(Unified, write_plumb_bob, "plumb_bob", MATRIX | {"k1", "k2", "p1", "p2", "k3"}, 90.0),
        "ros-rational": Layout(RationalPinhole, write_rational, "rational_polynomial", MATRIX | {*RATIONAL}, 90.0),
    },
    ("*camera_info*.yaml", "*camera_info*.yml"),
)
