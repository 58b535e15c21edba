"""Reading and writing of image files with unchanged bit depth and channels.

Colours are RGB or RGBA in Python, independent of the order in the file; OpenCV's BGR is converted
at each call. The size in memory is computed from the header before an image is decoded.
"""

from __future__ import annotations

import io
import re
import struct
import tempfile
import warnings
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..base.arguments import file_name, instance
from ..base.errors import MediaError, OmnimirrorError
from ..base.files import atomic_output, read_bytes
from . import exr, image_metadata
from ._panorama import GPano
from .image_metadata import (
    METADATA_WRITERS,
    UPRIGHT,
    embed_metadata,
    oriented,
    read_metadata,
    without_orientation,
)
from .image_metadata import ImageMetadata as ImageMetadata

# -- PNG headers, checked before decompression ----------------------------------------------------

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_HEADER_END = 33  # signature, length, "IHDR", 13 bytes, checksum
PNG_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # samples per pixel, by colour type
MAX_DEFLATE_RATIO = 1032  # maximum compression ratio of deflate: 258 bytes by 2 bits


def _png_damage(data: bytes) -> str:
    """Describe the damage of a PNG header; "" if there is none.

    >>> _png_damage(PNG_SIGNATURE + bytes(25))
    'damaged PNG header'
    """
    header = data[12 : PNG_HEADER_END - 4]
    if (
        len(data) < PNG_HEADER_END
        or header[:4] != b"IHDR"
        or data[29:PNG_HEADER_END] != zlib.crc32(header).to_bytes(4, "big")
    ):
        return "damaged PNG header"
    width, height, depth, colour = struct.unpack(">IIBB", header[4:14])
    if width * height * depth * PNG_SAMPLES.get(colour, 1) > 8 * MAX_DEFLATE_RATIO * len(data):
        return f"{width} x {height} px in the PNG header exceed the capacity of {len(data)} bytes"
    return ""


def _png_bytes(data: bytes) -> int:
    """Return the size in memory of the image that the header declares; a palette is expanded to
    colours.
    """
    width, height, depth, colour = struct.unpack_from(">IIBB", data, 16)
    return int(
        width
        * height
        * (2 if depth == 16 else 1)
        * (4 if colour == 3 else PNG_SAMPLES.get(colour, 4))
    )


# -- Size of an image in memory, from the header of its file ---------------------------------------

MAX_DECODED_BYTES = 2 << 30
"""Maximum size of the pixels of an image in bytes; OpenCV rejects more than 2^30 pixels on its own.
"""
JPEG_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
RADIANCE_SIZE = re.compile(rb"\n[-+][XY] +(\d+) +[-+][XY] +(\d+)\n")
TIFF_BYTE_ORDERS = {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}
TAG_WIDTH, TAG_HEIGHT, TAG_BITS, TAG_COLOURS, TAG_SAMPLES = 256, 257, 258, 262, 277
TIFF_PALETTE = 3  # expanded to colours
TIFF_NUMBERS = {3: "H", 4: "I", 16: "Q"}
PILLOW_FORMATS = ("BMP", "GIF", "WEBP", "PPM", "JPEG2000", "AVIF")


def decoded_bytes(data: bytes) -> int:
    """Return the size in memory of the image in a file's bytes; 0 if the header is not understood.

    Parameters
    ----------
    data
        The whole file.

    Returns
    -------
    int
        Width times height times channels times bytes of a sample.

    Examples
    --------
    >>> import cv2, numpy as np
    >>> image = np.zeros((20, 30, 3), np.uint16)
    >>> [decoded_bytes(cv2.imencode(suffix, image)[1].tobytes()) for suffix in (".png", ".tif", ".ppm")]
    [3600, 3600, 3600]
    """
    try:
        if data.startswith(PNG_SIGNATURE):
            return _png_bytes(data)
        if data.startswith(b"\xff\xd8\xff"):
            return _jpeg_bytes(data)
        if data[:4] in TIFF_BYTE_ORDERS:
            return _tiff_bytes(data)
        if data.startswith(b"#?"):
            size = RADIANCE_SIZE.search(data[:65536])
            return int(size[1]) * int(size[2]) * 3 * 4 if size else 0
        if data.startswith(exr.MAGIC):
            return exr.decoded_bytes(data)
    except (struct.error, IndexError, ValueError, KeyError):
        return 0
    return _pillow_bytes(data)


