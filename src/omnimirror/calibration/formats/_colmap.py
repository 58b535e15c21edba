"""COLMAP ``cameras.txt`` and ``cameras.bin``, with the centre of the first pixel at (0.5, 0.5)."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ...base.arguments import parse_float
from ...base.errors import OmnimirrorError, SpecError
from ...cameras.models import (
    EnhancedUnified,
    KannalaBrandt,
    RationalPinhole,
    ThinPrismFisheye,
    Unified,
)
from ...dewarp.views import sphere
from ._camera_format import (
    CameraEntry,
    CameraFile,
    CameraFormat,
    Content,
    Layout,
    ReadOptions,
    named_numbers,
    number_row,
)

HALF = 0.5  # px; offset of COLMAP's pixel centres
MATRIX = frozenset({"fx", "fy", "cx", "cy"})
KS = ("k1", "k2", "k3", "k4")
Numbers = tuple[float, ...]


class Model(NamedTuple):
    """Camera model of COLMAP."""

    number: int
    parameters: str
    model: Callable[..., Any] | None = None
    """Constructor of the corresponding camera model from named parameters; None if unsupported."""


def _pinhole(**named_numbers: Any) -> Any:
    return Unified(xi=0.0, **named_numbers)


KINDS = {
    "SIMPLE_PINHOLE": Model(0, "f cx cy", _pinhole),
    "PINHOLE": Model(1, "fx fy cx cy", _pinhole),
    "SIMPLE_RADIAL": Model(2, "f cx cy k1", _pinhole),
    "RADIAL": Model(3, "f cx cy k1 k2", _pinhole),
    "OPENCV": Model(4, "fx fy cx cy k1 k2 p1 p2", _pinhole),
    "OPENCV_FISHEYE": Model(5, "fx fy cx cy k1 k2 k3 k4", KannalaBrandt),
    "FULL_OPENCV": Model(6, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6", RationalPinhole),
    "FOV": Model(7, "fx fy cx cy omega"),
    "SIMPLE_RADIAL_FISHEYE": Model(8, "f cx cy k1", KannalaBrandt),
    "RADIAL_FISHEYE": Model(9, "f cx cy k1 k2", KannalaBrandt),
    "THIN_PRISM_FISHEYE": Model(10, "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"),
    "RAD_TAN_THIN_PRISM_FISHEYE": Model(
        11, "fx fy cx cy k1 k2 k3 k4 k5 k6 p2 p1 s1 s2 s3 s4", ThinPrismFisheye
    ),
    "SIMPLE_DIVISION": Model(12, "f cx cy k"),
    "DIVISION": Model(13, "fx fy cx cy k"),
    "SIMPLE_FISHEYE": Model(14, "f cx cy", KannalaBrandt),
    "FISHEYE": Model(15, "fx fy cx cy", KannalaBrandt),
    "EUCM": Model(16, "fx fy cx cy alpha beta", EnhancedUnified),
    "EQUIRECTANGULAR": Model(17, "w h"),
}
NAMES = {kind.number: name for name, kind in KINDS.items()}


# -- reading ----------------------------------------------------------------------------------


def read(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the cameras of the file with their ids."""
    cameras = _binary(file.data, file.source) if file.is_binary else _lines(file.text, reading)
    entries = [CameraEntry(str(line[0]), _camera(*line[1:], reading)) for line in cameras]
    if not entries:
        raise SpecError(
            f"{reading.source} must contain a camera, CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS; got none"
        )
    names = [entry.name for entry in entries]
    if repeated := [name for name in names if names.count(name) > 1]:
        raise SpecError(f"{reading.source}: the camera id {repeated[0]} must not occur twice")
    return entries


Line = tuple[int, str, tuple[int, int], Numbers, str]
"""Line of a camera: id, model, (width, height), parameters, and location in the file."""


def _lines(text: str, reading: ReadOptions) -> list[Line]:
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        location = f"{reading.source} line {number}"
        if len(words) < 4:
            raise SpecError(
                f"{location}: a camera must be CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS; got {words[0][:40]!r}"
            )
        _, name, *numbers = words
        try:
            identity = int(words[0])
            width, height, *parameters = (parse_float(word) for word in numbers)
        except ValueError:
            raise SpecError(
                f"{location}: the id, the size and the parameters of a camera must be numbers"
            ) from None
        if name not in KINDS:
            raise SpecError(
                f"{location}: the model must be one of {', '.join(KINDS)}; got {name[:40]!r}"
            )
        rows.append((identity, name, _size(width, height, location), tuple(parameters), location))
    return rows


def _size(width: float, height: float, location: str) -> tuple[int, int]:
    if not (
        0 < width < 2**31 and 0 < height < 2**31 and width == int(width) and height == int(height)
    ):
        raise SpecError(
            f"{location}: the image size must be positive integers; got {width:g} x {height:g}"
        )
    return int(width), int(height)


