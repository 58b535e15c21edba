"""OpenCV omnidir YAML: Mei's unified sphere, as in the sample ``omni_calibration``.

The sample does not write the image size; this module adds ``image_width`` and ``image_height``,
named as in OpenCV's other samples. omnidir has no k3.
"""

from __future__ import annotations

from ...base.errors import OmnimirrorError, SpecError
from ...cameras.models import Unified
from .base import CameraFile, CameraFormat, Layout, Reading, Stored, row
from .entries import Node

PLACES = frozenset({"xi", "fx", "fy", "skew", "cx", "cy", "k1", "k2", "p1", "p2"})


def read(file: CameraFile, reading: Reading) -> list[Stored]:
    """Read the camera of the file."""
    table = file.entries
    focal, centre, skew = camera_matrix(table["camera_matrix"])
    k1, k2, p1, p2 = table["distortion_coefficients"].row(4)
    xi = table["xi"].row(1)[0] if isinstance(table["xi"].value, dict | list) else table["xi"].number()
    size = image_size(table, reading)
    try:
        camera = Unified(xi, focal, centre, size, skew, k1=k1, k2=k2, p1=p1, p2=p2, **reading.told)
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None
    return [Stored("", camera)]


def camera_matrix(entry: Node) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Return focal lengths, centre and skew of a matrix ``[fx s cx; 0 fy cy; 0 0 1]``."""
    (fx, skew, cx), (zero, fy, cy), last = entry.matrix(3, 3).tolist()
    if zero != 0 or last != [0, 0, 1]:
        entry.refuse("is not valid; it is valid as [fx, s, cx, 0, fy, cy, 0, 0, 1]")
    return (fx, fy), (cx, cy), skew


def image_size(table: Node, reading: Reading) -> tuple[int, int]:
    """Return the image size from the file, otherwise the given size."""
    if "image_width" in table and "image_height" in table:
        return table["image_width"].whole(), table["image_height"].whole()
    return reading.size()


def opencv_matrix(name: str, rows: int, columns: int, numbers: list[float]) -> str:
    """Return a matrix in the format of OpenCV's FileStorage."""
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {row(numbers)} ]\n"


def write(camera: Unified, name: str = "") -> str:
    """Return the text of the file."""
    (fx, fy), (cx, cy), (width, height) = camera.focal_px, camera.centre_px, camera.image_size
    return (
        "%YAML:1.0\n---\n"
        f"image_width: {width}\nimage_height: {height}\n"
        + opencv_matrix("camera_matrix", 3, 3, [fx, camera.skew_px, cx, 0, fy, cy, 0, 0, 1])
        + opencv_matrix("distortion_coefficients", 1, 4, [camera.k1, camera.k2, camera.p1, camera.p2])
        + f"xi: {row([camera.xi])}\n"
    )


def recognises(file: CameraFile) -> bool:
    """Check for a camera matrix and xi."""
    return file.has("camera_matrix", "xi")


FORMAT = CameraFormat(
    "OpenCV omnidir FileStorage",
    recognises,
    read,
    {"opencv-omnidir": Layout(Unified, write, "the unified sphere", PLACES)},
)