def _jpeg_bytes(data: bytes) -> int:
    at = 2
    while data[at] == 0xFF:
        marker = data[at + 1]
        if marker in JPEG_FRAMES:
            depth, height, width, channels = struct.unpack_from(">BHHB", data, at + 4)
            return int(width * height * channels * -(-depth // 8))
        at += 1 if marker == 0xFF else 2 + struct.unpack_from(">H", data, at + 2)[0]
    return 0


def _tiff_bytes(data: bytes) -> int:
    """Read the first directory of a TIFF or BigTIFF file."""
    order, is_big = TIFF_BYTE_ORDERS[data[:4]], data[:4] in (b"II+\0", b"MM\0+")
    (at,) = struct.unpack_from(order + ("Q" if is_big else "I"), data, 8 if is_big else 4)
    (count,) = struct.unpack_from(order + ("Q" if is_big else "H"), data, at)
    size, head, inline = (20, 8, 8) if is_big else (12, 2, 4)
    tags: dict[int, tuple[int, ...]] = {}
    for i in range(min(count, 4096)):
        entry = at + head + size * i
        tag, kind, length = struct.unpack_from(order + ("HHQ" if is_big else "HHI"), data, entry)
        if (
            tag in (TAG_WIDTH, TAG_HEIGHT, TAG_BITS, TAG_COLOURS, TAG_SAMPLES)
            and kind in TIFF_NUMBERS
            and 1 <= length <= 64
        ):
            numbers = struct.Struct(f"{order}{length}{TIFF_NUMBERS[kind]}")
            offset = entry + size - inline
            if numbers.size > inline:
                (offset,) = struct.unpack_from(order + ("Q" if is_big else "I"), data, offset)
            tags[tag] = numbers.unpack_from(data, offset)
    depth = max(tags.get(TAG_BITS, (1,)))
    (channels,) = tags.get(TAG_SAMPLES, (1,))[:1]
    if tags.get(TAG_COLOURS) == (TIFF_PALETTE,):
        channels = 4
    return tags[TAG_WIDTH][0] * tags[TAG_HEIGHT][0] * channels * max(1, -(-depth // 8))


def _pillow_bytes(data: bytes) -> int:
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=PILLOW_FORMATS) as image:
                width, height = image.size
                is_palette, channels, kind = (
                    image.mode in ("P", "PA"),
                    len(image.getbands()),
                    image.format,
                )
    except Image.DecompressionBombError:
        return MAX_DECODED_BYTES + 1
    except Exception:  # damaged or of another type: the decoder reports the reason
        return 0
    is_deep = kind in ("PPM", "JPEG2000") and data[:2] not in (b"P1", b"P4")  # up to 16 bits
    return width * height * (4 if is_palette else channels) * (2 if is_deep else 1)


# -- Reading and writing ---------------------------------------------------------------------------

Image = NDArray[Any]


class ImageFormat(NamedTuple):
    """Capabilities of an image file format."""

    depths: tuple[str, ...]
    channels: tuple[int, ...]
    max_side_px: int = 1 << 20
    """Maximum width and height."""

    @property
    def has_alpha(self) -> bool:
        return 4 in self.channels


_JPEG = ImageFormat(("uint8",), (1, 3), 65_500)
_TIFF = ImageFormat(("uint8", "uint16", "float32"), (1, 3, 4))
FORMATS = {
    ".png": ImageFormat(("uint8", "uint16"), (1, 3, 4)),
    ".jpg": _JPEG,
    ".jpeg": _JPEG,
    ".tif": _TIFF,
    ".tiff": _TIFF,
    ".webp": ImageFormat(("uint8",), (3, 4), 16_383),
    ".bmp": ImageFormat(("uint8",), (1, 3)),
    ".hdr": ImageFormat(("float32",), (3,)),
    ".exr": ImageFormat(("float32",), (1, 3, 4)),
}
"""Formats that can be written, by suffix."""

MAX_HDR_VALUE = np.nextafter(np.float32(2.0**127), np.float32(0))
"""Maximum value of Radiance HDR: mantissa below 1 times 2^127."""
OPAQUE = {"uint8": 255, "uint16": 65535, "float32": 1.0}
"""Value of an opaque alpha channel, by data type."""

HEIC_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx")
"""Brands of ISO/IEC 23008-12 for HEVC-coded images, which OpenCV does not decode."""
RAW_SUFFIXES = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".rw2", ".raf", ".pef")
READABLE_FORMATS = (
    "PNG",
    "JPEG",
    "TIFF",
    "WebP",
    "AVIF",
    "JPEG 2000",
    "BMP",
    "GIF",
    "PPM",
    "HDR",
    "EXR",
)
"""Names of the formats that can be read."""
MAX_FILE_BYTES = 2 << 30
"""Maximum size of an image file in bytes."""


def format_of(path: str | Path) -> ImageFormat:
    """Return the format of a file from its suffix.

    >>> format_of("view.PNG").has_alpha, format_of("view.jpg").has_alpha
    (True, False)

    Raises
    ------
    MediaError
        If the format cannot be written, or requires a package that is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise MediaError(
            f"cannot write {path}: the suffix must be one of {', '.join(FORMATS)}; got {suffix!r}"
        )
    if suffix == ".exr":
        exr.check_exr_can_be_written(Path(path))
    return FORMATS[suffix]


def check_size(path: str | Path, size: tuple[int, int]) -> None:
    """Check that a format can store an image of a given (width, height).

    Raises
    ------
    MediaError
        If the image is too large, or the suffix cannot be written.
    """
    max_side = format_of(path).max_side_px
    if max(size) > max_side:
        raise MediaError(
            f"cannot write {path}: {Path(path).suffix} images must have at most {max_side} "
            f"px per side; got {size[0]} x {size[1]} px; use .png or .tif"
        )


def can_be_panorama(path: str | Path) -> bool:
    """Return whether the format can store panorama metadata.

    >>> can_be_panorama("view.jpg"), can_be_panorama("view.exr")
    (True, False)
    """
    return Path(path).suffix.lower() in image_metadata.XMP_WRITERS


def read_image_and_metadata(
    path: str | Path, *, stored_orientation: bool = False
) -> tuple[Image, ImageMetadata]:
    """Read an image file as :func:`read_image` does, with its metadata: colour profile, EXIF,
    orientation.
    """
    return decode_image_and_metadata(
        path, _data_of(Path(path)), stored_orientation=stored_orientation
    )


def decode_image_and_metadata(
    path: str | Path, data: bytes, *, stored_orientation: bool = False
) -> tuple[Image, ImageMetadata]:
    """Decode an image and its metadata from the bytes of a file; ``path`` names it in messages."""
    if not data:
        raise MediaError(f"cannot read the image {path}: the file is empty")
    metadata = read_metadata(data)
    if metadata.orientation == UPRIGHT:
        return _decoded(path, data), metadata
    image = _decoded(path, without_orientation(data))
    return image if stored_orientation else np.ascontiguousarray(
        oriented(image, metadata.orientation)
    ), metadata


def read_image(path: str | Path, *, stored_orientation: bool = False) -> Image:
    """Read an image file.

    The orientation in its EXIF data is applied, as ``cv2.imread`` and image viewers do.

    Parameters
    ----------
    path
        Name of the file.
    stored_orientation
        Return the pixels as they are stored, without the orientation applied: for a camera that was
        calibrated with stored pixels.

    Returns
    -------
    (h, w) or (h, w, 3) or (h, w, 4) array
        uint8, uint16 or float32 as in the file; channels in the order red, green, blue (alpha).

    Raises
    ------
    MediaError
        If the file does not exist, is unreadable or truncated, or is not an image.

    Examples
    --------
    >>> import numpy as np, omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_image(f"{folder}/red.png", np.full((2, 3, 3), (255, 0, 0), np.uint8))
    ...     om.read_image(f"{folder}/red.png")[0, 0]
    array([255,   0,   0], dtype=uint8)
    """
    return read_image_and_metadata(file_name("path", path), stored_orientation=stored_orientation)[
        0
    ]


def orientation_of(path: str | Path) -> int:
    """Return the orientation, 1 to 8, in an image file; 1 if there is none or the file cannot be
    read.
    """
    try:
        return read_metadata(_data_of(Path(path))).orientation
    except MediaError:
        return UPRIGHT


def _data_of(path: Path) -> bytes:
    try:
        data = read_bytes(path, MAX_FILE_BYTES)
    except FileNotFoundError:
        raise MediaError(f"cannot read the image {path}: the file does not exist") from None
    except OSError as e:
        raise MediaError(f"cannot read the image {path}: {e.strerror or e}") from None
    return data


def _decoded(path: str | Path, data: bytes) -> Image:
    if not data.startswith(exr.MAGIC):
        return decoded(path, data)
    _check_decoded_size(path, data)
    return exr.read_exr(Path(path), data)


def _check_decoded_size(path: str | Path, data: bytes) -> None:
    size = decoded_bytes(data)
    if size > MAX_DECODED_BYTES:
        raise MediaError(
            f"the image {path} must have at most {MAX_DECODED_BYTES >> 20} MB after "
            f"decoding; got {-(-size >> 20)} MB according to its header; reduce or split it"
        )


def decoded(path: str | Path, data: bytes) -> Image:
    """Decode an image from the bytes of a file, other than OpenEXR; ``path`` names it in messages.

    Raises
    ------
    MediaError
        If the data are truncated, damaged or not an image, or the pixels exceed
        :data:`MAX_DECODED_BYTES`.
    """
    if _is_truncated(data):
        raise MediaError(f"cannot read the image {path}: the file is truncated")
    if data.startswith(PNG_SIGNATURE) and (damage := _png_damage(data)):
        raise MediaError(f"cannot read the image {path}: {damage}")
    _check_decoded_size(path, data)
    try:
        with _quiet():
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as e:
        raise MediaError(f"cannot read the image {path}: {_reason(e)}") from None
    if image is None:
        raise MediaError(decoding_failure(path, data))
    if image.dtype.name not in OPAQUE:
        raise MediaError(
            f"the image {path} must have {', '.join(OPAQUE)} values; got {image.dtype.name}"
        )
    return _swap_red_blue(image)


def decoding_failure(path: str | Path, data: bytes) -> str:
    """Return the reason for a decoding failure, with a remedy for common formats."""
    if data[4:8] == b"ftyp" and any(brand in data[8:64] for brand in HEIC_BRANDS):
        return (
            f"cannot read the image {path}: HEIC is not supported; save it as JPEG (iPhone: "
            "Camera, Formats, Most Compatible)"
        )
    if Path(path).suffix.lower() in RAW_SUFFIXES:
        return (
            f"cannot read the image {path}: raw files are not supported; convert it to .tif or .png"
        )
    return f"cannot read the image {path}: it must be an undamaged image file ({', '.join(READABLE_FORMATS)})"


def write_image(
    path: str | Path,
    image: Image,
    *,
    panorama: GPano | None = None,
    metadata: ImageMetadata | None = None,
) -> None:
    """Write an image file atomically; an existing file is unchanged on errors.

    Parameters
    ----------
    path
        Path whose suffix selects the format, one of :data:`FORMATS`. PNG, TIFF, WebP and EXR are
        lossless, JPEG has quality 95. EXR requires the extra ``omnimirror[exr]``. HDR has no
        negative values and no NaN; they become 0.
    image : (h, w) or (h, w, 1) or (h, w, 3) or (h, w, 4) array
        uint8, uint16 or float32; channels in the order red, green, blue (alpha).
    panorama
        Part of the full sphere in the image, for viewers; supported by JPEG, PNG, WebP and TIFF.
    metadata
        Colour profile and EXIF from :func:`omnimirror.io.image_metadata.read_metadata`; supported
        by the same formats. ``metadata.supported_by`` returns what a file can hold.

    Raises
    ------
    MediaError
        If the suffix is unknown, the format does not support the image or the panorama metadata, or
        the file cannot be written.

    Examples
    --------
    >>> import numpy as np, omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_image(f"{folder}/red.png", np.full((2, 3, 3), (255, 0, 0), np.uint8))
    ...     om.read_image(f"{folder}/red.png")[0, 0]
    array([255,   0,   0], dtype=uint8)
    """
    path = file_name("path", path)
    instance("image", image, np.ndarray, "an array of pixels")
    if panorama is not None:
        instance("panorama", panorama, GPano, "a GPano")
    _check_writable(path, image, panorama, metadata)
    try:
        with atomic_output(path) as temporary:
            if temporary.suffix.lower() == ".exr":
                exr.write_exr(temporary, image)
            else:
                temporary.write_bytes(_encoded(Path(path), image, panorama, metadata))
    except MediaError:
        raise
    except OmnimirrorError as e:
        raise MediaError(str(e)) from None


def encode_image(
    path: str | Path,
    image: Image,
    *,
    panorama: GPano | None = None,
    metadata: ImageMetadata | None = None,
) -> bytes:
    """Return the bytes of the file that :func:`write_image` would write.

    >>> encode_image("view.png", np.zeros((4, 4), np.uint8))[:4]
    b'\\x89PNG'
    """
    path = Path(path)
    _check_writable(path, image, panorama, metadata)
    if path.suffix.lower() != ".exr":
        return _encoded(path, image, panorama, metadata)
    with tempfile.TemporaryDirectory(prefix="omnimirror-") as folder:
        file = Path(folder) / "image.exr"
        exr.write_exr(file, image)
        return read_bytes(file, MAX_FILE_BYTES)


def _check_writable(
    path: str | Path, image: Image, panorama: GPano | None, metadata: ImageMetadata | None
) -> None:
    """Raise MediaError unless the format of a file can store the image and its metadata."""
    kind = format_of(path)
    channels = image.shape[2] if image.ndim == 3 else 1
    if image.ndim not in (2, 3) or 0 in image.shape:
        raise MediaError(
            f"cannot write {path}: image must have the shape (h, w) or (h, w, c); got shape {image.shape}"
        )
    if image.dtype.name not in kind.depths or channels not in kind.channels:
        raise MediaError(
            f"cannot write {path}: {Path(path).suffix} images must be "
            f"{' or '.join(kind.depths)} with {' or '.join(map(str, kind.channels))} "
            f"channels; got {image.dtype.name} with {channels}"
        )
    check_size(path, (image.shape[1], image.shape[0]))
    if panorama is not None:
        _check_panorama(path, image, panorama)
    if metadata and Path(path).suffix.lower() not in METADATA_WRITERS:
        raise MediaError(
            f"cannot write {path}: a colour profile or EXIF requires {', '.join(METADATA_WRITERS)}"
        )


def _check_panorama(path: str | Path, image: Image, panorama: GPano) -> None:
    if not can_be_panorama(path):
        raise MediaError(
            f"cannot write {path}: panorama metadata requires {', '.join(image_metadata.XMP_WRITERS)}"
        )
    height, width = image.shape[:2]
    if panorama.cropped_size != (width, height):
        expected = " x ".join(map(str, panorama.cropped_size))
        raise MediaError(
            f"cannot write {path}: the image must have the size of panorama, {expected} px; got {width} x {height} px"
        )


def _encoded(
    path: Path, image: Image, panorama: GPano | None, metadata: ImageMetadata | None
) -> bytes:
    """Return the bytes of the file."""
    suffix = path.suffix.lower()
    if suffix == ".hdr":  # the encoder would wrap values outside the range of the format
        image = np.nan_to_num(image, nan=0.0).clip(0, MAX_HDR_VALUE)
    try:
        data = encoded(image, suffix)
    except cv2.error as e:
        raise MediaError(f"cannot write {path}: {_reason(e)}") from None
    if metadata:
        data = embed_metadata(suffix, data, metadata)
    return data if panorama is None else image_metadata.embed_xmp(suffix, data, panorama.xmp())


def encoded(image: Image, suffix: str, parameters: Sequence[int] = ()) -> bytes:
    """Encode a grey, RGB or RGBA image with OpenCV's encoder for ``suffix``."""
    with _quiet():
        is_encoded, buffer = cv2.imencode(
            suffix, _swap_red_blue(np.ascontiguousarray(image)), parameters
        )
    if not is_encoded:
        height, width = image.shape[:2]
        raise MediaError(f"cannot encode an image of {width} x {height} px as {suffix}")
    data: bytes = buffer.tobytes()
    return data


def _swap_red_blue(image: Image) -> Image:
    """Convert between RGB and BGR; an alpha channel stays last."""
    channels = image.shape[2] if image.ndim == 3 else 1
    if channels not in (3, 4):
        return image
    return np.asarray(
        cv2.cvtColor(image, cv2.COLOR_BGR2RGB if channels == 3 else cv2.COLOR_BGRA2RGBA)
    )


def _is_truncated(data: bytes) -> bool:
    """Return whether a JPEG or PNG has no end marker; decoders may fill the rest with grey without
    an error.
    """
    if data.startswith(PNG_SIGNATURE):
        return b"IEND\xaeB`\x82" not in data
    if data.startswith(b"\xff\xd8\xff"):
        return data.rfind(b"\xff\xd9") < _first_scan(data)  # thumbnails have end markers
    return False


def _first_scan(data: bytes) -> int:
    """Return the position of the first scan of a JPEG, after the header segments."""
    at = 2
    while data[at : at + 1] == b"\xff" and data[at + 1 : at + 2] != b"\xda":
        is_padding = data[at + 1 : at + 2] == b"\xff"
        at += 1 if is_padding else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return at


def _reason(e: cv2.error) -> str:
    """Return the reason of an OpenCV error: its first line without the source file."""
    return str(e.err or e).strip().split("\n")[0]


@dataclass
class _Silence:
    lock: Lock = field(default_factory=Lock)
    users: int = 0
    before: int = 0


_silence = _Silence()


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress messages of OpenCV, which are reported as exceptions; shared by all threads."""
    logging = cv2.utils.logging
    with _silence.lock:
        if _silence.users == 0:
            _silence.before = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
        _silence.users += 1
    try:
        yield
    finally:
        with _silence.lock:
            _silence.users -= 1
            if _silence.users == 0:
                logging.setLogLevel(_silence.before)


# -- JPEG coding parameters, quantisation tables and chroma subsampling (ITU-T T.81) ---------------

BLOCK = 8


class JpegCoding(NamedTuple):
    """Coding parameters of an image."""

    tables: tuple[NDArray[np.float64], ...]
    """Quantisation steps (8, 8) of Y, or of Y, Cb and Cr: by vertical and horizontal frequency."""
    subsampling: tuple[int, int] = (1, 1)
    """Chroma subsampling: luma pixels per chroma sample, vertically and horizontally."""


def read_jpeg_coding(path: str | Path) -> JpegCoding | None:
    """Read the coding of a file; None if it is not a JPEG file of grey or Y, Cb, Cr.

    Raises
    ------
    MediaError
        If the file does not exist, or cannot be read.
    """
    try:
        return parse_jpeg_coding(read_bytes(path, MAX_FILE_BYTES))
    except OSError as e:
        raise MediaError(f"cannot read the image {path}: {e.strerror or e}") from None


def parse_jpeg_coding(data: bytes) -> JpegCoding | None:
    """Read the coding of the bytes of a JPEG file; None for other files, and for colours other than
    grey or Y, Cb, Cr.

    >>> import cv2
    >>> data = cv2.imencode(".jpg", np.zeros((16, 16, 3), np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 50])[1].tobytes()
    >>> coding = parse_jpeg_coding(data)
    >>> coding.tables[0][0, :4], coding.subsampling
    (array([16., 11., 10., 16.]), (2, 2))
    """
    from PIL.JpegImagePlugin import JpegImageFile

    if not data.startswith(b"\xff\xd8\xff"):
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged EXIF data
            with JpegImageFile(io.BytesIO(data)) as image:
                tables_by_number, components = image.quantization, image.layer
    except (SyntaxError, ValueError, OSError):  # damaged
        return None
    names = bytes(name for name, *_ in components)
    numbers = [number for *_, number in components]
    if (
        len(components) not in (1, 3)
        or names == b"RGB"
        or any(number not in tables_by_number for number in numbers)
    ):
        return None
    tables = tuple(
        np.maximum(np.array(tables_by_number[number], float).reshape(BLOCK, BLOCK), 1.0)
        for number in numbers
    )
    (_, luma_x, luma_y, _), (_, chroma_x, chroma_y, _) = components[0], components[-1]
    across, down = luma_x / max(chroma_x, 1), luma_y / max(chroma_y, 1)
    if not (across in (1, 2, 4) and down in (1, 2, 4)):
        return None
    return JpegCoding(tables, (int(down), int(across)))
