"""OpenCV pinhole YAML with distortion, as in OpenCV's calibration sample.

Coefficients are k1, k2, p1, p2, k3, and k4, k5, k6 of the rational model. OpenCV ignores skew and
projects less than 90 deg from the axis.
"""

from __future__ import annotations

from typing import Any

from ...base.errors import OmnimirrorError, SpecError
from ...cameras.models import RationalPinhole, Unified
from .base import CameraFile, CameraFormat, Layout, Reading, Stored, named
from .opencv_fisheye import count_of, fisheye_model, is_matrix_with_coefficients
from .opencv_omnidir import camera_matrix, image_size, opencv_matrix

MATRIX = frozenset({"fx", "fy", "cx", "cy"})
NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
COUNTS = (4, 5, 8, 12, 14)


def read(file: CameraFile, reading: Reading) -> list[Stored]:
    """Read the camera of the file."""
    table = file.entries
    for name in ("xi", "distortion_model"):
        if name in table:
            table[name].refuse("does not belong to a pinhole camera of OpenCV, as which this is read")
    if fisheye_model(table):
        table["fisheye_model"].refuse("= 1 is that of a fisheye, and this is read as a pinhole camera")
    focal, centre, skew = camera_matrix(table["camera_matrix"])
    k = table["distortion_coefficients"].row(*COUNTS)
    if any(k[8:]):
        table["distortion_coefficients"].refuse(
            "holds thin-prism or tilt terms, which no camera model of ours has; all after the eighth must be 0"
        )
    model: Any = RationalPinhole if any(k[5:]) else Unified
    law = {} if model is RationalPinhole else {"xi": 0.0}
    numbers = named(NAMES if model is RationalPinhole else NAMES[:5], k)
    try:
        camera = model(
            focal_px=focal, centre_px=centre, image_size=image_size(table, reading), **law, **numbers, **reading.told
        )
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None
    ignored = (f"the skew of {skew:g} px is ignored, as by OpenCV's functions",) if skew else ()
    return [Stored("", camera, ignored)]


def write(camera: Any, name: str = "") -> str:
    """Return the text of the file, with five coefficients, or eight for the rational model."""
    (fx, fy), (cx, cy), (width, height) = camera.focal_px, camera.centre_px, camera.image_size
    k = [getattr(camera, n) for n in NAMES[: 8 if isinstance(camera, RationalPinhole) else 5]]
    return (
        "%YAML:1.0\n---\n"
        f"image_width: {width}\nimage_height: {height}\nfisheye_model: 0\n"
        + opencv_matrix("camera_matrix", 3, 3, [fx, 0, cx, 0, fy, cy, 0, 0, 1])
        + opencv_matrix("distortion_coefficients", len(k), 1, k)
    )


def recognises(file: CameraFile) -> bool:
    """Check for a camera matrix with coefficients, unless another model is declared."""
    if not is_matrix_with_coefficients(file):
        return False
    flag = fisheye_model(file.entries)
    return count_of(file) in COUNTS if flag is None else not flag


FORMAT = CameraFormat(
    "OpenCV pinhole FileStorage: k1, k2, p1, p2, ...",
    recognises,
    read,
    {
        "opencv-pinhole": Layout(Unified, write, "a pinhole camera", MATRIX | {*NAMES[:5]}, 90.0),
        "opencv-rational": Layout(RationalPinhole, write, "a rational pinhole camera", MATRIX | {*NAMES}, 90.0),
    },
)
