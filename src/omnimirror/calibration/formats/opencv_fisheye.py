"""OpenCV fisheye YAML: Kannala-Brandt polynomial, as in OpenCV's calibration sample.

OpenCV's functions divide by Z first, which limits projection and undistortion to less than
90 deg from the axis, although the formula is valid beyond.
"""

from __future__ import annotations

from ...base.errors import OmnimirrorError, SpecError
from ...cameras.models import KannalaBrandt
from .base import CameraFile, CameraFormat, Layout, Reading, Stored, named
from .entries import Node
from .opencv_omnidir import camera_matrix, image_size, opencv_matrix

PLACES = frozenset({"fx", "fy", "skew", "cx", "cy", "k1", "k2", "k3", "k4"})
BEHIND_DEG = 90.0


def read(file: CameraFile, reading: Reading) -> list[Stored]:
    """Read the camera of the file."""
    table = file.entries
    if "xi" in table:
        table["xi"].refuse("belongs to a camera of omnidir, and this is read as one of fisheye")
    if fisheye_model(table) is False:
        table["fisheye_model"].refuse("= 0 is that of a pinhole camera, and this is read as a fisheye")
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
    """Return the text of the file."""
    (fx, fy), (cx, cy), (width, height) = camera.focal_px, camera.centre_px, camera.image_size
    return (
        "%YAML:1.0\n---\n"
        f"image_width: {width}\nimage_height: {height}\nfisheye_model: 1\n"
        + opencv_matrix("camera_matrix", 3, 3, [fx, camera.skew_px, cx, 0, fy, cy, 0, 0, 1])
        + opencv_matrix("distortion_coefficients", 4, 1, [camera.k1, camera.k2, camera.k3, camera.k4])
    )


def fisheye_model(table: Node) -> bool | None:
    """Return the entry ``fisheye_model`` of OpenCV's calibration sample; None if missing."""
    if "fisheye_model" not in table:
        return None
    return str(table["fisheye_model"].value).lower() not in ("0", "false", "0.0", "0.")


def recognises(file: CameraFile) -> bool:
    """Check for a camera matrix with four coefficients, unless another model is declared."""
    if not is_matrix_with_coefficients(file):
        return False
    said = fisheye_model(file.entries)
    return count_of(file) == 4 if said is None else said


def count_of(file: CameraFile) -> int:
    """Return the number of distortion coefficients; 0 if they are not a list."""
    numbers = file.entries["distortion_coefficients"].flat().value
    return len(numbers) if isinstance(numbers, list) else 0


def is_matrix_with_coefficients(file: CameraFile) -> bool:
    """Check for a camera matrix and coefficients without entries specific to ROS or omnidir."""
    has_both = file.has("camera_matrix", "distortion_coefficients")
    return has_both and not (file.has("xi") or file.has("distortion_model"))


FORMAT = CameraFormat(
    "OpenCV fisheye FileStorage: k1, k2, k3, k4",
    recognises,
    read,
    {"opencv-fisheye": Layout(KannalaBrandt, write, "Kannala and Brandt's polynomial", PLACES, BEHIND_DEG)},
)