def _binary(data: bytes, source: str) -> list[Line]:
    rows: list[Line] = []
    try:
        (count,) = struct.unpack_from("<Q", data)
        offset = 8
        for i in range(min(count, len(data))):
            identity, model, width, height = struct.unpack_from("<IiQQ", data, offset)
            location = f"{source} camera {i + 1}"
            if model not in NAMES:
                raise SpecError(f"{location}: the model must be 0 to {max(NAMES)}; got {model}")
            n = len(KINDS[NAMES[model]].parameters.split())
            numbers = struct.unpack_from(f"<{n}d", data, offset + 24)
            offset += 24 + 8 * n
            rows.append((identity, NAMES[model], _size(width, height, location), numbers, location))
    except struct.error:
        raise SpecError(f"{source} ends in the middle of a camera") from None
    return rows


def _camera(
    name: str, size: tuple[int, int], numbers: Numbers, location: str, reading: ReadOptions
) -> Any:
    kind = KINDS[name]
    names = kind.parameters.split()
    if len(numbers) != len(names):
        raise SpecError(
            f"{location}: {name} must have {len(names)} parameters, {kind.parameters}; got {len(numbers)}"
        )
    if name == "EQUIRECTANGULAR":
        raise SpecError(
            f"{location}: EQUIRECTANGULAR describes a panorama, not the image of a camera"
        )
    if kind.model is None:
        supported = ", ".join(n for n, k in KINDS.items() if k.model)
        raise SpecError(
            f"{location}: {name} is not supported; the model must be one of {supported}"
        )
    values = named_numbers(names, numbers)
    f = values.pop("f", None)
    focal = (values.pop("fx"), values.pop("fy")) if f is None else (f, f)
    centre = (values.pop("cx") - HALF, values.pop("cy") - HALF)
    try:
        return kind.model(
            focal_px=focal, centre_px=centre, image_size=size, **values, **reading.model_arguments
        )
    except OmnimirrorError as problem:
        raise SpecError(f"{location}: {problem}") from None


# -- writing ----------------------------------------------------------------------------------


def values_of(camera: Any, name: str) -> Numbers:
    """Return the parameters of a camera in the order of one of COLMAP's models."""
    (fx, fy), (cx, cy) = camera.focal_px, camera.centre_px
    shifted = {"fx": fx, "fy": fy, "cx": cx + HALF, "cy": cy + HALF}
    return tuple(
        float(shifted[p] if p in shifted else getattr(camera, p))
        for p in KINDS[name].parameters.split()
    )


def text_file(size: tuple[int, int], name: str, numbers: Sequence[float]) -> str:
    """Return a ``cameras.txt`` with one camera."""
    return (
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, "
        f"HEIGHT, PARAMS[]\n# Number of cameras: 1\n1 {name} {size[0]} {size[1]} "
        f"{number_row(numbers, ' ')}\n"
    )


def binary_file(size: tuple[int, int], name: str, numbers: Sequence[float]) -> bytes:
    """Return a ``cameras.bin`` with one camera."""
    return struct.pack(f"<QIiQQ{len(numbers)}d", 1, 1, KINDS[name].number, *size, *numbers)


def _layout(
    kind: Any, model: str, description: str, extra: frozenset[str], is_binary: bool
) -> Layout:
    write_file = binary_file if is_binary else text_file

    def write(camera: Any, name: str = "") -> Content:
        return write_file(camera.image_size, model, values_of(camera, model))

    return Layout(
        kind, write, description, MATRIX | extra, 90.0, (".bin",) if is_binary else (".txt",)
    )


def recognises(file: CameraFile) -> bool:
    """Check for a binary file with a plausible number of cameras, or a line with a COLMAP model."""
    data = file.data
    if file.is_binary:
        count = int.from_bytes(data[:8], "little")
        return file.name.endswith(".bin") or 0 < count < len(data) / 32
    return (
        file.table is None
        and re.search(rb"^\s*\d+\s+(" + "|".join(KINDS).encode() + rb")\s+\d", data, re.M)
        is not None
    )


LAYOUTS = {
    "opencv-fisheye": (KannalaBrandt, "OPENCV_FISHEYE", frozenset(KS)),
    "eucm": (EnhancedUnified, "EUCM", frozenset({"alpha", "beta"})),
    "rad-tan-thin-prism-fisheye": (
        ThinPrismFisheye,
        "RAD_TAN_THIN_PRISM_FISHEYE",
        frozenset({*KS, "k5", "k6", "p1", "p2", "s1", "s2", "s3", "s4"}),
    ),
}


def _panorama(is_binary: bool) -> Layout:
    write_file = binary_file if is_binary else text_file

    def write(camera: Any, name: str = "") -> Content:
        size = sphere(camera).size
        return write_file(size, "EQUIRECTANGULAR", size)

    suffixes = (".bin",) if is_binary else (".txt",)
    return Layout(object, write, "EQUIRECTANGULAR", suffixes=suffixes, is_panorama=True)


FORMAT = CameraFormat(
    "COLMAP cameras",
    recognises,
    read,
    {
        f"colmap{'-bin' * is_binary}-{short}": _layout(kind, model, model, extra, is_binary)
        for is_binary in (False, True)
        for short, (kind, model, extra) in LAYOUTS.items()
    }
    | {
        f"colmap{'-bin' * is_binary}-equirectangular": _panorama(is_binary)
        for is_binary in (False, True)
    },
    ("cameras.txt", "cameras.bin"),
)
