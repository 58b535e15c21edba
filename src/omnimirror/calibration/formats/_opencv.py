"""OpenCV FileStorage YAML: omnidir (Mei's unified sphere), fisheye (Kannala-Brandt) and pinhole."""

from __future__ import annotations

from typing import Any

from ...base.errors import OmnimirrorError, SpecError
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

# -- omnidir (unified sphere) ----------------------------------------------------------------------
#
# OpenCV's sample ``omni_calibration`` does not write the image size; this module adds
# ``image_width`` and ``image_height``, named as in OpenCV's other samples. omnidir has no k3.

OMNIDIR_PARAMETERS = frozenset({"xi", "fx", "fy", "skew", "cx", "cy", "k1", "k2", "p1", "p2"})


def read_omnidir(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera of the file."""
    table = file.entries
    focal, centre, skew = camera_matrix(table["camera_matrix"])
    k1, k2, p1, p2 = table["distortion_coefficients"].row(4)
    xi = (
        table["xi"].row(1)[0]
        if isinstance(table["xi"].value, dict | list)
        else table["xi"].number()
    )
    size = image_size(table, reading)
    try:
        camera = Unified(
            xi=xi,
            focal_px=focal,
            centre_px=centre,
            image_size=size,
            skew_px=skew,
            k1=k1,
            k2=k2,
            p1=p1,
            p2=p2,
            **reading.model_arguments,
        )
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None
    return [CameraEntry("", camera)]


def camera_matrix(entry: Node) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Return focal lengths, centre and skew of a matrix ``[fx s cx; 0 fy cy; 0 0 1]``."""
    (fx, skew, cx), (zero, fy, cy), last = entry.matrix(3, 3).tolist()
    if zero != 0 or last != [0, 0, 1]:
        entry.fail("must be [fx, s, cx, 0, fy, cy, 0, 0, 1]")
    return (fx, fy), (cx, cy), skew


def image_size(table: Node, reading: ReadOptions) -> tuple[int, int]:
    """Return the image size from the file, otherwise the given size."""
    if "image_width" in table and "image_height" in table:
        return table["image_width"].integer(), table["image_height"].integer()
    return reading.size()


def opencv_matrix(name: str, rows: int, columns: int, numbers: list[float]) -> str:
    """Return a matrix in the format of OpenCV's FileStorage."""
    return (
        f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n"
        f"   data: [ {number_row(numbers)} ]\n"
    )


def write_omnidir(camera: Unified, name: str = "") -> str:
    """Return the text of the file."""
    (fx, fy), (cx, cy), (width, height) = camera.focal_px, camera.centre_px, camera.image_size
    return (
        "%YAML:1.0\n---\n"
        f"image_width: {width}\nimage_height: {height}\n"
        + opencv_matrix("camera_matrix", 3, 3, [fx, camera.skew_px, cx, 0, fy, cy, 0, 0, 1])
        + opencv_matrix(
            "distortion_coefficients", 1, 4, [camera.k1, camera.k2, camera.p1, camera.p2]
        )
        + f"xi: {number_row([camera.xi])}\n"
    )


def is_omnidir(file: CameraFile) -> bool:
    """Check for a camera matrix and xi."""
    return file.has("camera_matrix", "xi")


OMNIDIR = CameraFormat(
    "OpenCV omnidir FileStorage",
    is_omnidir,
    read_omnidir,
    {"opencv-omnidir": Layout(Unified, write_omnidir, "the unified sphere", OMNIDIR_PARAMETERS)},
)


# -- fisheye (Kannala-Brandt) ----------------------------------------------------------------------
#
# OpenCV's functions divide by Z first, which limits projection and undistortion to less than
# 90 deg from the axis, although the formula is valid beyond.

FISHEYE_PARAMETERS = frozenset({"fx", "fy", "skew", "cx", "cy", "k1", "k2", "k3", "k4"})
BEHIND_DEG = 90.0


def read_fisheye(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera of the file."""
    table = file.entries
    if "xi" in table:
        table["xi"].fail("belongs to the omnidir model; this file is read as fisheye")
    if fisheye_model(table) is False:
        table["fisheye_model"].fail("= 0 declares a pinhole camera; this file is read as fisheye")
    focal, centre, skew = camera_matrix(table["camera_matrix"])
    distortion = table["distortion_coefficients"]
    if len(distortion.flat().entries()) > 4:
        distortion.fail(
            "must have 4 numbers, k1 to k4, for a fisheye; got more, as for a pinhole camera"
        )
    ks = named_numbers(("k1", "k2", "k3", "k4"), distortion.row(4))
    try:
        camera = KannalaBrandt(
            focal_px=focal,
            centre_px=centre,
            image_size=image_size(table, reading),
            skew_px=skew,
            **ks,
            **reading.model_arguments,
        )
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None
    return [CameraEntry("", camera)]


def write_fisheye(camera: KannalaBrandt, name: str = "") -> str:
    """Return the text of the file."""
    (fx, fy), (cx, cy), (width, height) = camera.focal_px, camera.centre_px, camera.image_size
    return (
        "%YAML:1.0\n---\n"
        f"image_width: {width}\nimage_height: {height}\nfisheye_model: 1\n"
        + opencv_matrix("camera_matrix", 3, 3, [fx, camera.skew_px, cx, 0, fy, cy, 0, 0, 1])
        + opencv_matrix(
            "distortion_coefficients", 4, 1, [camera.k1, camera.k2, camera.k3, camera.k4]
        )
    )


FLAGS = dict.fromkeys(("0", "0.", "0.0", "false", "no", "off"), False) | dict.fromkeys(
    ("1", "1.", "1.0", "true", "yes", "on"), True
)
"""Booleans of FileStorage (integers), JSON and YAML 1.1."""


def fisheye_model(table: Node) -> bool | None:
    """Return the entry ``fisheye_model`` of OpenCV's calibration sample; None if missing."""
    if "fisheye_model" not in table:
        return None
    entry = table["fisheye_model"]
    flag = FLAGS.get(str(entry.value).lower())
    if flag is None:
        entry.fail("must be 0 for a pinhole camera or 1 for a fisheye")
    return flag


def is_fisheye(file: CameraFile) -> bool:
    """Check for a camera matrix with four coefficients, unless another model is declared."""
    if not is_matrix_with_coefficients(file):
        return False
    declared = fisheye_model(file.entries)
    return count_of(file) == 4 if declared is None else declared


def count_of(file: CameraFile) -> int:
    """Return the number of distortion coefficients; 0 if they are not a list."""
    numbers = file.entries["distortion_coefficients"].flat().value
    return len(numbers) if isinstance(numbers, list) else 0


def is_matrix_with_coefficients(file: CameraFile) -> bool:
    """Check for a camera matrix and coefficients without entries specific to ROS or omnidir."""
    has_both = file.has("camera_matrix", "distortion_coefficients")
    return has_both and not (file.has("xi") or file.has("distortion_model"))


FISHEYE = CameraFormat(
    "OpenCV fisheye FileStorage: k1, k2, k3, k4",
    is_fisheye,
    read_fisheye,
    {
        "opencv-fisheye": Layout(
            KannalaBrandt,
            write_fisheye,
            "Kannala and Brandt's polynomial",
            FISHEYE_PARAMETERS,
            BEHIND_DEG,
        )
    },
)


# -- Pinhole with distortion -----------------------------------------------------------------------
#
# Coefficients are k1, k2, p1, p2, k3, and k4, k5, k6 of the rational model. OpenCV ignores skew and
# projects less than 90 deg from the axis.

PINHOLE_MATRIX = frozenset({"fx", "fy", "cx", "cy"})
DISTORTION_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
DISTORTION_COUNTS = (4, 5, 8, 12, 14)


def read_pinhole(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera of the file."""
    table = file.entries
    for name in ("xi", "distortion_model"):
        if name in table:
            table[name].fail(
                "does not belong to a pinhole camera of OpenCV; this file is read as one"
            )
    if fisheye_model(table):
        table["fisheye_model"].fail("= 1 declares a fisheye; this file is read as a pinhole camera")
    focal, centre, skew = camera_matrix(table["camera_matrix"])
    k = distortion_numbers(table["distortion_coefficients"], *DISTORTION_COUNTS)
    model: Any = RationalPinhole if any(k[5:]) else Unified
    law = {} if model is RationalPinhole else {"xi": 0.0}
    numbers = named_numbers(
        DISTORTION_NAMES if model is RationalPinhole else DISTORTION_NAMES[:5], k
    )
    try:
        camera = model(
            focal_px=focal,
            centre_px=centre,
            image_size=image_size(table, reading),
            **law,
            **numbers,
            **reading.model_arguments,
        )
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None
    ignored = (f"the skew of {skew:g} px is ignored, as by OpenCV's functions",) if skew else ()
    return [CameraEntry("", camera, ignored)]


def distortion_numbers(entry: Node, *counts: int) -> tuple[float, ...]:
    """Return at most eight coefficients; those of thin prisms and tilted sensors must be 0."""
    k = entry.row(*counts)
    if any(k[8:]):
        entry.fail(
            "contains thin-prism or tilt terms, which are not supported; all after the eighth must be 0"
        )
    return k[:8]


def write_pinhole(camera: Any, name: str = "") -> str:
    """Return the text of the file, with five coefficients, or eight for the rational model."""
    (fx, fy), (cx, cy), (width, height) = camera.focal_px, camera.centre_px, camera.image_size
    k = [
        getattr(camera, n)
        for n in DISTORTION_NAMES[: 8 if isinstance(camera, RationalPinhole) else 5]
    ]
    return (
        "%YAML:1.0\n---\n"
        f"image_width: {width}\nimage_height: {height}\nfisheye_model: 0\n"
        + opencv_matrix("camera_matrix", 3, 3, [fx, 0, cx, 0, fy, cy, 0, 0, 1])
        + opencv_matrix("distortion_coefficients", len(k), 1, k)
    )


def is_pinhole(file: CameraFile) -> bool:
    """Check for a camera matrix with coefficients, unless another model is declared."""
    if not is_matrix_with_coefficients(file):
        return False
    flag = fisheye_model(file.entries)
    return count_of(file) in DISTORTION_COUNTS if flag is None else not flag


PINHOLE = CameraFormat(
    "OpenCV pinhole FileStorage: k1, k2, p1, p2, ...",
    is_pinhole,
    read_pinhole,
    {
        "opencv-pinhole": Layout(
            Unified,
            write_pinhole,
            "a pinhole camera",
            PINHOLE_MATRIX | {*DISTORTION_NAMES[:5]},
            90.0,
        ),
        "opencv-rational": Layout(
            RationalPinhole,
            write_pinhole,
            "a rational pinhole camera",
            PINHOLE_MATRIX | {*DISTORTION_NAMES},
            90.0,
        ),
    },
)
