"""OpenCV's module fisheye: Kannala and Brandt's polynomial in a YAML file, as OpenCV's calibration sample writes it.

OpenCV's functions divide by Z first, so that they project and undistort less than 90 deg from the axis, although the
formula itself goes on.
"""

from __future__ import annotations

import re

from ...camera_models import KannalaBrandt
from ...errors import OmnimirrorError, SpecError
from .base import CameraFormat, Layout, Reading, Stored, named, text_of
from .entries import read_yaml
from .opencv_omnidir import camera_matrix, image_size, opencv_matrix

PLACES = frozenset({"fx", "fy", "skew", "cx", "cy", "k1", "k2", "k3", "k4"})
BEHIND_DEG = 90.0


def read(data: bytes, reading: Reading) -> list[Stored]:
    """The camera of the file."""
    table = read_yaml(text_of(data, reading.source), reading.source)
    focal, centre, skew = camera_matrix(table["camera_matrix"])
    distortion = table["distortion_coefficients"]
    if len(distortion.flat().entries()) > 4:
        distortion.refuse("has more than 4 numbers, as of a pinhole camera; of a fisheye it is valid with 4, k1 to k4")
    ks = named(("k1", "k2", "k3", "k4"), distortion.row(4))
    try:
        camera = KannalaBrandt(focal, centre, image_size(table, reading), skew_px=skew, **ks, **reading.told)
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None
    return [Stored("", camera)]


def write(camera: KannalaBrandt, name: str = "") -> str:
    """The text of the file."""
    (fx, fy), (cx, cy), (width, height) = camera.focal_px, camera.centre_px, camera.image_size
    return (
        "%YAML:1.0\n---\n"
        f"image_width: {width}\nimage_height: {height}\nfisheye_model: 1\n"
        + opencv_matrix("camera_matrix", 3, 3, [fx, camera.skew_px, cx, 0, fy, cy, 0, 0, 1])
        + opencv_matrix("distortion_coefficients", 4, 1, [camera.k1, camera.k2, camera.k3, camera.k4])
    )


def recognises(name: str, data: bytes) -> bool:
    """Whether it has a camera matrix, and nothing that ROS or omnidir write beside one."""
    others = re.search(rb"^(xi|distortion_model)\s*:", data, re.M)
    return b"camera_matrix" in data and b"distortion_coefficients" in data and others is None


FORMAT = CameraFormat(
    "OpenCV fisheye YAML",
    recognises,
    read,
    {"opencv-fisheye": Layout(KannalaBrandt, write, "Kannala and Brandt's polynomial", PLACES, BEHIND_DEG)},
)
